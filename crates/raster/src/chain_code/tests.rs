use std::path::{Path, PathBuf};

use super::line::{CellChain, chains_of};
use super::*;
use crate::import::{self, Pixels, RasterOptions};
use spinney_base::io::Output;
use spinney_base::space::{Dimension, Region};
use spinney_base::value::{DataKind, SampleType, ValueType};
use spinney_base::{Result, TreeType};
use spinney_engine::dataset::{self, Dataset};
use spinney_engine::query::PolygonRequest;
use spinney_engine::store::{BuildOptions, Slab, Slabs, build_slabs, depth_for};

/// A raster of classes; 0 is VOID.
#[derive(Clone, Debug, PartialEq)]
struct ClassGrid {
    size: [u64; 2],
    cells: Vec<u8>,
}

struct OneSlab(Option<ClassGrid>, [u64; 3]);

impl Slabs for OneSlab {
    fn extent(&self) -> [u64; 3] {
        self.1
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        let Some(grid) = self.0.take() else { return Ok(false) };
        *slab = Slab { origin: [0; 3], size: self.1, bytes: grid.cells, valid: None };
        Ok(true)
    }
}

impl ClassGrid {
    fn of(rows: &[&str]) -> ClassGrid {
        let cells = rows.iter().flat_map(|row| row.bytes().map(|cell| cell.saturating_sub(b'0'))).collect();
        ClassGrid { size: [rows[0].len() as u64, rows.len() as u64], cells }
    }

    fn random(seed: u64) -> ClassGrid {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) + 1;
        let mut next = |bound: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % bound
        };
        let size = [1 + next(20), 1 + next(20)];
        let (classes, block) = (2 + next(3), 1 + next(4));
        let coarse: Vec<u8> = (0..400).map(|_| next(classes) as u8).collect();
        let cells = (0..size[0] * size[1])
            .map(|cell| coarse[(cell / size[0] / block * 20 + cell % size[0] / block) as usize])
            .collect();
        ClassGrid { size, cells }
    }

    fn tree(&self, directory: &Path) -> Dataset {
        let path = directory.join("raster.goblin");
        let extent = [self.size[0], self.size[1], 1];
        let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
        let options = BuildOptions::new(DataKind::Categorical, depth_for(extent));
        let mut slabs = OneSlab(Some(self.clone()), extent);
        let void = form.value.splat(0);
        build_slabs(form, &mut slabs, void, &options, Output::create(&path).unwrap(), &()).unwrap();
        dataset::open(&path, &Default::default()).unwrap()
    }

    /// The chain code file of the raster.
    fn text(&self, directory: &Path, directions: ChainDirections, request: &PolygonRequest) -> String {
        let path = directory.join("raster.chain");
        let output = Output::create(&path).unwrap();
        export_chain_code(&self.tree(directory), request, directions, output, &()).unwrap();
        std::fs::read_to_string(&path).unwrap()
    }
}

/// The chains of a file, without its head.
fn body(text: &str) -> &str {
    &text[text.find("region").or(text.find("line")).unwrap()..]
}

fn write(directory: &Path, text: &str) -> PathBuf {
    let path = directory.join("text.chain");
    std::fs::write(&path, text).unwrap();
    path
}

/// The raster read from a file, in bands of `rows` rows.
fn read(directory: &Path, text: &str, memory: u64, rows: u64) -> Result<ClassGrid> {
    let path = write(directory, text);
    let mut raster = import::open(&path, &RasterOptions { memory, ..RasterOptions::default() })?;
    let size = [raster.info().width, raster.info().height];
    let (mut cells, mut pixels) = (Vec::new(), Pixels::default());
    for y in (0..size[1]).step_by(rows as usize) {
        raster.read(Region::new(0, y, size[0], rows.min(size[1] - y)), &mut pixels)?;
        let valid = pixels.valid.clone().unwrap_or(vec![true; pixels.bytes.len()]);
        cells.extend(pixels.bytes.iter().zip(valid).map(|(class, valid)| if valid { *class } else { 0 }));
    }
    Ok(ClassGrid { size, cells })
}

