//! Levels of files as trees.

use super::affine::{AffineMap, Sampling, View};
use super::tree_file::{TreeFile, TreeFileNode};
use super::view_source::ViewSource;
use crate::tree::{Child, Children, Source};
use spinney_base::space::Bounds;
use spinney_base::{Result, TreeType};
use spinney_container::{Header, Metadata, Shape};
use spinney_crs::Frame;
use std::sync::Arc;

/// A file down to one of its levels, whose nodes are the cells.
pub struct Coarse {
    file: TreeFile,
    header: Header,
    metadata: Metadata,
}

/// INNER node above the cells of a [`Coarse`] tree.
#[derive(Clone, Copy, Debug)]
pub struct CoarseNode {
    node: TreeFileNode,
    level: u8,
}

impl Coarse {
    /// Level that is `above` levels above the file's cells.
    fn new(file: &TreeFile, above: u8) -> Coarse {
        let header = file.header();
        let shape = Shape { depth: header.depth() - above, ..header.shape };
        let cells = |cells: u64| cells.div_ceil(1 << above);
        let mut extent = header.extent;
        extent[..header.form.axes()].iter_mut().for_each(|end| *end = cells(*end));
        let metadata = file.metadata();
        let to_file = AffineMap::scaling(scale(header.form.axes(), above));
        let to_world = to_file.then(&AffineMap::from_rows(metadata.frame.matrix));
        let to_file = Frame { matrix: to_file.to_rows(), ..Frame::identity() };
        let points = metadata.control_points.as_ref();
        let metadata = Metadata {
            frame: Frame { matrix: to_world.to_rows(), ..metadata.frame.clone() },
            control_points: points.and_then(|points| points.seen_through(&to_file)),
            ..metadata.clone()
        };
        Coarse { file: file.clone(), header: Header { shape, extent, ..header.clone() }, metadata }
    }

    /// The file.
    pub(super) fn file(&self) -> &TreeFile {
        &self.file
    }

    pub(super) fn header(&self) -> &Header {
        &self.header
    }

    pub(super) fn metadata(&self) -> &Metadata {
        &self.metadata
    }
}

/// Widths of a level's cells, in cells of the file.
fn scale(axes: usize, above: u8) -> [f64; 3] {
    std::array::from_fn(|axis| if axis < axes { 2f64.powi(above.into()) } else { 1.0 })
}

impl Source for Coarse {
    type Node = CoarseNode;

    fn form(&self) -> TreeType {
        self.header.form
    }

    fn depth(&self) -> u8 {
        self.header.depth()
    }

    fn root(&self) -> Result<Child<CoarseNode>> {
        Ok(match self.file.root()? {
            Child::Inner { representative, .. } if self.depth() == 0 => Child::Leaf(representative),
            root => root.map_node(|node| CoarseNode { node, level: 0 }),
        })
    }

    fn children(&self, node: &CoarseNode, children: &mut Children<CoarseNode>) -> Result<()> {
        let level = node.level + 1;
        self.file.children_as(&node.node, children, |node| CoarseNode { node, level })?;
        if level == self.depth() {
            for child in &mut children[..self.header.form.children()] {
                *child = Child::uniform(child.value());
            }
        }
        Ok(())
    }

    fn draw(&self, bounds: &Bounds, values: &mut [u8], valid: &mut [bool]) -> Result<bool> {
        self.file.draw_at(self.depth(), bounds, values, valid)?;
        Ok(true)
    }

    fn check_unchanged(&self) -> Result<()> {
        self.file.check_unchanged()
    }
}

impl View {
    /// View of a level of its file, if the view's cells are nodes of that level and the file made
    /// them by the view's rule; else the view unchanged. Copying them takes a tenth of the time of
    /// computing them again.
    pub(super) fn of_level(self) -> Result<View> {
        let ViewSource::File(file @ (TreeFile::Goblin(_) | TreeFile::Autumnal(_))) = &**self.source() else {
            return Ok(self);
        };
        let rule = file.header().rule;
        let Some(above) = self.levels_above().filter(|_| self.sampling() == Sampling::Area(rule)) else {
            return Ok(self);
        };
        let coarse = Coarse::new(file, above);
        let to_file = AffineMap::scaling(scale(self.form().axes(), above));
        self.over_scaled(Arc::new(ViewSource::Coarse(Box::new(coarse))), &to_file)
    }
}
