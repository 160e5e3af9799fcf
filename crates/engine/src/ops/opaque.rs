//! Trees without their transparent cells: these are VOID instead.

use std::sync::Arc;

use super::affine::View;
use super::view_source::{ViewSource, ViewSourceNode};
use crate::tree::{Child, Children, Source};
use spinney_base::value::{Mask, ValueType};
use spinney_base::{Result, TreeType};

/// A source whose transparent cells are VOID. Levels above the cells are what they are: nothing that is transparent is in them.
pub struct Opaque {
    source: Arc<ViewSource>,
    value_type: ValueType,
}

impl Opaque {
    /// The source with its transparent cells.
    pub(super) fn source(&self) -> &ViewSource {
        &self.source
    }

    fn seen(&self, child: Child<ViewSourceNode>) -> Child<ViewSourceNode> {
        match child {
            Child::Leaf(value) if self.value_type.is_transparent(value) => Child::Void,
            child => child,
        }
    }
}

impl Source for Opaque {
    type Node = ViewSourceNode;

    fn form(&self) -> TreeType {
        self.source.form()
    }

    fn depth(&self) -> u8 {
        self.source.depth()
    }

    fn root(&self) -> Result<Child<ViewSourceNode>> {
        Ok(self.seen(self.source.root()?))
    }

    fn children(&self, node: &ViewSourceNode, children: &mut Children<ViewSourceNode>) -> Result<()> {
        self.source.children(node, children)?;
        for child in children.iter_mut() {
            *child = self.seen(*child);
        }
        Ok(())
    }
}

impl View {
    /// The view with VOID for cells that are transparent: those of values with opacity ([`Mask::Alpha`]) where that is 0.
    ///
    /// # Errors
    /// If the file is damaged, which tells whether there are any.
    pub fn opaque(self) -> Result<View> {
        let value_type = self.source().header().form.value;
        if value_type.mask != Mask::Alpha {
            return Ok(self);
        }
        // A file without any is seen as it is, so that what it has stored can be taken over.
        if let ViewSource::File(_) = &**self.source() {
            let totals = self.source().totals(None)?;
            if totals.channels.iter().all(|channel| channel.cells == totals.cells) {
                return Ok(self);
            }
        }
        let opaque = Opaque { source: self.source().clone(), value_type };
        Ok(self.over(Arc::new(ViewSource::Opaque(Box::new(opaque)))))
    }
}
