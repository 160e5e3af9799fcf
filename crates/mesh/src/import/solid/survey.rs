//! Knowledge of a whole surface, by which parts of its solid are built from the triangles that reach into them alone.

use std::path::Path;

use super::build::SolidReport;
use super::inside::State;
use super::plan::{SolidImport, SolidOptions, plan_in};
use crate::import::Model;
use spinney_base::space::{Code, CodeRun};
use spinney_base::{Progress, Result};
use spinney_container::Header;
use spinney_engine::store::TreeWriter;

/// Knowledge of a whole surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SolidSurvey {
    /// The box around the faces: the least coordinate along each axis, and the greatest.
    pub bounds: [[f64; 3]; 2],
    /// Whether the surface is divided into ones that are inside or outside for themselves: all of it has to be in memory for that.
    pub is_divided: bool,
    /// Nodes of the tree, which have all of its space, in the order of their codes. Those that no triangle reaches into, and whose first point is
    /// outside, may be left out.
    pub nodes: Vec<SurveyedNode>,
}

/// A node of the tree: one at the level that was asked for, or one above that which no triangle reaches into.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SurveyedNode {
    /// The node.
    pub code: Code,
    /// Triangles that reach into it.
    pub triangles: u64,
    /// Surfaces that its first point is inside of.
    pub inside: Vec<SurfaceAtPoint>,
}

/// A surface at a point inside of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfaceAtPoint {
    /// Number of the surface.
    pub surface: u32,
    /// How often it goes around the point; of faces that are turned either way, 1.
    pub winding: i32,
    /// Attribute of the face through which the solid was entered last.
    pub attribute: u32,
}

/// Plans how a part of the tree of some models is built, where [`SolidImport::survey`] has found out what there is to know of the whole; the part
/// is the one that a file asks for when it is [written](SolidImport::write).
///
/// # Errors
/// Those of [`plan_models`](super::plan_models), but that faces are not read.
pub fn plan_part(
    models: Vec<Box<dyn Model>>,
    options: &SolidOptions,
    survey: SolidSurvey,
) -> Result<SolidImport> {
    let mut import = plan_in(models, options, survey.bounds)?;
    import.survey = Some(survey);
    Ok(import)
}

impl SolidImport {
    /// Tells a file that has no cells, but for those of its layers, of the tree, and finds out what parts of it have to know of the whole surface, in nodes of a level that is chosen by the
    /// tree's header. Faces are read once, as for building; of the report that comes, too, cells are not known.
    ///
    /// # Errors
    /// Those of [`SolidImport::build`]; also if the surface is open: then all of it decides what is inside everywhere.
    pub fn survey(
        mut self,
        file: &mut TreeWriter,
        level: &dyn Fn(&Header) -> u8,
        beside: &Path,
        progress: &dyn Progress,
    ) -> Result<(SolidSurvey, SolidReport)> {
        let mut read = self.read(&|_| true, beside, progress)?;
        let decided = self.inside(&mut read, true, progress)?;
        let report = self.report(&read, &decided);
        let (form, options) = self.tree(&report);
        file.tell(form, self.extent, &options)?;
        let level = level(&options.header(form, self.extent)?);
        let solid = self.solid(form, decided.surfaces, None, progress)?;
        let (bounds, is_divided) = (self.bounds, decided.is_divided);
        Ok((SolidSurvey { bounds, is_divided, nodes: solid.nodes(level)? }, report))
    }
}

impl SolidSurvey {
    /// The state of a surface at the first point of a node, which is at a level that was surveyed or above it.
    pub(super) fn state(&self, node: Code, surface: usize, outside: State) -> State {
        let ends = |node: Code| CodeRun::of(node, node).map_or([u64::MAX, 0], CodeRun::ends);
        let [first, _] = ends(node);
        let behind = self.nodes.partition_point(|other| ends(other.code)[0] <= first);
        let surveyed = behind.checked_sub(1).map(|number| &self.nodes[number]);
        let surveyed = surveyed.filter(|other| first <= ends(other.code)[1]);
        let found =
            surveyed.and_then(|other| other.inside.iter().find(|found| found.surface as usize == surface));
        match found {
            Some(SurfaceAtPoint { winding, attribute, .. }) => {
                State { winding: *winding, attribute: *attribute, ..outside }
            }
            None => outside,
        }
    }
}
