//! Exact models in Spinney files as models for import.

use std::path::Path;

use super::{MeshFace, Model, ModelInfo};
use spinney_base::io::FileAccess;
use spinney_base::{Error, Result};
use spinney_brep::{Attributes, ExactModel, Faces, is_model_file};
use spinney_container::Tag;

/// Opens an exact model; returns `None` for other files. About `memory` bytes hold the attributes
/// of parts.
pub(super) fn open(path: &Path, memory: u64, access: &FileAccess) -> Result<Option<Box<dyn Model>>> {
    if !is_model_file(path, access)? {
        return Ok(None);
    }
    let model = ExactModel::open(path, &access.into())?;
    if model.is_unbounded() {
        let expected = "a bounded body; take the complement with `spinney combine not`";
        let found = format!("{}: a body that includes infinity", path.display());
        return Err(Error::invalid("model", found, expected));
    }
    let mut attributes = Attributes::within(memory.max(1 << 20));
    for part in 0..model.parts().len() as u32 {
        if let Some(text) = model.part_attributes(part)? {
            attributes.push_part(path, part, text)?;
        }
    }
    model.file_attributes()?.into_iter().try_for_each(|text| attributes.push_file(path, text))?;
    let frame = &model.metadata().frame;
    let most = [(1 << model.grid().bits) - 1; 3];
    let info = ModelInfo {
        path: path.to_path_buf(),
        format: "exact model".into(),
        faces: Some(model.len()),
        // (Bounds of the grid. Its minimum coordinates are the model's.)
        bounds: [model.grid().to_world([0; 3]), model.grid().to_world(most)],
        crs: frame.crs.clone(),
        unit: model.metadata().tag(Tag::Unit).map(String::from),
        step: Some(model.grid().width()),
        parts: model.parts().to_vec(),
        is_grouped: true,
        is_z_up: false,
        attributes,
        is_coloured: model.is_coloured()?,
        bytes: model.file_size(),
    };
    Ok(Some(Box::new(Exact { model, info })))
}

struct Exact {
    model: ExactModel,
    info: ModelInfo,
}

impl Model for Exact {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let grid = self.model.grid().clone();
        let mut points = Vec::new();
        let columns = self.model.value_columns()?;
        let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
        self.model.each_with_values(&columns, &mut |face, values| {
            points.clear();
            points.extend(face.points.iter().map(|point| grid.to_world(*point)));
            let (ring_ends, colours, part) = (face.ring_ends, face.colours, face.part);
            let values =
                columns.iter().zip(values).filter_map(|(name, json)| Some((*name, json.as_deref()?)));
            let values: Vec<(&str, &str)> = values.collect();
            each(&MeshFace { points: &points, ring_ends, colours, part, values: &values })
        })
    }
}
