//! 3D Tiles of exact models: structure, contents and positions.

use super::*;

/// A tile whose transforms have been applied.
struct Tile {
    depth: usize,
    error: f64,
    bounds: [Point; 2],
    is_leaf: bool,
    triangles: Vec<[Point; 3]>,
}

/// Reads a tile and all tiles below it.
fn read_tile(
    directory: &Path,
    tile: &Json,
    (depth, origin): (usize, Point),
    above: Option<&(f64, [Point; 2])>,
    found: &mut (Vec<Tile>, BTreeSet<PathBuf>),
) {
    let number = |json: &Json, at: usize| json[at].as_f64().unwrap();
    let matrix = &tile["transform"];
    let linear = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let origin = match matrix.is_null() {
        true => origin,
        false => {
            assert!((0..12).all(|at| number(matrix, at) == linear[at]), "{matrix}");
            add(origin, [12, 13, 14].map(|at| number(matrix, at)))
        }
    };
    let shape = &tile["boundingVolume"]["box"];
    let centre = add(origin, [0, 1, 2].map(|at| number(shape, at)));
    let half = [3, 7, 11].map(|at| number(shape, at));
    let bounds =
        [[0, 1, 2].map(|axis| centre[axis] - half[axis]), [0, 1, 2].map(|axis| centre[axis] + half[axis])];
    let error = tile["geometricError"].as_f64().unwrap();
    // (Sums of origins are rounded.)
    const ROUNDED: f64 = 1e-6;
    if let Some((error_above, [low, high])) = above {
        assert!(error <= *error_above, "{error} below {error_above}");
        let is_in = (0..3)
            .all(|axis| low[axis] - ROUNDED <= bounds[0][axis] && bounds[1][axis] <= high[axis] + ROUNDED);
        assert!(is_in, "{bounds:?} in {low:?} to {high:?}");
    }
    let mut triangles = Vec::new();
    if let Some(name) = tile["content"]["uri"].as_str() {
        let path = directory.join(name);
        triangles = Read::of(&path).triangles;
        triangles.as_flattened_mut().iter_mut().for_each(|point| *point = add(*point, origin));
        for point in triangles.as_flattened() {
            let is_in = (0..3).all(|axis| {
                bounds[0][axis] - ROUNDED <= point[axis] && point[axis] <= bounds[1][axis] + ROUNDED
            });
            assert!(is_in, "{name}: {point:?} in {bounds:?}");
        }
        assert!(found.1.insert(path), "{name} is used twice");
    }
    assert!(tile["refine"].is_null() || tile["refine"] == "REPLACE");
    let children = tile["children"].as_array().map_or(&[][..], Vec::as_slice);
    found.0.push(Tile { depth, error, bounds, is_leaf: children.is_empty(), triangles });
    for child in children {
        read_tile(directory, child, (depth + 1, origin), Some(&(error, bounds)), found);
    }
}

/// Writes and reads a tileset, and checks its structure.
fn tiles_of(model: &ExactModel, directory: &Path) -> (Json, Vec<Tile>) {
    let output = OutputDirectory::create(directory).unwrap();
    let summary = export_model_tileset(model, &GltfOptions::new(), output, MEMORY, &()).unwrap();
    let json: Json = serde_json::from_slice(&std::fs::read(directory.join("tileset.json")).unwrap()).unwrap();
    assert_eq!((&json["asset"]["version"], &json["root"]["refine"]), (&"1.1".into(), &"REPLACE".into()));
    let mut found = (Vec::new(), BTreeSet::new());
    read_tile(directory, &json["root"], (0, [0.0; 3]), None, &mut found);
    let (tiles, files) = found;
    assert!(json["geometricError"].as_f64().unwrap() >= tiles[0].error);
    // No other files.
    let mut there = BTreeSet::new();
    let mut pending = vec![directory.to_path_buf()];
    while let Some(directory) = pending.pop() {
        for entry in std::fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => pending.push(path),
                false => assert!(there.insert(path)),
            }
        }
    }
    assert!(there.remove(&directory.join("tileset.json")));
    assert_eq!(there, files);
    assert_eq!(summary.tiles, files.len() as u64);
    assert!(tiles.iter().all(|tile| tile.triangles.len() <= 1 << 15));
    let triangles: usize = tiles.iter().map(|tile| tile.triangles.len()).sum();
    assert_eq!(summary.triangles, triangles as u64);
    (json, tiles)
}

