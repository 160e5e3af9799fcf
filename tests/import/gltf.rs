//! Octrees as 3D Tiles and binary glTF, against meshes exported from the same trees.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

use serde_json::Value as Json;
use spinney::export::{GltfOptions, MeshRequest, export_glb, export_tileset};
use spinney::raw::export::mesh::{TilesetSummary, surface_mesh};
use spinney::raw::io::OutputDirectory;
use spinney::raw::store::{build_tree, depth_for};
use spinney::raw::value::Palette;
use spinney::{Crs, DataKind, Dataset, Error, Frame, Metadata, Output, Progress, Rule, SampleType, Value};

use crate::common::gltf_file::{Glb, Mesh, TilePosition, Tiles};
use crate::common::mesh_file::{cross, dot};
use crate::common::{Cells, OCT, QUAD, byte, dataset, made, oct, opened, options, value, with};

/// Requests the smooth surface, or the cells' faces.
fn request(smooth: bool) -> MeshRequest {
    with(MeshRequest::new(), |it| it.smooth = smooth)
}

fn tree_with(cells: &Cells, rule: Rule, kind: DataKind, metadata: Metadata) -> Dataset {
    let depth = depth_for(cells.size);
    opened(|path| {
        let options = options(rule, kind, depth).metadata(metadata);
        build_tree(
            &cells.tree_of_depth(depth, rule),
            cells.size,
            &options,
            Output::create(path).unwrap(),
            &(),
        )
        .unwrap();
    })
}

/// A ball and some isolated cells, in a space of several tile levels.
fn balls(side: u64) -> Cells {
    let centre = side as f64 / 2.0 + 0.3;
    made(OCT, [side; 3], |cell| {
        let distance: f64 = cell.iter().map(|at| (*at as f64 + 0.5 - centre).powi(2)).sum();
        let radius = side as f64 * 0.45;
        let is_alone = cell.iter().all(|at| at % 61 == 0) || cell == [side - 1; 3];
        (distance < radius * radius || is_alone).then(|| byte(255))
    })
}

fn write_tileset(tree: &Dataset, request: &MeshRequest, directory: &Path) -> TilesetSummary {
    let output = OutputDirectory::create(directory).unwrap();
    export_tileset(tree, request, &GltfOptions::new(), output, &()).unwrap()
}

fn read_json(path: &Path) -> Json {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Returns all files below a directory with their bytes.
fn files(directory: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut pending = vec![directory.to_path_buf()];
    while let Some(path) = pending.pop() {
        if path.is_dir() {
            pending.extend(std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
        } else {
            let name = path.strip_prefix(directory).unwrap().to_str().unwrap().to_owned();
            files.insert(name, std::fs::read(path).unwrap());
        }
    }
    files
}

/// Returns triangle vertices on the lattice of a level whose cells have the given side: 512 lattice
/// units per cell.
fn on_lattice<'a>(
    meshes: impl IntoIterator<Item = &'a Mesh>,
    cell: f64,
) -> impl Iterator<Item = [[i64; 3]; 3]> {
    let step = move |at: f64| {
        let steps = at / cell * 512.0;
        assert_eq!(steps, steps.round());
        steps as i64
    };
    meshes.into_iter().flat_map(move |mesh| {
        mesh.triangles.iter().map(move |triangle| triangle.map(|corner| mesh.corners[corner].at.map(step)))
    })
}

/// Checks that triangles form a closed surface, and that edges of smooth surfaces have two of them.
/// Returns six times their volume in cubic lattice units.
fn check_closed(triangles: impl Iterator<Item = [[i64; 3]; 3]>, smooth: bool, what: &str) -> i128 {
    let mut edges: HashMap<_, (i32, usize)> = HashMap::new();
    let mut volume = 0i128;
    for [a, b, c] in triangles {
        assert!(a != b && b != c && c != a, "{what}");
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (balance, count) = edges.entry((from.min(to), from.max(to))).or_default();
            *balance += if from < to { 1 } else { -1 };
            *count += 1;
        }
        let [a, b, c] = [a, b, c].map(|point| point.map(i128::from));
        volume += a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0]);
    }
    let open = edges.values().filter(|(balance, _)| *balance != 0).count();
    assert!(!smooth || edges.values().all(|(_, count)| *count == 2), "{what}: edges with several faces");
    assert_eq!(open, 0, "{what}: {open} of {} edges are open", edges.len());
    volume
}

