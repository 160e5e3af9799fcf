//! Query rates of tree files, on one thread: windows of 256 x 256 cells, single cells, statistics.
//!
//! `cargo bench --bench rates -- [--only windows|unaligned|cells|statistics|points] [--windows
//! LIST] [--cold] FILE...`
//!
//! For octrees only points are measured: random cells of the whole space, one by one and in large
//! batches; for Autumnal files only windows.
//!
//! Files are warm; with `--cold` no segment of a packed file is unpacked before a window or a
//! single cell is read. LIST has a window per line, `UP COLUMN ROW`: levels above the finest, and
//! the first cell; without it, aligned windows at random levels are read.

mod measuring;

use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use measuring::{Outcome, Random, median, quantile, seconds};
use spinney::raw::store::autumnal::Autumnal;
use spinney::raw::store::goblin::Goblin;
use spinney::{Bounds, Code, Dimension, FileAccess, Header, OpenOptions, Value};

const SIDE: u64 = 256;
const WINDOWS: usize = 4000;
const PASSES: usize = 5;
const CELLS: usize = 1_000_000;
const POINTS: usize = 8_000_000;
/// Number of windows and of single cells that are read with nothing unpacked.
const COLD: usize = 400;
const BOXES: usize = 300;
const BOX_SIDE: u64 = 4096;

fn main() -> Outcome<()> {
    spinney::raw::register();
    let mut listed = None;
    let mut only = None;
    let mut is_cold = false;
    let mut files = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--bench" => {}
            "--windows" => {
                listed =
                    Some(read_list(&arguments.next().ok_or("--windows: got no value, expected a file")?)?)
            }
            "--cold" => is_cold = true,
            "--only" => {
                only = Some(arguments.next().ok_or("--only: got no value, expected the name of a query")?)
            }
            _ => files.push(argument),
        }
    }
    if files.is_empty() {
        println!("rates: no files given, nothing to measure");
    }
    for file in &files {
        let path = Path::new(file);
        println!("{}", path.file_name().unwrap_or_default().to_string_lossy());
        if file.ends_with(".autumn") {
            let tree = Autumnal::open(path, &OpenOptions::new())?;
            let draw = |level, bounds: &Bounds, bytes: &mut [u8]| {
                tree.window(level, bounds, Value::ZERO, bytes, None).map(|()| 0)
            };
            measure_windows(
                &Drawn { header: tree.header(), draw: &draw, is_cold },
                listed.as_deref(),
                only.as_deref(),
            )?;
            continue;
        }
        let tree = Goblin::open(path, &OpenOptions::new())?;
        match tree.header().form.dimension {
            Dimension::Quad => measure(&tree, listed.as_deref(), only.as_deref(), is_cold)?,
            Dimension::Oct => points(&tree)?,
        }
    }
    Ok(())
}

/// Draws a window of a level. Returns the number of segments read.
type Draw<'a> = dyn Fn(u8, &Bounds, &mut [u8]) -> spinney::Result<usize> + 'a;

/// A quadtree whose windows are drawn.
struct Drawn<'a> {
    header: &'a Header,
    draw: &'a Draw<'a>,
    is_cold: bool,
}

/// Drops all unpacked segments of packed files.
fn forget_unpacked() {
    let access = FileAccess::default();
    let cache = access.unpacked();
    let limit = cache.limit();
    // The cache always holds its newest entry.
    cache.set_limit(0);
    cache.put(u64::MAX, 0, Arc::new(vec![0]));
    cache.set_limit(limit);
}

fn measure_windows(tree: &Drawn<'_>, listed: Option<&[[u64; 3]]>, only: Option<&str>) -> Outcome<()> {
    let is_selected = |query: &str| only.is_none_or(|only| only == query);
    let depth = tree.header.depth();
    if is_selected("windows") {
        let listed = listed.map(|listed| {
            listed.iter().map(|[up, column, row]| (depth - *up as u8, window_from([*column, *row]))).collect()
        });
        windows(tree, "aligned", &listed.unwrap_or_else(|| random_windows(tree.header, true)))?;
    }
    if is_selected("unaligned") {
        windows(tree, "unaligned", &random_windows(tree.header, false))?;
    }
    Ok(())
}

