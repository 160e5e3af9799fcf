//! Query results as JSON, identical in the program's output and the server's responses.

mod commits;
mod json;
mod measure;
mod numbers;
mod points;
mod statistics;
mod zones;

pub use commits::commit_as_json;
pub use json::{class_name, printable_json};
pub use measure::{CellMeasure, measure_key, measure_name, world_unit};
pub use numbers::{JsonNumbers, class_as_json};
pub use points::{OUTSIDE, PointLayers, PointReport, write_number};
pub use statistics::{
    Bins, bins_as_json, bins_of, bins_with, channels_as_json, filled, integral, statistics_as_json,
    statistics_of, void_share,
};
pub use zones::{ZoneForm, ZoneReport};
