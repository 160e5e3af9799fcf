//! Planning and building octrees of reconstructed solids.

use std::path::Path;

use crate::source::{Solid, SolidTree};
use spinney_base::io::Output;
use spinney_base::space::{EdgeRule, Up};
use spinney_base::{Error, Progress, Result};
use spinney_crs::Crs;
use spinney_engine::store::build_with;
use spinney_mesh::import::{Attribute, FittedCells, SolidOptions};

/// A solid and its planned cells, ready to be built: see [`ReconstructionImport::build`].
pub struct ReconstructionImport {
    solid: Box<dyn Solid>,
    cells: FittedCells,
    options: SolidOptions,
    provenance: String,
    description: Vec<(&'static str, String)>,
}

/// Rejects options for surfaces, about which images and outlines contain no data.
pub(crate) fn check(path: &Path, options: &SolidOptions) -> Result<()> {
    if options.attribute != Attribute::Occupancy || options.shell || options.up != Up::Z {
        let found = "building from images or outlines with colours, parts, a shell or another up axis";
        return Err(Error::unsupported(path, found, "omit --attribute, --shell and --up"));
    }
    if options.edge != EdgeRule::Centre {
        let expected = "centre: images and outlines only decide for centres of cells";
        return Err(Error::invalid("edge", options.edge.name(), expected));
    }
    Ok(())
}

impl ReconstructionImport {
    /// Creates a plan for a solid that was read. `input_description` describes the input, and
    /// `provenance` is stored in the file.
    pub(crate) fn new(
        solid: Box<dyn Solid>,
        cells: FittedCells,
        mut options: SolidOptions,
        (crs, provenance, input_description): (Option<Crs>, String, Vec<(&'static str, String)>),
    ) -> ReconstructionImport {
        options.crs = options.crs.or(crs).or_else(|| cells.frame.crs.clone());
        let mut description = input_description;
        let [x, y, z] = cells.extent;
        let width = cells.frame.linear().col(0).length();
        let unit = options.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
        let text = format!("{x} x {y} x {z} in a tree of depth {}, each {width}{unit} wide", cells.depth);
        description.push(("cells", text));
        ReconstructionImport { solid, cells, options, provenance, description }
    }

    /// Returns a description of the plan: pairs of a heading and its text.
    pub fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Builds the octree on the threads of the current rayon pool. Progress counts cells. Returns
    /// the number of cells that are not VOID.
    ///
    /// # Errors
    /// If the output cannot be written, or on cancellation. No output file is left then.
    pub fn build(self, output: Output, progress: &dyn Progress) -> Result<u64> {
        let ReconstructionImport { solid, cells, options, provenance, .. } = self;
        let build = cells.build_options(&options, provenance, &[]);
        let tree = SolidTree { solid: &*solid, depth: cells.depth, progress };
        Ok(build_with(&tree, cells.extent, &build, output.into(), progress, &mut |_| {})?.cells)
    }
}
