//! Views of files: each query is computed through the view, and nothing in advance.

use std::sync::Arc;

use crate::ops::{View, ViewOperation, ViewSource, WarpGrid};
use crate::query::{Canvas, check_level};
use crate::tree::{Child, Source, no_children};
use spinney_base::Result;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{MAX_VALUE_SIZE, Value};
use spinney_container::{Header, Metadata};

/// A view with its own header and metadata. Size, segments and checks are those of its file.
pub(super) struct Viewed {
    view: View,
    /// Whether the raster moves in the world when its cells are moved.
    moves: bool,
    header: Header,
    metadata: Metadata,
}

impl Viewed {
    pub(super) fn new(view: View, moves: bool) -> Viewed {
        let file = view.source();
        let mut header = file.header().clone();
        header.shape.depth = view.depth();
        header.extent = view.extent();
        let metadata = view.metadata(moves);
        Viewed { view, moves, header, metadata }
    }

    /// Returns the view with further operations.
    pub(super) fn through(self, steps: &[ViewOperation]) -> Result<Viewed> {
        Ok(Viewed::new(self.view.through(steps)?, self.moves))
    }

    /// Returns the view on another grid.
    pub(super) fn warped(self, grid: &WarpGrid) -> Result<Viewed> {
        Ok(Viewed::new(self.view.warped(grid)?, self.moves))
    }

    pub(super) fn view(&self) -> &View {
        &self.view
    }

    pub(super) fn source(&self) -> &ViewSource {
        self.view.source()
    }

    /// Returns the source, if the view shows all of it unchanged.
    pub(super) fn source_of_all(&self) -> Option<&Arc<ViewSource>> {
        self.view.is_whole().then(|| self.view.source())
    }

    pub(super) fn header(&self) -> &Header {
        &self.header
    }

    pub(super) fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Returns a view whose cells are those of a level.
    pub(super) fn at(&self, level: u8) -> Result<View> {
        check_level(level, self.view.depth())?;
        self.view.at_level(level)
    }

