//! Solids from formulas, as octrees of any depth: `cargo run --release --example solids --
//! DIRECTORY [DEPTH]`
//!
//! Writes `ball.goblin`, `torus.goblin` and `cave.goblin`. A solid is a source of a tree: it
//! classifies a block as empty, full, or to be divided, so that time and memory are proportional to
//! its surface, not to its cells.

use std::path::Path;

use spinney::tree::{Child, Children, Source, build_source};
use spinney::{
    BuildOptions, Code, DataKind, Dimension, Error, Metadata, Output, Result, Rule, SampleType, TreeType,
    Value, ValueType,
};

/// Octrees of bytes.
const FORM: TreeType = TreeType::new(Dimension::Oct, ValueType::new(SampleType::U8, 1));

/// Solid where a function of the coordinates is negative. The function changes by at most the
/// distance between two points, so that its value at the centre of a block can show that the whole
/// block is inside or outside.
struct Formula<F> {
    depth: u8,
    distance: F,
}

impl<F: Fn([f64; 3]) -> f64> Formula<F> {
    /// Classifies a block; coordinates are from -1 to 1.
    fn classify(&self, code: Code) -> Child<Code> {
        let side = 2.0 / (1u64 << code.level()) as f64;
        let middle = code.cell().map(|cell| (f64::from(cell) + 0.5) * side - 1.0);
        let distance = (self.distance)(middle);
        let is_cell = code.level() == self.depth;
        if is_cell || distance.abs() > side * 0.75f64.sqrt() {
            return if distance < 0.0 { Child::Leaf(Value::from([255u8])) } else { Child::Void };
        }
        Child::Inner { representative: Value::from([128u8]), node: code }
    }
}

impl<F: Fn([f64; 3]) -> f64 + Sync> Source for Formula<F> {
    type Node = Code;

    fn form(&self) -> TreeType {
        FORM
    }

    fn depth(&self) -> u8 {
        self.depth
    }

    fn root(&self) -> Result<Child<Code>> {
        Ok(self.classify(Code::root(FORM.dimension)))
    }

    fn children(&self, node: &Code, children: &mut Children<Code>) -> Result<()> {
        *children = std::array::from_fn(|step| self.classify(node.child(step)));
        Ok(())
    }
}

fn length(vector: &[f64]) -> f64 {
    vector.iter().map(|number| number * number).sum::<f64>().sqrt()
}

fn store(directory: &Path, name: &str, depth: u8, distance: impl Fn([f64; 3]) -> f64 + Sync) -> Result<()> {
    let path = directory.join(name).with_extension("goblin");
    let mut metadata = Metadata::default();
    let side = 2.0 / (1u64 << depth) as f64;
    for (axis, row) in metadata.frame.matrix.iter_mut().enumerate() {
        row[axis] = side;
        row[3] = -1.0;
    }
    let options = BuildOptions::new(DataKind::Continuous, depth).rule(Rule::Occupancy).metadata(metadata);
    // The representatives of a source need not be right: the tree computes its own.
    build_source(&Formula { depth, distance }, [1 << depth; 3], &options, Output::create(&path)?, &())?;
    println!("{}", path.display());
    Ok(())
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let directory = arguments.next().unwrap_or_else(|| ".".into());
    let depth = arguments.next().and_then(|depth| depth.parse().ok()).unwrap_or(8);
    let directory = Path::new(&directory);
    std::fs::create_dir_all(directory).map_err(Error::io(directory, "create"))?;
    store(directory, "ball", depth, |point| length(&point) - 0.8)?;
    store(directory, "torus", depth, |[x, y, z]| length(&[length(&[x, y]) - 0.62, z]) - 0.24)?;
    // A box with rounded edges, hollowed by a gyroid.
    store(directory, "cave", depth, |[x, y, z]| {
        let out = [x, y, z].map(|number: f64| (number.abs() - 0.7).max(0.0));
        let [u, v, w] = [x, y, z].map(|number| number * 7.0);
        let gyroid = u.sin() * v.cos() + v.sin() * w.cos() + w.sin() * u.cos();
        (length(&out) - 0.1).max((gyroid.abs() - 0.5) / 12.2)
    })
}
