//! Slopes of a relief and the light on it, from cells and their neighbours: Horn's method, as `gdaldem` has it.

use super::layer::{Light, LightKind, SlopeUnit};

/// Growth of numbers across the cells of a row, by Horn (Hill shading and the reflectance map, 1981): eight times that of a
/// cell to the next along the row, and to the next row.
#[derive(Default)]
pub(super) struct Growth {
    pub(super) along: Vec<f64>,
    pub(super) down: Vec<f64>,
}

impl Growth {
    /// Computes the growth across the inner cells of the second of three rows; NaN where a cell is VOID.
    ///
    /// In place of neighbours that are VOID count numbers that go on as they come from the other side, along the row or
    /// across rows (their mean if both are there), or where there is none either, that of the cell itself.
    pub(super) fn compute(&mut self, rows: [&[f64]; 3]) {
        let [above, here, below] = rows;
        let width = here.len() - 2;
        self.along.clear();
        self.down.clear();
        let cells = above.windows(3).zip(here.windows(3)).zip(below.windows(3));
        for ((a, h), b) in cells {
            // (The cell itself matters only by being there.)
            self.along.push((a[2] + 2.0 * h[2] + b[2]) - (a[0] + 2.0 * h[0] + b[0]));
            self.down.push((b[0] + 2.0 * b[1] + b[2]) - (a[0] + 2.0 * a[1] + a[2]));
        }
        for x in 0..width {
            if here[x + 1].is_nan() {
                (self.along[x], self.down[x]) = (f64::NAN, f64::NAN);
            } else if self.along[x].is_nan() || self.down[x].is_nan() {
                let cells = rows.map(|row| [row[x], row[x + 1], row[x + 2]]);
                let [a, h, b] = filled(cells);
                self.along[x] = (a[2] + 2.0 * h[2] + b[2]) - (a[0] + 2.0 * h[0] + b[0]);
                self.down[x] = (b[0] + 2.0 * b[1] + b[2]) - (a[0] + 2.0 * a[1] + a[2]);
                // (Of infinite heights no slope is known.)
                if self.along[x].is_nan() || self.down[x].is_nan() {
                    (self.along[x], self.down[x]) = (0.0, 0.0);
                }
            }
        }
    }

    /// The slopes of the row's cells, given the edges of the cells on the ground and what numbers are multiplied with.
    pub(super) fn slopes(&self, [along, down]: [[f64; 2]; 2], height: f64) -> Slopes<'_> {
        // The gradient has the growth as its products with the edges: it is the growth times their inverse.
        let area = 8.0 * (along[0] * down[1] - along[1] * down[0]) / height;
        let inverse = [[down[1] / area, -along[1] / area], [-down[0] / area, along[0] / area]];
        // (Edges in one line, or beyond all numbers, have no inverse: flat.)
        let is_sound = inverse.iter().flatten().all(|factor| factor.is_finite());
        let inverse = if is_sound { inverse } else { [[0.0; 2]; 2] };
        Slopes { growth: self, inverse }
    }
}

/// Slopes of a row's cells.
pub(super) struct Slopes<'a> {
    growth: &'a Growth,
    /// Factors of the growth along rows and down columns in the slope to the east, and in that to the north.
    inverse: [[f64; 2]; 2],
}

impl Slopes<'_> {
    /// By how much the cells go up to the west and to the north, per metre; NaN where they are VOID.
    fn west_and_north(&self) -> impl Iterator<Item = (f64, f64)> {
        let [east, north] = self.inverse;
        let cells = self.growth.along.iter().zip(&self.growth.down);
        // (Growth beyond all numbers has no product with 0.)
        let product = |growth: f64, factor: f64| if factor == 0.0 { 0.0 } else { growth * factor };
        let slope = move |[along, down]: [f64; 2], factors: [f64; 2]| {
            product(along, factors[0]) + product(down, factors[1])
        };
        cells.map(move |(along, down)| (-slope([*along, *down], east), slope([*along, *down], north)))
    }
}

/// A cell and its neighbours, with numbers for those that are VOID.
fn filled(cells: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let centre = cells[1][1];
    std::array::from_fn(|y| {
        std::array::from_fn(|x| {
            let on = |near: f64, far: f64| Some(2.0 * near - far).filter(|number| !number.is_nan());
            let number = Some(cells[y][x]).filter(|number| !number.is_nan());
            let along = || if x == 1 { None } else { on(cells[y][1], cells[y][2 - x]) };
            let across = || if y == 1 { None } else { on(cells[1][x], cells[2 - y][x]) };
            // (Neither axis comes first: a transposed raster has the same slopes.)
            number.unwrap_or_else(|| match (along(), across()) {
                (Some(one), Some(other)) => (one + other) / 2.0,
                (found, None) | (None, found) => found.unwrap_or(centre),
            })
        })
    })
}

