//! Layers of a parsed style, before they are resolved for a tree.

use super::blend::Blend;
use super::mask::Mask;

/// One layer.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layer {
    pub(super) draw: Draw,
    /// Index of the channel that is drawn.
    pub(super) band: usize,
    /// Factor of the layer's opacity, 0 to 1.
    pub(super) opacity: f64,
    pub(super) blend: Blend,
    /// The values that are shown.
    pub(super) mask: Mask,
}

/// Content of a layer.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Draw {
    /// The default style of the tree.
    Auto,
    /// Class colours; those of the tree if `classes` is empty.
    Palette {
        classes: Vec<Class>,
        other: Option<[u8; 4]>,
    },
    Ramp(Ramp),
    /// Three channels as red, green and blue, by index; chosen by colour role if `bands` is `None`.
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

/// A colour ramp.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ramp {
    pub(super) colours: RampColours,
    pub(super) domain: [Bound; 2],
    pub(super) interpolation: Interpolation,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum RampColours {
    /// Evenly spaced over the domain.
    Even(Vec<[u8; 4]>),
    /// Evenly spaced, with separate colours for the domain below and above 0.
    Heights { sea: Vec<[u8; 4]>, land: Vec<[u8; 4]> },
    /// Ascending positions, as numbers or percentiles.
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
    /// Linear interpolation.
    Linear,
    /// Colour of the lower stop.
    Discrete,
    /// Colour of the nearest stop.
    Nearest,
}

/// Light of a hillshade.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Light {
    /// Compass degrees: 0 is north, 90 is east.
    pub(super) azimuth: f64,
    /// Degrees above the horizon.
    pub(super) altitude: f64,
    /// Vertical exaggeration.
    pub(super) z: f64,
    pub(super) kind: LightKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LightKind {
    /// One light.
    Single,
    /// Four lights, in the south-west, west, north-west and north, weighted by the direction of the
    /// slope (USGS open-file report 92-422).
    Multidirectional,
    /// One light, combined with the steepness.
    Combined,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SlopeUnit {
    Degrees,
    Percent,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Contours {
    /// If `None`, chosen from the tree's values.
    pub(super) interval: Option<f64>,
    pub(super) base: f64,
    pub(super) colour: [u8; 4],
    /// In pixels.
    pub(super) width: f64,
    /// Every n-th line is twice as wide; 0 disables this.
    pub(super) bold: u32,
}

/// Encoding of heights as colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Tenths of a metre above -10000 m.
    Mapbox,
    /// 1/256 of a metre above -32768 m.
    Terrarium,
}