/// A slab of 2n x 2n triangles on either side and a distant box. Upper vertices alternate around
/// the middle of the grid, so that exact triangles have their centroids below it, and some coarse
/// ones above.
fn slab(n: i32) -> FaceList {
    let mut list = FaceList::new(grid([0; 3], 0.001, 16), vec!["slab".into(), "box".into()]);
    let width = 30_000 / n;
    let upper = |i: i32, j: i32| {
        let is_inside = 0 < i && i < n && 0 < j && j < n;
        let shift = if is_inside && (i + j) % 3 == 0 { 60 } else { -98 };
        [i * width, j * width, (1 << 15) + shift]
    };
    let lower = |i: i32, j: i32| [i * width, j * width, 0];
    let mut add = |a: [i32; 3], b: [i32; 3], c: [i32; 3], d: [i32; 3]| {
        push(&mut list, &[vec![a, b, c]], 0, None);
        push(&mut list, &[vec![a, c, d]], 0, None);
    };
    for i in 0..n {
        for j in 0..n {
            add(upper(i, j), upper(i + 1, j), upper(i + 1, j + 1), upper(i, j + 1));
            add(lower(i, j + 1), lower(i + 1, j + 1), lower(i + 1, j), lower(i, j));
        }
        add(lower(i, 0), lower(i + 1, 0), upper(i + 1, 0), upper(i, 0));
        add(lower(i + 1, n), lower(i, n), upper(i, n), upper(i + 1, n));
        add(lower(0, i + 1), lower(0, i), upper(0, i), upper(0, i + 1));
        add(lower(n, i), lower(n, i + 1), upper(n, i + 1), upper(n, i));
    }
    for face in cuboid([64_900; 3], [65_400; 3]) {
        push(&mut list, &face, 1, None);
    }
    list
}

#[test]
fn tiles_have_every_level_within_their_boxes() {
    check_tiles(&bumpy_torus(250, 180, grid([0; 3], 0.001, 16)));
}

#[test]
fn distant_objects_do_not_make_large_tiles() {
    let mut list = bumpy_torus(210, 150, grid([0; 3], 0.001, 20));
    for face in cuboid([1_000_000; 3], [1_000_100; 3]) {
        push(&mut list, &face, 0, None);
    }
    let directory = tempfile::tempdir().unwrap();
    let (plain, path) = (file_of(&list), directory.path().join("levels.goblin"));
    add_levels(&plain, (Output::create(&path).unwrap(), plain.codec()), MEMORY, &()).unwrap();
    let levels = ExactModel::open(&path, &OpenOptions::new()).unwrap();
    for (model, name) in [(&plain, "without"), (&levels, "with")] {
        let (json, tiles) = tiles_of(model, &directory.path().join(name));
        // Without levels, the root has no content.
        assert_eq!(json["root"]["content"].is_null(), model.levels().is_empty());
        let leaves = || tiles.iter().filter(|tile| tile.is_leaf);
        assert!(leaves().all(|tile| tile.error == 0.0 && tile.depth == 1));
        let count: usize = leaves().map(|tile| tile.triangles.len()).sum();
        assert_eq!(count as u64, Triangulated::of(&list).unwrap().len());
    }
}

#[test]
fn tiles_above_cells_without_exact_faces_are_replaced() {
    let empty = check_tiles(&slab(156));
    assert!(empty > 0);
}