/// Checks a tileset of one unit per cell against the tree. Returns its tiles.
fn check_tileset(tree: &Dataset, smooth: bool, what: &str) -> Tiles {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path().join("tiles");
    let summary = write_tileset(tree, &request(smooth), &directory);
    let tileset = read_json(&directory.join("tileset.json"));
    let tiles = Tiles::read(&directory, &tileset);
    // Files and listed contents are the same sets.
    let name = |[level, x, y, z]: TilePosition| format!("content/{level}/{x}/{y}/{z}.glb");
    let contents: BTreeSet<TilePosition> =
        tiles.tiles.iter().filter(|(_, has)| **has).map(|(tile, _)| *tile).collect();
    let mut expected: BTreeSet<String> = contents.iter().map(|tile| name(*tile)).collect();
    expected.extend(tiles.files.iter().cloned());
    expected.insert("tileset.json".into());
    assert_eq!(files(&directory).into_keys().collect::<BTreeSet<_>>(), expected, "{what}");
    assert_eq!(summary.tiles, contents.len() as u64, "{what}");
    let levels = tileset["root"]["children"][0]["implicitTiling"]["availableLevels"].as_u64().unwrap() as u32;
    assert_eq!(u32::from(summary.levels), levels);
    // Every tile has content or descendants with content.
    for (tile, has_content) in &tiles.tiles {
        let [level, x, y, z] = *tile;
        let is_parent = (0..8).any(|step: u32| {
            let [x, y, z] = [x << 1 | step & 1, y << 1 | step >> 1 & 1, z << 1 | step >> 2];
            tiles.tiles.contains_key(&[level + 1, x, y, z])
        });
        assert!(*has_content || is_parent || level == 0, "{what}: {tile:?}");
    }
    let depth = u32::from(tree.depth());
    let mut triangles = 0;
    for level in 0..levels {
        let cell = f64::from(1u32 << (levels - 1 - level));
        assert_eq!(
            tileset["root"]["children"][0]["geometricError"].as_f64().unwrap() / f64::from(1u32 << level),
            cell
        );
        let mut meshes = Vec::new();
        for tile in contents.iter().filter(|tile| tile[0] == level) {
            let glb = Glb::read(&directory.join(name(*tile)));
            // With y upwards.
            let turned = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
            assert_eq!(glb.matrix, turned);
            let side = f64::from(1u32 << (depth - level));
            let [_, at @ ..] = *tile;
            let (centre, half) = match tiles.boxes.get(tile) {
                Some([centre, half]) => (*centre, *half),
                None => (at.map(|at| (f64::from(at) + 0.5) * side), [side / 2.0; 3]),
            };
            let all = &tileset["root"]["boundingVolume"]["box"];
            let all = |at: usize| all[at].as_f64().unwrap();
            for mesh in &glb.meshes {
                for corner in &mesh.corners {
                    for axis in 0..3 {
                        assert!((corner.at[axis] - all(axis)).abs() <= all(3 + 4 * axis), "{what}: {tile:?}");
                        assert!((corner.at[axis] - centre[axis]).abs() <= half[axis], "{what}: {tile:?}");
                    }
                }
            }
            triangles += glb.meshes.iter().map(|mesh| mesh.triangles.len() as u64).sum::<u64>();
            meshes.extend(glb.meshes);
        }
        let volume = check_closed(on_lattice(&meshes, cell), smooth, &format!("{what}, level {level}"));
        // The whole mesh exported at the same level.
        let cells = tree.depth() - (levels - 1 - level) as u8;
        let whole = surface_mesh(tree, &with(request(smooth), |it| it.level = Some(cells)), &()).unwrap();
        let corners = whole.triangles.iter().map(|it| it.map(|corner| whole.vertices[corner as usize]));
        let expected: f64 = corners.map(|[a, b, c]| dot(a, cross(b, c))).sum();
        let found = volume as f64 / 512f64.powi(3) * cell.powi(3);
        // Vertices of smooth surfaces are rounded to the lattice.
        let rounding = whole.triangles.len() as f64 * 3.0 / 1024.0 * cell.powi(3);
        let tolerance = if smooth { rounding } else { 1e-9 * expected.abs() };
        assert!((found - expected).abs() <= tolerance, "{what}, level {level}: {found}, not {expected}");
        if smooth {
            // Slivers may be omitted.
            let (found, all) =
                (meshes.iter().map(|mesh| mesh.triangles.len()).sum::<usize>(), whole.triangles.len());
            assert!(found <= all && found * 100 >= all * 95, "{what}, level {level}: {found} of {all}");
        }
    }
    assert_eq!(triangles, summary.triangles);
    // A bounding box contains those of all descendants.
    for (tile, [centre, half]) in tiles.boxes.iter().filter(|(tile, _)| tile[0] > 0) {
        let [level, x, y, z] = *tile;
        let [above, outer] = tiles.boxes[&[level - 1, x / 2, y / 2, z / 2]];
        for axis in 0..3 {
            assert!((centre[axis] - above[axis]).abs() + half[axis] <= outer[axis], "{what}: {tile:?}");
        }
    }
    tiles
}

