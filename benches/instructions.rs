//! One job with one tree file per run, so that its instructions can be counted externally.
//!
//! `cargo bench --bench instructions -- JOB FILE [COUNT]`
//!
//! Times on a busy machine are too noisy to detect changes of a few percent; the instruction count
//! of a run is the same every time. `benches/instructions.py` runs all jobs with many files under
//! valgrind, subtracts the cost of opening the file, and compares two states of the project.
//!
//! A job runs the same COUNT queries every time, and prints a checksum of their results, which must
//! be the same in both states of the project. The jobs:
//!
//! | job | query |
//! | --- | --- |
//! | `open` | none; the file is opened and closed COUNT times |
//! | `descent` | the value of one cell of the deepest level |
//! | `coarse` | the value of one node of any level |
//! | `points` | the values of COUNT cells of the deepest level, all at once |
//! | `tiles` | an aligned window at any level: 256 x 256 cells, in octrees 32 x 32 x 32 |
//! | `unaligned` | such a window anywhere |
//! | `tiles-valid` | as `tiles`, with a flag per cell that is not VOID |
//! | `walk` | statistics of a box, whose sides cut zones |
//! | `histogram` | a histogram of a box |
//! | `find` | the largest blocks of a box above the middle of the values |
//! | `solid` | volume, surface and centre of an octree |

#[allow(dead_code)] // nothing is timed here
mod measuring;

use std::path::Path;

use measuring::{Outcome, Random};
use spinney::query::{Condition, PointSamples};
use spinney::{Bounds, Dataset, Number};

/// A job, and its default number of queries.
type Job = (&'static str, u64, fn(&Dataset, u64, &mut Digest) -> Outcome<()>);

const JOBS: [Job; 10] = [
    ("descent", 200_000, descent),
    ("coarse", 200_000, coarse),
    ("points", 500_000, points),
    ("tiles", 400, |tree, count, digest| windows(tree, count, true, false, digest)),
    ("unaligned", 300, |tree, count, digest| windows(tree, count, false, false, digest)),
    ("tiles-valid", 400, |tree, count, digest| windows(tree, count, true, true, digest)),
    ("walk", 300, walk),
    ("histogram", 100, histogram),
    ("find", 100, find),
    ("solid", 1, solid),
];

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let (job, file, count) = match &arguments[..] {
        [] => {
            println!("instructions: no job given, nothing to count; see benches/instructions.py");
            return Ok(());
        }
        [job, file] => (job.as_str(), Path::new(file), None),
        [job, file, count] => (job.as_str(), Path::new(file), Some(count.parse::<u64>()?)),
        _ => return Err("expected JOB FILE [COUNT]".into()),
    };
    let mut digest = Digest(0);
    if job == "open" {
        for _ in 0..count.unwrap_or(1) {
            digest.add(opened(file)?.header().extent[0]);
        }
    } else {
        let known = JOBS.iter().find(|(name, _, _)| *name == job);
        let (_, usual, run) = known.ok_or_else(|| format!("{job}: no such job"))?;
        run(&opened(file)?, count.unwrap_or(*usual), &mut digest)?;
    }
    println!("{:016x}", digest.0);
    Ok(())
}

/// Opens a dataset; all other library calls are queries.
fn opened(path: &Path) -> spinney::Result<Dataset> {
    spinney::open(path)
}

/// A checksum of all results that depends on their order.
struct Digest(u64);

impl Digest {
    fn add(&mut self, value: u64) {
        self.0 = (self.0.rotate_left(5) ^ value).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    }

    fn add_numbers(&mut self, numbers: &[f64]) {
        numbers.iter().for_each(|number| self.add(number.to_bits()));
    }

    /// Adds a sample of many bytes: adding all takes longer than drawing a tile.
    fn add_some(&mut self, bytes: &[u8]) {
        bytes.iter().step_by(1021).for_each(|byte| self.add(u64::from(*byte)));
    }
}

/// Returns a random cell of an extent.
fn cell(extent: [u64; 3], random: &mut Random) -> [u64; 3] {
    extent.map(|cells| if cells > 1 { random.below(cells) } else { 0 })
}

fn descent(tree: &Dataset, count: u64, digest: &mut Digest) -> Outcome<()> {
    let (extent, depth) = (tree.header().extent, tree.depth());
    let mut random = Random(1);
    let mut value = [Number::default(); 4];
    for _ in 0..count {
        let found = tree.point(cell(extent, &mut random), depth, &mut value)?;
        digest.add(if found { value[0].to_f64().to_bits() } else { 1 });
    }
    Ok(())
}

fn coarse(tree: &Dataset, count: u64, digest: &mut Digest) -> Outcome<()> {
    let extents: Vec<_> = (0..=tree.depth()).map(|level| tree.extent_at(level).max).collect();
    let mut random = Random(2);
    let mut value = [Number::default(); 4];
    for _ in 0..count {
        let level = random.below(extents.len() as u64) as usize;
        let found = tree.point(cell(extents[level], &mut random), level as u8, &mut value)?;
        digest.add(if found { value[0].to_f64().to_bits() } else { 1 });
    }
    Ok(())
}