/// Numbers that the light is computed with.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    kind: LightKind,
    sin_altitude: f64,
    cos_altitude: f64,
    sin_azimuth: f64,
    cos_azimuth: f64,
}

impl Lamp {
    pub(super) fn new(light: &Light) -> Lamp {
        let (sin_altitude, cos_altitude) = light.altitude.to_radians().sin_cos();
        let (sin_azimuth, cos_azimuth) = light.azimuth.to_radians().sin_cos();
        Lamp { kind: light.kind, sin_altitude, cos_altitude, sin_azimuth, cos_azimuth }
    }

    /// Writes the light on the cells of a row, 1 to 255; NaN where they are VOID.
    pub(super) fn shade(&self, slopes: &Slopes<'_>, out: &mut Vec<f64>) {
        let slopes = slopes.west_and_north();
        let light = |share: f64| if share <= 0.0 { 1.0 } else { 1.0 + 254.0 * share };
        let Lamp { sin_altitude, cos_altitude, sin_azimuth, cos_azimuth, .. } = *self;
        let lit = move |x: f64, y: f64| {
            let cosine = (sin_altitude - (y * cos_azimuth - x * sin_azimuth) * cos_altitude)
                / (1.0 + x * x + y * y).sqrt();
            // (Slopes beyond all numbers are dark.)
            if cosine.is_nan() && !x.is_nan() && !y.is_nan() { 0.0 } else { cosine }
        };
        out.clear();
        match self.kind {
            LightKind::Single => out.extend(slopes.map(|(x, y)| light(lit(x, y)))),
            LightKind::Combined => {
                let half = std::f64::consts::FRAC_PI_2;
                out.extend(slopes.map(|(x, y)| {
                    let steepness = x.hypot(y).atan();
                    light(1.0 - lit(x, y).clamp(-1.0, 1.0).acos() * steepness / (half * half))
                }));
            }
            LightKind::Multidirectional => {
                // (USGS open file report 92-422: lamps in the south-west, west, north-west and north, each weighed by
                // the squared sine of its angle with the slope's direction.)
                let diagonal = -std::f64::consts::FRAC_1_SQRT_2;
                out.extend(slopes.map(|(x, y)| {
                    let steep = x * x + y * y;
                    if steep == 0.0 {
                        return light(sin_altitude);
                    }
                    let lamp = |slope: f64| (sin_altitude + slope * cos_altitude).max(0.0);
                    let south_west = 0.5 * steep - x * y;
                    let sum = south_west * lamp((x - y) * diagonal)
                        + x * x * lamp(-x)
                        + (steep - south_west) * lamp((x + y) * diagonal)
                        + y * y * lamp(-y);
                    let share = 0.5 * sum / (steep * (1.0 + steep).sqrt());
                    if share.is_nan() && !x.is_nan() && !y.is_nan() { light(0.0) } else { light(share) }
                }));
            }
        }
    }
}

/// Writes the slopes of a row's cells.
pub(super) fn slope(slopes: &Slopes<'_>, unit: SlopeUnit, out: &mut Vec<f64>) {
    let tangents = slopes.west_and_north().map(|(west, north)| west.hypot(north));
    out.clear();
    match unit {
        SlopeUnit::Degrees => out.extend(tangents.map(|tangent| tangent.atan().to_degrees())),
        SlopeUnit::Percent => out.extend(tangents.map(|tangent| 100.0 * tangent)),
    }
}

/// Writes the directions in which a row's cells slope downwards, in degrees on a compass; NaN where they are flat.
pub(super) fn aspect(slopes: &Slopes<'_>, out: &mut Vec<f64>) {
    out.clear();
    out.extend(slopes.west_and_north().map(|(west, north)| {
        if west == 0.0 && north == 0.0 {
            return f64::NAN;
        }
        // (It slopes down to the east where it goes up to the west.)
        let degrees = west.atan2(-north).to_degrees();
        let degrees = if degrees < 0.0 { degrees + 360.0 } else { degrees };
        if degrees >= 360.0 { 0.0 } else { degrees }
    }));
}
