//! All symmetries of the square and the cube, singly and in pairs, against permuted cell arrays.

use spinney::raw::ops::{AffineMap, Axis, View};
use spinney::{DataKind, Frame, Rule, ViewOperation};

use crate::common::{
    Cells, OCT, QUAD, assert_same, goblin, goblin_bytes, goblin_from_view, seen, view_in, view_of_cells,
    view_of_file,
};

/// The source axis of each axis of the result, and whether it is mirrored.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Symmetry {
    from: [usize; 3],
    mirror: [bool; 3],
}

impl Symmetry {
    const NONE: Symmetry = Symmetry { from: [0, 1, 2], mirror: [false; 3] };

    /// Returns the 48 of the cube, or the 8 of the square.
    fn all(axes: usize) -> Vec<Symmetry> {
        let mut all = Vec::new();
        for number in 0..27 * 8usize {
            let from = [number / 8 % 3, number / 24 % 3, number / 72];
            let mirror = std::array::from_fn(|axis| number >> axis & 1 > 0);
            let is_order = from[0] != from[1] && from[1] != from[2] && from[0] != from[2];
            let in_plane = from[2] == 2 && !mirror[2];
            if is_order && (axes > 2 || in_plane) {
                all.push(Symmetry { from, mirror });
            }
        }
        assert_eq!(all.len(), if axes > 2 { 48 } else { 8 });
        all
    }

    /// Returns the command-line form.
    fn text(&self, axes: usize) -> String {
        let parts = (0..axes).map(|to| {
            let sign = if self.mirror[to] { '-' } else { '+' };
            format!("{sign}{}", ["x", "y", "z"][self.from[to]])
        });
        format!("axes={}", parts.collect::<Vec<_>>().join(","))
    }

    fn map(&self) -> AffineMap {
        AffineMap::symmetry(self.from.map(|axis| [Axis::X, Axis::Y, Axis::Z][axis]), self.mirror).unwrap()
    }

    /// This, then another: an axis of the result comes from an intermediate axis, which comes from
    /// one of the first.
    fn then(&self, next: &Symmetry) -> Symmetry {
        Symmetry {
            from: next.from.map(|between| self.from[between]),
            mirror: std::array::from_fn(|to| next.mirror[to] != self.mirror[next.from[to]]),
        }
    }

    /// Returns the position that a cell of a box moves to.
    fn place(&self, cell: [u64; 3], size: [u64; 3]) -> [u64; 3] {
        std::array::from_fn(|to| {
            let axis = self.from[to];
            if self.mirror[to] { size[axis] - 1 - cell[axis] } else { cell[axis] }
        })
    }

    /// Moves every cell.
    fn of(&self, cells: &Cells) -> Cells {
        let size = self.from.map(|axis| cells.size[axis]);
        let mut moved = Cells { form: cells.form, size, cells: vec![None; cells.cells.len()] };
        each_cell(cells.size, |cell| {
            let [x, y, z] = self.place(cell, cells.size);
            moved.cells[((z * size[1] + y) * size[0] + x) as usize] = cells.get(cell);
        });
        moved
    }
}

fn each_cell(size: [u64; 3], mut each: impl FnMut([u64; 3])) {
    for z in 0..size[2] {
        for y in 0..size[1] {
            (0..size[0]).for_each(|x| each([x, y, z]));
        }
    }
}

/// Applies an operation in text form.
fn done(view: View, step: &str) -> View {
    let step: ViewOperation = step.parse().unwrap();
    step.apply(view).unwrap()
}

fn is_same(a: &Cells, b: &Cells) -> bool {
    a.size == b.size && a.cells == b.cells
}

fn one_by_one(cells: &Cells) {
    let (view, axes) = (view_of_cells(cells), cells.form.axes());
    for symmetry in Symmetry::all(axes) {
        let expected = symmetry.of(cells);
        let text = symmetry.text(axes);
        let what = format!("{text} of {:?}", cells.size);
        assert_same(&seen(&done(view.clone(), &text)), &expected, &what);
        assert_same(&seen(&view.clone().transform(&symmetry.map()).unwrap()), &expected, &what);
    }
}

#[test]
fn every_symmetry_of_the_cube() {
    // A cube, and boxes whose sides would show a wrong order of axes.
    for size in [[8, 8, 8], [7, 5, 3], [2, 8, 5]] {
        one_by_one(&Cells::noise(OCT, 41, size, 200));
    }
    // Large leaves next to detail.
    for seed in 0..4 {
        one_by_one(&Cells::random(OCT, seed, [8, 7, 8], 3, true));
    }
}

