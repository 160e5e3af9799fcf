//! Solids made of formulas, as octrees of any depth: `cargo run --release --example solids -- FOLDER [DEPTH]`
//!
//! Writes `ball.goblin`, `torus.goblin` and `cave.goblin`. A solid is a source of a tree: it says of a block whether it is
//! empty, full, or has to be looked at more closely, and is never held in memory.

use std::path::Path;

use spinney::Result;
use spinney::space::{Code, Oct};
use spinney::store::Output;
use spinney::store::build::{BuildOptions, build};
use spinney::store::goblin::Metadata;
use spinney::tree::{Child, Source};
use spinney::value::{Kind, Rule};

/// A solid where a function of the place is negative. No change of the function is larger than the change of place, so
/// its value in the middle of a block can tell that all of the block is inside or outside.
struct Formula<F> {
    depth: u8,
    distance: F,
}

impl<F: Fn([f64; 3]) -> f64> Formula<F> {
    /// What a block is; places go from -1 to 1.
    fn look(&self, code: Code<Oct>) -> Child<[u8; 1], Code<Oct>> {
        let side = 2.0 / (1u64 << code.level()) as f64;
        let middle = code.cell().map(|cell| (f64::from(cell) + 0.5) * side - 1.0);
        let distance = (self.distance)(middle);
        let is_cell = code.level() == self.depth;
        if is_cell || distance.abs() > side * 0.75f64.sqrt() {
            return if distance < 0.0 { Child::Leaf([255]) } else { Child::Void };
        }
        Child::Inner { representative: [128], node: code }
    }
}

impl<F: Fn([f64; 3]) -> f64> Source for Formula<F> {
    type Dim = Oct;
    type Value = [u8; 1];
    type Node = Code<Oct>;

    fn depth(&self) -> u8 {
        self.depth
    }

    fn root(&self) -> Result<Child<[u8; 1], Code<Oct>>> {
        Ok(self.look(Code::ROOT))
    }

    fn each_child(
        &self,
        node: &Code<Oct>,
        mut each: impl FnMut(usize, Child<[u8; 1], Code<Oct>>) -> Result<()>,
    ) -> Result<()> {
        (0..8).try_for_each(|step| each(step, self.look(node.child(step))))
    }
}

fn length(place: &[f64]) -> f64 {
    place.iter().map(|number| number * number).sum::<f64>().sqrt()
}

fn store(folder: &Path, name: &str, depth: u8, distance: impl Fn([f64; 3]) -> f64 + Sync) -> Result<()> {
    let path = folder.join(name).with_extension("goblin");
    let mut metadata = Metadata::default();
    let side = 2.0 / (1u64 << depth) as f64;
    for (axis, row) in metadata.frame.matrix.iter_mut().enumerate() {
        row[axis] = side;
        row[3] = -1.0;
    }
    let options = BuildOptions {
        rule: Rule::Occupancy,
        kind: Kind::Continuous,
        depth,
        memory: 256 << 20,
        metadata,
        share: false,
    };
    build(&Formula { depth, distance }, [1 << depth; 3], &options, Output::create(&path)?, &())?;
    println!("{}", path.display());
    Ok(())
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().unwrap_or_else(|| ".".into());
    let depth = arguments.next().and_then(|depth| depth.parse().ok()).unwrap_or(8);
    let folder = Path::new(&folder);
    store(folder, "ball", depth, |place| length(&place) - 0.8)?;
    store(folder, "torus", depth, |[x, y, z]| length(&[length(&[x, y]) - 0.62, z]) - 0.24)?;
    // A box with rounded edges, hollowed by a gyroid.
    store(folder, "cave", depth, |[x, y, z]| {
        let out = [x, y, z].map(|place: f64| (place.abs() - 0.7).max(0.0));
        let [u, v, w] = [x, y, z].map(|place| place * 7.0);
        let gyroid = u.sin() * v.cos() + v.sin() * w.cos() + w.sin() * u.cos();
        (length(&out) - 0.1).max((gyroid.abs() - 0.5) / 12.2)
    })
}