const BOTH: [ChainDirections; 2] = [ChainDirections::Four, ChainDirections::Eight];

fn assert_round_trip(grid: &ClassGrid) {
    let directory = tempfile::tempdir().unwrap();
    for directions in BOTH {
        for across_corners in [false, true] {
            let mut request = PolygonRequest::new();
            request.across_corners = across_corners;
            let text = grid.text(directory.path(), directions, &request);
            for (memory, rows) in [(1 << 10, 1), (1 << 20, 7)] {
                let found = read(directory.path(), &text, memory, rows).unwrap();
                assert_eq!(found, *grid, "{directions:?} {across_corners}\n{text}");
            }
        }
    }
}

#[test]
fn rasters_survive_a_round_trip() {
    for rows in [
        &["1"][..],
        &["0"],
        &["12", "21"],
        &["101", "010", "101"],
        &["111", "101", "111"],
        &["11111", "10001", "10201", "10001", "11111"],
        // Holes within holes, and holes that touch at a corner.
        &["1111111", "1000001", "1011101", "1010101", "1011101", "1000001", "1111111"],
        &["11111", "10111", "11011", "11111"],
        &["01110", "10001", "01110"],
        &["1110", "1011", "1101", "0111"],
        // Lines of one cell, there and back.
        &["00000", "11110", "00010", "01110", "01000"],
    ] {
        assert_round_trip(&ClassGrid::of(rows));
    }
}

#[test]
fn random_rasters_survive_a_round_trip() {
    (0..50).for_each(|seed| assert_round_trip(&ClassGrid::random(seed)));
}

#[test]
fn chains_are_counterclockwise_from_the_first_cell() {
    let directory = tempfile::tempdir().unwrap();
    let grid = ClassGrid::of(&["00000", "01110", "01010", "01110", "00000"]);
    let [four, eight] =
        BOTH.map(|directions| grid.text(directory.path(), directions, &PolygonRequest::new()));
    assert_eq!(body(&four), "region 1 1 1\n333000111222\nhole 2 2\n0321\nend 1\n");
    // The hole's chain follows the cells around it. Those at its corners are not its 4-neighbours.
    assert_eq!(body(&eight), "region 1 1 1\n66002244\nhole 2 1\n7531\nend 1\n");
    let single =
        ClassGrid::of(&["02"]).text(directory.path(), ChainDirections::Eight, &PolygonRequest::new());
    assert_eq!(body(&single), "region 2 1 0\nend 1\n");
}

#[test]
fn a_single_class_can_be_exported() {
    let directory = tempfile::tempdir().unwrap();
    let grid = ClassGrid::of(&["123", "321"]);
    let mut request = PolygonRequest::new();
    request.classes = Some(vec![3u64.into()]);
    let text = grid.text(directory.path(), ChainDirections::Four, &request);
    let found = read(directory.path(), &text, 1 << 20, 1).unwrap();
    assert_eq!(found, ClassGrid::of(&["003", "300"]));
    request.simplify = Some(1.0);
    let output = Output::create(&directory.path().join("none.chain")).unwrap();
    let error = export_chain_code(&grid.tree(directory.path()), &request, ChainDirections::Four, output, &());
    assert!(error.unwrap_err().to_string().contains("simplif"));
}

#[test]
fn textbook_chain_codes_are_read() {
    let directory = tempfile::tempdir().unwrap();
    let head = "freeman-chain-code 1\ndirections";
    // Clockwise, with 8 directions, without a size: a triangle.
    let found = read(directory.path(), &format!("{head} 8 region 1 2 0 77 4444 11 end"), 1 << 10, 9).unwrap();
    assert_eq!(found, ClassGrid::of(&["00100", "01110", "11111"]));
    // Later regions cover earlier ones; chains continue across spaces and lines.
    let text = format!(
        "{head} 4\nsize 4 3\ntype u8\nregion 1 0 0 3330\n000 111 2222\nregion 5 1 1\n0 3 2 1\nend 2\n"
    );
    assert_eq!(read(directory.path(), &text, 1 << 10, 2).unwrap(), ClassGrid::of(&["1111", "1511", "1111"]));
    // A line is open.
    let text = format!("{head} 8\r\nsize 5 2\r\nline 2 0 1\r\n0107\r\nend\r\n");
    assert_eq!(read(directory.path(), &text, 1 << 10, 2).unwrap(), ClassGrid::of(&["00220", "22002"]));
}

