//! Content of glTF that is not read, for warnings.

use super::super::model_file::ModelFile;
use super::document::Document;
use super::meshes::draco;
use spinney_base::{Error, Result};

/// Counts of what is left out.
#[derive(Clone, Debug, Default)]
pub(super) struct Losses {
    /// Primitives of points or lines.
    pub(super) lines: u64,
    /// Primitives without positions.
    pub(super) unplaced: u64,
    /// Primitives with morph targets.
    pub(super) targets: u64,
    /// Primitives with feature identifiers that are not objects.
    pub(super) features: u64,
    /// Columns of property tables of other types, or with a schema in another file.
    pub(super) columns: u64,
    /// Nodes and instances that are flat, with a scale of zero.
    pub(super) flat: u64,
    textures: u64,
    skins: u64,
    animations: u64,
    cameras: u64,
    scenes: u64,
}

impl Losses {
    pub(super) fn of(document: &Document<'_>) -> Losses {
        let [textures, skins, animations, cameras] =
            [&document.textures, &document.skins, &document.animations, &document.cameras]
                .map(|list| list.len() as u64);
        let scenes = document.scenes.len().saturating_sub(1) as u64;
        Losses { textures, skins, animations, cameras, scenes, ..Losses::default() }
    }

    /// Warning, if there are any.
    pub(super) fn remark(&self) -> Option<String> {
        let counts = [
            (self.lines, "primitive of points or lines", "primitives of points or lines"),
            (self.unplaced, "primitive without positions", "primitives without positions"),
            (self.flat, "node with a scale of 0", "nodes with a scale of 0"),
            (self.textures, "texture", "textures"),
            (self.skins, "skin", "skins"),
            (self.targets, "primitive's morph targets", "primitives' morph targets"),
            (self.features, "primitive's feature identifiers", "primitives' feature identifiers"),
            (self.columns, "column of a property table", "columns of property tables"),
            (self.animations, "animation", "animations"),
            (self.cameras, "camera", "cameras"),
            (self.scenes, "scene that is not the default", "scenes that are not the default"),
        ];
        let counts = counts.iter().filter(|(count, ..)| *count > 0);
        let items: Vec<String> = counts
            .map(|(count, one, many)| format!("{count} {}", if *count == 1 { one } else { many }))
            .collect();
        (!items.is_empty()).then(|| format!("left out: {}", items.join(", ")))
    }
}

/// Checks the extensions that a file declares to be required: others can be left out.
pub(super) fn check_required(source: &ModelFile, document: &Document<'_>) -> Result<()> {
    /// Extensions that are read, or that do not concern positions.
    const KNOWN: [&str; 7] = [
        "KHR_mesh_quantization",
        "EXT_meshopt_compression",
        "KHR_meshopt_compression",
        "EXT_mesh_gpu_instancing",
        "EXT_mesh_features",
        "EXT_structural_metadata",
        "EXT_instance_features",
    ];
    const APPEARANCES: [&str; 5] =
        ["KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "EXT_lights_"];
    for name in &document.extensions_required {
        if name == "KHR_draco_mesh_compression" {
            return Err(draco(source));
        }
        let is_appearance = APPEARANCES.iter().any(|start| name.starts_with(start));
        if !is_appearance && !KNOWN.contains(&name.as_str()) {
            let found =
                format!("glTF that requires the extension {}", name.chars().take(60).collect::<String>());
            let advice = "write the model without it, for example from Blender";
            return Err(Error::unsupported(source.path(), found, advice));
        }
    }
    Ok(())
}
