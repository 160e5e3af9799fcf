use super::*;
use crate::{Crs, Projection, web_mercator};
use spinney_overlay::{Crossings, Polygon};

fn framed(crs: u32, numbers: [f64; 6]) -> Frame {
    Frame { crs: Some(Crs::epsg(crs)), ..Frame::planar(numbers) }
}

/// Whether a point is inside of rings, by the even-odd definition.
fn has(rings: &[Vec<[f64; 2]>], [x, y]: [f64; 2]) -> bool {
    let edges = rings.iter().flat_map(|ring| ring.iter().zip(ring.iter().cycle().skip(1)));
    let crosses = edges
        .filter(|(a, b)| (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
    crosses.count() % 2 == 1
}

/// Number of cells whose centres are inside rings of longitudes and latitudes, by testing all
/// cells. Longitudes that differ by a turn are equivalent.
fn counted(rings: &[Vec<[f64; 2]>], frame: &Frame, extent: [u64; 3]) -> u64 {
    let projection = Projection::new(frame.crs.as_ref().unwrap(), true).unwrap();
    let cells = (0..extent[1]).flat_map(|row| (0..extent[0]).map(move |column| (column, row)));
    let inside = cells.filter(|(column, row)| {
        let [x, y, _] = frame.to_world([*column as f64 + 0.5, *row as f64 + 0.5, 0.0]);
        let Some([longitude, latitude]) = projection.inverse([x, y]) else { return false };
        [-720.0, -360.0, 0.0, 360.0, 720.0].into_iter().any(|turn| has(rings, [longitude + turn, latitude]))
    });
    inside.count() as u64
}

fn counted_in_cells(rings: &[Vec<[f64; 2]>], frame: &Frame, extent: [u64; 3]) -> u64 {
    let locator = CellLocator::new(&Coordinates::LONLAT, frame, extent).unwrap();
    let parts = locator.parts(&[rings.to_vec()]);
    if parts.is_empty() {
        return 0;
    }
    Polygon::of_parts(&parts).unwrap().count_centres(&Bounds::of_extent(extent), &mut Crossings::default())
}

/// A ring of longitudes and latitudes around a position.
fn ring(state: &mut u64, middle: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    let mut random = |most: f64| {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) as f64 / (1u64 << 31) as f64 * most
    };
    let count = 3 + random(9.0) as usize;
    let corner = |i: usize| {
        let (angle, away) = (i as f64 / count as f64 * std::f64::consts::TAU, radius * (0.5 + random(0.5)));
        [middle[0] + away * angle.cos(), (middle[1] + away * angle.sin()).clamp(-90.0, 90.0)]
    };
    (0..count).map(corner).collect()
}

#[test]
fn polygons_in_degrees_contain_the_cells_whose_positions_are_inside() {
    let trees = [
        // UTM, Lambert's conic, both poles, Africa, Web Mercator around the 180th meridian, and
        // degrees in several ranges.
        (framed(32632, [500.0, 0.0, 480_000.0, 0.0, -500.0, 5_350_000.0]), [9.0, 48.0], 1.0),
        (framed(3034, [20_000.0, 0.0, 3_000_000.0, 0.0, -20_000.0, 3_500_000.0]), [8.0, 54.0], 30.0),
        (framed(3413, [90_000.0, 0.0, -4_000_000.0, 0.0, -90_000.0, 4_000_000.0]), [10.0, 80.0], 60.0),
        (framed(3031, [90_000.0, 0.0, -4_000_000.0, 0.0, -90_000.0, 4_000_000.0]), [170.0, -70.0], 50.0),
        (framed(32601, [3000.0, 0.0, 300_000.0, 0.0, -3000.0, 800_000.0]), [-180.0, 6.0], 3.0),
        (framed(3857, [10_000.0, 0.0, 19_600_000.0, 0.0, -10_000.0, 500_000.0]), [-179.0, 2.0], 9.0),
        (framed(4326, [0.25, 0.0, 170.0, 0.0, -0.25, 10.0]), [-178.0, 0.0], 12.0),
        (framed(4326, [4.0, 0.0, -180.0, 0.0, -2.0, 90.0]), [175.0, 20.0], 50.0),
        (framed(4326, [4.0, 0.0, 0.0, 0.0, -2.0, 90.0]), [-3.0, 20.0], 50.0),
        (framed(4258, [0.01, 0.002, 8.0, 0.003, -0.01, 50.0]), [8.4, 49.6], 0.5),
    ];
    let mut state = 3;
    for (frame, middle, radius) in trees {
        let extent = [90, 89, 1];
        let mut some = 0;
        for _ in 0..25 {
            let rings = [ring(&mut state, middle, radius), ring(&mut state, middle, radius * 0.3)];
            let (expected, found) =
                (counted(&rings, &frame, extent), counted_in_cells(&rings, &frame, extent));
            // (Centres within a hundredth of a cell of an edge may be on either side of it.)
            let close = 4 + expected / 200;
            assert!(expected.abs_diff(found) <= close, "{frame:?}: {found}, not {expected}: {rings:?}");
            some += expected;
        }
        assert!(some > 2000, "{frame:?}: {some}");
    }
}

#[test]
fn boxes_lie_across_the_seam() {
    let world = framed(4326, [0.5, 0.0, -180.0, 0.0, -0.5, 90.0]);
    let extent = [720, 360, 1];
    let boxes = |locator: &CellLocator, [w, s, e, n]: [f64; 4]| -> Vec<[u64; 4]> {
        let boxes = locator.boxes([w, s, 0.0], [e, n, 0.0]).unwrap();
        boxes.iter().map(|b| [b.min[0], b.min[1], b.max[0], b.max[1]]).collect()
    };
    for coordinates in [Coordinates::LONLAT, Coordinates::World] {
        let locator = CellLocator::new(&coordinates, &world, extent).unwrap();
        assert_eq!(boxes(&locator, [175.0, -1.0, -175.0, 1.0]), [[710, 178, 720, 182], [0, 178, 10, 182]]);
        assert_eq!(boxes(&locator, [-185.0, -1.0, -175.0, 1.0]), [[710, 178, 720, 182], [0, 178, 10, 182]]);
        assert_eq!(boxes(&locator, [-10.0, -1.0, 10.0, 1.0]), [[340, 178, 380, 182]]);
        assert_eq!(boxes(&locator, [170.0, -1.0, 180.0, 1.0]), [[700, 178, 720, 182]]);
        assert_eq!(boxes(&locator, [-180.0, -90.0, 180.0, 90.0]), [[0, 0, 720, 360]]);
        assert!(boxes(&locator, [0.0, 95.0, 10.0, 99.0]).is_empty());
        assert!(locator.boxes([0.0, 1.0, 0.0], [1.0, 1.0, 0.0]).is_err());
    }
    let pacific = framed(4326, [0.5, 0.0, 170.0, 0.0, -0.5, 10.0]);
    let locator = CellLocator::new(&Coordinates::LONLAT, &pacific, [40, 40, 1]).unwrap();
    assert_eq!(boxes(&locator, [175.0, -1.0, -175.0, 1.0]), [[10, 18, 30, 22]]);
    assert_eq!(boxes(&locator, [-176.0, -1.0, -175.0, 1.0]), [[28, 18, 30, 22]]);
    assert_eq!(locator.cell([-175.0, 0.25, 0.0]), Some([30.0, 19.5, 0.0]));
    assert!(boxes(&locator, [0.0, -1.0, 5.0, 1.0]).is_empty());
    // The Web Mercator square is periodic, too; a polar projection has no seam.
    let locator = CellLocator::new(&Coordinates::LONLAT, &web_mercator(8), [256, 256, 1]).unwrap();
    assert_eq!(boxes(&locator, [178.6, -1.0, -178.6, 1.0]), [[255, 127, 256, 129], [0, 127, 1, 129]]);
    let pole = framed(3413, [100_000.0, 0.0, -4_000_000.0, 0.0, -100_000.0, 4_000_000.0]);
    let locator = CellLocator::new(&Coordinates::LONLAT, &pole, [80, 80, 1]).unwrap();
    assert_eq!(boxes(&locator, [170.0, 80.0, -170.0, 85.0]).len(), 1);
    assert_eq!(boxes(&locator, [-180.0, 60.0, 180.0, 90.0]).len(), 1);
}

#[test]
fn boxes_around_points_are_found_in_cells_and_in_the_world() {
    let frame = framed(32632, [10.0, 0.0, 500_000.0, 0.0, -10.0, 5_000_000.0]);
    let extent = [100, 50, 1];
    let cells = CellLocator::new(&Coordinates::Cells, &frame, extent).unwrap();
    let found = cells.boxes([3.0, 4.0, 0.0], [7.0, 9.0, 0.0]).unwrap();
    assert_eq!((found[0].min, found[0].max), ([3, 4, 0], [7, 9, 1]));
    let world = CellLocator::new(&Coordinates::World, &frame, extent).unwrap();
    let found = world.boxes([500_030.0, 4_999_910.0, 0.0], [500_070.0, 4_999_960.0, 0.0]).unwrap();
    assert_eq!((found[0].min, found[0].max), ([3, 4, 0], [7, 9, 1]));
    assert!(world.is_inside(world.cell([500_030.0, 4_999_910.0, 0.0]).unwrap()));
    assert!(!world.is_inside(world.cell([499_999.0, 4_999_910.0, 0.0]).unwrap()));
    let nowhere = Frame { crs: None, ..frame };
    assert!(CellLocator::new(&Coordinates::LONLAT, &nowhere, extent).is_err());
    for (text, coordinates) in
        [("cells", Coordinates::Cells), ("world", Coordinates::World), ("lonlat", Coordinates::LONLAT)]
    {
        assert_eq!(text.parse::<Coordinates>().unwrap(), coordinates);
    }
    assert!("here".parse::<Coordinates>().unwrap_err().to_string().contains("cells, world, lonlat"));
}