#[test]
fn lines_are_chains_of_the_nearest_cells() {
    let steps = |steps: &[(u8, u64)]| steps.to_vec();
    let line = |points: &[[f64; 2]]| chains_of(points, [8, 8]);
    let chain = |start, codes: &[(u8, u64)]| CellChain { start, steps: steps(codes) };
    assert_eq!(line(&[[0.5, 0.5], [4.5, 4.5]]), [chain([0, 0], &[(7, 4)])]);
    assert_eq!(line(&[[0.5, 6.5], [4.5, 6.5], [4.5, 4.5]]), [chain([0, 6], &[(0, 4), (2, 2)])]);
    assert_eq!(line(&[[3.2, 3.9]]), [chain([3, 3], &[])]);
    // Out of the raster and in again.
    let found = line(&[[6.5, 2.5], [9.5, 2.5], [9.5, 4.5], [6.5, 4.5]]);
    assert_eq!(found, [chain([6, 2], &[(0, 1)]), chain([7, 4], &[(4, 1)])]);
    assert_eq!(line(&[[8.0, 1.0], [8.0, 3.0]]), []);
    assert_eq!(line(&[[-1e6, 4.0], [1e6, 4.0]]), [chain([0, 4], &[(0, 7)])]);
    for far in [1e300, f64::MAX] {
        let found = line(&[[-far, -far], [far, far]]);
        assert!(found.len() <= 1, "{found:?}");
    }
    assert_eq!(line(&[[f64::NAN, 0.0], [1.0, 1.0]]), []);
    // Cells are within half a cell of the segment, along the shorter axis: no closer cells exist.
    for seed in 0..400u64 {
        let at = |shift: u64| (seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> shift) as f64 % 64.0 + 0.5;
        let [a, b] =
            [[at(5).floor() + 0.5, at(17).floor() + 0.5], [at(29).floor() + 0.5, at(41).floor() + 0.5]];
        let [chain] = &chains_of(&[a, b], [65, 65])[..] else { panic!("one chain of {a:?} to {b:?}") };
        let mut cell = chain.start;
        for (code, count) in &chain.steps {
            for _ in 0..*count {
                let step = ChainDirections::Eight.step(*code).unwrap();
                cell = [cell[0] + step[0], cell[1] + step[1]];
                let centre = [cell[0] as f64 + 0.5, cell[1] as f64 + 0.5];
                let along = [b[0] - a[0], b[1] - a[1]];
                let cross_product = (centre[0] - a[0]) * along[1] - (centre[1] - a[1]) * along[0];
                let most = along[0].abs().max(along[1].abs());
                assert!(cross_product.abs() <= 0.5 * most + 1e-9, "{a:?} to {b:?}: {cell:?}");
            }
        }
        assert_eq!(cell, b.map(|at| at.floor() as i64));
    }
}

