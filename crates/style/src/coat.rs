//! A layer resolved for a tree: converts samples to colours, row by row.

use super::blend::{Blend, share};
use super::colour::distinct;
use super::layer::{Encoding, SlopeUnit};
use super::mask::Mask;
use super::relief::{Growth, Lamp, aspect, slope};
use super::scale::Scale;

/// A layer whose parameters are in sample values of the tree.
#[derive(Debug)]
pub(super) struct Coat {
    pub(super) band: usize,
    pub(super) ink: Ink,
    /// 0 to 255.
    pub(super) opacity: u8,
    pub(super) blend: Blend,
    pub(super) mask: Mask,
}

/// How a layer computes colours.
#[derive(Debug)]
pub(super) enum Ink {
    Classes(Classes),
    Scale(Scale),
    /// Three channels as RGB. `ends` are the values that become 0 and 255.
    Channels {
        bands: [usize; 3],
        ends: [[f64; 2]; 3],
    },
    Light {
        lamp: Lamp,
        height: f64,
    },
    Slope {
        unit: SlopeUnit,
        height: f64,
        scale: Scale,
    },
    Aspect(Scale),
    Contours(Lines),
    /// Terrain-RGB. Metres are sample values times `metres[0]`, plus `metres[1]`.
    Heights {
        encoding: Encoding,
        metres: [f64; 2],
    },
}

/// Colours of classes.
#[derive(Debug)]
pub(super) struct Classes {
    /// Colours of the values 0, 1, 2, ...
    pub(super) dense: Vec<[u8; 4]>,
    /// Colours of other values, in ascending order.
    pub(super) sparse: Vec<(f64, [u8; 4])>,
    /// Names of the `sparse` classes, if the style defines them.
    pub(super) names: Vec<String>,
    /// Colour of all other values; if `None`, each value gets a distinct colour.
    pub(super) other: Option<[u8; 4]>,
}

impl Classes {
    #[inline]
    pub(super) fn colour(&self, number: f64) -> [u8; 4] {
        let index = number as usize;
        if let Some(colour) = self.dense.get(index).filter(|_| index as f64 == number) {
            return *colour;
        }
        if let Ok(found) = self.sparse.binary_search_by(|class| class.0.total_cmp(&(number + 0.0))) {
            return self.sparse[found].1;
        }
        self.other.unwrap_or_else(|| {
            let [red, green, blue] = distinct(number);
            [red, green, blue, 255]
        })
    }
}

/// Parameters of contours, in sample values of the tree.
#[derive(Debug)]
pub(super) struct Lines {
    pub(super) interval: f64,
    pub(super) base: f64,
    pub(super) colour: [u8; 4],
    pub(super) width: f64,
    pub(super) bold: f64,
}

impl Lines {
    /// The colour of a cell, given its value and the gradient per cell.
    #[inline]
    fn colour(&self, number: f64, growth: f64) -> [u8; 4] {
        let place = (number - self.base) / self.interval;
        let line = place.round();
        // Distance to the contour line in cells, by a first-order approximation.
        let distance = (place - line).abs() * self.interval / growth;
        let is_bold = self.bold > 0.0 && line % self.bold == 0.0;
        let width = if is_bold { 2.0 * self.width } else { self.width };
        let cover = (width / 2.0 + 0.5 - distance).clamp(0.0, 1.0) * width.min(1.0);
        let [red, green, blue, alpha] = self.colour;
        // The cast maps NaN to 0: no line.
        [red, green, blue, (f64::from(alpha) * cover + 0.5) as u8]
    }
}

