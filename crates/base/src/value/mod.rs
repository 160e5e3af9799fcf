//! Values of cells: samples, run-time typed values, sums and statistics, and the rules for coarse
//! levels.

mod dispatch;
mod double;
mod erased;
mod majority;
mod missing;
mod native;
mod number;
mod palette;
mod rule;
mod sample;
mod square_sum;
mod sums;
mod triple;
mod value_type;
mod zone_stats;

pub use dispatch::with_native_type;
pub use double::DoubleDouble;
pub use erased::{MAX_VALUE_SIZE, with_sample_type};
pub use erased::{Numbers, Samples, Value};
pub use majority::break_tie;
pub use native::Native;
pub use number::Number;
pub use palette::Palette;
pub use rule::{DataKind, Rule};
pub use sample::Sample;
pub use square_sum::SquareSum;
pub use sums::Sums;
pub use triple::TripleDouble;
pub use value_type::{Mask, SampleType, ValueType};
pub use zone_stats::ZoneStats;
pub use zone_stats::{dominant, erase, native, representative};
