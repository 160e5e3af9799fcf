//! Tiles of rasters on any grid, against the nodes of warped trees.

use std::path::Path;

use spinney::raw::export::tiles::{
    TileContent, TileId, TileRange, TileSamples, TileSource, TreeTiles, WarpedTiles,
};
use spinney::raw::space::{Projection, web_mercator};
use spinney::raw::store::build_tree;
use spinney::tree::MemTree;
use spinney::{
    Code, Crs, DataKind, Dataset, Dimension, FileView, Frame, Metadata, Output, Resampling, Rule, SampleType,
    Value, ViewOperation, WarpOptions, WriteOptions, transform,
};

use crate::common::{options, quad, with};

/// Returns a fixture's own tree, and its tree on the web map grid down to a zoom.
fn native_and_warped(input: &str, way: Resampling, zoom: u8, directory: &Path) -> (Dataset, Dataset) {
    let [native, warped] = ["native.goblin", "warped.goblin"].map(|name| directory.join(name));
    let import = spinney::import::raster::plan(&[input.into()], &Default::default()).unwrap();
    import.build(Output::create(&native).unwrap(), &()).unwrap();
    let mut chain = FileView::of(&native);
    chain.steps = vec![ViewOperation::WebMercator(Some(zoom))];
    chain.warp.resampling = Some(way);
    transform(&chain, Output::create(&warped).unwrap(), WriteOptions::new(64 << 20), &()).unwrap();
    (spinney::open(native).unwrap(), spinney::open(warped).unwrap())
}

#[test]
fn tiles_of_other_grids_are_those_of_the_warped_tree() {
    let directory = tempfile::tempdir().unwrap();
    for (input, way, zoom) in [
        ("fixtures/island_classes.tif", Resampling::Nearest, 12),
        ("fixtures/island_elevation.tif", Resampling::Bilinear, 12),
        ("fixtures/island_elevation.tif", Resampling::Area, 11),
    ] {
        let (native, warped) = native_and_warped(input, way, zoom, directory.path());
        let mut options = WarpOptions::default();
        options.resampling = Some(way);
        let frame = &native.metadata().frame;
        let ours =
            WarpedTiles::new(native.whole_source().unwrap(), frame, 256, Some(zoom), &options).unwrap();
        let expected = TreeTiles::world(&warped).unwrap();
        let range = TileRange::of_degrees(zoom, ours.degrees());
        let (mut drawn, mut detailed) = (0, 0);
        for row in range.min[1] - 1..=range.max[1] {
            for column in range.min[0] - 1..=range.max[0] {
                let tile = TileId { zoom, column, row };
                let [mut a, mut b] = [TileSamples::default(), TileSamples::default()];
                ours.tile(tile, 256, 1, &mut a).unwrap();
                expected.tile(tile, 256, 1, &mut b).unwrap();
                assert!(a.valid == b.valid && a.values == b.values, "{input} {way} {tile:?}");
                // Predictions without drawing are right, and tiles beyond the borders are empty.
                let value = a.valid.contains(&true);
                match ours.content(tile).unwrap() {
                    TileContent::Empty => assert!(!a.valid[258 + 1..258 + 257].contains(&true), "{tile:?}"),
                    TileContent::Uniform(_) => assert!(value),
                    TileContent::Detail => detailed += 1,
                }
                drawn += u32::from(value);
            }
        }
        assert!(drawn > 1 && detailed > 1, "{input}: {drawn} tiles, {detailed} of them with detail");
    }
}