/// Input rows of a layer.
pub(super) struct Rows<'a> {
    /// The current row per channel, with neighbours at both ends if they are needed; NaN in VOID
    /// cells.
    pub(super) here: [&'a [f64]; 4],
    /// The rows above and below per channel, with neighbours, for layers that need them.
    pub(super) around: [[&'a [f64]; 2]; 4],
    /// Metres to the east and north from a cell to the next one in its row, and to the one below.
    pub(super) edges: [[f64; 2]; 2],
}

/// Reusable buffers.
#[derive(Default)]
pub(super) struct Scratch {
    growth: Growth,
    numbers: Vec<f64>,
}

impl Coat {
    /// Returns whether colours depend on neighbouring cells.
    pub(super) fn needs_neighbours(&self) -> bool {
        matches!(self.ink, Ink::Light { .. } | Ink::Slope { .. } | Ink::Aspect(_) | Ink::Contours(_))
    }

    /// Returns whether the layer reads a channel.
    pub(super) fn reads(&self, channel: usize) -> bool {
        match &self.ink {
            Ink::Channels { bands, .. } => bands.contains(&channel) || self.band == channel,
            _ => self.band == channel,
        }
    }

    /// Computes the colours of a row; transparent where cells are VOID or masked.
    pub(super) fn row(&self, rows: &Rows<'_>, scratch: &mut Scratch, out: &mut [[u8; 4]]) {
        let here = rows.here[self.band];
        let margin = (here.len() - out.len()) / 2;
        let values = &here[margin..margin + out.len()];
        let Scratch { growth, numbers } = scratch;
        if self.needs_neighbours() {
            let [above, below] = rows.around[self.band];
            growth.compute([above, here, below]);
        }
        match &self.ink {
            Ink::Classes(classes) => fill(out, values, |number| classes.colour(number)),
            Ink::Scale(scale) => fill(out, values, |number| scale.colour(number)),
            Ink::Heights { encoding, metres } => {
                fill(out, values, |number| encoded(*encoding, number * metres[0] + metres[1]));
            }
            Ink::Light { lamp, height } => {
                lamp.shade(&growth.slopes(rows.edges, *height), numbers);
                fill(out, numbers, |light| {
                    let grey = (light + 0.5) as u8;
                    [grey, grey, grey, 255]
                });
            }
            Ink::Slope { unit, height, scale } => {
                slope(&growth.slopes(rows.edges, *height), *unit, numbers);
                fill(out, numbers, |slope| scale.colour(slope));
            }
            Ink::Aspect(scale) => {
                aspect(&growth.slopes(rows.edges, 1.0), numbers);
                fill(out, numbers, |aspect| scale.colour(aspect));
            }
            Ink::Contours(lines) => {
                let cells = values.iter().zip(growth.along.iter().zip(&growth.down));
                for (colour, (number, (along, down))) in out.iter_mut().zip(cells) {
                    *colour = lines.colour(*number, along.hypot(*down) / 8.0);
                }
            }
            Ink::Channels { bands, ends } => {
                let bands = bands.map(|band| &rows.here[band][margin..margin + out.len()]);
                let cells = bands[0].iter().zip(bands[1]).zip(bands[2]);
                for (colour, ((red, green), blue)) in out.iter_mut().zip(cells) {
                    let samples = [*red, *green, *blue];
                    // A pixel has a colour if any of the channels has a value.
                    let is_void = samples.iter().all(|sample| sample.is_nan());
                    let [red, green, blue] = [0, 1, 2].map(|i| stretched(samples[i], ends[i]));
                    *colour = if is_void { [0; 4] } else { [red, green, blue, 255] };
                }
            }
        }
        if !self.mask.is_empty() {
            let hidden = out.iter_mut().zip(values).filter(|(_, value)| !self.mask.shows(**value));
            hidden.for_each(|(colour, _)| *colour = [0; 4]);
        }
        if self.opacity < 255 {
            out.iter_mut().for_each(|colour| colour[3] = self.faded(colour[3]));
        }
    }

    /// Multiplies an opacity by the layer's.
    #[inline]
    fn faded(&self, alpha: u8) -> u8 {
        share(u32::from(alpha) * u32::from(self.opacity)) as u8
    }

    /// Returns all colours that a row can have; `None` if they are unknown or very many.
    pub(super) fn colours(&self) -> Option<Vec<[u8; 4]>> {
        let mut colours: Vec<[u8; 4]> = match &self.ink {
            Ink::Scale(scale) | Ink::Slope { scale, .. } | Ink::Aspect(scale) => scale.steps()?.to_vec(),
            Ink::Light { .. } => (1..=255).map(|grey| [grey, grey, grey, 255]).collect(),
            Ink::Classes(classes) => {
                let sparse = classes.sparse.iter().map(|class| class.1);
                classes.dense.iter().copied().chain(sparse).chain([classes.other?]).collect()
            }
            _ => return None,
        };
        colours.iter_mut().for_each(|colour| colour[3] = self.faded(colour[3]));
        if !self.mask.is_empty() || matches!(self.ink, Ink::Aspect(_)) {
            colours.push([0; 4]);
        }
        Some(colours)
    }

    /// Returns whether all cells with a value are opaque.
    pub(super) fn is_opaque(&self) -> bool {
        let opaque = |colours: &[[u8; 4]]| colours.iter().all(|colour| colour[3] == 255);
        let is_opaque = match &self.ink {
            Ink::Scale(scale) | Ink::Slope { scale, .. } => opaque(scale.colours()),
            Ink::Light { .. } | Ink::Channels { .. } | Ink::Heights { .. } => true,
            Ink::Classes(classes) => {
                opaque(&classes.dense)
                    && classes.sparse.iter().all(|class| class.1[3] == 255)
                    && classes.other.is_none_or(|other| other[3] == 255)
            }
            Ink::Contours(_) | Ink::Aspect(_) => false,
        };
        is_opaque && self.opacity == 255 && self.mask.is_empty()
    }

    /// Returns whether colours encode heights.
    pub(super) fn encodes_heights(&self) -> bool {
        matches!(self.ink, Ink::Heights { .. })
    }

    /// Returns whether all colours are grey.
    pub(super) fn is_grey(&self) -> bool {
        let grey =
            |colours: &[[u8; 4]]| colours.iter().all(|[red, green, blue, _]| red == green && green == blue);
        match &self.ink {
            Ink::Scale(scale) | Ink::Slope { scale, .. } | Ink::Aspect(scale) => grey(scale.colours()),
            Ink::Light { .. } => true,
            Ink::Contours(lines) => grey(&[lines.colour]),
            _ => false,
        }
    }
}

/// Maps numbers to colours; NaN is transparent.
#[inline]
fn fill(out: &mut [[u8; 4]], numbers: &[f64], colour: impl Fn(f64) -> [u8; 4]) {
    for (out, number) in out.iter_mut().zip(numbers) {
        *out = if number.is_nan() { [0; 4] } else { colour(*number) };
    }
}

/// Stretches a number from `low..high` to 0..255; 0 if the range is empty.
#[inline]
pub(super) fn stretched(number: f64, [low, high]: [f64; 2]) -> u8 {
    // Halve first: the difference of two numbers may overflow.
    let share = (number / 2.0 - low / 2.0) / (high / 2.0 - low / 2.0);
    // The cast saturates at 0 and 255 and maps NaN to 0.
    (share * 255.0 + 0.5) as u8
}

/// Encodes a height in metres as colour.
#[inline]
fn encoded(encoding: Encoding, metres: f64) -> [u8; 4] {
    let (units, most) = match encoding {
        Encoding::Mapbox => ((metres + 10_000.0) * 10.0, f64::from((1 << 24) - 1)),
        Encoding::Terrarium => ((metres + 32_768.0) * 256.0, f64::from((1 << 24) - 1)),
    };
    let [_, red, green, blue] = ((units + 0.5).floor().clamp(0.0, most) as u32).to_be_bytes();
    [red, green, blue, 255]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_become_samples() {
        let samples = |ends: [f64; 2], numbers: &[f64]| -> Vec<u8> {
            numbers.iter().map(|number| stretched(*number, ends)).collect()
        };
        assert_eq!(samples([-1.0, 1.0], &[-1.0, 0.0, 1.0, 2.0, -9.0]), [0, 128, 255, 255, 0]);
        assert_eq!(samples([1.0, -1.0], &[-1.0, 1.0]), [255, 0]);
        assert_eq!(samples([f64::MIN, f64::MAX], &[f64::MIN, 0.0, f64::MAX]), [0, 128, 255]);
        assert_eq!(samples([0.0, 1.0], &[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]), [0, 255, 0]);
        assert_eq!(samples([5.0, 5.0], &[5.0]), [0]);
    }

    #[test]
    fn encoded_heights_survive_a_round_trip() {
        for step in 0..200_000 {
            let metres = -9_999.0 + f64::from(step) * 0.123;
            let [r, g, b, _] = encoded(Encoding::Mapbox, metres).map(f64::from);
            let back = -10_000.0 + (r * 65_536.0 + g * 256.0 + b) * 0.1;
            assert!((back - metres).abs() <= 0.05 + 1e-6, "{metres} {back}");
            let [r, g, b, _] = encoded(Encoding::Terrarium, metres).map(f64::from);
            let back = r * 256.0 + g + b / 256.0 - 32_768.0;
            assert!((back - metres).abs() <= 0.5 / 256.0 + 1e-9, "{metres} {back}");
        }
        assert_eq!(encoded(Encoding::Mapbox, 0.0), [1, 134, 160, 255]);
        assert_eq!(encoded(Encoding::Terrarium, 0.0), [128, 0, 0, 255]);
        assert_eq!(encoded(Encoding::Mapbox, -1e9), [0, 0, 0, 255]);
        assert_eq!(encoded(Encoding::Terrarium, 1e9), [255; 4]);
    }
}