#[test]
fn malformed_files_are_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let head = "freeman-chain-code 1\ndirections 4\nsize 4 3\n";
    for (text, expected) in [
        (
            "freeman-chain-codes 1".to_owned(),
            "line 1: found `freeman-chain-codes`, expected `freeman-chain-code 1`",
        ),
        ("freeman-chain-code 2".into(), "version `2`"),
        ("freeman-chain-code".into(), "line 1: found the end of the file"),
        ("freeman-chain-code 1\n".into(), "expected chains"),
        ("freeman-chain-code 1\nregion 1 0 0 03".into(), "before chains"),
        ("freeman-chain-code 1\ndirections 6\n".into(), "line 2: found `6`, expected 4 or 8"),
        (head.replace("4 3", "4000000000 3"), "a number of columns, from 1 to 536870912"),
        (head.replace("4 3", "0 3"), "a number of columns"),
        (format!("{head}size 1 1\n"), "line 4: found a second line `size`"),
        (format!("{head}type u7\n"), "line 4: found `u7`, expected a type: u8"),
        (format!("{head}transform 0 0 0 0 0 0\n"), "an invertible map"),
        (format!("{head}transform 1 0 0 0 nan 0\n"), "six numbers"),
        (format!("{head}crs EPSG:x\n"), "a coordinate system"),
        (format!("{head}palette #112233\n"), "as in #ff8000ff"),
        (format!("{head}name 1 Wood\n"), "quotation marks"),
        (format!("{head}colour 1\n"), "line 4: found `colour`, expected directions, size"),
        (format!("{head}{}\n", "x".repeat(1000)), "expected a word or a number"),
        (format!("{head}region 256 0 0 0321\nend"), "a class of type u8"),
        (format!("{head}region 1 5 0 0321\nend"), "a column, from 0 to 4"),
        (format!("{head}region 1 0 99999999999999999999 0321\nend"), "a row, from 0 to 3"),
        (
            format!("{head}region 1 4 0 03\nend"),
            "line 4: found a move to column 5, row 0, expected columns from 0 to 4",
        ),
        (format!("{head}region 1 0 0\n0321\n1\nend"), "line 6: found a move to column 0, row -1"),
        (
            format!("{head}region 1 0 0\n033\n21\nend"),
            "line 4: found a chain that ends at column 0, row 1, expected column 0, row 0",
        ),
        (format!("{head}region 1 0 0\n0341\nend"), "line 5: found `4`, expected codes from 0 to 3"),
        (format!("{head}region 1 0 0\n03x1\nend"), "line 5: found `x`"),
        (format!("{head}hole 0 0 0321\nend"), "holes and parts after their region"),
        (format!("{head}line 1 0 0 00\nend"), "8 directions for lines"),
        (format!("{head}region 1 0 0 0321\n"), "the file is incomplete"),
        (format!("{head}region 1 0 0 0321\nregions\n"), "line 5: found `regions`"),
        (format!("{head}region 1 0 0 0321\nend 2\n"), "expected 1, the number of regions and lines"),
        (format!("{head}region 1 0 0 0321\nend 1\nregion"), "the end of the file"),
        ("freeman-chain-code 1\ndirections 4\nregion 1 0 0 02\nend".into(), "no cells"),
        (format!("{head}region 1 0 0 \u{e9}\u{e9}\nend"), "found `"),
    ] {
        let error = read(directory.path(), &text, 1 << 20, 8).unwrap_err().to_string();
        assert!(
            error.contains(expected) && error.contains("text.chain"),
            "{text}\n{error}\nexpected: {expected}"
        );
    }
    let wide = format!("{}region 1 0 0 0321\nend", head.replace("4 3", "500000000 3"));
    let error = read(directory.path(), &wide, 1 << 20, 1).unwrap_err().to_string();
    assert!(error.contains("a row of 500000000 cells needs 1000000000 bytes"), "{error}");
    // Arbitrary bytes are rejected without a panic.
    let whole = ClassGrid::random(3).text(directory.path(), ChainDirections::Eight, &PolygonRequest::new());
    for offset in 0..whole.len() {
        for byte in [b' ', b'9', b'z', 0xff] {
            let mut bytes = whole.clone().into_bytes();
            bytes[offset] = byte;
            let path = directory.path().join("changed.chain");
            std::fs::write(&path, bytes).unwrap();
            if let Ok(mut raster) = import::open(&path, &RasterOptions::default()) {
                let (width, height) = (raster.info().width, raster.info().height.min(64));
                if width < 4096 {
                    let _ = raster.read(Region::new(0, 0, width, height), &mut Pixels::default());
                }
            }
        }
    }
}
