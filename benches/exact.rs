//! Query rates of exact models, on one thread.
//!
//! `cargo bench --bench exact -- [--only measures|nearest|rays|boxes|cells] FILE...`
//!
//! Files are meshes of closed surfaces, built in a temporary directory, or existing models. They
//! are warm. Points are distributed over the model's bounds, or near the surface; rays go from one
//! such point to another; boxes and cells have a 64th of the space's width, near the surface.

mod measuring;

use std::hint::black_box;
use std::path::{Path, PathBuf};

use measuring::{Outcome, Random, median, seconds};
use spinney::brep::{FaceBuffer, Faces, MassProperties};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::is_model_file;
use spinney::raw::brep::query::Visited;
use spinney::{ExactModel, OpenOptions, Output};

const QUERIES: usize = 20_000;

fn main() -> Outcome<()> {
    let mut only = None;
    let mut files = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--bench" => {}
            "--only" => {
                only = Some(arguments.next().ok_or("--only: got no value, expected the name of a query")?)
            }
            _ => files.push(PathBuf::from(argument)),
        }
    }
    if files.is_empty() {
        println!("exact: no files given, nothing to measure");
    }
    let directory = tempfile::tempdir()?;
    for file in &files {
        println!("{}", file.file_name().unwrap_or_default().to_string_lossy());
        let model = open(file, directory.path())?;
        for (name, measure) in [
            ("measures", measures as fn(&ExactModel) -> Outcome<()>),
            ("nearest", nearest),
            ("rays", rays),
            ("boxes", boxes),
            ("cells", cells),
        ] {
            if only.as_deref().is_none_or(|only| only == name) {
                measure(&model)?;
            }
        }
    }
    Ok(())
}

fn open(file: &Path, directory: &Path) -> Outcome<ExactModel> {
    if is_model_file(file, &Default::default())? {
        return Ok(ExactModel::open(file, &OpenOptions::new())?);
    }
    let path = directory.join("model.goblin");
    import_exact(
        open_all(&[file.to_path_buf()], 1 << 30)?,
        &ExactOptions::new(),
        Output::create(&path)?,
        &(),
    )?;
    Ok(ExactModel::open(&path, &OpenOptions::new())?)
}

/// Points in grid units: distributed over the bounds, or within about 2^-12 of the space's width
/// from the surface.
struct PointSampler {
    random: Random,
    bounds: [[f64; 3]; 2],
    side: f64,
}

impl PointSampler {
    fn of(model: &ExactModel) -> Outcome<PointSampler> {
        let bounds = MassProperties::of(model, &())?.bounds.ok_or("no faces")?;
        let bounds = bounds.map(|corner| model.grid().to_grid(corner));
        Ok(PointSampler { random: Random(1), bounds, side: (1u64 << model.grid().bits) as f64 })
    }

    fn share(&mut self) -> f64 {
        self.random.below(1 << 40) as f64 / (1u64 << 40) as f64
    }

    fn anywhere(&mut self) -> [f64; 3] {
        let [min, max] = self.bounds;
        [0, 1, 2].map(|axis| min[axis] + self.share() * (max[axis] - min[axis]))
    }

    fn near(&mut self, model: &ExactModel) -> Outcome<[f64; 3]> {
        let mut buffer = FaceBuffer::default();
        model.face(self.random.below(model.len()), &mut buffer)?;
        let corner = buffer.face().points[0];
        Ok(corner.map(|at| f64::from(at) + (self.share() - 0.5) * self.side / 2048.0))
    }
}

fn to_world(model: &ExactModel, point: [f64; 3]) -> [f64; 3] {
    let grid = model.grid();
    [0, 1, 2].map(|axis| (point[axis] + grid.origin[axis] as f64) * grid.width())
}

fn measures(model: &ExactModel) -> Outcome<()> {
    let mut times = Vec::new();
    for _ in 0..5 {
        times.push(seconds(|| {
            black_box(MassProperties::of(model, &())?);
            Ok(())
        })?);
    }
    println!("  measures: {:.1} million faces a second", model.len() as f64 / median(&mut times) * 1e-6);
    Ok(())
}

