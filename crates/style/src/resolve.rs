//! Resolves styles for a tree: percentiles, units and palettes become numbers and colours.

use super::Style;
use super::coat::{Classes, Coat, Ink, Lines};
use super::domain::{PercentileNumbers, Percentiles};
use super::layer::{Bound, Class, Contours, Draw, Interpolation, Layer, Ramp, RampColours};
use super::relief::Lamp;
use super::scale::Scale;
use spinney_base::{Error, Progress, Result};
use spinney_container::Unit;
use spinney_engine::dataset::Dataset;

/// Resolves the layers of a style, from bottom to top. Returns them and the percentiles that they
/// use, of which `given` may contain some.
///
/// # Errors
/// If the tree lacks a channel or is corrupt, or on cancellation.
pub(super) fn coats(
    style: &Style,
    tree: &Dataset,
    given: Option<&PercentileNumbers>,
    progress: &dyn Progress,
) -> Result<(Vec<Coat>, PercentileNumbers)> {
    let resolver = Resolver { tree, percentiles: Percentiles::new(tree, given, progress) };
    let mut coats = Vec::new();
    for layer in &style.layers {
        if layer.draw == Draw::Auto {
            let default = Style::default_for(tree);
            for own in default.layers {
                let Layer { opacity, blend, mask, .. } = layer.clone();
                coats.push(resolver.coat(&Layer { opacity, blend, mask, ..own })?);
            }
        } else {
            coats.push(resolver.coat(layer)?);
        }
    }
    Ok((coats, resolver.percentiles.into_resolved()))
}

/// Evenly spaced stops over a range. Discrete colours get an equal share of the range each; others
/// include both ends.
fn even_stops(
    colours: &[[u8; 4]],
    [low, high]: [f64; 2],
    interpolation: Interpolation,
) -> Vec<(f64, [u8; 4])> {
    let parts = match interpolation {
        Interpolation::Discrete => colours.len(),
        _ => colours.len() - 1,
    };
    let place = |i: usize| {
        let share = i as f64 / parts as f64;
        low * (1.0 - share) + high * share
    };
    colours.iter().enumerate().map(|(i, colour)| (place(i), *colour)).collect()
}

struct Resolver<'a> {
    tree: &'a Dataset,
    percentiles: Percentiles<'a>,
}