fn measure(tree: &Goblin, listed: Option<&[[u64; 3]]>, only: Option<&str>, is_cold: bool) -> Outcome<()> {
    let is_selected = |query: &str| only.is_none_or(|only| only == query);
    let draw =
        |level, bounds: &Bounds, bytes: &mut [u8]| tree.window(level, bounds, Value::ZERO, bytes, None);
    measure_windows(&Drawn { header: tree.header(), draw: &draw, is_cold }, listed, only)?;
    if is_selected("cells") {
        cells(tree, is_cold)?;
    }
    if is_selected("points") {
        points(tree)?;
    }
    if is_selected("statistics") {
        statistics(tree)?;
    }
    Ok(())
}

fn extent(header: &Header, level: u8) -> [u64; 2] {
    let shift = header.depth() - level;
    [0, 1].map(|axis| header.extent[axis].div_ceil(1 << shift))
}

fn window_at(random: &mut Random, [width, height]: [u64; 2], aligned: bool) -> Bounds {
    let mut start = |size: u64| {
        if aligned {
            random.below(size.div_ceil(SIDE)) * SIDE
        } else {
            random.below(size.saturating_sub(SIDE) + 1)
        }
    };
    window_from([start(width), start(height)])
}

fn window_from([column, row]: [u64; 2]) -> Bounds {
    Bounds { min: [column, row, 0], max: [column + SIDE, row + SIDE, 1] }
}

/// Returns windows at random positions of random levels with more than one window.
fn random_windows(header: &Header, aligned: bool) -> Vec<(u8, Bounds)> {
    let depth = header.depth();
    let first = 8.min(depth);
    let mut random = Random(1);
    let mut one = || {
        let level = first + random.below(u64::from(depth - first) + 1) as u8;
        (level, window_at(&mut random, extent(header, level), aligned))
    };
    (0..WINDOWS).map(|_| one()).collect()
}

fn read_list(file: &str) -> Outcome<Vec<[u64; 3]>> {
    let line = |line: &str| -> Outcome<[u64; 3]> {
        let numbers: Vec<u64> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        numbers.try_into().map_err(|_| "a window is three numbers".into())
    };
    std::fs::read_to_string(file)?.lines().map(line).collect()
}

/// Measurements of the windows of one level.
#[derive(Default)]
struct Level {
    micros: Vec<f64>,
    segments: usize,
}

fn windows(tree: &Drawn<'_>, name: &str, positions: &[(u8, Bounds)]) -> Outcome<()> {
    let depth = tree.header.depth();
    let positions = &positions[..if tree.is_cold { COLD.min(positions.len()) } else { positions.len() }];
    let first = positions.iter().map(|(level, _)| *level).min().unwrap_or(depth);
    let mut bytes = vec![0; (SIDE * SIDE) as usize * tree.header.form.width()];
    let mut rates = Vec::new();
    // A window's time is the median of the passes, since other processes interrupt occasionally.
    let mut times = vec![[0.0; PASSES]; positions.len()];
    let mut levels: Vec<Level> = (first..=depth).map(|_| Level::default()).collect();
    for pass in 0..=PASSES {
        let took = seconds(|| {
            for ((level, bounds), times) in positions.iter().zip(&mut times) {
                if tree.is_cold {
                    forget_unpacked();
                }
                let start = Instant::now();
                let segments = (tree.draw)(*level, bounds, &mut bytes)?;
                black_box(&bytes);
                if pass > 0 {
                    times[pass - 1] = start.elapsed().as_secs_f64() * 1e6;
                }
                let known = &mut levels[usize::from(level - first)];
                known.segments = known.segments.max(segments);
            }
            Ok(())
        })?;
        if pass > 0 {
            rates.push(positions.len() as f64 / took);
        }
    }
    for ((level, _), times) in positions.iter().zip(&mut times) {
        levels[usize::from(level - first)].micros.push(median(times));
    }
    let mut all: Vec<f64> = levels.iter().flat_map(|level| level.micros.iter().copied()).collect();
    println!(
        "  {name} windows: {:.0}/s, median {:.1} us, p99 {:.1} us, at most {} segments",
        median(&mut rates),
        median(&mut all),
        quantile(&mut all, 0.99),
        levels.iter().map(|level| level.segments).max().unwrap_or(0),
    );
    let mut means = Vec::new();
    for (known, number) in levels.iter_mut().zip(first..) {
        if known.micros.is_empty() {
            continue;
        }
        let mean = known.micros.iter().sum::<f64>() / known.micros.len() as f64;
        means.push(mean);
        println!(
            "    level {number}: mean {mean:.1} us, median {:.1} us, p99 {:.1} us, at most {} segments",
            median(&mut known.micros),
            quantile(&mut known.micros, 0.99),
            known.segments,
        );
    }
    let slowest = means.iter().copied().fold(0.0, f64::max);
    println!("    slowest level / median level: {:.2}", slowest / median(&mut means));
    Ok(())
}