    /// Reads a box of cells of a level: see [`Dataset::window`](super::Dataset::window).
    pub(super) fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: Value,
        bytes: &mut [u8],
        valid: Option<&mut [bool]>,
    ) -> Result<()> {
        if !self.view.source().draws_levels() {
            let view = self.at(level)?;
            let mut canvas = Canvas::new(view.form(), bounds, fill, bytes, valid)?;
            return canvas.draw(&view, view.root()?, view.depth());
        }
        check_level(level, self.view.depth())?;
        // Drawn as one box, not node by node. (The canvas is made only for its checks of the
        // buffers' sizes.)
        let mut own = Vec::new();
        let valid = match valid {
            Some(valid) => valid,
            None => {
                own.resize(bounds.volume().min(bytes.len() as u64) as usize, false);
                &mut own
            }
        };
        Canvas::new(self.view.form(), bounds, fill, bytes, Some(&mut *valid))?;
        let space = Bounds::space(self.view.form().dimension, level);
        if !space.contains(bounds) {
            return self.part_inside(level, (bounds, &bounds.intersect(&space)), bytes, valid);
        }
        self.view.draw_at(level, bounds, bytes, valid)?;
        fill_void(fill, bytes, valid, self.view.form().width());
        Ok(())
    }

    /// Draws the intersection of a box with the space into the box, whose cells are all VOID so
    /// far.
    fn part_inside(
        &self,
        level: u8,
        (bounds, inside): (&Bounds, &Bounds),
        bytes: &mut [u8],
        valid: &mut [bool],
    ) -> Result<()> {
        if inside.is_empty() {
            return Ok(());
        }
        let (cells, width) = (inside.volume() as usize, self.view.form().width());
        let (mut values, mut present) = (vec![0; cells * width], vec![false; cells]);
        self.view.draw_at(level, inside, &mut values, &mut present)?;
        let ([columns, rows, _], [width_inside, height, _]) = (bounds.size(), inside.size());
        for (cell, present) in present.iter().enumerate().filter(|(_, present)| **present) {
            let at = cell as u64;
            let place = [at % width_inside, at / width_inside % height, at / width_inside / height];
            let [x, y, z] = [0, 1, 2].map(|axis| place[axis] + inside.min[axis] - bounds.min[axis]);
            let to = ((z * rows + y) * columns + x) as usize;
            valid[to] = *present;
            bytes[to * width..(to + 1) * width].copy_from_slice(&values[cell * width..(cell + 1) * width]);
        }
        Ok(())
    }

    /// Reads the values of some cells of a level; `None` is VOID, as is every cell outside.
    pub(super) fn values_at(
        &self,
        level: u8,
        cells: &[[u64; 3]],
        values: &mut [Option<Value>],
    ) -> Result<()> {
        let is_calculated = self.view.source().draws_levels();
        let (view, form) = (self.at(level)?, self.view.form());
        let space = Bounds::space(form.dimension, level);
        for (cell, value) in cells.iter().zip(values) {
            *value = None;
            if (0..3).any(|axis| cell[axis] >= space.max[axis]) {
                continue;
            }
            let bounds = Bounds { min: *cell, max: cell.map(|cell| cell + 1) };
            let (mut bytes, mut valid) = ([0; MAX_VALUE_SIZE], [false]);
            let bytes = &mut bytes[..form.width()];
            if is_calculated {
                self.view.draw_at(level, &bounds, bytes, &mut valid)?;
            } else {
                let mut canvas = Canvas::new(form, &bounds, Value::ZERO, bytes, Some(&mut valid))?;
                canvas.draw(&view, view.root()?, view.depth())?;
            }
            *value = valid[0].then(|| Value::from_bytes(bytes));
        }
        Ok(())
    }

    /// Returns whether some cells of a box may be VOID; `false` is certain.
    pub(super) fn may_have_void(&self, bounds: &Bounds) -> Result<bool> {
        // A search of the whole view can take as long as drawing it, so a search that visits this
        // many nodes without a result returns `true`.
        const MAX_NODES: usize = 100_000;
        // (Nodes of a tree on another grid are computed from tens of positions each, calculated
        // nodes block by block.)
        const MAX_COMPUTED: usize = 1000;
        let most = if self.view.source().is_computed() { MAX_COMPUTED } else { MAX_NODES };
        if !self.header.extent_bounds().contains(bounds) {
            return Ok(true);
        }
        let (view, form) = (&self.view, self.view.form());
        let mut children = no_children();
        let mut pending = vec![(Code::root(form.dimension), view.root()?)];
        for _ in 0..most {
            let Some((code, child)) = pending.pop() else { return Ok(false) };
            if code.bounds(view.depth()).intersect(bounds).is_empty() {
                continue;
            }
            match child {
                Child::Void => return Ok(true),
                Child::Leaf(_) => {}
                Child::Inner { node, .. } => {
                    view.children(&node, &mut children)?;
                    let below = children[..form.children()].iter_mut().map(std::mem::take).enumerate();
                    pending.extend(below.map(|(step, child)| (code.child(step), child)));
                }
            }
        }
        Ok(true)
    }

    /// Returns whether the tree has more than `most` INNER nodes.
    pub(super) fn has_more_nodes(&self, most: u64) -> Result<bool> {
        let mut found = 0;
        let mut children = no_children();
        let mut pending = vec![self.view.root()?];
        while let Some(child) = pending.pop() {
            if let Child::Inner { node, .. } = child {
                found += 1;
                if found > most {
                    return Ok(true);
                }
                self.view.children(&node, &mut children)?;
                pending.extend(children[..self.view.form().children()].iter_mut().map(std::mem::take));
            }
        }
        Ok(false)
    }
}

/// Writes the fill value to VOID cells.
fn fill_void(fill: Value, bytes: &mut [u8], valid: &[bool], width: usize) {
    let fill = &fill.to_bytes()[..width];
    for (value, _) in bytes.chunks_exact_mut(width).zip(valid).filter(|(_, valid)| !**valid) {
        value.copy_from_slice(fill);
    }
}
