//! The bounding box of all cells that are not VOID.

use std::time::{Duration, Instant};

use spinney::Bounds;
use spinney::raw::ops::{AffineMap, Axis, View, data_box};

use crate::common::{Cells, OCT, QUAD, Random, oct_size, quad_size, seen, value, view_of_cells};

/// Returns the box by brute force.
fn slow_box(cells: &Cells) -> Option<Bounds> {
    let [width, height, _] = cells.size;
    let mut found: Option<Bounds> = None;
    for (i, _) in cells.cells.iter().enumerate().filter(|(_, cell)| cell.is_some()) {
        let i = i as u64;
        let cell = [i % width, i / width % height, i / width / height];
        let bounds = found.get_or_insert(Bounds { min: cell, max: cell.map(|at| at + 1) });
        bounds.min = std::array::from_fn(|axis| bounds.min[axis].min(cell[axis]));
        bounds.max = std::array::from_fn(|axis| bounds.max[axis].max(cell[axis] + 1));
    }
    found
}

#[test]
fn boxes_are_the_smallest() {
    let mut random = Random(5);
    for round in 0..40 {
        let form = if round % 3 == 0 { OCT } else { QUAD };
        let size = if form == QUAD { quad_size(&mut random) } else { oct_size(&mut random) };
        // From no cell at all to one cell in four.
        let one_in = 4 << random.below(9);
        let mut cells = Cells::noise(form, round, size, 9);
        cells.cells.fill_with(|| (random.below(one_in) == 0).then(|| value(form.value, 3)));
        let view = view_of_cells(&cells);
        let turned = || view.clone().transform(&AffineMap::rotation(Axis::Z, 20.0, [4.0; 3]));
        let views: [View; 2] = [view.clone(), turned().unwrap()];
        for view in views {
            assert_eq!(data_box(&view).unwrap(), slow_box(&seen(&view)), "round {round}, {size:?}");
        }
    }
}

#[test]
fn tall_and_wide_rasters_are_cropped_quickly() {
    let start = Instant::now();
    let cells = Cells::noise(QUAD, 1, [8, 8, 1], 5);
    for factors in [[1.0, 7_777_775.0, 1.0], [30_000_000.0, 1.0, 1.0]] {
        let view = view_of_cells(&cells).scale(factors).unwrap();
        let size = view.extent();
        assert_eq!(data_box(&view).unwrap(), Some(Bounds { min: [0; 3], max: size }));
    }
    assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
}
