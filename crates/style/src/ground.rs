//! Cell edges on the ground, in metres, for any location on a map.

use spinney_crs::{Crs, Frame, WEB_MERCATOR};

/// Edges of a map's cells on the ground, from which slopes, aspects and hillshades are computed.
///
/// Degrees are converted to metres on the WGS 84 ellipsoid, depending on latitude. Distances in Web
/// Mercator are divided by its local scale. Feet and kilometres are converted. Cells of unknown
/// units count as metres.
///
/// North is the direction of the second coordinate, whatever the order and direction of rows and
/// columns. Rasters without georeferencing (no CRS, and square cells of 1, 2, 4, ... units in row
/// order) have north at the top.
#[derive(Clone, Debug)]
pub struct Ground {
    /// World vectors from a cell to the next one in its row, and to the next one in its column.
    edges: [[f64; 2]; 2],
    /// Northing of row 0 in the middle of the raster, and its increment per row.
    northing: [f64; 2],
    unit: Unit,
}

#[derive(Clone, Copy, Debug)]
enum Unit {
    Degrees,
    Mercator,
    Metres(f64),
}

/// Semi-major axis and squared eccentricity of the WGS 84 ellipsoid.
const AXIS: f64 = 6_378_137.0;
const ECCENTRICITY: f64 = 0.006_694_379_990_141_316;
/// Minimum metres per degree of longitude, which avoids zero-width cells at the poles.
const LEAST: f64 = 1e-3;

impl Ground {
    /// Edges of a pixel of one metre, north up.
    pub const PIXEL: [[f64; 2]; 2] = [[1.0, 0.0], [0.0, -1.0]];

    /// Creates the ground of a raster with `columns` columns in a frame.
    pub fn new(frame: &Frame, columns: u64) -> Ground {
        let [a, b, _, d, e, _] = frame.affine();
        let middle = frame.to_world([columns as f64 / 2.0, 0.0, 0.0])[1];
        let unit = match &frame.crs {
            None => Unit::Metres(1.0),
            Some(crs) if crs.is_same(&Crs::epsg(WEB_MERCATOR)) => Unit::Mercator,
            Some(crs) => match crs.unit() {
                Some("degrees") => Unit::Degrees,
                Some("ft") => Unit::Metres(0.3048),
                Some("us-ft") => Unit::Metres(1200.0 / 3937.0),
                Some("km") => Unit::Metres(1000.0),
                _ => Unit::Metres(1.0),
            },
        };
        let is_unplaced =
            frame.crs.is_none() && [b, d] == [0.0; 2] && a == e && a >= 1.0 && a.log2().fract() == 0.0;
        let edges = [[a, d], [b, if is_unplaced { -e } else { e }]];
        Ground { edges, northing: [middle, e], unit }
    }

    /// Returns the metres to the east and north from a cell of a row to the next one in its row,
    /// and to the one below. Rows outside the raster are valid.
    pub fn cell(&self, row: f64) -> [[f64; 2]; 2] {
        let northing = self.northing[0] + (row + 0.5) * self.northing[1];
        let [east, north] = match self.unit {
            Unit::Metres(metres) => [metres; 2],
            Unit::Mercator => [1.0 / (northing / AXIS).cosh(); 2],
            Unit::Degrees => {
                let latitude = northing.clamp(-90.0, 90.0).to_radians();
                let flat = 1.0 - ECCENTRICITY * latitude.sin().powi(2);
                let east = AXIS * latitude.cos() / flat.sqrt();
                let north = AXIS * (1.0 - ECCENTRICITY) / flat.powf(1.5);
                [east.to_radians().max(LEAST), north.to_radians()]
            }
        };
        self.edges.map(|[x, y]| [x * east, y * north])
    }

    /// Returns the cell edges of consecutive rows.
    pub fn rows(&self, first: f64, count: usize) -> Vec<[[f64; 2]; 2]> {
        (0..count).map(|row| self.cell(first + row as f64)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_crs::web_mercator;

    #[test]
    fn cells_have_a_ground_size_at_all_latitudes() {
        let planar = |crs, e: f64, f| Frame { crs, ..Frame::planar([-e, 0.0, 10.0, 0.0, e, f]) };
        let close = |found: [[f64; 2]; 2], expected: [f64; 2]| {
            let expected = [[expected[0], 0.0], [0.0, -expected[1]]].concat();
            let pairs = found.concat().into_iter().zip(expected);
            assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs()), "{found:?}");
        };
        // Published lengths of a degree at the equator and at 45 degrees.
        let degrees = Ground::new(&planar(Some(Crs::epsg(4326)), -1.0, 45.5), 10);
        close(degrees.cell(0.0), [78_846.835, 111_131.778]);
        close(degrees.cell(45.0), [111_319.491, 110_574.276]);
        let all = degrees.rows(-60.0, 200);
        assert!(all.iter().all(|[east, south]| east[0] > 0.0 && south[1] < 0.0 && south[1].is_finite()));
        close(Ground::new(&planar(Some(Crs::epsg(2263)), -10.0, 0.0), 5).cell(0.0), [3.048_006_096; 2]);
        close(Ground::new(&Frame::identity(), 5).cell(0.0), [1.0; 2]);
        close(Ground::new(&Frame::identity().coarser(3), 5).cell(0.0), [8.0; 2]);
        // Rows that start in the south, and columns that run south.
        let frame = Frame::planar([10.0, 0.0, 0.0, 0.0, 10.0, 0.0]);
        assert_eq!(Ground::new(&frame, 5).cell(0.0), [[10.0, 0.0], [0.0, 10.0]]);
        let frame = Frame::planar([0.0, 10.0, 0.0, -5.0, 0.0, 0.0]);
        assert_eq!(Ground::new(&frame, 5).cell(0.0), [[0.0, -5.0], [10.0, 0.0]]);
        // At 60 degrees, the scale of Web Mercator is 2.
        let mercator = Ground::new(&web_mercator(8), 256);
        let row = (1.0 - 3f64.sqrt().asinh() / std::f64::consts::PI) * 128.0;
        close(mercator.cell(row - 0.5), [2.0 * 20_037_508.342_789_244 / 256.0 / 2.0; 2]);
    }
}
