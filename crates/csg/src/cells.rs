//! Octrees of CSG solids.

use crate::bounded_solid::BoundedSolid;
use crate::field::Field;
use crate::model::Csg;
use crate::source::CsgTree;
use spinney_base::io::Output;
use spinney_base::space::{EdgeRule, Up};
use spinney_base::{Error, Progress, Result};
use spinney_container::Tag;
use spinney_engine::store::build_with;
use spinney_mesh::import::{Attribute, FittedCells, SolidOptions, fit_cells};

/// Ratio of the width of cells to the distance of facets from the patches that they approximate.
const PATCH_SHARE: f64 = 16.0;

/// A solid and its planned cells, ready to be built: see [`CsgImport::build`].
pub struct CsgImport {
    csg: Csg,
    bounded: BoundedSolid,
    cells: FittedCells,
    options: SolidOptions,
    description: Vec<(&'static str, String)>,
}

impl CsgImport {
    /// Plans the octree of a solid. A cell is full if its centre is inside. With [`EdgeRule::Area`]
    /// its value is the share of 8 x 8 x 8 samples that are inside. An infinite solid is clipped to
    /// its bounds, or to the box around its finite primitives.
    ///
    /// ```
    /// use spinney::raw::csg::{Csg, CsgImport};
    /// use spinney::import::mesh::{Resolution, SolidOptions};
    /// use spinney::Output;
    ///
    /// # let directory = tempfile::tempdir().unwrap();
    /// # let path = directory.path().join("dented.goblin");
    /// let csg = Csg::parse("dented".as_ref(), "difference(block(0,0,0, 2,2,2), ball(1,1,2, 0.5))")?;
    /// let mut options = SolidOptions::new();
    /// options.resolution = Resolution::Cells(64);
    /// let cells = CsgImport::plan(csg, &options)?.build(Output::create(&path)?, &())?;
    /// let volume = cells as f64 * (2.0f64 / 64.0).powi(3);
    /// assert!((volume - (8.0 - std::f64::consts::PI / 12.0)).abs() < 0.01);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the options are not supported: CSG solids have no colours and parts, no shell, no other
    /// up axis and no touched cells; if the solid is infinite and nothing bounds it.
    pub fn plan(csg: Csg, options: &SolidOptions) -> Result<CsgImport> {
        if options.attribute != Attribute::Occupancy || options.shell || options.up != Up::Z {
            let found = "building CSG primitives with colours, parts, a shell or another up axis";
            let advice = "omit --attribute, --shell and --up; rotate(1,0,0, 90, a) in the text turns y to z";
            return Err(Error::unsupported(&csg.path, found, advice));
        }
        if options.edge == EdgeRule::Touch {
            return Err(Error::invalid(
                "edge",
                "touch",
                "centre or area: the surface of CSG primitives is not known",
            ));
        }
        let mut bounded = csg.bounded()?;
        let cells = fit_cells(bounded.bounds, options)?;
        // (A cell in which facets and patches differ has its centre within this distance of both.)
        bounded.facet_patches(cells.frame.linear().col(0).length() / PATCH_SHARE)?;
        let mut options = options.clone();
        options.unit = options.unit.or_else(|| csg.unit().map(String::from));
        let description = describe(&csg, &bounded, &cells, &options);
        Ok(CsgImport { csg, bounded, cells, options, description })
    }

    /// Returns a description of the plan: pairs of a heading and its text.
    pub fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Returns the source of the octree.
    fn tree<'a>(&self, progress: &'a dyn Progress) -> CsgTree<'a> {
        let depth = self.cells.depth;
        CsgTree {
            field: Field::new(&self.bounded, &self.cells.frame.matrix, f64::from(1u32 << depth)),
            instructions: self.bounded.lowered.instructions.clone(),
            depth,
            by_area: self.options.edge == EdgeRule::Area,
            progress,
        }
    }

    /// Builds the octree on the threads of the current rayon pool. Progress counts cells. Returns
    /// the number of cells that are not VOID.
    ///
    /// # Errors
    /// If the output cannot be written, or on cancellation. No output file is left then.
    pub fn build(self, output: Output, progress: &dyn Progress) -> Result<u64> {
        let CsgImport { csg, cells, options, .. } = &self;
        let provenance = format!("primitives {}", csg.path.display());
        let build = cells.build_options(options, provenance, &[(Tag::Csg, csg.text())]);
        let tree = self.tree(progress);
        Ok(build_with(&tree, cells.extent, &build, output.into(), progress, &mut |_| {})?.cells)
    }
}

fn describe(
    csg: &Csg,
    bounded: &BoundedSolid,
    cells: &FittedCells,
    options: &SolidOptions,
) -> Vec<(&'static str, String)> {
    let mut lines = vec![("input", format!("{} ({})", csg.path.display(), csg.counted()))];
    lines.extend(bounded.ends.as_ref().map(|ends| ("ends", ends.clone())));
    let shells = bounded.shells();
    lines.extend(shells.map(|(name, patches, volume)| {
        ("volume", format!("{volume} in {name} ({patches} patches), by the integral of their polynomials"))
    }));
    let [x, y, z] = cells.extent;
    let width = cells.frame.linear().col(0).length();
    let unit = options.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
    lines.push((
        "cells",
        format!("{x} x {y} x {z} in a tree of depth {}, each {width}{unit} wide", cells.depth),
    ));
    let edge = match options.edge {
        EdgeRule::Area => "the share of each cell that is inside, by 8 x 8 x 8 samples",
        _ => "cells whose centre is inside",
    };
    lines.push(("fill", format!("the solid: {edge}")));
    lines
}
