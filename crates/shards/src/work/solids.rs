//! Octrees of the solids that models enclose.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output};
use spinney_base::space::{Code, CodeRange, Dimension};
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_engine::store::TreeTarget;
use spinney_mesh::import::{
    Resolution, SolidOptions, SolidSurvey, SurfaceAtPoint, SurveyedNode, files_of, open_all_with,
    plan_models, plan_part,
};

use super::{Load, PlannedWork, ShardTask, Work, WorkPlan, check_is_local};
use crate::balance::level_of_cuts;
use crate::job::PlannedInput;

/// Maximum absolute winding number: far above that of real models, and safe from overflow.
const MAX_AROUND: u32 = 1 << 30;

/// Solid of some models.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Solid {
    options: SolidOptions,
    survey: Survey,
}

/// Properties of the entire surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Survey {
    /// Minimum and maximum coordinates.
    #[serde(with = "spinney_base::text_fields")]
    bounds: [[f64; 3]; 2],
    is_divided: bool,
    /// Nodes whose first point is inside of surfaces.
    inside: Vec<Node>,
}

/// Node: its code in hexadecimal digits; for each surface around its first point, the surface's
/// number, the winding number and the attribute.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Node(String, Vec<(u32, i32, u32)>);

impl Survey {
    fn of(survey: &SolidSurvey) -> Survey {
        let surface = |SurfaceAtPoint { surface, winding, attribute }: &SurfaceAtPoint| {
            (*surface, *winding, *attribute)
        };
        let inside = survey.nodes.iter().filter(|node| !node.inside.is_empty());
        let inside = inside.map(|node| {
            Node(format!("{:016x}", node.code.bits()), node.inside.iter().map(surface).collect())
        });
        Survey { bounds: survey.bounds, is_divided: survey.is_divided, inside: inside.collect() }
    }

    fn survey(&self) -> Result<SolidSurvey> {
        let [min, max] = self.bounds;
        if !(0..3).all(|axis| min[axis] <= max[axis] && (max[axis] - min[axis]).is_finite()) {
            return Err(Error::invalid("survey bounds", format!("{:?}", self.bounds), "a box"));
        }
        let surface = |(surface, winding, attribute): &(u32, i32, u32)| SurfaceAtPoint {
            surface: *surface,
            winding: *winding,
            attribute: *attribute,
        };
        let node = |Node(code, surfaces): &Node| {
            let bits = u64::from_str_radix(code, 16).ok();
            let code = bits.and_then(|bits| Code::from_bits(Dimension::Oct, bits))?;
            let is_sound = surfaces.iter().all(|(_, winding, _)| winding.unsigned_abs() <= MAX_AROUND);
            is_sound.then(|| SurveyedNode {
                code,
                triangles: 0,
                inside: surfaces.iter().map(surface).collect(),
            })
        };
        let nodes: Option<Vec<SurveyedNode>> = self.inside.iter().map(node).collect();
        let ends = |node: &SurveyedNode| CodeRange::of(node.code, node.code).map_or([0; 2], CodeRange::ends);
        let nodes = nodes.filter(|nodes| nodes.windows(2).all(|pair| ends(&pair[0])[1] < ends(&pair[1])[0]));
        let nodes = nodes
            .ok_or_else(|| Error::invalid("survey nodes", "invalid or unsorted codes", "ascending codes"))?;
        Ok(SolidSurvey { bounds: self.bounds, is_divided: self.is_divided, nodes })
    }
}

impl Solid {
    /// Work of an import before its surface is surveyed. Fails if the cells are those of another
    /// tree, which needs a single-process build.
    pub(super) fn of(inputs: &[PathBuf], options: &SolidOptions) -> Result<Solid> {
        if let Resolution::Like(..) = options.resolution {
            let path = inputs.first().cloned().unwrap_or_default();
            let advice = "build it in a single process, or set the same cell width with --cell";
            return Err(Error::unsupported(path, "a solid on the cells of another tree in shards", advice));
        }
        Ok(Solid { options: options.clone(), survey: Survey::default() })
    }
}

/// Copy of the options with another memory limit in bytes.
fn with_memory(options: &SolidOptions, memory: u64) -> SolidOptions {
    let mut options = options.clone();
    options.memory = memory;
    options
}

