//! Layers of a style, as they are written down.

use super::blend::Blend;
use super::mask::Mask;

/// One layer.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layer {
    pub(super) draw: Draw,
    /// The channel that is drawn, from 0.
    pub(super) band: usize,
    /// Share of the layer's own opacity, 0 to 1.
    pub(super) opacity: f64,
    pub(super) blend: Blend,
    /// The values that are shown at all.
    pub(super) mask: Mask,
}

/// Content of a layer.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Draw {
    /// The tree's default.
    Auto,
    /// Classes; those of the tree, if there are none.
    Palette {
        classes: Vec<Class>,
        other: Option<[u8; 4]>,
    },
    Ramp(Ramp),
    /// Three channels as red, green and blue, from 0; those of these roles, if there are none.
    Rgb {
        bands: Option<[usize; 3]>,
        domain: [Bound; 2],
    },
    Hillshade(Light),
    Slope {
        unit: SlopeUnit,
        z: f64,
        ramp: Ramp,
    },
    Aspect {
        ramp: Ramp,
    },
    Contours(Contours),
    TerrainRgb(Encoding),
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Class {
    pub(super) value: f64,
    pub(super) colour: [u8; 4],
    pub(super) name: String,
}

/// Colours of numbers.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ramp {
    pub(super) colours: RampColours,
    pub(super) domain: [Bound; 2],
    pub(super) interpolation: Interpolation,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum RampColours {
    /// Evenly over the domain.
    Even(Vec<[u8; 4]>),
    /// Evenly over the part of the domain below 0, and over that above.
    Heights { sea: Vec<[u8; 4]>, land: Vec<[u8; 4]> },
    /// In ascending order, by numbers or by percentiles.
    Stops(Vec<(Bound, [u8; 4])>),
}

/// A number, or a percentile of the tree's values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Bound {
    Number(f64),
    /// 0 to 100.
    Percent(f64),
}

/// Colours of numbers between two stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Interpolation {
    /// Mixed, by the distances.
    Linear,
    /// That of the lower one.
    Discrete,
    /// That of the nearer one.
    Nearest,
}

/// Light on a relief.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Light {
    /// Degrees on a compass: 0 is north, 90 is east.
    pub(super) azimuth: f64,
    /// Degrees above the horizon.
    pub(super) altitude: f64,
    /// Exaggeration of heights.
    pub(super) z: f64,
    pub(super) kind: LightKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LightKind {
    /// One lamp.
    Single,
    /// Four, in the west and on both sides of it, each for the slopes across it (USGS open file report 92-422).
    Multidirectional,
    /// One, and shade by steepness.
    Combined,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SlopeUnit {
    Degrees,
    Percent,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Contours {
    /// Chosen by the tree's values if it is not given.
    pub(super) interval: Option<f64>,
    pub(super) base: f64,
    pub(super) colour: [u8; 4],
    /// In pixels.
    pub(super) width: f64,
    /// Every n-th line is twice as wide; 0: none.
    pub(super) bold: u32,
}

/// Code of heights in colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Tenths of a metre above -10000.
    Mapbox,
    /// Parts of 256 of a metre above -32768.
    Terrarium,
}
