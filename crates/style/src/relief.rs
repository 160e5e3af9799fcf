//! Slope, aspect and hillshade from cells and their neighbours by Horn's method, as in `gdaldem`.

use super::layer::{Light, LightKind, SlopeUnit};

/// Differences across the cells of a row (Horn, Hill shading and the reflectance map, 1981): eight
/// times the change per cell along the row, and per row.
#[derive(Default)]
pub(super) struct Growth {
    pub(super) along: Vec<f64>,
    pub(super) down: Vec<f64>,
}

impl Growth {
    /// Computes the differences for the inner cells of the second of three rows; NaN if a cell is
    /// VOID.
    ///
    /// VOID neighbours are extrapolated linearly from the opposite side, along the row or across
    /// rows, or as the mean of both. If neither is possible, they get the cell's own value.
    pub(super) fn compute(&mut self, rows: [&[f64]; 3]) {
        let [above, here, below] = rows;
        let width = here.len() - 2;
        self.along.clear();
        self.down.clear();
        let cells = above.windows(3).zip(here.windows(3)).zip(below.windows(3));
        for ((a, h), b) in cells {
            // The cell itself has weight 0, but must not be VOID.
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
                // Infinite heights have no defined slope.
                if self.along[x].is_nan() || self.down[x].is_nan() {
                    (self.along[x], self.down[x]) = (0.0, 0.0);
                }
            }
        }
    }

    /// Returns the slopes of the row, given the cell edges on the ground. Numbers are multiplied by
    /// `height`.
    pub(super) fn slopes(&self, [along, down]: [[f64; 2]; 2], height: f64) -> Slopes<'_> {
        // The dot products of the gradient with the edges are the differences. Invert that system.
        let area = 8.0 * (along[0] * down[1] - along[1] * down[0]) / height;
        let inverse = [[down[1] / area, -along[1] / area], [-down[0] / area, along[0] / area]];
        // Collinear or infinite edges have no inverse: treat the ground as flat.
        let is_sound = inverse.iter().flatten().all(|factor| factor.is_finite());
        let inverse = if is_sound { inverse } else { [[0.0; 2]; 2] };
        Slopes { growth: self, inverse }
    }
}

/// Slopes of a row's cells.
pub(super) struct Slopes<'a> {
    growth: &'a Growth,
    /// Factors of the differences along rows and down columns: for the slope to the east, and for
    /// the slope to the north.
    inverse: [[f64; 2]; 2],
}

impl Slopes<'_> {
    /// Rise of the cells to the west and to the north, per metre; NaN in VOID cells.
    fn west_and_north(&self) -> impl Iterator<Item = (f64, f64)> {
        let [east, north] = self.inverse;
        let cells = self.growth.along.iter().zip(&self.growth.down);
        // Avoid NaN from infinite differences times 0.
        let product = |growth: f64, factor: f64| if factor == 0.0 { 0.0 } else { growth * factor };
        let slope = move |[along, down]: [f64; 2], factors: [f64; 2]| {
            product(along, factors[0]) + product(down, factors[1])
        };
        cells.map(move |(along, down)| (-slope([*along, *down], east), slope([*along, *down], north)))
    }
}

/// Replaces VOID neighbours of a cell by numbers.
fn filled(cells: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let centre = cells[1][1];
    std::array::from_fn(|y| {
        std::array::from_fn(|x| {
            let on = |near: f64, far: f64| Some(2.0 * near - far).filter(|number| !number.is_nan());
            let number = Some(cells[y][x]).filter(|number| !number.is_nan());
            let along = || if x == 1 { None } else { on(cells[y][1], cells[y][2 - x]) };
            let across = || if y == 1 { None } else { on(cells[1][x], cells[2 - y][x]) };
            // Treat both axes alike, so that a transposed raster has the same slopes.
            number.unwrap_or_else(|| match (along(), across()) {
                (Some(one), Some(other)) => (one + other) / 2.0,
                (found, None) | (None, found) => found.unwrap_or(centre),
            })
        })
    })
}

/// Precomputed parameters of the light.
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

    /// Computes the light on the cells of a row, 1 to 255; NaN in VOID cells.
    pub(super) fn shade(&self, slopes: &Slopes<'_>, out: &mut Vec<f64>) {
        let slopes = slopes.west_and_north();
        let light = |share: f64| if share <= 0.0 { 1.0 } else { 1.0 + 254.0 * share };
        let Lamp { sin_altitude, cos_altitude, sin_azimuth, cos_azimuth, .. } = *self;
        let lit = move |x: f64, y: f64| {
            let cosine = (sin_altitude - (y * cos_azimuth - x * sin_azimuth) * cos_altitude)
                / (1.0 + x * x + y * y).sqrt();
            // Infinite slopes are dark.
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
                // USGS open-file report 92-422: lights in the south-west, west, north-west and
                // north. Each is weighted by the squared cosine of the angle between its direction
                // and the slope's.
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

/// Computes the slopes of a row's cells.
pub(super) fn slope(slopes: &Slopes<'_>, unit: SlopeUnit, out: &mut Vec<f64>) {
    let tangents = slopes.west_and_north().map(|(west, north)| west.hypot(north));
    out.clear();
    match unit {
        SlopeUnit::Degrees => out.extend(tangents.map(|tangent| tangent.atan().to_degrees())),
        SlopeUnit::Percent => out.extend(tangents.map(|tangent| 100.0 * tangent)),
    }
}

/// Computes the downhill directions of a row's cells in compass degrees; NaN in VOID and flat
/// cells.
pub(super) fn aspect(slopes: &Slopes<'_>, out: &mut Vec<f64>) {
    out.clear();
    out.extend(slopes.west_and_north().map(|(west, north)| {
        if west == 0.0 && north == 0.0 {
            return f64::NAN;
        }
        // A cell that rises to the west faces east.
        let degrees = west.atan2(-north).to_degrees();
        let degrees = if degrees < 0.0 { degrees + 360.0 } else { degrees };
        if degrees >= 360.0 { 0.0 } else { degrees }
    }));
}