/// Checks the tiles of a model with levels. Returns the number of empty leaves.
fn check_tiles(list: &FaceList) -> usize {
    let directory = tempfile::tempdir().unwrap();
    let plain = file_of(list);
    let path = directory.path().join("levels.goblin");
    add_levels(&plain, (Output::create(&path).unwrap(), plain.codec()), MEMORY, &()).unwrap();
    let model = ExactModel::open(&path, &OpenOptions::new()).unwrap();
    let levels = model.levels();
    let (json, tiles) = tiles_of(&model, &directory.path().join("tiles"));
    assert!(json["asset"]["extras"].is_null());
    let first = levels.iter().rposition(|level| level.faces <= 20_000).unwrap();
    let depths = levels.len() - first;
    assert!(depths >= 3, "{depths}");
    for (depth, level) in levels[first..].iter().enumerate() {
        let here = || tiles.iter().filter(|tile| tile.depth == depth);
        let count: usize = here().map(|tile| tile.triangles.len()).sum();
        let surface = model.surface(SurfaceDetail::Level((first + depth) as u8), None, &()).unwrap();
        let surface = Triangulated::of(&surface).unwrap();
        assert_eq!(count as u64, surface.len(), "depth {depth}");
        let mut expected = 0.0;
        surface
            .each(&mut |face| {
                let corner = |at: usize| model.grid().to_world(face.points[at]);
                expected += double_area([0, 1, 2].map(corner)) / 2.0;
                Ok(())
            })
            .unwrap();
        let found = area(here().flat_map(|tile| tile.triangles.iter().copied()));
        assert!((found - expected).abs() < 1e-5 * expected, "depth {depth}: {found}, expected {expected}");
        let error = level.error * model.grid().width();
        let has_error = |tile: &Tile| (tile.error - error).abs() <= 1e-9 * error;
        assert!(here().all(|tile| has_error(tile) || tile.triangles.is_empty()), "depth {depth}");
    }
    let leaves = || tiles.iter().filter(|tile| tile.is_leaf);
    let early: Vec<_> = leaves().filter(|tile| tile.error != 0.0).map(|tile| tile.bounds).collect();
    assert!(early.is_empty(), "leaves with an error: {early:?}");
    let count: usize = leaves().map(|tile| tile.triangles.len()).sum();
    assert_eq!(count as u64, Triangulated::of(&model).unwrap().len());
    let all: Vec<_> = leaves().flat_map(|tile| tile.triangles.iter().copied()).collect();
    assert!((six_volumes(&all) / 6.0 - volume(&model)).abs() < 1e-5 * volume(&model));
    // Errors are in metres, as coordinates are.
    for (unit, crs, metres) in [(Some("mm"), None, 0.001), (None, Some(2263), 1200.0 / 3937.0)] {
        let moved = placed(&plain, directory.path(), unit, crs.map(Crs::epsg));
        let path = directory.path().join("moved.goblin");
        add_levels(&moved, (Output::create(&path).unwrap(), moved.codec()), MEMORY, &()).unwrap();
        let moved = ExactModel::open(&path, &OpenOptions::new()).unwrap();
        let tiles = directory.path().join(format!("tiles {metres}"));
        let (_, tiles) = tiles_of(&moved, &tiles);
        let expected = moved.levels()[first].error * moved.grid().width() * metres;
        assert!((tiles[0].error - expected).abs() < 1e-9 * expected, "{unit:?} {crs:?}");
        for name in ["placed.goblin", "moved.goblin"] {
            std::fs::remove_file(directory.path().join(name)).unwrap();
        }
    }
    leaves().filter(|tile| tile.triangles.is_empty()).count()
}

#[test]
fn tiles_are_on_the_globe() {
    // Corners of a box of 1000 x 1000 x 10 m in EPSG:28992, as PROJ 9 computes them with
    // EPSG:15934's seven parameters, which keep heights.
    const EXPECTED: [Point; 8] = [
        [3888259.18211, 332519.08030, 5028033.52724],
        [3888168.48594, 333515.02965, 5028037.67152],
        [3887470.59007, 332444.72656, 5028644.06099],
        [3887379.89360, 333440.67559, 5028648.20551],
        [3888265.26541, 332519.60053, 5028041.44702],
        [3888174.56909, 333515.55144, 5028045.59130],
        [3887476.67213, 332445.24668, 5028651.98172],
        [3887385.97552, 333441.19726, 5028656.12625],
    ];
    let directory = tempfile::tempdir().unwrap();
    let mut list = FaceList::new(grid([121_000, 487_000, 0], 1.0, 10), vec!["box".into()]);
    for face in cuboid([0; 3], [1000, 1000, 10]) {
        push(&mut list, &face, 0, None);
    }
    let model = placed(&file_of(&list), directory.path(), None, Some(Crs::epsg(28992)));
    let (json, tiles) = tiles_of(&model, &directory.path().join("tiles"));
    assert!(json["asset"]["extras"]["note"].as_str().unwrap().contains("EPSG:4978"), "{json}");
    assert_eq!((tiles.len(), tiles[0].triangles.len()), (1, 12));
    let mut seen = BTreeSet::new();
    for point in tiles[0].triangles.as_flattened() {
        let distances = EXPECTED.map(|expected| distance(expected, *point));
        let nearest = (0..8).min_by(|a, b| distances[*a].total_cmp(&distances[*b])).unwrap();
        assert!(distances[nearest] < 1e-3, "{point:?} is {} m off", distances[nearest]);
        seen.insert(nearest);
    }
    assert_eq!(seen.len(), 8);
    // In millimetres, without a coordinate system.
    let model = file_of(&list);
    std::fs::remove_file(directory.path().join("placed.goblin")).unwrap();
    let local = placed(&model, directory.path(), Some("mm"), None);
    let (json, tiles) = tiles_of(&local, &directory.path().join("local"));
    assert!(json["asset"]["extras"].is_null());
    assert!(distance(tiles[0].bounds[0], [121.0, 487.0, 0.0]) < 1e-3, "{:?}", tiles[0].bounds);
}

