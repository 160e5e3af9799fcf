//! The Web Mercator square: the world as the root of a quadtree, as web maps divide it into tiles.

use super::{Crs, Frame};

/// EPSG code of Web Mercator (WGS 84 / Pseudo-Mercator).
pub const WEB_MERCATOR: u32 = 3857;
/// Half the side of the world square in metres: half the equator of a sphere with a radius of
/// 6378137 m.
pub const WEB_MERCATOR_HALF: f64 = 20_037_508.342_789_244;
/// Latitude in degrees of the square's northern and southern border.
pub const WEB_MERCATOR_LATITUDE: f64 = 85.051_128_779_806_59;

/// Returns the frame of a tree whose root is the world square and whose cells are at level `depth`.
/// The FD path of a node at level z is the quadkey of the tile at zoom z, which has 256 x 256 cells
/// at level z + 8.
///
/// ```
/// use spinney::raw::space::{web_mercator, web_mercator_depth};
/// let frame = web_mercator(8);
/// assert_eq!(web_mercator_depth(&frame, [256, 256, 1]), Some(8));
/// ```
pub fn web_mercator(depth: u8) -> Frame {
    let cell = 2.0 * WEB_MERCATOR_HALF / 2f64.powi(depth.into());
    let frame = Frame::planar([cell, 0.0, -WEB_MERCATOR_HALF, 0.0, -cell, WEB_MERCATOR_HALF]);
    Frame { crs: Some(Crs::epsg(WEB_MERCATOR)), ..frame }
}

/// Returns the depth of a tree whose root is the Web Mercator world square ([`web_mercator`]), and
/// `None` for all other trees. `extent` is the number of cells along each axis; it must cover the
/// whole square.
pub fn web_mercator_depth(frame: &Frame, extent: [u64; 3]) -> Option<u8> {
    let [side, height, layers] = extent;
    if side != height || layers != 1 || !side.is_power_of_two() {
        return None;
    }
    let depth = side.trailing_zeros() as u8;
    let world = web_mercator(depth);
    // (Corners may differ by rounding errors.)
    let corners = [[0.0; 3], [side as f64, side as f64, 0.0], [side as f64, 0.0, 0.0]];
    let is_close = corners.iter().all(|corner| {
        let (here, there) = (frame.to_world(*corner), world.to_world(*corner));
        (0..2).all(|axis| (here[axis] - there[axis]).abs() <= 1e-6)
    });
    let is_system = frame.crs.as_ref().is_some_and(|crs| crs.is_same(&Crs::epsg(WEB_MERCATOR)));
    (is_close && is_system).then_some(depth)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_world_is_known_by_its_frame() {
        for depth in [0, 8, 15, 28] {
            assert_eq!(web_mercator_depth(&web_mercator(depth), [1 << depth, 1 << depth, 1]), Some(depth));
        }
        assert_eq!(web_mercator_depth(&web_mercator(8), [512, 512, 1]), None);
        assert_eq!(web_mercator_depth(&web_mercator(8), [256, 255, 1]), None);
        let other_crs = Frame { crs: Some(Crs::epsg(4326)), ..web_mercator(8) };
        assert_eq!(web_mercator_depth(&other_crs, [256, 256, 1]), None);
        let without_crs = Frame { crs: None, ..web_mercator(8) };
        assert_eq!(web_mercator_depth(&without_crs, [256, 256, 1]), None);
    }

    #[test]
    fn the_square_ends_where_its_latitude_says() {
        let north = (std::f64::consts::PI).sinh().atan().to_degrees();
        assert!((north - WEB_MERCATOR_LATITUDE).abs() < 1e-12);
        assert!((6_378_137.0 * std::f64::consts::PI - WEB_MERCATOR_HALF).abs() < 1e-8);
    }
}