#[test]
fn blocks_of_other_grids_know_their_tiles() {
    let directory = tempfile::tempdir().unwrap();
    let (native, _) =
        native_and_warped("fixtures/island_classes.tif", Resampling::Nearest, 8, directory.path());
    let frame = &native.metadata().frame;
    let zoom = 13;
    let tiles =
        WarpedTiles::new(native.whole_source().unwrap(), frame, 256, Some(zoom), &WarpOptions::default())
            .unwrap();
    let projection = Projection::new(frame.crs.as_ref().unwrap(), false).unwrap();
    for cell in [[3u32, 5, 0], [100, 90, 0], [180, 60, 0]] {
        let block = Code::from_cell(Dimension::Quad, native.depth(), cell).unwrap();
        let [x, y, _] = frame.to_world([f64::from(cell[0]) + 0.5, f64::from(cell[1]) + 0.5, 0.0]);
        let [longitude, latitude] = projection.inverse([x, y]).unwrap();
        for zoom in [0, 5, zoom] {
            let there = TileRange::of_degrees(zoom, [longitude, latitude, longitude + 1e-9, latitude + 1e-9]);
            let found = tiles.tiles_of(block, zoom);
            assert_eq!(found.intersect(&there), there, "{cell:?} at zoom {zoom}");
            assert!((0..2).all(|axis| found.max[axis] - found.min[axis] <= 3), "{found:?}");
        }
    }
}

#[test]
fn archives_contain_the_bounds_of_the_data() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let form = quad(SampleType::U8, 1);
    let write = |name: &str, frame: Frame, extent: [u64; 3], has: &dyn Fn([u32; 3]) -> bool| {
        let cell = |cell: [u32; 3]| has(cell).then(|| Value::from([7u8]));
        let tree = MemTree::from_cells(form, 9, Rule::Mean, &cell);
        let metadata = Metadata { frame, ..Metadata::default() };
        let options =
            with(options(Rule::Mean, DataKind::Continuous, 9), |options| options.metadata = metadata);
        build_tree(&tree, extent, &options, Output::create(&path(name)).unwrap(), &()).unwrap();
        spinney::open(path(name)).unwrap()
    };
    // Data extents in the world square: a box; both sides of the 180th meridian; the full circle.
    let all = [512, 512, 1];
    let place_of = |map: &Dataset| TreeTiles::world(map).unwrap().data_place().unwrap();
    let east = write("east.goblin", web_mercator(9), all, &|[x, y, _]| {
        (384..400).contains(&x) && (256..272).contains(&y)
    });
    let place = place_of(&east);
    assert_eq!([place.bounds[0], place.bounds[2], place.bounds[3]], [90.0, 101.25, 0.0]);
    assert_eq!(place.centre[0], 95.625);
    assert!(
        (-11.3..-11.1).contains(&place.bounds[1]) && (-5.7..-5.5).contains(&place.centre[1]),
        "{place:?}"
    );
    let fiji = write("fiji.goblin", web_mercator(9), all, &|[x, y, _]| {
        !(16..480).contains(&x) && (256..272).contains(&y)
    });
    let place = place_of(&fiji);
    assert_eq!((place.bounds[0], place.bounds[2]), (-180.0, 180.0));
    assert!((place.centre[0] - 173.0).abs() < 8.0 || place.centre[0] < -173.0, "{place:?}");
    let round = write("round.goblin", web_mercator(9), all, &|[_, y, _]| (256..272).contains(&y));
    assert_eq!(place_of(&round).centre[0], 0.0);
    // A raster that continues beyond the antimeridian.
    let frame = Frame { crs: Some(Crs::epsg(4326)), ..Frame::planar([0.05, 0.0, 175.0, 0.0, -0.05, -10.0]) };
    let pacific = write("pacific.goblin", frame.clone(), [200, 100, 1], &|[x, y, _]| x < 200 && y < 100);
    let tiles =
        WarpedTiles::new(pacific.whole_source().unwrap(), &frame, 256, Some(4), &WarpOptions::default())
            .unwrap();
    let place = tiles.data_place().unwrap();
    assert_eq!((place.bounds[0], place.bounds[2]), (-180.0, 180.0));
    assert!(
        (place.centre[0].abs() - 180.0).abs() < 1e-9 && (place.centre[1] + 12.5).abs() < 0.1,
        "{place:?}"
    );
}