#[test]
fn tiles_of_each_level_meet_and_enclose_the_solid() {
    let tree = dataset(&balls(140), Rule::Occupancy, DataKind::Continuous);
    for smooth in [false, true] {
        let tiles = check_tileset(&tree, smooth, &format!("balls, smooth {smooth}"));
        assert_eq!(tiles.boxes.is_empty(), !smooth);
        assert_eq!(tiles.files.len(), 1);
    }
    // A full space, whose surface is the border of the space.
    let full = dataset(&made(OCT, [96; 3], |_| Some(byte(255))), Rule::Occupancy, DataKind::Continuous);
    for smooth in [false, true] {
        check_tileset(&full, smooth, &format!("full, smooth {smooth}"));
    }
    // Smaller than a tile.
    let small = dataset(&Cells::random(OCT, 3, [9, 4, 7], 2, true), Rule::Max, DataKind::Categorical);
    for smooth in [false, true] {
        check_tileset(&small, smooth, &format!("small, smooth {smooth}"));
    }
}

#[test]
fn random_solids_are_closed_at_every_level() {
    for seed in 0..3 {
        let cells = Cells::random(OCT, seed, [67, 30 + seed, 66], 4, true);
        let tree = dataset(&cells, Rule::Majority, DataKind::Categorical);
        for smooth in [false, true] {
            check_tileset(&tree, smooth, &format!("seed {seed}, smooth {smooth}"));
        }
    }
}

#[test]
fn subtrees_below_subtrees() {
    // Five levels of tiles: those of the last are roots of their own subtrees.
    let cells = made(OCT, [1024, 8, 4], |[x, y, z]| (x % 100 < 3 && y < 6 && z < 3).then(|| byte(255)));
    let tree = dataset(&cells, Rule::Occupancy, DataKind::Continuous);
    let tiles = check_tileset(&tree, false, "long");
    assert_eq!(tiles.files.len(), 1 + tiles.tiles.keys().filter(|tile| tile[0] == 4).count());
    check_tileset(&tree, true, "long and smooth");
}

