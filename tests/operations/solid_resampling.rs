//! Resampled solids of cells keep their volume: against overlaps of boxes, and points within cells.

use spinney::raw::ops::{AffineMap, Axis, Sampling, View};
use spinney::{DataKind, Frame, Rule};

use crate::common::{Cells, OCT, Random, as_byte, byte, cells_of, goblin, made, view_of_file};

/// Returns a solid of up to 7 cells along each axis that touches all sides: full, partially full
/// and empty cells.
fn solid(random: &mut Random) -> Cells {
    let size = [0; 3].map(|_| 1 + random.below(7));
    let noise = Cells::random(OCT, random.next(), size, 8, true);
    let fullness = [255, 255, 255, 255, 100, 31, 254, 1];
    made(OCT, size, |cell| Some(byte(fullness[as_byte(noise.get(cell)?) as usize % 8])))
}

/// Returns a view of a solid that resamples by its rule.
fn view(cells: &Cells) -> View {
    view_of_file(goblin(cells, Rule::Occupancy, DataKind::Continuous), cells.size)
        .sampled(Sampling::Area(Rule::Occupancy))
        .unwrap()
}

/// A window that hides everything outside: the frame of its cells, and their numbers.
type Window = (Frame, [u64; 3]);

fn volume(cells: &Cells) -> f64 {
    cells.cells.iter().flatten().map(|value| f64::from(as_byte(*value)) / 255.0).sum()
}

/// Returns the box of the source that a box of a frame's cells covers, for frames along the axes.
fn image(frame: &Frame, min: [f64; 3], max: [f64; 3]) -> [[f64; 2]; 3] {
    let (low, high) = (frame.to_world(min), frame.to_world(max));
    std::array::from_fn(|axis| [low[axis].min(high[axis]), low[axis].max(high[axis])])
}

/// Returns how full a box is, from the overlaps with all cells of the source.
fn filled(cells: &Cells, space: [[f64; 2]; 3], windows: &[Window]) -> f64 {
    let mut shown = space;
    for (frame, size) in windows {
        let window = image(frame, [0.0; 3], size.map(|cells| cells as f64));
        for (shown, window) in shown.iter_mut().zip(window) {
            *shown = [shown[0].max(window[0]), shown[1].min(window[1])];
        }
    }
    let mut sum = 0.0;
    for z in 0..cells.size[2] {
        for y in 0..cells.size[1] {
            for x in 0..cells.size[0] {
                let Some(value) = cells.get([x, y, z]) else { continue };
                let overlap = |(cell, [low, high]): (u64, [f64; 2])| {
                    (high.min(cell as f64 + 1.0) - low.max(cell as f64)).max(0.0)
                };
                let share: f64 = [x, y, z].into_iter().zip(shown).map(overlap).product();
                sum += share * f64::from(as_byte(value));
            }
        }
    }
    sum / space.iter().map(|[low, high]| high - low).product::<f64>()
}

fn each_cell(size: [u64; 3], mut each: impl FnMut([u64; 3])) {
    for z in 0..size[2] {
        for y in 0..size[1] {
            (0..size[0]).for_each(|x| each([x, y, z]));
        }
    }
}

/// Applies a random operation that keeps axes.
fn operation(view: View, random: &mut Random, windows: &mut Vec<Window>) -> View {
    let number = |random: &mut Random| 0.3 + random.below(200) as f64 / 100.0;
    match random.below(5) {
        0 => view.scale([0; 3].map(|_| number(random))).unwrap(),
        1 => view.translate([0; 3].map(|_| random.below(500) as f64 / 100.0 - 2.5)).unwrap(),
        2 => {
            let depth = view.depth();
            view.resample((depth + 1).saturating_sub(random.below(3) as u8)).unwrap()
        }
        3 => {
            let map = AffineMap::scaling([-number(random), number(random), -number(random)]);
            view.transform(&map).unwrap()
        }
        _ => {
            let size = view.extent();
            let first = size.map(|cells| random.below(cells) as i64);
            let size = size.map(|cells| 1 + random.below(cells + 2));
            let view = view.window(first, size).unwrap();
            windows.push((view.frame(false), size));
            view
        }
    }
}

