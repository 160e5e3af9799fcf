//! Colours of cells in images of solids.

use spinney_base::Result;
use spinney_base::value::{DataKind, Palette, Rule, SampleType};
use spinney_engine::dataset::Dataset;
use spinney_style::{CLAY, distinct, to_linear, viridis};

/// Map from values to colours: linear red, green and blue, 0 to 1.
pub(super) enum Paint {
    /// One colour for all cells.
    Clay([f64; 3]),
    /// The first three channels, where `most` is full intensity: linear for floating-point samples,
    /// sRGB otherwise.
    Channels { most: f64, is_linear: bool },
    /// Classes with a palette.
    Palette(Palette),
    /// Classes without a palette.
    Classes,
    /// Continuous values, from the minimum over a range.
    Range { least: f64, range: f64, colours: Vec<[u8; 4]> },
}

impl Paint {
    pub(super) fn of(tree: &Dataset) -> Result<Paint> {
        let header = tree.header();
        let value = header.form.value;
        if value.channels >= 3 {
            let most = match value.sample {
                SampleType::U8 => 255.0,
                SampleType::U16 => 65535.0,
                _ => 1.0,
            };
            return Ok(Paint::Channels { most, is_linear: value.sample.is_float() });
        }
        if header.rule == Rule::Occupancy {
            return Ok(Paint::clay());
        }
        if let Some(palette) = &tree.metadata().palette {
            return Ok(Paint::Palette(palette.clone()));
        }
        if header.kind == DataKind::Categorical {
            return Ok(Paint::Classes);
        }
        let bounds = tree.value_bounds()?;
        Ok(match bounds.first() {
            Some((least, most)) if least < most => {
                Paint::Range { least: *least, range: most - least, colours: viridis() }
            }
            _ => Paint::clay(),
        })
    }

    /// Colour of solids without values.
    pub(super) fn clay() -> Paint {
        Paint::Clay(linear(CLAY))
    }

    pub(super) fn colour(&self, value: &[f64; 4]) -> [f64; 3] {
        match self {
            Paint::Clay(colour) => *colour,
            Paint::Channels { most, is_linear } => [0, 1, 2].map(|channel| {
                let share = (value[channel] / most).clamp(0.0, 1.0);
                if *is_linear { share } else { to_linear(share) }
            }),
            Paint::Palette(palette) => match palette.colours.get(value[0].max(0.0) as usize) {
                Some([red, green, blue, _]) => linear([*red, *green, *blue]),
                None => linear(CLAY),
            },
            Paint::Classes => linear(distinct(value[0])),
            Paint::Range { least, range, colours } => {
                let last = colours.len().saturating_sub(1);
                let index = ((value[0] - least) / range * last as f64).round().clamp(0.0, last as f64);
                match colours.get(index as usize) {
                    Some([red, green, blue, _]) => linear([*red, *green, *blue]),
                    None => linear(CLAY),
                }
            }
        }
    }
}

/// Linear light of an 8-bit sRGB colour.
pub(super) fn linear(colour: [u8; 3]) -> [f64; 3] {
    colour.map(|sample| to_linear(f64::from(sample) / 255.0))
}
