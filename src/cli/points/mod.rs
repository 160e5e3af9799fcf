//! Parts of subcommands that are about trees of points.

mod get;
mod info;
mod nearest;
mod stats;

use std::path::Path;

use anyhow::{Result, bail};
use spinney::Coordinates;
use spinney::import::feature::FeatureFilter;
use spinney::points::{PointRegion, PointTree};
use spinney::raw::points::{is_point_file, region_of_polygons};

use super::Global;
use super::args::PartOptions;
use super::report::Work;

pub(super) use get::get;
pub(super) use info::info;
pub(super) use nearest::nearest;
pub(super) use stats::stats;

/// The tree of points in a file; `None` if it has anything else.
pub(super) fn open(path: &Path, global: &Global) -> Result<Option<PointTree>> {
    if !is_point_file(path, global.access())? {
        return Ok(None);
    }
    Ok(Some(PointTree::open(path, &global.access().into())?))
}

/// Name of such files in messages.
pub(super) const KIND: &str = "a tree of points";

/// Where points are asked for, as options say it.
#[derive(clap::Args, Debug, Default)]
pub(crate) struct PointPlaces {
    /// Place in which points are asked for, of trees of points: the polygons of a file of features, which are brought to the
    /// tree's coordinate system from that of their file
    #[arg(long, value_name = "FEATURES", conflicts_with_all = ["window", "ball"])]
    within: Option<std::path::PathBuf>,
    /// Ball around X,Y,Z in which points are asked for, of trees of points: no farther away than R
    #[arg(long, value_name = "X,Y,Z,R", value_parser = parse_ball, conflicts_with = "window", allow_hyphen_values = true)]
    ball: Option<[f64; 4]>,
    /// Features alone for which all of this holds: points, of trees of points, as in 'classification=2,intensity>100'
    #[arg(long = "where", value_name = "CONDITION,...")]
    filter: Option<FeatureFilter>,
}

fn parse_ball(text: &str) -> Result<[f64; 4], String> {
    super::args::numbers(text)
        .filter(|[_, _, _, radius]: &[f64; 4]| *radius >= 0.0)
        .ok_or_else(|| "expected four numbers, a centre and a radius, as in 100,200,30,5".into())
}

impl PointPlaces {
    /// An option that was given, which makes no sense for other trees.
    pub(super) fn given(&self) -> Option<&'static str> {
        let given = [
            ("--within", self.within.is_some()),
            ("--ball", self.ball.is_some()),
            ("--where", self.filter.is_some()),
        ];
        given.into_iter().find(|(_, is_given)| *is_given).map(|(name, _)| name)
    }

    /// The selection that is meant.
    pub(super) fn selection(
        &self,
        tree: &PointTree,
        part: &PartOptions,
        level: Option<u8>,
        global: &Global,
    ) -> Result<spinney::points::Selection> {
        let is_world = matches!(part.coordinates().given(), None | Some(Coordinates::World));
        if !is_world {
            bail!("--in: of points places are given in their own coordinates (--in world)");
        }
        let region = match (&self.within, self.ball, part.corners()) {
            (Some(path), ..) => region_of_polygons(tree, path, &Work::start(global, "polygons")?)?,
            (None, Some([x, y, z, radius]), _) => PointRegion::Ball([x, y, z], radius),
            (None, None, Some(corners)) => PointRegion::Box(corners),
            (None, None, None) => PointRegion::All,
        };
        let conditions =
            self.filter.as_ref().map(|filter| filter.for_points(tree.attributes())).transpose()?;
        Ok(spinney::points::Selection { region, level, conditions: conditions.unwrap_or_default() })
    }
}
