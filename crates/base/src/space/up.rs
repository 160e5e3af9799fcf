//! The axis that points up.

use std::fmt;
use std::str::FromStr;

use crate::Error;
use serde::{Deserialize, Serialize};

/// Coordinate axis that points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Up {
    /// The second axis, as in many modelling programs; north is then along -z.
    Y,
    /// The third axis, as on maps; north is along y.
    #[default]
    Z,
}

impl Up {
    /// Rotates a point or direction with this up axis such that z points up.
    pub fn to_z_up(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Up::Y => [x, -z, y],
            Up::Z => [x, y, z],
        }
    }

    /// Inverse of [`Up::to_z_up`].
    pub fn from_z_up(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Up::Y => [x, z, -y],
            Up::Z => [x, y, z],
        }
    }
}

impl fmt::Display for Up {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Up::Y => "y",
            Up::Z => "z",
        })
    }
}

impl FromStr for Up {
    type Err = Error;

    fn from_str(name: &str) -> Result<Up, Error> {
        match name {
            "y" => Ok(Up::Y),
            "z" => Ok(Up::Z),
            _ => Err(Error::invalid("axis that points up", format!("`{name}`"), "y or z")),
        }
    }
}
