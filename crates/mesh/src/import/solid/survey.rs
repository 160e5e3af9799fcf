//! Survey of a whole surface. With it, shards of the solid are built only from the triangles that
//! reach into them.

use std::path::Path;

use super::build::SolidReport;
use super::inside::State;
use super::plan::{SolidImport, SolidOptions, plan_in};
use crate::import::Model;
use spinney_base::space::{Code, CodeRange};
use spinney_base::{Progress, Result};
use spinney_container::Header;
use spinney_engine::store::TreeWriter;

/// Survey of a whole surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SolidSurvey {
    /// Bounding box of the faces: minimum and maximum coordinates.
    pub bounds: [[f64; 3]; 2],
    /// Whether the surface is divided into surfaces with their own inside tests, which requires all
    /// of it in memory.
    pub is_divided: bool,
    /// Nodes of the tree in the order of their codes, covering its whole space. Nodes without
    /// triangles whose first point is outside may be left out.
    pub nodes: Vec<SurveyedNode>,
}

/// Node of the tree at the surveyed level, or above it if no triangle reaches into the node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SurveyedNode {
    /// Code of the node.
    pub code: Code,
    /// Number of triangles that reach into the node.
    pub triangles: u64,
    /// Surfaces that enclose its first point.
    pub inside: Vec<SurfaceAtPoint>,
}

/// Surface at a point that it encloses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfaceAtPoint {
    /// Index of the surface.
    pub surface: u32,
    /// Winding number at the point; 1 for surfaces of inconsistent orientation.
    pub winding: i32,
    /// Attribute of the face through which the solid was last entered.
    pub attribute: u32,
}

/// Plans the build of a shard of the models' tree, based on the survey of the whole tree by
/// [`SolidImport::survey`]. The shard's run is the one that a file requests when it is
/// [written](SolidImport::write).
///
/// # Errors
/// Those of [`plan_models`](super::plan_models), except that faces are not read.
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
    /// Declares the tree as the next layer of a head file, which stores no cells of it, and surveys
    /// the whole surface for its shards. `level` chooses the level of the surveyed nodes from the
    /// tree's header. Faces are read once, as in a build. The returned report has no number of
    /// cells.
    ///
    /// # Errors
    /// Those of [`SolidImport::build`]; also if the surface is open, since all of it then decides
    /// what is inside anywhere.
    pub fn survey(
        mut self,
        file: &mut TreeWriter,
        level: &dyn Fn(&Header) -> u8,
        directory: &Path,
        progress: &dyn Progress,
    ) -> Result<(SolidSurvey, SolidReport)> {
        let mut read = self.read(&|_| true, directory, progress)?;
        let decided = self.inside(&mut read, true, progress)?;
        let report = self.report(&read, &decided);
        let (form, options) = self.tree(&report);
        file.write_layer_header(form, self.extent, &options)?;
        let level = level(&options.header(form, self.extent)?);
        let solid = self.solid(form, decided.surfaces, None, progress)?;
        let (bounds, is_divided) = (self.bounds, decided.is_divided);
        Ok((SolidSurvey { bounds, is_divided, nodes: solid.nodes(level)? }, report))
    }
}

impl SolidSurvey {
    /// State of a surface at the first point of a node at or above the surveyed level.
    pub(super) fn state(&self, node: Code, surface: usize, outside: State) -> State {
        let ends = |node: Code| CodeRange::of(node, node).map_or([u64::MAX, 0], CodeRange::ends);
        let [first, _] = ends(node);
        let count = self.nodes.partition_point(|other| ends(other.code)[0] <= first);
        let surveyed = count.checked_sub(1).map(|number| &self.nodes[number]);
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
