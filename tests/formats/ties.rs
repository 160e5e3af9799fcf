//! Majorities of tied classes: the children decide, in the same way everywhere, without a bias to
//! any class.

use spinney::edit::{Edit, Note};
use spinney::raw::ops::apply_edits;
use spinney::raw::store::autumnal::Autumnal;
use spinney::raw::store::goblin::Goblin;
use spinney::{Code, Codec, DataKind, Dataset, Rule, SampleType, Value};

use super::counted::CountedFile;
use crate::common::{
    Cells, Random, goblin, goblin_bytes, goblin_from_tree, made, oct, options, quad, same_trees, value, with,
    write_cells,
};

const MAJORITY: (Rule, DataKind) = (Rule::Majority, DataKind::Categorical);

/// Classes in order, with their cell counts.
type Counts = Vec<(Value, u64)>;

/// Decides a tie, given the tied classes, the children's values, and the cells that each tied class
/// has.
type Decision = fn(&[Value], &[Value], u64) -> Value;

/// The rule of formats.md.
fn by_children(tied: &[Value], children: &[Value], cells: u64) -> Value {
    if let Some(first) = children.iter().find(|child| tied.contains(child)) {
        return *first;
    }
    let mut hash = cells;
    for child in children {
        let [low, high] =
            [0, 8].map(|at| u64::from_le_bytes(child.to_bytes()[at..at + 8].try_into().unwrap()));
        hash = (hash ^ low ^ high).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        hash ^= hash >> 32;
    }
    tied[(hash % tied.len() as u64) as usize]
}

/// The previous rule: the lowest class.
fn by_number(tied: &[Value], _: &[Value], _: u64) -> Value {
    tied[0]
}

/// Returns a node's value and its class counts, and calls `see` for all nodes below it.
fn model(
    cells: &Cells,
    code: Code,
    depth: u8,
    decide: Decision,
    see: &mut dyn FnMut(Code, Option<Value>, bool),
) -> (Option<Value>, Counts) {
    if code.level() == depth {
        let value = cells.get(code.cell().map(u64::from));
        see(code, value, false);
        return (value, value.map(|value| (value, 1)).into_iter().collect());
    }
    let (mut children, mut counts) = (Vec::new(), Counts::new());
    for step in 0..cells.form.children() {
        let (value, below) = model(cells, code.child(step), depth, decide, see);
        children.extend(value);
        for (class, cells) in below {
            match counts.iter_mut().find(|(other, _)| *other == class) {
                Some((_, sum)) => *sum += cells,
                None => counts.push((class, cells)),
            }
        }
    }
    counts.sort_by_key(|(class, _)| cells.form.value.order_key(*class));
    let most = counts.iter().map(|(_, cells)| *cells).max().unwrap_or(0);
    let tied: Vec<_> = counts.iter().filter(|(_, cells)| *cells == most).map(|(class, _)| *class).collect();
    let value = (most > 0).then(|| if tied.len() == 1 { tied[0] } else { decide(&tied, &children, most) });
    see(code, value, tied.len() > 1 && !children.iter().any(|child| tied.contains(child)));
    (value, counts)
}

/// Compares all nodes of a tree with the model's. Returns the number of nodes that a hash decided.
fn check(cells: &Cells, what: &str, value_at: &dyn Fn(Code) -> Option<Value>) -> usize {
    let mut hashed = 0;
    model(
        cells,
        Code::root(cells.form.dimension),
        cells.depth(),
        by_children,
        &mut |code, value, is_hashed| {
            assert_eq!(value_at(code), value, "{what}, {code}");
            hashed += usize::from(is_hashed);
        },
    );
    hashed
}

/// Returns small rasters and volumes of few classes, with many ties; every second one has VOID
/// cells.
fn rasters() -> Vec<Cells> {
    let mut all = Vec::new();
    for sample in [SampleType::U8, SampleType::U16, SampleType::I32] {
        for (number, classes) in [2, 3, 4, 12].into_iter().enumerate() {
            let seed = 100 * classes + number as u64;
            for (form, size) in [
                (quad(sample, 1), [64, 64, 1]),
                (quad(sample, 1), [61, 50, 1]),
                (oct(sample, 1), [16, 16, 16]),
            ] {
                all.push(match number % 2 {
                    0 => Cells::noise(form, seed, size, classes),
                    _ => {
                        let mut random = Random(seed);
                        let cells = (0..size.iter().product())
                            .map(|_| Some(value(form.value, random.below(classes))));
                        Cells { form, size, cells: cells.collect() }
                    }
                });
                all.push(Cells::random(form, seed, size, classes, number % 2 == 0));
            }
        }
    }
    all
}

