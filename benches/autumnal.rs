//! Autumnal files compared with Goblin files of the same tree, on one thread: single cells,
//! windows, traversals, small edits; and several concurrent reader processes.
//!
//! `cargo bench --bench autumnal -- [--readers] GOBLIN AUTUMN [GOBLIN AUTUMN ...]`
//!
//! Files are warm. They are not modified: edits go to a copy next to the file, without syncs.

mod measuring;

use std::hint::black_box;
use std::io::{self, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use measuring::{Outcome, Random, median, quantile, seconds};
use spinney::edit::{Edit, Editor, FillRegion, Note};
use spinney::raw::dataset::open;
use spinney::raw::io::{FileId, Mapped, ReadBackend, WriteBackend};
use spinney::raw::ops::apply_edits;
use spinney::raw::store::autumnal::Autumnal;
use spinney::raw::store::goblin::Goblin;
use spinney::raw::tree::no_children;
use spinney::tree::{Child, Source};
use spinney::{Bounds, Code, Dataset, Dimension, FileView, Number, OpenOptions};

const CELLS: usize = 1_000_000;
const WINDOWS: usize = 1000;
const SIDE: u64 = 256;
const EDITS: usize = 200;
const PASSES: usize = 5;

fn main() -> Outcome<()> {
    let mut files: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    if files.first().is_some_and(|argument| argument == "--read") {
        return read(&files[1]);
    }
    let only_readers = files.first().is_some_and(|argument| argument == "--readers");
    if only_readers {
        files.remove(0);
    }
    if files.is_empty() {
        println!("autumnal: no files given, nothing to measure");
    }
    for pair in files.chunks_exact(2) {
        println!("{} and {}", pair[0], pair[1]);
        if only_readers {
            readers(&pair[1])?;
            continue;
        }
        measure(&pair[0], &pair[1])?;
    }
    Ok(())
}

/// Returns the median time of some passes, in nanoseconds per one of `count` operations.
fn nanoseconds(count: usize, mut pass: impl FnMut() -> Outcome<()>) -> Outcome<f64> {
    let times: Outcome<Vec<f64>> = (0..PASSES).map(|_| seconds(&mut pass)).collect();
    Ok(median(&mut times?) * 1e9 / count as f64)
}

fn measure(goblin_path: &str, autumnal_path: &str) -> Outcome<()> {
    let options = OpenOptions::new();
    let goblin = Goblin::open(goblin_path.as_ref(), &options)?;
    let autumnal = Autumnal::open(autumnal_path.as_ref(), &options)?;
    let (form, depth, extent) = (goblin.header().form, goblin.header().depth(), goblin.header().extent);
    let mut random = Random(1);
    let cells: Vec<Code> = (0..CELLS)
        .filter_map(|_| {
            Code::from_cell(form.dimension, depth, extent.map(|cells| random.below(cells) as u32))
        })
        .collect();
    let a = nanoseconds(CELLS, || {
        cells.iter().try_for_each(|cell| goblin.value_at(*cell).map(|value| _ = black_box(value)))?;
        Ok(())
    })?;
    let b = nanoseconds(CELLS, || {
        cells.iter().try_for_each(|cell| autumnal.value_at(*cell).map(|value| _ = black_box(value)))?;
        Ok(())
    })?;
    println!("  single cells     {a:8.0} ns  {b:8.0} ns  {:.2}", b / a);

    let trees: [Dataset; 2] =
        [open(goblin_path.as_ref(), &options)?, open(autumnal_path.as_ref(), &options)?];
    let windows: Vec<(u8, Bounds)> = (0..WINDOWS)
        .map(|_| {
            let level = depth - random.below(u64::from(depth.saturating_sub(8)) + 1) as u8;
            let size = extent.map(|cells| cells.div_ceil(1 << (depth - level)));
            let min: [u64; 3] = std::array::from_fn(|axis| random.below(size[axis]) / SIDE * SIDE);
            let max = std::array::from_fn(|axis| if axis < 2 { min[axis] + SIDE } else { min[axis] + 1 });
            (level, Bounds { min, max })
        })
        .collect();
    let mut times = [0.0; 2];
    for (tree, time) in trees.iter().zip(&mut times) {
        let mut bytes = vec![0; (SIDE * SIDE) as usize * form.width()];
        *time = nanoseconds(WINDOWS, || {
            windows
                .iter()
                .try_for_each(|(level, bounds)| tree.window(*level, bounds, 0.0, &mut bytes, None))?;
            Ok(())
        })?;
    }
    println!(
        "  windows of 256^2 {:8.1} us  {:8.1} us  {:.2}",
        times[0] / 1e3,
        times[1] / 1e3,
        times[1] / times[0]
    );

    let mut times = [0.0; 2];
    let mut records = 0;
    times[0] = nanoseconds(1, || walk(&goblin, &mut records))?;
    times[1] = nanoseconds(1, || walk(&autumnal, &mut records))?;
    let rate = |time: f64| records as f64 / time * 1e3;
    println!("  walk, {records} records: {:.1} and {:.1} million/s", rate(times[0]), rate(times[1]));

    if form.dimension == Dimension::Quad && extent[0] > 2 * SIDE && extent[1] > 2 * SIDE {
        edits(&goblin, autumnal_path.as_ref())?;
    }
    Ok(())
}

/// Visits every node.
fn walk<S: Source>(source: &S, records: &mut u64) -> Outcome<()> {
    fn node<S: Source>(source: &S, node_of: &S::Node, records: &mut u64) -> spinney::Result<()> {
        *records += 1;
        let mut children = no_children();
        source.children(node_of, &mut children)?;
        for child in &children[..source.form().children()] {
            match child {
                Child::Inner { node: below, .. } => node(source, below, records)?,
                child => _ = black_box(child.value()),
            }
        }
        Ok(())
    }
    *records = 0;
    if let Child::Inner { node: root, .. } = source.root()? {
        node(source, &root, records)?;
    }
    Ok(())
}

/// An in-memory file that is never synced.
struct Unsynced(std::fs::File, std::path::PathBuf);

impl WriteBackend for Unsynced {
    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        std::os::unix::fs::FileExt::write_all_at(&self.0, bytes, offset)
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn reader(&self) -> spinney::Result<Box<dyn ReadBackend>> {
        Ok(Box::new(Mapped::open(&self.1)?))
    }

    fn id(&self) -> FileId {
        FileId::of(&self.0).unwrap_or_else(|_| FileId::unique())
    }
}

fn edits(goblin: &Goblin, path: &Path) -> Outcome<()> {
    let copy = tempfile::NamedTempFile::new_in(path.parent().unwrap_or(Path::new(".")))?;
    std::fs::copy(path, copy.path())?;
    let file = std::fs::File::options().read(true).write(true).open(copy.path())?;
    let backend = Unsynced(file, copy.path().to_path_buf());
    let mut editor = Editor::on(Box::new(backend), copy.path(), 64 << 20)?;
    let extent = goblin.header().extent;
    let mut random = Random(2);
    let corner = |random: &mut Random| [random.below(extent[0] - SIDE), random.below(extent[1] - SIDE), 0];
    for what in ["a fill", "a paste", "an aligned paste"] {
        let mut times = Vec::new();
        let mut written = 0;
        for _ in 0..EDITS {
            let (mut min, mut from) = (corner(&mut random), corner(&mut random));
            if what == "an aligned paste" {
                (min, from) = (min.map(|cell| cell / SIDE * SIDE), from.map(|cell| cell / SIDE * SIDE));
            }
            let bounds = Bounds { min, max: [min[0] + SIDE, min[1] + SIDE, 1] };
            let change = if what == "a fill" {
                Edit::Fill(FillRegion::Box(bounds), None)
            } else {
                // Cells of another region of the map.
                let window = format!("window={},{},{SIDE},{SIDE}", from[0], from[1]);
                let patch = FileView { steps: vec![window.parse()?], ..FileView::of(goblin.path()) };
                Edit::Paste {
                    patch,
                    at: Some(min.map(|cell| cell as i64)),
                    void: true,
                    options: Default::default(),
                }
            };
            let edit = || {
                apply_edits(&mut editor, &mut [Ok(change)].into_iter(), &())?;
                let commit = editor.commit(Note::default())?;
                written += commit.map_or(0, |commit| commit.written.bytes);
                Ok(())
            };
            times.push(seconds(edit)? * 1e3);
        }
        let (median, worst) = (median(&mut times), quantile(&mut times, 0.99));
        println!(
            "  {what} of 256^2: {median:.2} ms, 99 in 100 within {worst:.2} ms, {} KiB written on average",
            written / EDITS as u64 / 1024
        );
    }
    Ok(())
}

/// Looks up single cells until the input ends; prints their number, and the process's proportional
/// memory (PSS).
fn read(path: &str) -> Outcome<()> {
    let tree = open(path.as_ref(), &OpenOptions::default())?;
    let extent = tree.header().extent;
    let depth = tree.depth();
    let mut random = Random(u64::from(std::process::id()));
    let mut value = [Number::default(); 4];
    let mut pass = |count: usize| -> Outcome<()> {
        for _ in 0..count {
            let cell = extent.map(|cells| random.below(cells));
            black_box(tree.point(cell, depth, &mut value)?);
        }
        Ok(())
    };
    pass(3_000_000)?;
    println!("ready");
    let mut go = [0];
    io::stdin().read_exact(&mut go)?;
    let start = Instant::now();
    let mut queries = 0;
    while start.elapsed() < Duration::from_secs(3) {
        pass(100_000)?;
        queries += 100_000;
    }
    let rate = queries as f64 / start.elapsed().as_secs_f64();
    println!("rate {rate}");
    io::stdin().read_exact(&mut go)?;
    let maps = std::fs::read_to_string("/proc/self/smaps_rollup")?;
    let pss = maps.lines().find_map(|line| line.strip_prefix("Pss:")).unwrap_or("0");
    println!("pss {}", pss.trim().trim_end_matches(" kB"));
    io::stdin().read_exact(&mut go)?;
    Ok(())
}

/// Measures one reader process, then four at once: cells per second, and proportional memory.
fn readers(path: &str) -> Outcome<()> {
    let mut sums = Vec::new();
    for count in [1, 4] {
        let mut children = Vec::new();
        for _ in 0..count {
            let mut child = Command::new(std::env::current_exe()?)
                .args(["--read", path])
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .spawn()?;
            let input = child.stdin.take().ok_or("no pipe")?;
            let output = io::BufReader::new(child.stdout.take().ok_or("no pipe")?);
            children.push((child, input, output));
        }
        let mut sum = [0.0; 2];
        for step in 0..3 {
            let mut lines = Vec::new();
            for (_, _, output) in &mut children {
                let mut line = String::new();
                io::BufRead::read_line(output, &mut line)?;
                lines.push(line);
            }
            if step > 0 {
                let number =
                    |line: &String| line.split_whitespace().nth(1).and_then(|n| n.parse::<f64>().ok());
                sum[step - 1] = lines.iter().filter_map(number).sum();
            }
            for (_, input, _) in &mut children {
                input.write_all(b"x")?;
            }
        }
        for (mut child, ..) in children {
            child.wait()?;
        }
        println!("  {count} readers: {:.2} million cells/s, {:.1} MiB", sum[0] / 1e6, sum[1] / 1024.0);
        sums.push(sum);
    }
    println!(
        "  four to one: {:.2} times the rate, {:.2} of the memory",
        sums[1][0] / sums[0][0],
        sums[1][1] / sums[0][1]
    );
    Ok(())
}
