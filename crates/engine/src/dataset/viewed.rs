//! Views of files: questions are answered through the view, nothing is computed beforehand.

use crate::ops::{Step, View, ViewSource, WarpGrid};
use crate::query::{Canvas, check_level};
use crate::tree::{Child, Source, no_children};
use spinney_base::Result;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{MAX_VALUE_SIZE, Value};
use spinney_container::{Header, Metadata};

/// A view with its own header and metadata. Size, segments and checks are those of the file that it stands on.
pub(super) struct Viewed {
    view: View,
    /// Whether the picture moves in the world as its cells are moved.
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

    /// The view with more steps applied to it.
    pub(super) fn through(self, steps: &[Step]) -> Result<Viewed> {
        Ok(Viewed::new(self.view.through(steps)?, self.moves))
    }

    /// The view on another grid.
    pub(super) fn warped(self, grid: &WarpGrid) -> Result<Viewed> {
        Ok(Viewed::new(self.view.warped(grid)?, self.moves))
    }

    pub(super) fn view(&self) -> &View {
        &self.view
    }

    pub(super) fn source(&self) -> &ViewSource {
        self.view.source()
    }

    pub(super) fn header(&self) -> &Header {
        &self.header
    }

    pub(super) fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The view with the cells of a level.
    pub(super) fn at(&self, level: u8) -> Result<View> {
        check_level(level, self.view.depth())?;
        if level == self.view.depth() { Ok(self.view.clone()) } else { self.view.clone().resample(level) }
    }

    /// Whether some cells of a box may be VOID; `false` is sure.
    pub(super) fn may_have_void(&self, bounds: &Bounds) -> Result<bool> {
        // A search of the whole view can take as long as drawing it: one that is not done after so many nodes
        // says yes.
        const MAX_NODES: usize = 100_000;
        // (Those on another grid are computed, each by tens of places.)
        const MAX_COMPUTED: usize = 1000;
        let is_computed = matches!(**self.view.source(), ViewSource::Warped(_));
        let most = if is_computed { MAX_COMPUTED } else { MAX_NODES };
        if !self.header.picture().contains(bounds) {
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

    /// Whether the tree has more than so many INNER nodes.
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

/// The value of one cell of a view; `None` is VOID, as is everything outside.
pub(super) fn value_at(view: &View, cell: [u64; 3]) -> Result<Option<Value>> {
    let form = view.form();
    let space = Bounds::space(form.dimension, view.depth());
    if (0..3).any(|axis| cell[axis] >= space.max[axis]) {
        return Ok(None);
    }
    let bounds = Bounds { min: cell, max: cell.map(|cell| cell + 1) };
    let (mut bytes, mut valid) = ([0; MAX_VALUE_SIZE], [false]);
    let bytes = &mut bytes[..form.width()];
    let mut canvas = Canvas::new(form, &bounds, Value::ZERO, bytes, Some(&mut valid))?;
    canvas.draw(view, view.root()?, view.depth())?;
    Ok(valid[0].then(|| Value::from_bytes(bytes)))
}