#[test]
fn all_trees_agree_with_the_model() {
    let mut hashed = 0;
    let directory = tempfile::tempdir().unwrap();
    for (number, cells) in rasters().iter().enumerate() {
        let what = format!("{number}, {}", cells.form);
        let tree = cells.tree(Rule::Majority);
        hashed += check(cells, &what, &|code| tree.value_at(code));
        let bytes = goblin_bytes(cells, Rule::Majority, DataKind::Categorical);
        let file = Goblin::from_bytes(bytes.clone()).unwrap();
        check(cells, &what, &|code| file.value_at(code).unwrap());
        assert!(
            bytes == goblin_from_tree(&tree, cells.size, Rule::Majority, DataKind::Categorical),
            "{what}"
        );
        assert_eq!(Dataset::of(file.into()).unwrap().verify(1 << 24, &()).unwrap(), [], "{what}");
        let path = directory.path().join(format!("{number}.goblin"));
        let how = options(MAJORITY.0, MAJORITY.1, cells.depth());
        write_cells(&path, cells, &with(how.clone(), |it| it.packing.codec = Codec::Packed));
        let packed = Goblin::open(&path, &Default::default()).unwrap();
        check(cells, &what, &|code| packed.value_at(code).unwrap());
        let path = path.with_extension("autumn");
        write_cells(&path, cells, &how);
        let file = Autumnal::open(&path, &Default::default()).unwrap();
        check(cells, &what, &|code| file.value_at(code).unwrap());
        assert_eq!(file.verify(1 << 24, &()).unwrap(), [], "{what}");
    }
    assert!(hashed > 20, "{hashed}");
}

#[test]
fn large_blocks_agree_with_the_tree_in_memory() {
    let form = quad(SampleType::U8, 1);
    for (size, classes) in [([512, 512, 1], 4), ([600, 300, 1], 2), ([256, 256, 1], 200)] {
        let mut random = Random(classes);
        let cells = made(form, size, |_| None);
        let cells = Cells {
            cells: cells.cells.iter().map(|_| Some(value(form.value, random.below(classes)))).collect(),
            ..cells
        };
        same_trees(&goblin(&cells, Rule::Majority, DataKind::Categorical), &cells.tree(Rule::Majority));
    }
    // Squares of two classes whose nodes are tied on all levels.
    let cells = made(form, [512, 512, 1], |[x, y, _]| Some(value(form.value, (x + y) % 2 + 2 * (x / 8 % 2))));
    same_trees(&goblin(&cells, Rule::Majority, DataKind::Categorical), &cells.tree(Rule::Majority));
}

#[test]
fn edited_files_are_those_that_are_built() {
    for (form, size) in [(quad(SampleType::U8, 1), [100, 64, 1]), (oct(SampleType::U16, 1), [16, 16, 16])] {
        let mut cells = Cells::noise(form, 7, size, 4);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("t.autumn");
        write_cells(&path, &cells, &options(MAJORITY.0, MAJORITY.1, cells.depth()));
        let mut file = CountedFile::new(std::fs::read(&path).unwrap());
        let mut random = Random(3);
        for number in 0..20 {
            let at = size.map(|side| random.below(side));
            let new = (number % 5 > 0).then(|| value(form.value, random.below(4)));
            let samples = new.map(|new| form.value.numbers(new)[..1].to_vec());
            let edit = Edit::Set(vec![(at, samples)]);
            apply_edits(&mut file.editor, &mut [Ok(edit)].into_iter(), &()).unwrap();
            file.editor.commit(Note::default()).unwrap();
            cells.cells[((at[2] * size[1] + at[1]) * size[0] + at[0]) as usize] = new;
        }
        same_trees(&*file.editor.tree(), &cells.tree(Rule::Majority));
        let tree = Autumnal::from_bytes(file.bytes()).unwrap();
        check(&cells, "edited", &|code| tree.value_at(code).unwrap());
        assert_eq!(tree.verify(1 << 24, &()).unwrap(), []);
    }
}