#[test]
fn units_and_systems_of_all_kinds_lead_to_the_globe() {
    // Corners of the geographic box in EPSG:4978, as PROJ 9 computes them.
    const LOW: Point = [4405237.54067, 540895.15710, 4565247.54083];
    const HIGH: Point = [4405155.63417, 540963.14400, 4565331.94585];
    let directory = tempfile::tempdir().unwrap();
    let placed_at = |list: &FaceList, unit: Option<&str>, crs: u32| {
        let model = placed(&file_of(list), directory.path(), unit, Some(Crs::epsg(crs)));
        let tiles = directory.path().join(format!("{crs}{}", unit.unwrap_or_default()));
        let (json, tiles) = tiles_of(&model, &tiles);
        std::fs::remove_file(directory.path().join("placed.goblin")).unwrap();
        let note = json["asset"]["extras"]["note"].as_str().unwrap().to_owned();
        assert!(note.contains("are in EPSG:4978"), "{note}");
        tiles[0].triangles.as_flattened().to_vec()
    };
    let has =
        |points: &[Point], expected: Point| points.iter().any(|point| distance(*point, expected) < 2e-3);
    for (crs, unit) in [(4326, None), (4979, None), (4979, Some("m")), (4937, None)] {
        let points = placed_at(&geographic_box(), unit, crs);
        assert!(has(&points, LOW) && has(&points, HIGH), "EPSG:{crs}: {points:?}");
    }
    // Geocentric coordinates are unchanged.
    let grid =
        Grid { bits: 12, origin: [3_888_000_000, 332_000_000, 5_028_000_000], step: 1.0, divisor: 1000.0 };
    let mut list = FaceList::new(grid.clone(), vec!["box".into()]);
    for face in cuboid([0; 3], [2000, 3000, 4000]) {
        push(&mut list, &face, 0, None);
    }
    let points = placed_at(&list, None, 4978);
    assert!(
        has(&points, [3_888_000.0, 332_000.0, 5_028_000.0])
            && has(&points, [3_888_002.0, 332_003.0, 5_028_004.0])
    );
    // The same box in metres and in millimetres, in a system in metres.
    let small = |divisor| {
        let grid = Grid { bits: 12, origin: [121_000_000, 487_000_000, 0], step: 1.0, divisor };
        let mut list = FaceList::new(grid, vec!["box".into()]);
        for face in cuboid([0; 3], [2000, 3000, 4000]) {
            push(&mut list, &face, 0, None);
        }
        list
    };
    let metres = placed_at(&small(1000.0), None, 28992);
    let millimetres = placed_at(&small(1.0), Some("mm"), 28992);
    assert!(metres.iter().all(|point| has(&millimetres, *point)), "{metres:?}, {millimetres:?}");
}

#[test]
fn tilesets_are_refused_or_advised() {
    let directory = tempfile::tempdir().unwrap();
    let model = file_of(&boxes(grid([0; 3], 0.125, 12)));
    let tiles = directory.path().join("tiles");
    let (_, found) = tiles_of(&model, &tiles);
    assert!(found.len() == 1 && found[0].is_leaf && found[0].error == 0.0);
    let names: Vec<Json> = model.parts().iter().map(|name| name.as_str().into()).collect();
    assert_eq!(Read::of(&tiles.join("content/0/1.glb")).table()["name"], names);
    let bytes = std::fs::read(tiles.join("tileset.json")).unwrap();
    let error = OutputDirectory::create(&tiles)
        .and_then(|output| export_model_tileset(&model, &GltfOptions::new(), output, MEMORY, &()))
        .unwrap_err()
        .to_string();
    assert!(error.contains("not empty"), "{error}");
    assert_eq!(std::fs::read(tiles.join("tileset.json")).unwrap(), bytes);
    let large = file_of(&bumpy_torus(360, 280, grid([0; 3], 0.001, 16)));
    let output = OutputDirectory::create(&directory.path().join("large")).unwrap();
    let error =
        export_model_tileset(&large, &GltfOptions::new(), output, MEMORY, &()).unwrap_err().to_string();
    assert!(error.contains("without levels") && error.contains("spinney transform FILE levels"), "{error}");
    let names = std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(names.collect::<Vec<_>>(), ["tiles"]);
}
