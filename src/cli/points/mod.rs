//! The subcommands for trees of points.

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

/// Opens the tree of points in a file; `None` if the file has anything else.
pub(super) fn open(path: &Path, global: &Global) -> Result<Option<PointTree>> {
    if !is_point_file(path, global.access())? {
        return Ok(None);
    }
    Ok(Some(PointTree::open(path, &global.access().into())?))
}

/// Name of trees of points in messages.
pub(super) const KIND: &str = "a tree of points";

/// Options that select points of a tree of points.
#[derive(clap::Args, Debug, Default)]
pub(crate) struct PointSelection {
    /// Region in which to select points of trees of points: the polygons of a feature file,
    /// reprojected to the tree's coordinate system
    #[arg(long, value_name = "FEATURES", conflicts_with_all = ["window", "ball"])]
    within: Option<std::path::PathBuf>,
    /// Ball in trees of points: points within the distance R of X,Y,Z
    #[arg(long, value_name = "X,Y,Z,R", value_parser = parse_ball, conflicts_with = "window", allow_hyphen_values = true)]
    ball: Option<[f64; 4]>,
    /// Only features for which all conditions hold: points of trees of points, as in
    /// 'classification=2,intensity>100'
    #[arg(long = "where", value_name = "CONDITION,...")]
    filter: Option<FeatureFilter>,
}

fn parse_ball(text: &str) -> Result<[f64; 4], String> {
    super::args::numbers(text)
        .filter(|[_, _, _, radius]: &[f64; 4]| *radius >= 0.0)
        .ok_or_else(|| "expected 4 numbers, X,Y,Z and a radius, such as 100,200,30,5".into())
}

impl PointSelection {
    /// Returns the first given option for points, which other trees reject.
    pub(super) fn given(&self) -> Option<&'static str> {
        let given = [
            ("--within", self.within.is_some()),
            ("--ball", self.ball.is_some()),
            ("--where", self.filter.is_some()),
        ];
        given.into_iter().find(|(_, is_given)| *is_given).map(|(name, _)| name)
    }

    /// Returns the selection.
    pub(super) fn selection(
        &self,
        tree: &PointTree,
        part: &PartOptions,
        level: Option<u8>,
        global: &Global,
    ) -> Result<spinney::points::Selection> {
        let is_world = matches!(part.coordinates().given(), None | Some(Coordinates::World));
        if !is_world {
            bail!("--in: expected world: positions in trees of points are in their own coordinates");
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
