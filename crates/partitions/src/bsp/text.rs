//! BSP trees as text: a line per node in preorder. A node that divides is a plane, and is followed
//! by its back and then by its front. A leaf is `in` or `out`. (The first line of a solid's text is
//! in `solid_text.rs`.)

use std::path::Path;

use spinney_base::space::Dimension;
use spinney_base::value::{SampleType, ValueType};
use spinney_base::{Result, TreeType};
use spinney_brep::{Grid, MAX_BITS};

use super::{Bsp, Division};
use crate::cell_head::CellHead;
use crate::preorder::{BinaryNode, PreorderBuilder};
use crate::solid_text::{Lines, NODE_BYTES, head, push_plane};
use crate::text_file;

/// Word that the text of a tree of the plane begins with.
const PLANE: &str = "bsp:";
/// Maximum number of spaces before a node.
const MAX_INDENT: usize = 40;

impl Bsp {
    /// Formats a tree of space as the text of a solid ([`SolidText`](crate::SolidText)). Numbers of
    /// faces in a plane are comments.
    pub fn to_text(&self, grid: &Grid, unit: Option<&str>) -> String {
        let mut text = head("bsp", grid, unit);
        self.push_nodes(&mut text);
        text
    }

    /// Formats a tree of the plane whose inside is cells of a quadtree.
    pub fn plane_text(&self, depth: u8, extent: [u64; 3]) -> String {
        let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
        let mut text = format!("{PLANE}{}\n", CellHead { form, depth, extent }.text());
        self.push_nodes(&mut text);
        text
    }

    /// Appends the lines of the nodes. In a tree of the plane, a line is `a b d`: its back is where
    /// `a x + b y + d` is negative.
    pub fn push_nodes(&self, text: &mut String) {
        let is_flat = self.dimension == Dimension::Quad;
        let mut pending = vec![(0, 0)];
        while let Some((at, depth)) = pending.pop() {
            text.extend(std::iter::repeat_n(' ', depth.min(MAX_INDENT)));
            match &self.nodes[at] {
                BinaryNode::Leaf(is_inside) => text.push_str(if *is_inside { "in" } else { "out" }),
                BinaryNode::Divided { by, second } => {
                    pending.extend([(*second, depth + 1), (at + 1, depth + 1)]);
                    match (is_flat, by.descriptor()) {
                        (true, ([a, b, _], d)) => text.push_str(&format!("{a} {b} {d}")),
                        _ => push_plane(text, &by.plane),
                    }
                    let mut sources: Vec<usize> =
                        by.fragments.iter().map(|fragment| fragment.source).collect();
                    sources.sort_unstable();
                    sources.dedup();
                    if !sources.is_empty() {
                        text.push_str(" #");
                        sources.iter().for_each(|source| text.push_str(&format!(" {source}")));
                    }
                }
            }
            text.push('\n');
        }
    }

    /// Parses the lines of the nodes.
    pub(crate) fn parse(lines: &mut Lines<'_>, dimension: Dimension) -> Result<Bsp> {
        let mut made = PreorderBuilder::new(|_: &Division| false);
        let mut missing = 1u64;
        while let Some(line) = lines.next() {
            if missing == 0 {
                return Err(lines.bad(line, "the end of the text: the tree is complete"));
            }
            match line {
                "in" | "out" => {
                    made.leaf(line == "in");
                    missing -= 1;
                }
                _ => {
                    made.divide(Division::by(lines.plane(line, dimension)?));
                    missing += 1;
                }
            }
        }
        match missing {
            0 => Ok(Bsp { dimension, nodes: made.finish() }),
            _ => Err(lines.bad("", format!("{missing} more nodes: planes, `in` or `out`"))),
        }
    }
}

/// BSP tree of cells of a quadtree, read from a text.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct PlaneText {
    /// The tree; its inside is the cells.
    pub tree: Bsp,
    /// Levels of the quadtree.
    pub depth: u8,
    /// Cells along each axis.
    pub extent: [u64; 3],
}

impl PlaneText {
    /// Reads a file. Its text and its nodes may use at most `memory` bytes.
    ///
    /// # Errors
    /// If the file cannot be read, exceeds `memory`, or is no text of a tree of cells.
    pub fn read(path: &Path, memory: u64) -> Result<PlaneText> {
        let text = text_file::read(path, "BSP tree", NODE_BYTES, memory)?;
        let mut lines = Lines::of(path, &text);
        let line = lines.next().unwrap_or_default();
        let head = line.strip_prefix(PLANE).and_then(|rest| {
            let parts: Vec<&str> = rest.split(':').collect();
            CellHead::parse(<[&str; 4]>::try_from(parts).ok()?).ok()
        });
        let u8_cells = ValueType::new(SampleType::U8, 1);
        let head = head
            .filter(|head| head.depth <= MAX_BITS && head.form == TreeType::new(Dimension::Quad, u8_cells));
        let Some(CellHead { depth, extent, .. }) = head else {
            return Err(lines.bad(line, "`bsp:xy:DEPTH:u8:WIDTHxHEIGHT`, or `bsp:xyz:...` of a solid"));
        };
        Ok(PlaneText { tree: Bsp::parse(&mut lines, Dimension::Quad)?, depth, extent })
    }
}
