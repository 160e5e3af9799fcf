//! Windows of any source, drawn block by block.

use zerocopy::FromBytes;

use super::walk::{child_bounds, node_bounds};
use crate::space::{Bounds, Code};
use crate::store::goblin::Layout;
use crate::tree::{Child, Source};
use crate::value::{Sample, Value};
use crate::{Error, Result};

/// A box of cells to draw on.
pub(crate) struct Canvas<'a, V: Value> {
    bounds: Bounds,
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
        Ok(Canvas { bounds: *bounds, values, valid })
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
                place.value().into_iter().for_each(|value| self.paint(&part, value));
                Ok(())
            }
        }
    }

    /// Gives all cells of a part one value.
    fn paint(&mut self, part: &Bounds, value: V) {
        let [width, height, _] = self.bounds.size().map(|size| size as usize);
        let at: [usize; 3] = std::array::from_fn(|axis| (part.min[axis] - self.bounds.min[axis]) as usize);
        let size = part.size().map(|size| size as usize);
        let wire = value.to_wire();
        for z in at[2]..at[2] + size[2] {
            for y in at[1]..at[1] + size[1] {
                let start = (z * height + y) * width + at[0];
                self.values[start..start + size[0]].fill(wire);
                if let Some(valid) = &mut self.valid {
                    valid[start..start + size[0]].fill(true);
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
