//! Answers as JSON, as the program prints them and the server sends them: the same text for the same question.

mod json;
mod points;
mod zones;

pub use json::{cell_area, channels_as_json, class_as_json, class_name, printable_json};
pub use points::{OUTSIDE, PointLayers, PointReport, write_number};
pub use zones::ZoneReport;
