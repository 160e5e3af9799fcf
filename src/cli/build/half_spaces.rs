//! `spinney build` of solids of half-spaces: the text of BSP trees and of extended octrees.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::import::mesh::ExactOptions;
use spinney::raw::import::mesh::{ExactReport, MeshArrays};
use spinney::raw::partitions::SolidText;
use spinney::{Output, Progress};

use super::exact::lines;
use super::rasters::RasterArgs;
use super::solids::SolidArgs;
use super::{Common, Lines};

/// A text that was read, and the options for its model.
pub(super) struct HalfSpaceImport {
    solid: SolidText,
    input: PathBuf,
    options: ExactOptions,
    description: Lines,
}

impl HalfSpaceImport {
    /// Whether a file has a BSP tree of space, or planes in a DF-expression. (A missing file may
    /// have them.)
    pub(super) fn is_one(input: &Path) -> bool {
        let is = |name: &str| input.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(name));
        (is("bsp") || is("df")) && (SolidText::is_in(input) || !input.exists())
    }

    /// Reads the text. It must be the only input.
    pub(super) fn plan(
        inputs: &[PathBuf],
        (rasters, solids, common): (&RasterArgs, &SolidArgs, &Common),
    ) -> Result<HalfSpaceImport> {
        let [input] = inputs else {
            bail!(
                "got {} inputs, expected one solid of half-spaces; `spinney combine` unites models",
                inputs.len()
            )
        };
        rasters.refuse(input)?;
        let name = input.display();
        if !solids.brep {
            bail!("{name}: is a solid of half-spaces, which needs --brep; make cells of the model then")
        }
        common.given.check("an exact model of half-spaces", &["--brep", "--unit", "--crs", "--codec"])?;
        let solid = SolidText::read(input, common.memory.bytes)?;
        let mut options = ExactOptions::new();
        options.snap = Some(solid.grid.width());
        options.unit = solids.unit.clone().or_else(|| solid.unit.clone());
        options.crs.clone_from(&common.crs);
        options.codec = common.packing.choice().codec;
        options.memory = common.memory.bytes;
        let nodes = solid.tree.nodes().len();
        let description = vec![("input", format!("{name}: half-spaces, a BSP tree of {nodes} nodes"))];
        Ok(HalfSpaceImport { solid, input: input.clone(), options, description })
    }

    pub(super) fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Builds the file. Returns lines about it.
    pub(super) fn build(self, output: Output, progress: &dyn Progress) -> Result<Lines> {
        let mut mesh = MeshArrays::default();
        mesh.name = self.input.display().to_string();
        for rings in self.solid.polygons(progress)? {
            for ring in &rings {
                mesh.corners.extend((mesh.vertices.len() as u32..).take(ring.len()));
                mesh.vertices.extend(ring);
                mesh.ring_ends.push(mesh.corners.len());
            }
            mesh.face_ends.push(mesh.ring_ends.len());
        }
        if mesh.vertices.is_empty() {
            bail!("{}: no half-space is inside, expected a solid", self.input.display());
        }
        let report: ExactReport =
            spinney::import::mesh::import_exact(vec![mesh.model()?], &self.options, output, progress)?;
        Ok(lines(&report, false))
    }
}