fn cells(tree: &Goblin, is_cold: bool) -> Outcome<()> {
    let (dimension, depth) = (tree.header().form.dimension, tree.header().depth());
    let [width, height] = extent(tree.header(), depth);
    let mut random = Random(2);
    let count = if is_cold { COLD } else { CELLS };
    let positions: Vec<[u32; 3]> =
        (0..count).map(|_| [random.below(width) as u32, random.below(height) as u32, 0]).collect();
    let mut nanos = Vec::new();
    for pass in 0..=PASSES {
        let took = seconds(|| {
            for cell in &positions {
                if is_cold {
                    forget_unpacked();
                }
                let code = Code::from_cell(dimension, depth, *cell).ok_or("inside")?;
                black_box(tree.value_at(code)?);
            }
            Ok(())
        })?;
        if pass > 0 {
            nanos.push(took * 1e9 / count as f64);
        }
    }
    println!("  single cells: {:.0} ns each", median(&mut nanos));
    Ok(())
}

fn points(tree: &Goblin) -> Outcome<()> {
    let (dimension, depth) = (tree.header().form.dimension, tree.header().depth());
    let space = Bounds::space(dimension, depth).max;
    let mut random = Random(4);
    let positions: Vec<[u32; 3]> =
        (0..POINTS).map(|_| std::array::from_fn(|axis| random.below(space[axis]) as u32)).collect();
    let mut values = vec![None; POINTS];
    let (mut single, mut many) = (Vec::new(), Vec::new());
    for pass in 0..=PASSES {
        let took = seconds(|| {
            for cell in &positions[..CELLS] {
                let code = Code::from_cell(dimension, depth, *cell).ok_or("inside")?;
                black_box(tree.value_at(code)?);
            }
            Ok(())
        })?;
        let bulk = seconds(|| Ok(tree.values_at(depth, &positions, &mut values)?))?;
        black_box(&values);
        if pass > 0 {
            single.push(CELLS as f64 / took * 1e-6);
            many.push(POINTS as f64 / bulk * 1e-6);
        }
    }
    for (cell, value) in positions.iter().zip(&values).step_by(97) {
        let expected = tree.value_at(Code::from_cell(dimension, depth, *cell).ok_or("inside")?)?;
        assert_eq!(expected, *value, "{cell:?}");
    }
    let (single, many) = (median(&mut single), median(&mut many));
    println!("  random points: {single:.1} million/s one by one, {many:.1} million/s of {POINTS} at once");
    Ok(())
}

fn statistics(tree: &Goblin) -> Outcome<()> {
    let [width, height] = extent(tree.header(), tree.header().depth());
    let side = BOX_SIDE.min(width / 2).min(height / 2);
    let mut random = Random(3);
    let positions: Vec<Bounds> = (0..BOXES)
        .map(|_| {
            let min = [random.below(width - side + 1), random.below(height - side + 1), 0];
            Bounds { min, max: [min[0] + side, min[1] + side, 1] }
        })
        .collect();
    let mut rates = Vec::new();
    for pass in 0..=PASSES {
        let took = seconds(|| {
            for bounds in &positions {
                black_box(tree.statistics(Some(*bounds), &())?);
            }
            Ok(())
        })?;
        if pass > 0 {
            rates.push(BOXES as f64 / took);
        }
    }
    println!("  statistics of {side} x {side} cells: {:.0}/s", median(&mut rates));
    Ok(())
}
