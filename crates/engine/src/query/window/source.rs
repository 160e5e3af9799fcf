//! Windows of any source, drawn block by block.

use super::check_buffers;
use crate::tree::{CellBlock, Child, Source, no_children};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::space::Bounds;
use spinney_base::value::Value;

/// A box of cells to draw on.
pub struct Canvas<'a> {
    form: TreeType,
    bounds: Bounds,
    /// Increment of a value's index per cell along each axis.
    strides: [usize; 3],
    values: &'a mut [u8],
    valid: Option<&'a mut [bool]>,
}

/// Base-2 logarithm of the cells of the largest blocks that are drawn at once: 256 x 256, or 32 x
/// 32 x 32.
const BLOCK_BITS: u8 = 16;

/// Evaluates an expression with the width of a value in bytes as a constant.
macro_rules! with_width {
    ($width:expr, $WIDTH:ident => $body:expr) => {{
        macro_rules! with {
            ($bytes:literal) => {{
                const $WIDTH: usize = $bytes;
                $body
            }};
        }
        match $width {
            1 => with!(1),
            2 => with!(2),
            3 => with!(3),
            4 => with!(4),
            6 => with!(6),
            8 => with!(8),
            12 => with!(12),
            16 => with!(16),
            width => unreachable!("no tree has values of {width} bytes"),
        }
    }};
}

impl<'a> Canvas<'a> {
    /// Creates a canvas whose cells are all VOID, which `fill` represents.
    ///
    /// # Errors
    /// If a buffer does not have one value, or one flag, per cell.
    pub fn new(
        form: TreeType,
        bounds: &Bounds,
        fill: Value,
        values: &'a mut [u8],
        mut valid: Option<&'a mut [bool]>,
    ) -> Result<Canvas<'a>> {
        check_buffers(form.value, bounds, values, valid.as_deref())?;
        if let Some(valid) = &mut valid {
            valid.fill(false);
        }
        let [width, height, _] = bounds.size().map(|size| size as usize);
        let mut canvas = Canvas { form, bounds: *bounds, strides: [1, width, width * height], values, valid };
        with_width!(form.width(), WIDTH => canvas.cells::<WIDTH>().values.fill(bytes_of(fill)));
        Ok(canvas)
    }

    /// Draws a subtree of a source at a level. The box of `top` is the whole space, and `level`
    /// counts from `top`.
    ///
    /// # Errors
    /// If the source fails.
    pub fn draw<S: Source>(&mut self, source: &S, top: Child<S::Node>, level: u8) -> Result<()> {
        self.node(source, &top, Bounds::space(self.form.dimension, level), level)
    }

    /// Draws a node that is `levels` levels above the cells; `space` is its box.
    fn node<S: Source>(
        &mut self,
        source: &S,
        node: &Child<S::Node>,
        space: Bounds,
        levels: u8,
    ) -> Result<()> {
        let part = space.intersect(&self.bounds);
        if part.is_empty() {
            return Ok(());
        }
        match node {
            Child::Inner { node, .. } if levels > 0 => {
                // (If little of a block is requested, reading all of it is not worth it.)
                let is_most = part.volume() >= space.volume() / 4;
                if is_most
                    && levels * self.form.axes() as u8 <= BLOCK_BITS
                    && let Some(block) = source.cells(node, levels)?
                {
                    self.copy(&block, &space, &part);
                    return Ok(());
                }
                let (mut children, mut is_unread) = (no_children(), false);
                source.children(node, &mut children)?;
                for (step, child) in children[..self.form.children()].iter().enumerate() {
                    let space = space.child(self.form.dimension, step);
                    defer_missing(self.node(source, child, space, levels - 1), &mut is_unread)?;
                }
                finish_deferred(is_unread)?;
            }
            // (VOID is there already.)
            node => {
                if let Some(value) = node.value() {
                    self.paint(part.min, part.size().map(|size| size as usize), value);
                }
            }
        }
        Ok(())
    }

    /// Copies the requested part of a node's cells.
    fn copy(&mut self, block: &CellBlock, space: &Bounds, part: &Bounds) {
        let width = self.form.width();
        let ([columns, rows, _], size) = (space.size(), part.size());
        for z in part.min[2]..part.max[2] {
            for y in part.min[1]..part.max[1] {
                let first = [part.min[0], y, z];
                let [x, y, z] = [0, 1, 2].map(|axis| first[axis] - space.min[axis]);
                let from = ((z * rows + y) * columns + x) as usize;
                let to: usize = (0..3)
                    .map(|axis| (first[axis] - self.bounds.min[axis]) as usize * self.strides[axis])
                    .sum();
                for step in 0..size[0] as usize {
                    if !block.present[from + step] {
                        continue;
                    }
                    let (from, to) = (from + step, to + step);
                    self.values[to * width..(to + 1) * width]
                        .copy_from_slice(&block.values[from * width..(from + 1) * width]);
                    if let Some(valid) = &mut self.valid {
                        valid[to] = true;
                    }
                }
            }
        }
    }

    /// Sets all cells of a block to one value.
    fn paint(&mut self, min: [u64; 3], size: [usize; 3], value: Value) {
        with_width!(self.form.width(), WIDTH => self.cells::<WIDTH>().paint(min, size, value));
    }

    /// Returns the canvas for values of a constant width, for loops over very many blocks.
    ///
    /// `WIDTH` must be the width of the tree's values.
    #[inline]
    fn cells<const WIDTH: usize>(&mut self) -> Cells<'_, WIDTH> {
        debug_assert_eq!(WIDTH, self.form.width());
        let (values, _) = self.values.as_chunks_mut();
        Cells { origin: self.bounds.min, strides: self.strides, values, valid: self.valid.as_deref_mut() }
    }
}

/// Cells of a [`Canvas`] with values of `WIDTH` bytes.
struct Cells<'a, const WIDTH: usize> {
    /// The first cell.
    origin: [u64; 3],
    strides: [usize; 3],
    values: &'a mut [[u8; WIDTH]],
    valid: Option<&'a mut [bool]>,
}

/// Returns the first bytes of a value.
#[inline]
fn bytes_of<const WIDTH: usize>(value: Value) -> [u8; WIDTH] {
    let mut bytes = [0; WIDTH];
    value.write(&mut bytes);
    bytes
}

impl<const WIDTH: usize> Cells<'_, WIDTH> {
    /// Sets all cells of a block, which must be in the box, to one value.
    #[inline]
    fn paint(&mut self, min: [u64; 3], size: [usize; 3], value: Value) {
        let bytes = bytes_of(value);
        let strides = self.strides;
        let start: usize = (0..3).map(|axis| (min[axis] - self.origin[axis]) as usize * strides[axis]).sum();
        // Most blocks are single cells.
        if size == [1; 3] {
            self.values[start] = bytes;
            if let Some(valid) = &mut self.valid {
                valid[start] = true;
            }
            return;
        }
        for z in 0..size[2] {
            for y in 0..size[1] {
                let row = start + z * strides[2] + y * strides[1];
                self.values[row..row + size[0]].fill(bytes);
                if let Some(valid) = &mut self.valid {
                    valid[row..row + size[0]].fill(true);
                }
            }
        }
    }
}
