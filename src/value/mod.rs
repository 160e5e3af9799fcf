//! Values: sample types, values of one or more samples, the rules that average them, palettes.

mod dispatch;
mod palette;
mod rule;
mod sample;
mod tally;

pub use palette::Palette;
pub use rule::{Kind, Rule};
pub use sample::{Sample, SampleType, Sum, Value, ValueType};
pub use tally::{Tally, representative};
pub(crate) use tally::{channelwise_max, channelwise_min, dominant, most_frequent};