/// Writes the head file.
pub(super) fn write_head(
    (paths, inputs): (&[PathBuf], &[PlannedInput]),
    options: &SolidOptions,
    head: Output,
    progress: &dyn Progress,
) -> Result<WorkPlan> {
    let work = Solid::of(paths, options)?;
    let import = plan_models(open_all_with(paths, options.memory, head.access())?, options)?;
    let (mut description, depth) = (import.description().to_vec(), import.depth());
    let target = TreeTarget::Head(head);
    let temporary = target.temporary();
    let mut file = target.start((Dimension::Oct, depth), 1)?;
    let (survey, report) = import.survey(&mut file, &level_of_cuts, &temporary, progress)?;
    file.finish()?;
    description.push(("surface", report.inside.text().into()));
    let bytes = inputs.iter().fold(0u64, |sum, input| sum.saturating_add(input.bytes()));
    let all: u128 = survey.nodes.iter().map(|node| u128::from(node.triangles)).sum();
    let load = |node: &SurveyedNode| {
        let bytes = (u128::from(bytes) * u128::from(node.triangles) / all.max(1)) as u64;
        Load { layer: 0, cells: node.code.bounds(depth), bytes }
    };
    let loads = survey.nodes.iter().filter(|node| node.triangles > 0).map(load).collect();
    let work = PlannedWork::Solid(Box::new(Solid { survey: Survey::of(&survey), ..work }));
    Ok(WorkPlan { work, loads, ranges: None, description })
}

impl Work for Solid {
    fn files_of(&self, input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
        check_is_local(input)?;
        files_of(input, access)
    }

    fn check(&self, _: usize, _: &[Header]) -> Result<()> {
        self.survey.survey().map(|_| ())
    }

    fn build(&self, part: ShardTask, memory: u64, progress: &dyn Progress) -> Result<()> {
        let models = open_all_with(&part.paths(), memory, &part.shard.access)?;
        let import = plan_part(models, &with_memory(&self.options, memory), self.survey.survey()?)?;
        let directory = part.shard.temporary().to_path_buf();
        let mut file = part.target().start((Dimension::Oct, import.depth()), 1)?;
        import.write(&mut file, &directory, progress)?;
        file.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::space::{EdgeRule, Up};
    use spinney_crs::{Crs, Frame};
    use spinney_engine::store::Packing;
    use spinney_mesh::import::Attribute;

    #[test]
    fn solid_work_survives_serialization() {
        let mut options = SolidOptions::new();
        let again = |options: &SolidOptions| {
            let planned = Solid::of(&[], options).unwrap();
            let text = serde_json::to_string(&planned).unwrap();
            let read: Solid = serde_json::from_str(&text).unwrap();
            assert_eq!((read.options.memory, &read.survey), (0, &planned.survey));
            assert_eq!(with_memory(&read.options, options.memory), *options);
        };
        again(&options);
        options.resolution = Resolution::Cell(0.1 + 0.2);
        (options.edge, options.attribute, options.up) = (EdgeRule::Touch, Attribute::PartNumber, Up::Y);
        (options.shell, options.unit, options.crs) = (true, Some("mm".into()), Some(Crs::epsg(7415)));
        options.packing = Packing::packed();
        again(&options);
        options.resolution = Resolution::Depth(9);
        again(&options);
        options.resolution = Resolution::Like(Frame::identity(), 9);
        Solid::of(&[], &options).unwrap_err();
    }

    #[test]
    fn surveys_survive_serialization() {
        let root = Code::root(Dimension::Oct);
        let at = |surface, winding, attribute| SurfaceAtPoint { surface, winding, attribute };
        let nodes = vec![
            SurveyedNode {
                code: root.child(1),
                triangles: 0,
                inside: vec![at(0, -2, u32::MAX), at(7, 1, 3)],
            },
            SurveyedNode { code: root.child(2).child(5), triangles: 0, inside: vec![at(0, 1, 0)] },
        ];
        let bounds = [[-0.1, 1e-300, 3.0], [1.0 / 3.0, 1.0, 3.0]];
        let survey = SolidSurvey { bounds, is_divided: true, nodes };
        let mut planned = Survey::of(&survey);
        assert_eq!(planned.survey().unwrap(), survey);
        planned.inside[0].1[0].1 = i32::MIN;
        planned.survey().unwrap_err();
        planned.inside.swap(0, 1);
        planned.survey().unwrap_err();
    }
}