fn report(name: &str, count: usize, time: f64, visited: Visited) {
    let each = |number: u64| number as f64 / count as f64;
    let (nodes, faces) = (each(visited.nodes), each(visited.faces));
    let rate = count as f64 / time * 1e-3;
    println!("  {name}: {rate:.1} thousand a second, {nodes:.1} nodes and {faces:.1} faces each");
}

fn add(sum: &mut Visited, visited: Visited) {
    sum.nodes += visited.nodes;
    sum.faces += visited.faces;
}

fn nearest(model: &ExactModel) -> Outcome<()> {
    let mut sampler = PointSampler::of(model)?;
    for is_near in [false, true] {
        let points: Vec<[f64; 3]> = (0..QUERIES)
            .map(|_| if is_near { sampler.near(model) } else { Ok(sampler.anywhere()) })
            .collect::<Outcome<_>>()?;
        let mut visited = Visited::default();
        let time = seconds(|| {
            for point in &points {
                let found = model.nearest(to_world(model, *point))?.ok_or("no faces")?;
                add(&mut visited, found.visited);
            }
            Ok(())
        })?;
        let name = if is_near { "nearest points, near the surface" } else { "nearest points, anywhere" };
        report(name, QUERIES, time, visited);
    }
    Ok(())
}

fn rays(model: &ExactModel) -> Outcome<()> {
    let mut sampler = PointSampler::of(model)?;
    let ways: Vec<[[f64; 3]; 2]> = (0..QUERIES)
        .map(|_| {
            let (from, to) = (sampler.anywhere(), sampler.anywhere());
            // From outside of the bounds.
            [[0, 1, 2].map(|axis| from[axis] - 3.0 * (to[axis] - from[axis])), to]
        })
        .collect();
    let (mut visited, mut met) = (Visited::default(), 0);
    let time = seconds(|| {
        for [from, to] in &ways {
            let (from, to) = (to_world(model, *from), to_world(model, *to));
            let (hit, work) = model.ray(from, [0, 1, 2].map(|axis| to[axis] - from[axis]))?;
            met += usize::from(hit.is_some());
            add(&mut visited, work);
        }
        Ok(())
    })?;
    report(&format!("rays, {} % of which meet it", 100 * met / QUERIES), QUERIES, time, visited);
    Ok(())
}

fn boxes(model: &ExactModel) -> Outcome<()> {
    let mut sampler = PointSampler::of(model)?;
    let half = sampler.side / 128.0;
    let centres: Vec<[f64; 3]> =
        (0..QUERIES).map(|_| Ok(sampler.near(model)?.map(|at| at + 0.7 * half))).collect::<Outcome<_>>()?;
    let mut visited = Visited::default();
    let time = seconds(|| {
        for centre in &centres {
            let [low, high] = [-half, half].map(|by| to_world(model, centre.map(|at| at + by)));
            let (place, work) = model.locate_box(low, high)?;
            black_box(place);
            add(&mut visited, work);
        }
        Ok(())
    })?;
    report("boxes", QUERIES, time, visited);
    Ok(())
}

fn cells(model: &ExactModel) -> Outcome<()> {
    let mut sampler = PointSampler::of(model)?;
    for level in [6, 9] {
        let width = sampler.side / f64::from(1u32 << level);
        let count = QUERIES / 10;
        let cells: Vec<[u32; 3]> = (0..count)
            .map(|_| Ok(sampler.near(model)?.map(|at| ((at / width).max(0.0) as u32).min((1 << level) - 1))))
            .collect::<Outcome<_>>()?;
        let mut visited = Visited::default();
        let time = seconds(|| {
            for cell in &cells {
                add(&mut visited, model.cell_coverage(level, *cell, &())?.visited);
            }
            Ok(())
        })?;
        report(&format!("coverage of cells of level {level}"), count, time, visited);
    }
    Ok(())
}