#[test]
fn every_symmetry_of_the_square() {
    for size in [[8, 8, 1], [7, 3, 1], [5, 16, 1]] {
        one_by_one(&Cells::noise(QUAD, 42, size, 200));
    }
    for seed in 0..4 {
        one_by_one(&Cells::random(QUAD, seed, [32, 29, 1], 3, true));
    }
}

fn distinct(cells: &Cells) {
    let (view, axes) = (view_of_cells(cells), cells.form.axes());
    let mut all: Vec<Cells> = Vec::new();
    for symmetry in Symmetry::all(axes) {
        let text = symmetry.text(axes);
        let found = seen(&done(view.clone(), &text));
        assert!(!all.iter().any(|other| is_same(other, &found)), "{text} is like another");
        all.push(found);
    }
}

#[test]
fn no_two_symmetries_are_alike() {
    distinct(&Cells::noise(OCT, 43, [4, 4, 4], 200));
    distinct(&Cells::noise(QUAD, 43, [4, 4, 1], 200));
}

fn in_pairs(cells: &Cells) {
    let (view, axes) = (view_of_cells(cells), cells.form.axes());
    for first in Symmetry::all(axes) {
        let once = done(view.clone(), &first.text(axes));
        let mut back = 0;
        for second in Symmetry::all(axes) {
            let product = first.then(&second);
            let what = format!("{}, then {}", first.text(axes), second.text(axes));
            let twice = done(once.clone(), &second.text(axes));
            let at_once = done(view.clone(), &product.text(axes));
            assert_eq!(first.map().then(&second.map()), product.map(), "{what}");
            assert_eq!(twice.to_source(), at_once.to_source(), "{what}");
            let twice = seen(&twice);
            assert_same(&twice, &seen(&at_once), &what);
            assert_same(&twice, &second.of(&first.of(cells)), &what);
            if product == Symmetry::NONE {
                assert_same(&twice, cells, &what);
                back += 1;
            }
        }
        assert_eq!(back, 1, "one way back of {first:?}");
    }
}

#[test]
fn one_after_the_other_is_their_product() {
    in_pairs(&Cells::noise(OCT, 44, [7, 5, 3], 200));
    in_pairs(&Cells::noise(QUAD, 44, [7, 3, 1], 200));
}

/// Returns the number of different images generated by operations, until no new one appears.
fn generated(cells: &Cells, steps: &[&str]) -> usize {
    let mut views = vec![view_of_cells(cells)];
    let mut all = vec![cells.clone()];
    while let Some(view) = views.pop() {
        for step in steps {
            let next = done(view.clone(), step);
            let found = seen(&next);
            if !all.iter().any(|other| is_same(other, &found)) {
                assert!(all.len() < 48, "{steps:?} make more than there are");
                all.push(found);
                views.push(next);
            }
        }
    }
    all.len()
}

#[test]
fn turns_and_mirrorings_make_all_of_them() {
    let cube = Cells::noise(OCT, 45, [4, 4, 4], 200);
    assert_eq!(generated(&cube, &["rotate=90,x", "rotate=90,y"]), 24, "turns alone");
    assert_eq!(generated(&cube, &["rotate=90,x", "rotate=90,z", "mirror=y"]), 48);
    assert_eq!(generated(&cube, &["mirror=x", "mirror=y", "mirror=z"]), 8);
    assert_eq!(generated(&cube, &["rotate=120,1,1,1"]), 3, "about a diagonal");
    let square = Cells::noise(QUAD, 45, [4, 4, 1], 200);
    assert_eq!(generated(&square, &["rotate=90"]), 4);
    assert_eq!(generated(&square, &["rotate=90", "transpose"]), 8);
    assert_eq!(generated(&square, &["mirror=x", "mirror=y"]), 4);
}

