//! Boxes of any size, read block by block.

use std::ffi::{c_int, c_void};

use engine::Bounds;

use crate::dataset::{level_of, opened, spinney_dataset};
use crate::queries::{flags, some_bounds_at, spinney_box};
use crate::status::{Failure, guarded, spinney_status};

/// A block of cells, as passed to the caller's function.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_block {
    /// Its cells, at the requested level.
    pub cells: spinney_box,
    /// Samples in the layout of spinney_read(). Valid until the function returns.
    pub samples: *const u8,
    /// One byte per cell: 1 if the cell has a value.
    pub valid: *const u8,
}

/// A function that receives blocks. It stops the reading by returning anything but 0.
pub type spinney_take_block =
    Option<unsafe extern "C" fn(user: *mut c_void, block: *const spinney_block) -> c_int>;

/// Cells along the sides of blocks, in quadtrees and in octrees: those of the files' dense blocks.
const SIDES: [u64; 2] = [256, 64];

/// Reads a box of cells of a level block by block, in rows of blocks, and passes each block to
/// `take`, with `user`. Blocks are at most 256 cells wide and high (64 in octrees), and begin at
/// multiples of that, except at the box's own border. Needs memory for one block. SPINNEY_STOPPED
/// if `take` stops.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_read_blocks(
    dataset: *const spinney_dataset,
    level: u32,
    cells: *const spinney_box,
    fill: f64,
    take: spinney_take_block,
    user: *mut c_void,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `some_bounds_at`.
        let (dataset, bounds) = unsafe { (&opened(dataset)?.dataset, some_bounds_at(cells)?) };
        let take = take.ok_or_else(|| Failure::invalid("take: got NULL, expected a function"))?;
        let form = dataset.header().form;
        let side = SIDES[usize::from(form.axes() == 3)];
        // A block has at most 2^18 cells of 16 bytes.
        let max_cells = side.pow(form.axes() as u32);
        let allocate = |bytes: u64| {
            let mut bytes_there = Vec::new();
            bytes_there.try_reserve_exact(bytes as usize).map_err(|_| Failure::memory(bytes))?;
            bytes_there.resize(bytes as usize, 0u8);
            Ok::<_, Failure>(bytes_there)
        };
        let (mut samples, mut valid) = (allocate(max_cells * form.width() as u64)?, allocate(max_cells)?);
        let parts = |axis: usize| {
            let Bounds { min, max } = bounds;
            let starts = (min[axis] / side..max[axis].div_ceil(side)).map(move |part| part * side);
            starts.map(move |start| (start.max(min[axis]), (start + side).min(max[axis])))
        };
        for z in parts(2) {
            for y in parts(1) {
                for x in parts(0) {
                    let part = Bounds { min: [x.0, y.0, z.0], max: [x.1, y.1, z.1] };
                    let count = part.volume() as usize;
                    let (samples, valid) = (&mut samples[..count * form.width()], &mut valid[..count]);
                    dataset.window(level_of(level), &part, fill, samples, Some(flags(valid)))?;
                    let block = spinney_block {
                        cells: part.into(),
                        samples: samples.as_ptr().cast(),
                        valid: valid.as_ptr(),
                    };
                    // SAFETY: the function is the caller's own. The block outlives its call.
                    if unsafe { take(user, &block) } != 0 {
                        return Err(Failure::stopped());
                    }
                }
            }
        }
        Ok(())
    })
}