#[test]
fn an_empty_tree_has_a_root() {
    let cells = made(OCT, [100; 3], |_| None);
    let tree = dataset(&cells, Rule::Occupancy, DataKind::Continuous);
    let tiles = check_tileset(&tree, false, "empty");
    assert_eq!(tiles.tiles, BTreeMap::from([([0; 4], false)]));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("empty.glb");
    let classes = dataset(&cells, Rule::Majority, DataKind::Categorical);
    for (tree, smooth) in [(&tree, false), (&tree, true), (&classes, false), (&classes, true)] {
        let output = Output::create(&path).unwrap();
        assert_eq!(export_glb(tree, &request(smooth), &GltfOptions::new(), output, &()).unwrap(), 0);
        assert!(Glb::read(&path).meshes.is_empty());
    }
}

#[test]
fn models_have_no_parts_without_triangles() {
    // A full tile, whose surface in the first of its cells belongs to it, and the tiles after it,
    // most of which have no surface.
    let cells = made(OCT, [192; 3], |cell| cell.iter().all(|at| *at < 128).then(|| byte(255)));
    let tree = dataset(&cells, Rule::Occupancy, DataKind::Continuous);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("cube.glb");
    for smooth in [false, true] {
        let output = Output::create(&path).unwrap();
        let count = export_glb(&tree, &request(smooth), &GltfOptions::new(), output, &()).unwrap();
        let meshes = Glb::read(&path).meshes;
        assert!(meshes.iter().all(|mesh| !mesh.triangles.is_empty()));
        assert_eq!(meshes.iter().map(|mesh| mesh.triangles.len() as u64).sum::<u64>(), count);
        // All vertices are used by triangles.
        for mesh in meshes {
            let used: BTreeSet<usize> = mesh.triangles.iter().flatten().copied().collect();
            assert_eq!(used.len(), mesh.corners.len());
        }
    }
}

#[test]
fn normals_point_out_of_the_solid() {
    let side = 100;
    let cells = balls(side);
    let tree = dataset(&cells, Rule::Occupancy, DataKind::Continuous);
    let directory = tempfile::tempdir().unwrap();
    for smooth in [false, true] {
        let path = directory.path().join("ball.glb");
        let output = Output::create(&path).unwrap();
        let count = export_glb(&tree, &request(smooth), &GltfOptions::new(), output, &()).unwrap();
        let glb = Glb::read(&path);
        let centre = side as f64 / 2.0 + 0.3;
        let (mut seen, mut triangles) = (0, 0);
        for mesh in &glb.meshes {
            triangles += mesh.triangles.len();
            for corner in &mesh.corners {
                let length = dot(corner.normal, corner.normal).sqrt();
                assert!((length - 1.0).abs() < 0.02);
                let out = corner.at.map(|at| at - centre);
                let distance = dot(out, out).sqrt();
                if (distance - 45.0).abs() < 3.0 {
                    seen += 1;
                    let cosine = dot(out, corner.normal) / distance;
                    // Normals of cell faces are parallel to an axis.
                    let least = if smooth { 0.8 } else { -0.05 };
                    assert!(cosine > least, "{:?}: {:?}", corner.at, corner.normal);
                }
            }
            // Triangles are oriented like their normals.
            for triangle in &mesh.triangles {
                let [a, b, c] = triangle.map(|corner| mesh.corners[corner]);
                let minus = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|axis| a[axis] - b[axis]);
                let flat = cross(minus(b.at, a.at), minus(c.at, a.at));
                if !smooth {
                    assert!(dot(flat, a.normal) > 0.0);
                }
            }
        }
        assert!(seen > 10_000, "{seen}");
        assert_eq!(triangles as u64, count);
    }
}

