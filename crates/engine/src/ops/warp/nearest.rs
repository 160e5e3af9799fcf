//! Source cell at each cell's centre.

use zerocopy::FromBytes;

use super::lattice::Lattice;
use super::window::{Window, floor};
use crate::store::records::{Record, RecordLayout, with_record_type};
use crate::tree::CellBlock;
use spinney_base::TreeType;

/// Picks the cells at the positions of a lattice.
pub(super) fn pick(
    form: TreeType,
    window: &Window,
    lattice: &Lattice,
    size: [usize; 2],
    block: &mut CellBlock,
) {
    with_record_type!(RecordLayout::new(form), R => pick_values::<R>(window, lattice, size, block));
}

fn pick_values<R: Record>(
    window: &Window,
    lattice: &Lattice,
    [width, height]: [usize; 2],
    block: &mut CellBlock,
) {
    let from = <[R::Bytes]>::ref_from_bytes(&window.bytes).expect("a value for each cell");
    let to = <[R::Bytes]>::mut_from_bytes(&mut block.values).expect("a value for each cell");
    let valid = &window.valid[..from.len()];
    if let Lattice::Separable { columns, rows } = lattice {
        let columns = cells_at(window, 0, columns);
        for (y, row) in cells_at(window, 1, rows).into_iter().enumerate() {
            let Some(row) = row else { continue };
            let first = row * window.size[0];
            let (from, valid) = (&from[first..first + window.size[0]], &valid[first..first + window.size[0]]);
            let cells = y * width..(y + 1) * width;
            for ((column, to), present) in
                columns.iter().zip(&mut to[cells.clone()]).zip(&mut block.present[cells])
            {
                if let Some(column) = *column {
                    (*to, *present) = (from[column], valid[column]);
                }
            }
        }
        return;
    }
    for y in 0..height {
        for x in 0..width {
            let [column, row] = lattice.at(x, y);
            if let Some(index) =
                window.index(floor(column), floor(row)).filter(|_| column.is_finite() && row.is_finite())
            {
                (to[y * width + x], block.present[y * width + x]) = (from[index], valid[index]);
            }
        }
    }
}

/// Cells of a window that contain some positions along an axis.
fn cells_at(window: &Window, axis: usize, positions: &[f64]) -> Vec<Option<usize>> {
    let cell_at = |number: &f64| {
        let cell = floor(*number) - window.origin[axis];
        (number.is_finite() && (cell as u64) < window.size[axis] as u64).then_some(cell as usize)
    };
    positions.iter().map(cell_at).collect()
}
