//! Colours of categorical values.

use serde::{Deserialize, Serialize};

/// RGBA colours by value: entry `i` is the colour of value `i`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Palette {
    /// 8 bits each of red, green, blue and opacity; at most 65536 entries.
    pub colours: Vec<[u8; 4]>,
}
