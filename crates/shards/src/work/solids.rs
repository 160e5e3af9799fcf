//! Octrees of the solids that models enclose.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::Output;
use spinney_base::space::{Code, CodeRun, Dimension};
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_crs::Crs;
use spinney_engine::store::{Packing, TreeTarget};
use spinney_mesh::import::{
    Resolution, SolidOptions, SolidSurvey, SurfaceAtPoint, SurveyedNode, files_of, open_all, plan_models,
    plan_part,
};

use super::packing::PlannedPacking;
use super::{Load, PartOfJob, PlannedWork, Told, Work, number};
use crate::balance::level_of_cuts;
use crate::job::PlannedInput;

/// The solid of some models. Numbers that are no whole ones are texts, so that every digit of them stays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Solid {
    resolution: Cells,
    edge: String,
    attribute: String,
    shell: bool,
    up: String,
    unit: Option<String>,
    crs: Option<Crs>,
    packing: PlannedPacking,
    survey: Survey,
}

/// Resolution of the cells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Cells {
    Along(u64),
    Width(String),
    Depth(u8),
}

/// Knowledge of the whole surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Survey {
    /// Least and greatest coordinates.
    bounds: Vec<String>,
    is_divided: bool,
    /// Nodes whose first point is inside of surfaces: their codes in hexadecimal digits, and of each surface its number, the winding number and the
    /// attribute.
    inside: Vec<(String, Vec<(u32, i32, u32)>)>,
}

impl Survey {
    fn of(survey: &SolidSurvey) -> Survey {
        let surface = |SurfaceAtPoint { surface, winding, attribute }: &SurfaceAtPoint| {
            (*surface, *winding, *attribute)
        };
        let inside = survey.nodes.iter().filter(|node| !node.inside.is_empty());
        let inside = inside
            .map(|node| (format!("{:016x}", node.code.bits()), node.inside.iter().map(surface).collect()));
        Survey {
            bounds: survey.bounds.as_flattened().iter().map(f64::to_string).collect(),
            is_divided: survey.is_divided,
            inside: inside.collect(),
        }
    }

    fn survey(&self) -> Result<SolidSurvey> {
        let bounds = self.bounds.iter().map(|text| number(text)).collect::<Result<Vec<f64>>>()?;
        let bounds = match bounds.as_chunks::<3>() {
            ([min, max], [])
                if (0..3).all(|axis| min[axis] <= max[axis] && (max[axis] - min[axis]).is_finite()) =>
            {
                [*min, *max]
            }
            _ => return Err(Error::invalid("bounds", format!("{:?}", self.bounds), "a box")),
        };
        let node = |(code, surfaces): &(String, Vec<(u32, i32, u32)>)| {
            let bits = u64::from_str_radix(code, 16).ok();
            let code = bits.and_then(|bits| Code::from_bits(Dimension::Oct, bits))?;
            let surface = |(surface, winding, attribute): &(u32, i32, u32)| SurfaceAtPoint {
                surface: *surface,
                winding: *winding,
                attribute: *attribute,
            };
            Some(SurveyedNode { code, triangles: 0, inside: surfaces.iter().map(surface).collect() })
        };
        let nodes: Option<Vec<SurveyedNode>> = self.inside.iter().map(node).collect();
        let ends = |node: &SurveyedNode| CodeRun::of(node.code, node.code).map_or([0; 2], CodeRun::ends);
        let nodes = nodes.filter(|nodes| nodes.windows(2).all(|pair| ends(&pair[0])[1] < ends(&pair[1])[0]));
        let nodes = nodes.ok_or_else(|| Error::invalid("nodes", "ones out of order", "codes that ascend"))?;
        Ok(SolidSurvey { bounds, is_divided: self.is_divided, nodes })
    }
}

impl Solid {
    /// The work of an import before its surface is known. Cells that are laid over another tree are left to one build.
    pub(super) fn of(inputs: &[PathBuf], options: &SolidOptions) -> Result<Solid> {
        let resolution = match &options.resolution {
            Resolution::Cells(cells) => Cells::Along(*cells),
            Resolution::Cell(width) => Cells::Width(width.to_string()),
            Resolution::Depth(depth) => Cells::Depth(*depth),
            Resolution::Like(..) => {
                let path = inputs.first().cloned().unwrap_or_default();
                let advice = "build it in one go, or choose cells of the same width (--cell)";
                return Err(Error::unsupported(path, "a solid on another tree's cells in shards", advice));
            }
        };
        Ok(Solid {
            resolution,
            edge: options.edge.to_string(),
            attribute: options.attribute.name().into(),
            shell: options.shell,
            up: options.up.to_string(),
            unit: options.unit.clone(),
            crs: options.crs.clone(),
            packing: PlannedPacking::of(options.packing),
            survey: Survey::default(),
        })
    }

    /// The options, with so many bytes of memory.
    fn options(&self, memory: u64) -> Result<SolidOptions> {
        let mut options = SolidOptions::new();
        options.resolution = match &self.resolution {
            Cells::Along(cells) => Resolution::Cells(*cells),
            Cells::Width(width) => Resolution::Cell(number(width)?),
            Cells::Depth(depth) => Resolution::Depth(*depth),
        };
        (options.edge, options.attribute) = (self.edge.parse()?, self.attribute.parse()?);
        (options.shell, options.up) = (self.shell, self.up.parse()?);
        (options.unit, options.crs) = (self.unit.clone(), self.crs.clone());
        (options.packing, options.memory) = (self.packing.packing()?, memory);
        Ok(options)
    }
}

/// Writes a file that tells of the layer.
pub(super) fn write_head(
    (paths, inputs): (&[PathBuf], &[PlannedInput]),
    options: &SolidOptions,
    head: Output,
    progress: &dyn Progress,
) -> Result<Told> {
    let work = Solid::of(paths, options)?;
    let import = plan_models(open_all(paths, options.memory)?, options)?;
    let (mut description, depth) = (import.description().to_vec(), import.depth());
    let target = TreeTarget::Head(head);
    let beside = target.temporary();
    let mut file = target.start((Dimension::Oct, depth), 1)?;
    let (survey, report) = import.survey(&mut file, &level_of_cuts, &beside, progress)?;
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
    Ok(Told { work, loads, description })
}

impl Work for Solid {
    fn files_of(&self, input: &Path) -> Result<Vec<PathBuf>> {
        files_of(input)
    }

    fn packing(&self) -> Result<Packing> {
        self.packing.packing()
    }

    fn check(&self, _: usize, _: &[Header]) -> Result<()> {
        self.options(0)?;
        self.survey.survey().map(|_| ())
    }

    fn build(&self, part: PartOfJob, memory: u64, progress: &dyn Progress) -> Result<()> {
        let models = open_all(&part.paths(), memory)?;
        let import = plan_part(models, &self.options(memory)?, self.survey.survey()?)?;
        let folder = part.shard.temporary().to_path_buf();
        let mut file = part.target().start((Dimension::Oct, import.depth()), 1)?;
        import.write(&mut file, &folder, progress)?;
        file.finish()
    }
}