#[test]
fn cells_have_the_overlap_with_the_source() {
    let mut random = Random(0x50_11d5);
    for case in 0..80 {
        let cells = solid(&mut random);
        let (mut view, mut windows) = (view(&cells), Vec::new());
        for _ in 0..1 + random.below(3) {
            view = operation(view, &mut random, &mut windows);
        }
        let (frame, size) = (view.frame(false), view.extent());
        let found = cells_of(&view, size);
        let mut total = 0.0;
        each_cell(size, |cell| {
            let [min, max] = [0, 1].map(|end| cell.map(|cell| (cell + end) as f64));
            let expected = filled(&cells, image(&frame, min, max), &windows);
            let byte = found.get(cell).map_or(0, as_byte);
            // (On the border of two numbers, rounding errors decide.)
            assert!((f64::from(byte) - expected).abs() < 0.5001, "{case}: {cell:?}: {byte}, {expected}");
            total += expected / 255.0 * frame.linear().determinant().abs();
        });
        if windows.is_empty() {
            assert!((total - volume(&cells)).abs() < 1e-6, "{case}: {total}, {}", volume(&cells));
        }
    }
}

#[test]
fn turned_solids_keep_their_volume() {
    const SAMPLES: u64 = 6;
    let mut random = Random(0x7_0211ed);
    for case in 0..25 {
        let cells = solid(&mut random);
        let (mut view, mut windows) = (view(&cells), Vec::new());
        if random.below(3) == 0 {
            view = operation(view, &mut random, &mut windows);
        }
        let centre = [0; 3].map(|_| random.below(70) as f64 / 10.0);
        let turn = match random.below(2) {
            0 => AffineMap::rotation(Axis::Z, random.below(360) as f64, centre),
            _ => {
                let axis = [0; 3].map(|_| 1.0 + random.below(9) as f64);
                AffineMap::rotation_about(axis, random.below(360) as f64, centre).unwrap()
            }
        };
        view = view.transform(&turn).unwrap();
        if random.below(3) == 0 {
            view = operation(view, &mut random, &mut windows);
        }
        let (frame, size) = (view.frame(false), view.extent());
        let found = cells_of(&view, size);
        let (mut worst, mut sum) = (0.0f64, 0.0);
        each_cell(size, |cell| {
            // The mean of points that are evenly spaced in the cell.
            let mut mean = 0.0;
            each_cell([SAMPLES; 3], |at| {
                let point = |axis: usize| cell[axis] as f64 + (at[axis] as f64 + 0.5) / SAMPLES as f64;
                let point = frame.to_world(std::array::from_fn(point));
                let is_shown = windows.iter().all(|(frame, size)| {
                    let inside = frame.to_cells(point).unwrap();
                    (0..3).all(|axis| inside[axis] >= 0.0 && inside[axis] < size[axis] as f64)
                });
                let value = cells.at(point.map(|number| number.floor() as i64)).filter(|_| is_shown);
                mean += value.map_or(0.0, |value| f64::from(as_byte(value)));
            });
            mean /= SAMPLES.pow(3) as f64;
            let byte = f64::from(found.get(cell).map_or(0, as_byte));
            worst = worst.max((byte - mean).abs());
            sum += byte / 255.0;
        });
        assert!(worst < 30.0, "{case}: a cell differs by {worst} of 255");
        let (sum, expected) = (sum * frame.linear().determinant().abs(), volume(&cells));
        if windows.is_empty() {
            let rounding = found.count() as f64 * 0.5 / 255.0 * frame.linear().determinant().abs();
            assert!((sum - expected).abs() <= rounding, "{case}: volume {sum}, expected {expected}");
        }
    }
}

#[test]
fn other_rules_and_nearest_are_unchanged() {
    // A full block of 3 x 3 x 1 cells, translated by half a cell: the mean of what is there.
    let cells = made(OCT, [3, 3, 1], |_| Some(byte(255)));
    let mean = view_of_file(goblin(&cells, Rule::Mean, DataKind::Continuous), cells.size)
        .translate([0.0, 0.0, 0.5])
        .unwrap()
        .sampled(Sampling::Area(Rule::Mean))
        .unwrap();
    assert_eq!(cells_of(&mean, mean.extent()).cells, vec![Some(byte(255)); 18]);
    let nearest = self::view(&cells).translate([0.0, 0.0, 0.3]).unwrap().sampled(Sampling::Centre).unwrap();
    let found = cells_of(&nearest, nearest.extent());
    assert_eq!((found.count(), volume(&found)), (9, 9.0));
}