#[test]
fn turns_and_mirrorings_by_their_axes() {
    // The expected axes: a rotation maps x to y, y to z or z to x, and an axis that maps to a
    // negative one is mirrored.
    let names = [
        ("rotate=90", "axes=-y,+x,+z"),
        ("rotate=90,x", "axes=+x,-z,+y"),
        ("rotate=90,y", "axes=+z,+y,-x"),
        ("rotate=-90,z", "axes=+y,-x,+z"),
        ("rotate=180,x", "axes=+x,-y,-z"),
        ("rotate=270,y", "axes=-z,+y,+x"),
        ("rotate=120,1,1,1", "axes=+z,+x,+y"),
        ("rotate=-120,1,1,1", "axes=+y,+z,+x"),
        ("rotate=180,1,1,0", "axes=+y,+x,-z"),
        ("mirror=x", "axes=-x,+y,+z"),
        ("mirror=y", "axes=+x,-y,+z"),
        ("mirror=z", "axes=+x,+y,-z"),
        ("transpose", "axes=+y,+x,+z"),
        ("scale=1", "axes=+x,+y,+z"),
        ("affine=0,0,-1,9,1,0,0,-4,0,1,0,2", "axes=-z,+x,+y"),
    ];
    // About the centre of an odd by even number of cells, a quarter turn must not cut cells in
    // half.
    for size in [[7, 5, 3], [7, 4, 3], [4, 6, 5], [8, 2, 5]] {
        let view = view_of_cells(&Cells::noise(OCT, 46, size, 200));
        for (name, axes) in names {
            let [found, expected] = [name, axes].map(|step| seen(&done(view.clone(), step)));
            assert_same(&found, &expected, &format!("{name} of {size:?}"));
        }
    }
    for size in [[7, 4, 1], [4, 7, 1], [6, 4, 1]] {
        let view = view_of_cells(&Cells::noise(QUAD, 46, size, 200));
        for (name, axes) in
            [("rotate=90", "axes=-y,+x"), ("rotate=-90", "axes=+y,-x"), ("rotate=180", "axes=-x,-y")]
        {
            let [found, expected] = [name, axes].map(|step| seen(&done(view.clone(), step)));
            assert_same(&found, &expected, &format!("{name} of {size:?}"));
        }
    }
}

#[test]
fn turned_about_the_middle_and_back() {
    let frame = Frame::planar([0.5, 0.25, 100.0, 0.125, -0.5, 50.0]);
    for size in [[7, 5, 3], [7, 4, 2], [4, 7, 2]] {
        let cells = Cells::noise(OCT, 49, size, 200);
        let chains: [&[&str]; 5] = [
            &["rotate=90", "rotate=-90"],
            &["rotate=-90,x", "rotate=90,x"],
            &["rotate=90,y", "rotate=90,y", "rotate=90,y", "rotate=90,y"],
            &["rotate=90,0,0,1", "rotate=-90,z"],
            &["rotate=120,1,1,1", "rotate=-120,1,1,1"],
        ];
        for steps in chains {
            let view = steps.iter().fold(view_in(&cells, &frame), |view, step| done(view, step));
            assert_same(&seen(&view), &cells, &format!("{steps:?} of {size:?}"));
            assert_eq!(view.frame(true), frame, "{steps:?} of {size:?}: moved back in the world, too");
        }
    }
    // An explicit centre is used: here half a cell off, which cuts cells.
    let view = view_of_cells(&Cells::noise(QUAD, 49, [6, 4, 1], 200));
    let extent = |step: &str| done(view.clone(), step).extent();
    assert_eq!(extent("rotate=90@3,2"), [4, 6, 1]);
    assert_eq!(extent("rotate=90@3.5,2"), [5, 7, 1]);
}

fn in_files(cells: &Cells) {
    let (rule, kind) = (Rule::Majority, DataKind::Categorical);
    let view = view_of_file(goblin(cells, rule, kind), cells.size);
    for symmetry in Symmetry::all(cells.form.axes()) {
        let found = goblin_from_view(&view.clone().transform(&symmetry.map()).unwrap(), rule, kind);
        let expected = goblin_bytes(&symmetry.of(cells), rule, kind);
        assert!(found == expected, "{}", symmetry.text(cells.form.axes()));
    }
}

#[test]
fn files_of_symmetries_are_those_of_the_cells() {
    // Large enough that whole blocks of cells are drawn, and several of them.
    in_files(&Cells::noise(OCT, 47, [70, 21, 40], 9));
    in_files(&Cells::noise(QUAD, 47, [300, 260, 1], 9));
}

fn in_the_world(cells: &Cells) {
    let (axes, size) = (cells.form.axes(), cells.size);
    let mut frame = Frame::planar([0.5, 0.25, 100.0, 0.125, -0.5, 50.0]);
    frame.matrix[2] = if axes > 2 { [0.25, 0.0, 2.0, -7.0] } else { frame.matrix[2] };
    let view = view_in(cells, &frame);
    for symmetry in Symmetry::all(axes) {
        let there = view.clone().transform(&symmetry.map()).unwrap().frame(false);
        each_cell(size, |cell| {
            let centre = |cell: [u64; 3]| cell.map(|cell| cell as f64 + 0.5);
            let found = there.to_world(centre(symmetry.place(cell, size)));
            assert_eq!(found, frame.to_world(centre(cell)), "{cell:?}, {}", symmetry.text(axes));
        });
    }
}

#[test]
fn every_cell_stays_where_it_is_in_the_world() {
    in_the_world(&Cells::noise(OCT, 48, [7, 5, 3], 200));
    in_the_world(&Cells::noise(QUAD, 48, [7, 3, 1], 200));
}