#[test]
fn classes_are_features_and_colours_are_per_vertex() {
    let cells =
        made(OCT, [80, 20, 20], |[x, y, _]| (y < 15).then(|| value(OCT.value, if x < 70 { 3 } else { 7 })));
    let mut colours = vec![[0u8; 4]; 256];
    (colours[3], colours[7]) = ([255, 0, 0, 255], [0, 188, 255, 255]);
    let metadata = Metadata {
        palette: Some(Palette { colours }),
        class_names: [(3.into(), "meadow".to_owned()), (7.into(), "Wald \u{e4}".to_owned())].into(),
        ..Metadata::default()
    };
    let tree = tree_with(&cells, Rule::Majority, DataKind::Categorical, metadata);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("classes.glb");
    for smooth in [false, true] {
        export_glb(&tree, &request(smooth), &GltfOptions::new(), Output::create(&path).unwrap(), &())
            .unwrap();
        let glb = Glb::read(&path);
        let table = &glb.json["extensions"]["EXT_structural_metadata"]["propertyTables"][0];
        assert_eq!(table["count"], 2);
        let column = |name: &str, part: &str| glb.view(&table["properties"][name][part]).to_vec();
        assert_eq!(column("value", "values"), [3, 0, 0, 0, 7, 0, 0, 0]);
        assert_eq!(column("name", "values"), "meadowWald \u{e4}".as_bytes());
        assert_eq!(column("name", "stringOffsets"), [0, 0, 0, 0, 6, 0, 0, 0, 13, 0, 0, 0]);
        let corners = glb.meshes.iter().flat_map(|mesh| &mesh.corners);
        let mut seen = [0; 2];
        for corner in corners {
            let class = usize::from(corner.class.unwrap());
            seen[class] += 1;
            // 188 in sRGB is half as bright as 255.
            let colour = [[1.0, 0.0, 0.0], [0.0, 0.5, 1.0]][class];
            let found = corner.colour.unwrap();
            assert!((0..3).all(|axis| (found[axis] - colour[axis]).abs() < 0.01), "{found:?}");
            let edge = if smooth { 1.0 } else { 0.0 };
            assert!(if class == 0 { corner.at[0] <= 70.0 + edge } else { corner.at[0] >= 70.0 - edge });
        }
        assert!(seen.iter().all(|seen| *seen > 0));
    }
    // Colours of cells.
    let cells = made(oct(SampleType::U8, 3), [10; 3], |_| Some(Value::from([255u8, 188, 0])));
    let tree = dataset(&cells, Rule::Mean, DataKind::Continuous);
    export_glb(&tree, &request(false), &GltfOptions::new(), Output::create(&path).unwrap(), &()).unwrap();
    let glb = Glb::read(&path);
    let colour = glb.meshes[0].corners[0].colour.unwrap();
    assert!((colour[0], colour[2]) == (1.0, 0.0) && (colour[1] - 0.5).abs() < 0.01);
}

#[test]
fn files_do_not_depend_on_threads() {
    let tree = dataset(&balls(200), Rule::Occupancy, DataKind::Continuous);
    let directory = tempfile::tempdir().unwrap();
    let written = [1, 2, 5].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (tiles, glb) = (directory.path().join(format!("{threads}")), directory.path().join("x.glb"));
        pool.install(|| {
            write_tileset(&tree, &request(true), &tiles);
            let output = Output::create(&glb).unwrap();
            export_glb(&tree, &request(true), &GltfOptions::new(), output, &()).unwrap();
        });
        (files(&tiles), std::fs::read(glb).unwrap())
    });
    assert!(written[0] == written[1] && written[1] == written[2]);
}

#[test]
fn known_systems_are_put_onto_the_globe() {
    let cells = made(OCT, [100; 3], |[_, _, z]| (z < 50).then(|| byte(255)));
    let mut frame = Frame::planar([2.0, 0.0, 500_000.0, 0.0, 2.0, 5_150_000.0]);
    (frame.matrix[2][2], frame.matrix[2][3]) = (2.0, 1000.0);
    frame.crs = Some(Crs::epsg(32632));
    let metadata = Metadata { frame, ..Metadata::default() };
    let tree = tree_with(&cells, Rule::Occupancy, DataKind::Continuous, metadata);
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path().join("tiles");
    let summary = write_tileset(&tree, &request(false), &directory);
    assert!(summary.deviation.unwrap() < 0.01);
    let tileset = read_json(&directory.join("tileset.json"));
    let m: [f64; 16] = std::array::from_fn(|at| tileset["root"]["transform"][at].as_f64().unwrap());
    let glb = Glb::read(&directory.join("content/0/0/0/0.glb"));
    // Cell (100, 0, 0) of the finest level, through glTF's matrix with y upwards: 500 200, 5 150
    // 000, 1000; by PROJ.
    let turned = [100.0 * glb.matrix[0], 100.0 * glb.matrix[1], 100.0 * glb.matrix[2]];
    let [x, y, z] = [turned[0], -turned[2], turned[1]];
    let found = [0, 1, 2].map(|row| m[row] * x + m[4 + row] * y + m[8 + row] * z + m[12 + row]);
    let expected = [4_344_388.047_8, 688_286.075_3, 4_604_678.941_7];
    for axis in 0..3 {
        assert!((found[axis] - expected[axis]).abs() < 0.01, "{found:?}");
    }
}

