//! Windows of any source, drawn block by block.

use zerocopy::FromBytes;

use crate::query::node_bounds;
use crate::query::walk::child_bounds;
use crate::space::{Bounds, Code};
use crate::store::goblin::Layout;
use crate::tree::{Child, Source};
use crate::value::{Sample, Value};
use crate::{Error, Result};

/// A box of cells to draw on.
pub(crate) struct Canvas<'a, V: Value> {
    bounds: Bounds,
    /// Places from a cell to the next along each axis.
    strides: [usize; 3],
    values: &'a mut [V::Wire],
    valid: Option<&'a mut [bool]>,
}

impl<'a, V: Value> Canvas<'a, V> {
    /// A box all of whose cells are VOID, which `fill` stands for.
    ///
    /// # Errors
    /// If there is not room for each of its cells.
    pub(crate) fn new(
        bounds: &Bounds,
        fill: V,
        values: &'a mut [V::Wire],
        mut valid: Option<&'a mut [bool]>,
    ) -> Result<Self> {
        let cells = bounds.volume();
        let flags = valid.as_ref().map_or(cells, |valid| valid.len() as u64);
        if values.len() as u64 != cells || flags != cells {
            let found = format!("{} values and {flags} flags", values.len());
            return Err(Error::invalid("window buffer", found, format!("{cells}")));
        }
        values.fill(fill.to_wire());
        if let Some(valid) = &mut valid {
            valid.fill(false);
        }
        let [width, height, _] = bounds.size().map(|size| size as usize);
        Ok(Canvas { bounds: *bounds, strides: [1, width, width * height], values, valid })
    }

    /// Draws what a source has below some place of it, at a level: all of it by default.
    ///
    /// # Errors
    /// If the source fails.
    pub(crate) fn draw<S>(&mut self, source: &S, top: Child<V, S::Node>, level: u8) -> Result<()>
    where
        S: Source<Value = V>,
        S::Dim: Layout,
    {
        self.place(source, top, node_bounds(Code::<S::Dim>::ROOT, level), level)
    }

    fn place<S>(&mut self, source: &S, place: Child<V, S::Node>, space: Bounds, levels: u8) -> Result<()>
    where
        S: Source<Value = V>,
        S::Dim: Layout,
    {
        let part = space.intersect(&self.bounds);
        if part.is_empty() {
            return Ok(());
        }
        match place {
            Child::Inner { node, .. } if levels > 0 => source.each_child(&node, |step, child| {
                self.place(source, child, child_bounds::<S::Dim>(&space, step), levels - 1)
            }),
            place => {
                let size = part.size().map(|size| size as usize);
                place.value().into_iter().for_each(|value| self.paint(part.min, size, value));
                Ok(())
            }
        }
    }

    /// Gives all cells of a block one value.
    #[inline]
    pub(super) fn paint(&mut self, min: [u64; 3], size: [usize; 3], value: V) {
        let wire = value.to_wire();
        let strides = self.strides;
        let start: usize =
            (0..3).map(|axis| (min[axis] - self.bounds.min[axis]) as usize * strides[axis]).sum();
        // Single cells are most of what there is.
        if size == [1; 3] {
            self.values[start] = wire;
            if let Some(valid) = &mut self.valid {
                valid[start] = true;
            }
            return;
        }
        for z in 0..size[2] {
            for y in 0..size[1] {
                let row = start + z * strides[2] + y * strides[1];
                self.values[row..row + size[0]].fill(wire);
                if let Some(valid) = &mut self.valid {
                    valid[row..row + size[0]].fill(true);
                }
            }
        }
    }
}

/// A window's bytes as values.
///
/// # Errors
/// If there are not as many as cells.
pub(crate) fn wires_of<V: Value>(bytes: &mut [u8], cells: u64) -> Result<&mut [V::Wire]> {
    let found = format!("{} bytes", bytes.len());
    <[V::Wire]>::mut_from_bytes_with_elems(bytes, cells as usize)
        .map_err(|_| Error::invalid("window buffer", found, format!("{cells} values of {}", V::TYPE)))
}

/// The value whose every sample is nearest to a number.
pub(crate) fn fill_value<V: Value>(fill: f64) -> V {
    V::from_channels(|_| V::Sample::from_f64_lossy(fill))
}