impl Resolver<'_> {
    fn coat(&self, layer: &Layer) -> Result<Coat> {
        let band = layer.band;
        let bands = match layer.draw {
            Draw::Rgb { bands, .. } => bands.unwrap_or(self.tree.metadata().rgb_channels()),
            _ => [band; 3],
        };
        let channels = usize::from(self.tree.header().form.value.channels);
        if let Some(band) = bands.into_iter().find(|band| *band >= channels) {
            let found = format!("channel {}", band + 1);
            return Err(Error::invalid("style", found, format!("the tree's channels 1 to {channels}")));
        }
        let ink = match &layer.draw {
            Draw::Auto | Draw::Palette { .. } => self.classes(&layer.draw),
            Draw::Ramp(ramp) => Ink::Scale(self.scale(band, ramp)?),
            Draw::Rgb { domain, .. } => {
                let ends = |band: usize| -> Result<[f64; 2]> { self.ends(band, domain) };
                Ink::Channels { bands, ends: [ends(bands[0])?, ends(bands[1])?, ends(bands[2])?] }
            }
            Draw::Hillshade(light) => {
                Ink::Light { lamp: Lamp::new(light), height: light.z * self.metres(band)[0] }
            }
            Draw::Slope { unit, z, ramp } => {
                let (height, scale) = (z * self.metres(band)[0], self.scale(band, ramp)?);
                Ink::Slope { unit: *unit, height, scale }
            }
            Draw::Aspect { ramp } => Ink::Aspect(self.scale(band, ramp)?),
            Draw::Contours(contours) => Ink::Contours(self.lines(band, contours)?),
            Draw::TerrainRgb(encoding) => Ink::Heights { encoding: *encoding, metres: self.metres(band) },
        };
        let opacity = (layer.opacity * 255.0 + 0.5) as u8;
        Ok(Coat { band, ink, opacity, blend: layer.blend, mask: layer.mask.clone() })
    }

    /// Scale and offset that convert numbers of a channel to metres.
    fn metres(&self, band: usize) -> [f64; 2] {
        let metadata = self.tree.metadata();
        let (factor, summand) = metadata.scale_offset.get(band).copied().unwrap_or((1.0, 0.0));
        let unit = metadata.units.get(band).and_then(|unit| Unit::parse(unit)).and_then(Unit::metres);
        let unit = unit.unwrap_or(1.0);
        [factor * unit, summand * unit]
    }

    /// Resolves the two bounds of a domain; 0 and 1 if the tree has no values.
    fn ends(&self, band: usize, domain: &[Bound; 2]) -> Result<[f64; 2]> {
        let [low, high] =
            [self.percentiles.number(band, domain[0])?, self.percentiles.number(band, domain[1])?];
        Ok([low.unwrap_or(0.0), high.unwrap_or(1.0)])
    }

    fn scale(&self, band: usize, ramp: &Ramp) -> Result<Scale> {
        let stops = match &ramp.colours {
            RampColours::Even(colours) => {
                let mut ends = self.ends(band, &ramp.domain)?;
                let mut colours = colours.clone();
                if ends[0] > ends[1] {
                    ends.reverse();
                    colours.reverse();
                }
                even_stops(&colours, ends, ramp.interpolation)
            }
            RampColours::Heights { sea, land } => {
                let [a, b] = self.ends(band, &ramp.domain)?;
                let (low, high) = (a.min(b), a.max(b));
                let mut stops = Vec::new();
                if low < 0.0 {
                    stops.extend(even_stops(sea, [low, high.min(0.0)], ramp.interpolation));
                }
                if high > 0.0 || low >= 0.0 {
                    stops.extend(even_stops(land, [low.max(0.0), high], ramp.interpolation));
                }
                stops
            }
            RampColours::Stops(stops) => {
                let mut numbers: Vec<(f64, [u8; 4])> = Vec::with_capacity(stops.len());
                for (index, (bound, colour)) in stops.iter().enumerate() {
                    let number = self.percentiles.number(band, *bound)?.unwrap_or(index as f64);
                    // Numbers and percentiles may be mixed in any order. Make the stops ascend.
                    let least = numbers.last().map_or(number, |last| last.0);
                    numbers.push((number.max(least), *colour));
                }
                numbers
            }
        };
        Ok(Scale::new(&stops, ramp.interpolation))
    }

    fn lines(&self, band: usize, contours: &Contours) -> Result<Lines> {
        let interval = match contours.interval {
            Some(interval) => interval,
            None => {
                let [low, high] = self.ends(band, &[Bound::Percent(2.0), Bound::Percent(98.0)])?;
                round_step((high - low) / 15.0)
            }
        };
        let Contours { base, colour, width, bold, .. } = *contours;
        Ok(Lines { interval, base, colour, width, bold: f64::from(bold) })
    }

    /// Class colours of the style, or else those of the tree.
    fn classes(&self, draw: &Draw) -> Ink {
        let (given, other): (&[Class], _) = match draw {
            Draw::Palette { classes, other } => (classes, *other),
            _ => (&[], None),
        };
        let mut classes = Classes { dense: Vec::new(), sparse: Vec::new(), names: Vec::new(), other };
        if !given.is_empty() {
            classes.sparse = given.iter().map(|class| (class.value, class.colour)).collect();
            classes.names = given.iter().map(|class| class.name.clone()).collect();
            classes.other = Some(other.unwrap_or([0; 4]));
        } else if let Some(palette) = &self.tree.metadata().palette {
            classes.dense.clone_from(&palette.colours);
            // Like images with a palette.
            classes.other = Some(other.unwrap_or([0, 0, 0, 255]));
        }
        Ink::Classes(classes)
    }
}

/// Returns the round number near a step: 1, 2 or 5 times a power of ten; 1 if the step is not
/// positive and finite.
pub(super) fn round_step(step: f64) -> f64 {
    if !(step > 0.0 && step.is_finite()) {
        return 1.0;
    }
    let power = 10f64.powf(step.log10().floor());
    let factor = [1.0, 2.0, 5.0, 10.0].into_iter().find(|factor| factor * power >= step * 0.75);
    factor.unwrap_or(10.0) * power
}