/// Cancels after a number of checks.
struct Impatient(std::sync::atomic::AtomicU64);

impl Progress for Impatient {
    fn interrupted(&self) -> bool {
        self.0.fetch_update(Relaxed, Relaxed, |left| Some(left.saturating_sub(1))).unwrap() == 0
    }
}

use std::sync::atomic::Ordering::Relaxed;

#[test]
fn failures_leave_no_files() {
    let tree = dataset(&balls(200), Rule::Occupancy, DataKind::Continuous);
    let directory = tempfile::tempdir().unwrap();
    let left = || std::fs::read_dir(directory.path()).unwrap().count();
    let (request, options) = (MeshRequest::new(), GltfOptions::new());
    for patience in [0, 1, 30, 60] {
        let impatient = Impatient(patience.into());
        let output = OutputDirectory::create(&directory.path().join("a")).unwrap();
        let ended = export_tileset(&tree, &request, &options, output, &impatient);
        assert!(matches!(ended, Err(Error::Interrupted)), "{patience}");
        let output = Output::create(&directory.path().join("a.glb")).unwrap();
        let ended = export_glb(&tree, &request, &options, output, &Impatient(patience.into()));
        assert!(matches!(ended, Err(Error::Interrupted)), "{patience}");
        assert_eq!(left(), 0, "{patience}");
    }
    let quadtree =
        dataset(&Cells::random(QUAD, 1, [20, 20, 1], 3, true), Rule::Majority, DataKind::Categorical);
    let output = OutputDirectory::create(&directory.path().join("a")).unwrap();
    assert!(export_tileset(&quadtree, &request, &options, output, &()).is_err());
    let deep = with(MeshRequest::new(), |it| it.level = Some(12));
    let output = OutputDirectory::create(&directory.path().join("a")).unwrap();
    assert!(export_tileset(&tree, &deep, &options, output, &()).is_err());
    assert_eq!(left(), 0);
}

#[cfg(feature = "meshopt")]
#[test]
fn compressed_files_say_so_and_are_smaller() {
    let tree = dataset(&balls(100), Rule::Occupancy, DataKind::Continuous);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.glb");
    let sizes = [false, true].map(|meshopt| {
        let options = with(GltfOptions::new(), |it| it.meshopt = meshopt);
        export_glb(&tree, &request(true), &options, Output::create(&path).unwrap(), &()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let json: Json = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        let required: Vec<&str> =
            json["extensionsRequired"].as_array().unwrap().iter().map(|it| it.as_str().unwrap()).collect();
        assert_eq!(required.contains(&"EXT_meshopt_compression"), meshopt);
        bytes.len()
    });
    assert!(sizes[1] * 2 < sizes[0], "{sizes:?}");
}

#[cfg(not(feature = "meshopt"))]
#[test]
fn compression_that_is_not_built_in_is_refused() {
    let tree = dataset(&balls(100), Rule::Occupancy, DataKind::Continuous);
    let directory = tempfile::tempdir().unwrap();
    let options = with(GltfOptions::new(), |it| it.meshopt = true);
    let output = Output::create(&directory.path().join("x.glb")).unwrap();
    let error = export_glb(&tree, &request(true), &options, output, &()).unwrap_err();
    assert!(error.to_string().contains("meshopt"), "{error}");
}