/// Returns a raster of four classes with equal cell counts: noise, or noise in squares with single
/// cells between them.
fn equal_shares(seed: u64, clustered: bool) -> Cells {
    const SIDE: u64 = 256;
    let form = quad(SampleType::U8, 1);
    let mut random = Random(seed);
    let mut squares: Vec<u64> = (0..SIDE * SIDE / 9 + SIDE).map(|number| number % 4).collect();
    let mut noise: Vec<u64> = (0..SIDE * SIDE).map(|number| number % 4).collect();
    for list in [&mut squares, &mut noise] {
        for last in (1..list.len()).rev() {
            list.swap(last, random.below(last as u64 + 1) as usize);
        }
    }
    made(form, [SIDE, SIDE, 1], |[x, y, _]| {
        let own = noise[(x + SIDE * y) as usize];
        let square = squares[(x / 3 + (SIDE / 3 + 1) * (y / 3)) as usize];
        Some(value(form.value, if clustered && own % 4 + x % 5 != 3 { square } else { own }))
    })
}

/// Returns the deviation of four classes' shares from their shares of cells, on each of four
/// levels, in standard deviations of a mean over some rasters; then, likewise, the difference
/// between the upper two classes and the lower two.
fn biases(clustered: bool, decide: Decision) -> Vec<[f64; 5]> {
    const RASTERS: u64 = 8;
    let mut found = Vec::new();
    for above in 1..=4u8 {
        found.push((above, vec![[0.0; 5]; RASTERS as usize]));
    }
    for raster in 0..RASTERS {
        let cells = equal_shares(900 + raster, clustered);
        let depth = cells.depth();
        let mut counts = [[0.0; 4]; 5];
        model(&cells, Code::root(cells.form.dimension), depth, decide, &mut |code, found, _| {
            let above = usize::from(depth - code.level());
            if above <= 4 {
                let class = (0..4).find(|class| found == Some(value(cells.form.value, *class))).unwrap();
                counts[above][class as usize] += 1.0;
            }
        });
        let shares = counts.map(|counts| counts.map(|count| count / counts.iter().sum::<f64>()));
        for (above, differences) in &mut found {
            let own = &mut differences[raster as usize];
            for class in 0..4 {
                own[class] = shares[usize::from(*above)][class] - shares[0][class];
            }
            own[4] = own[3] + own[2] - own[1] - own[0];
        }
    }
    let deviations = found.into_iter().map(|(above, differences)| {
        // Nodes are at best independent: a share of one quarter then has this standard deviation.
        let nodes = (65_536 >> (2 * above)) as f64 * RASTERS as f64;
        let deviation = (0.25f64 * 0.75 / nodes).sqrt();
        std::array::from_fn(|number| {
            let mean = differences.iter().map(|own| own[number]).sum::<f64>() / RASTERS as f64;
            mean / deviation / if number == 4 { (4.0f64 / 3.0).sqrt() * 2.0 } else { 1.0 }
        })
    });
    deviations.collect()
}

#[test]
fn no_class_grows_with_the_levels() {
    for clustered in [false, true] {
        for (above, biases) in (1..).zip(biases(clustered, by_children)) {
            assert!(
                biases.iter().all(|bias| bias.abs() < 3.0),
                "{clustered}, {above} levels above: {biases:?}"
            );
        }
        // If the lowest class wins, its share grows and the highest class's share shrinks. Higher
        // levels have too few nodes to show it.
        for (above, [lowest, .., highest, order]) in (1..).zip(biases(clustered, by_number)).take(2) {
            let is_biased = lowest > 3.0 && highest < -3.0 && order < -3.0;
            assert!(is_biased, "{clustered}, {above} levels above: {lowest}, {highest}, {order}");
        }
    }
}

#[test]
fn files_have_the_shares_of_the_cells() {
    let mut shares = vec![[0.0; 4]; 4];
    for seed in 0..4 {
        let cells = equal_shares(seed, false);
        let file = goblin(&cells, Rule::Majority, DataKind::Categorical);
        for above in 1..=4u8 {
            let level = cells.depth() - above;
            let side = 1u32 << level;
            for number in 0..side * side {
                let code =
                    Code::from_cell(cells.form.dimension, level, [number % side, number / side, 0]).unwrap();
                let found = file.value_at(code).unwrap();
                let class = (0..4).find(|class| found == Some(value(cells.form.value, *class))).unwrap();
                shares[usize::from(above - 1)][class as usize] += 0.25 / f64::from(side * side);
            }
        }
    }
    for (above, shares) in (1..).zip(&shares) {
        let deviation = (0.25f64 * 0.75 / (4.0 * (65_536 >> (2 * above)) as f64)).sqrt();
        assert!(shares.iter().all(|share| (share - 0.25).abs() < 3.0 * deviation), "{above}: {shares:?}");
    }
}