fn points(tree: &Dataset, count: u64, digest: &mut Digest) -> Outcome<()> {
    let extent = tree.header().extent;
    let mut random = Random(3);
    let cells: Vec<_> = (0..count).map(|_| cell(extent, &mut random)).collect();
    let mut samples = PointSamples::default();
    tree.points(&cells, tree.depth(), &mut samples)?;
    for index in (0..cells.len()).step_by(101) {
        match samples.get(index) {
            Some(numbers) => numbers.iter().for_each(|number| digest.add(number.to_f64().to_bits())),
            None => digest.add(1),
        }
    }
    Ok(())
}

fn windows(tree: &Dataset, count: u64, aligned: bool, with_flags: bool, digest: &mut Digest) -> Outcome<()> {
    let axes = tree.header().form.axes();
    let log: u8 = if axes == 2 { 8 } else { 5 };
    let side = 1u64 << log;
    let sides: [u64; 3] = std::array::from_fn(|axis| if axis < axes { side } else { 1 });
    let cells = sides.iter().product::<u64>() as usize;
    let mut bytes = vec![0; cells * tree.header().form.width()];
    let mut flags = vec![false; cells];
    let mut random = Random(4);
    let coarsest = log.min(tree.depth());
    for _ in 0..count {
        let level = coarsest + random.below(u64::from(tree.depth() - coarsest) + 1) as u8;
        let extent = tree.extent_at(level).max;
        let min = std::array::from_fn(|axis| match sides[axis] {
            1 => 0,
            side if aligned => random.below(extent[axis].div_ceil(side)) * side,
            _ => random.below(extent[axis]),
        });
        let bounds = Bounds { min, max: std::array::from_fn(|axis| min[axis] + sides[axis]) };
        tree.window(level, &bounds, 0.0, &mut bytes, with_flags.then_some(&mut flags[..]))?;
        digest.add_some(&bytes);
        if with_flags {
            flags.iter().step_by(1021).for_each(|flag| digest.add(u64::from(*flag)));
        }
    }
    Ok(())
}

/// Returns a box between two random cells.
fn cuboid(tree: &Dataset, random: &mut Random) -> Bounds {
    let extent = tree.header().extent;
    let (a, b) = (cell(extent, random), cell(extent, random));
    let ends: [_; 3] = std::array::from_fn(|axis| (a[axis].min(b[axis]), a[axis].max(b[axis]) + 1));
    Bounds { min: ends.map(|(min, _)| min), max: ends.map(|(_, max)| max) }
}

fn walk(tree: &Dataset, count: u64, digest: &mut Digest) -> Outcome<()> {
    let mut random = Random(5);
    for _ in 0..count {
        let statistics = tree.statistics(Some(cuboid(tree, &mut random)), &())?;
        digest.add(statistics.cells);
        for channel in &statistics.channels {
            digest.add_numbers(&[
                channel.min.to_f64(),
                channel.max.to_f64(),
                channel.mean,
                channel.standard_deviation,
            ]);
        }
        statistics.classes.iter().for_each(|(_, cells)| digest.add(*cells));
    }
    Ok(())
}

fn histogram(tree: &Dataset, count: u64, digest: &mut Digest) -> Outcome<()> {
    let mut random = Random(6);
    let (low, high) = tree.value_bounds()?.first().copied().unwrap_or_default();
    for _ in 0..count {
        let bins = tree.histogram(&cuboid(tree, &mut random), low, high, 16, &())?;
        bins.into_iter().for_each(|cells| digest.add(cells));
    }
    Ok(())
}

fn find(tree: &Dataset, count: u64, digest: &mut Digest) -> Outcome<()> {
    let mut random = Random(7);
    let (low, high) = tree.value_bounds()?.first().copied().unwrap_or_default();
    let condition = Condition::Above(((low + high) / 2.0).into());
    for _ in 0..count {
        // At most this many, since each has a string.
        let mut left = 1000;
        tree.find(condition, Some(cuboid(tree, &mut random)), &(), &mut |block| {
            digest.add(block.bounds.min[0] ^ block.bounds.max[1] << 32 ^ u64::from(block.level));
            left -= 1;
            Ok(left > 0)
        })?;
    }
    Ok(())
}

fn solid(tree: &Dataset, count: u64, digest: &mut Digest) -> Outcome<()> {
    for _ in 0..count {
        let solid = tree.solid(tree.depth(), &())?;
        let surface = tree.solid_surface(tree.depth(), &())?;
        digest.add(solid.cells);
        digest.add_numbers(&[solid.volume, surface.smooth_area()]);
        digest.add_numbers(&solid.centre.unwrap_or_default());
        surface.faces.into_iter().for_each(|faces| digest.add(faces));
    }
    Ok(())
}
