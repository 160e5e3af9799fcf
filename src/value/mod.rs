//! Values: sample types, values of one or more samples, the rules that average them, palettes.

mod palette;
mod rule;
mod sample;

pub use palette::Palette;
pub use rule::{Kind, Rule};
pub use sample::{Sample, SampleType, Sum, Value, ValueType};
