//! Bintrees as DF-expressions: one line, whose first word describes the tree.
//!
//! ```text
//! line    = head " " symbols
//! head    = "bintree:" halving ":" cells                               cells: see `cell_head.rs`
//! halving = "alternating" | "adaptive"
//! symbols = one per node, in preorder: the node, its first half (west, north or above),
//!           its second half (east, south or below)
//! ```
//!
//! A dividing node is `G` (`M` in volumes) if axes alternate, otherwise the axis: `X`, `Y` or `Z`.
//! Leaves are `W` (`V`) for VOID, `B` (`F`) for 255 in each channel, a digit, or numbers in
//! brackets. White space and round parentheses are ignored.

use std::path::Path;

use spinney_base::space::{Bounds, Dimension};
use spinney_base::value::{Value, ValueType};
use spinney_base::{Error, Result, TreeType};
use spinney_engine::tree::df;

use super::{Bintree, BintreeNode, Halving, MAX_CELLS, halves, preorder_builder, too_many};
use crate::cell_head::CellHead;
use crate::preorder::BinaryNode;
use crate::text_file;

/// Word that all expressions begin with.
const NAME: &str = "bintree";

impl Bintree {
    /// Formats the tree as a DF-expression, without a trailing line break.
    pub fn to_text(&self) -> String {
        let TreeType { dimension, value } = self.form;
        let halving = if self.halving == Halving::Alternating { "alternating" } else { "adaptive" };
        let [void, black, inner] =
            if dimension == Dimension::Quad { ['W', 'B', 'G'] } else { ['V', 'F', 'M'] };
        let head = CellHead { form: self.form, depth: self.depth, extent: self.extent };
        let mut text = format!("{NAME}:{halving}:{} ", head.text());
        let full = value.splat(255u8);
        for node in &self.nodes {
            match node {
                BinaryNode::Divided { by, .. } if self.halving == Halving::Adaptive => {
                    text.push(char::from(b'X' + by));
                }
                BinaryNode::Divided { .. } => text.push(inner),
                BinaryNode::Leaf(None) => text.push(void),
                BinaryNode::Leaf(Some(value)) if full == Some(*value) => text.push(black),
                BinaryNode::Leaf(Some(number)) => df::write_value(&mut text, value, *number),
            }
        }
        text
    }

    /// Parses a DF-expression. The resulting tree is condensed.
    ///
    /// # Errors
    /// If `text` is not a DF-expression of a bintree, is deeper than its head declares, has values
    /// beyond its extent, or more than `most` nodes.
    pub fn from_text(text: &str, most: usize) -> Result<Bintree> {
        Parser { place: NAME, text }.tree(most)
    }

    /// Reads a file with a DF-expression. String and nodes may use at most `memory` bytes.
    ///
    /// # Errors
    /// If the file cannot be read or exceeds `memory`, and those of [`Bintree::from_text`].
    pub fn read(path: &Path, memory: u64) -> Result<Bintree> {
        let text = text_file::read(path, NAME, size_of::<BintreeNode>(), memory)?;
        let place = path.display().to_string();
        Parser { place: &place, text: &text }.tree(text.len())
    }
}

/// Maximum ratio of squares or cubes to nodes, for expressions of any size. (Alternating axes need
/// at most four per leaf.)
const SQUARES_PER_NODE: u64 = 8;

/// Number of squares or cubes that a block consists of. Its sides are powers of two.
fn squares_of(block: Bounds, dimension: Dimension) -> u64 {
    let sides = &block.size()[..dimension.axes()];
    let least = sides.iter().copied().min().unwrap_or(1).max(1);
    sides.iter().map(|side| side / least).fold(1, u64::saturating_mul)
}

struct Parser<'a> {
    /// Origin of the text, for messages.
    place: &'a str,
    text: &'a str,
}

impl Parser<'_> {
    /// Error that something else was expected at byte `at`.
    fn bad(&self, at: usize, expected: &str) -> Error {
        let rest = self.text.get(at..).unwrap_or_default();
        let found = match rest.char_indices().nth(20) {
            Some((end, _)) => format!("`{}...`", &rest[..end]),
            None if rest.is_empty() => "its end".into(),
            None => format!("`{}`", rest.trim_end()),
        };
        Error::invalid(format!("{}, byte {at}", self.place), found, expected)
    }

    /// Parses the first word. Returns the tree without nodes, and the word's end.
    fn head(&self) -> Result<(Bintree, usize)> {
        let start = self.text.len() - self.text.trim_start().len();
        let head = self.text[start..].split_whitespace().next().unwrap_or_default();
        let expected = "`bintree:alternating:xy:DEPTH:TYPE:WIDTHxHEIGHT`, or `adaptive`, or `xyz` with WIDTHxHEIGHTxDEPTH";
        let bad = |part: &str| self.bad(start + (part.as_ptr() as usize - head.as_ptr() as usize), expected);
        let parts: Vec<_> = head.split(':').collect();
        let [NAME, halving, axes, depth, values, extent] = parts[..] else { return Err(bad(head)) };
        let halving = match halving {
            "alternating" => Halving::Alternating,
            "adaptive" => Halving::Adaptive,
            _ => return Err(bad(halving)),
        };
        let CellHead { form, depth, extent } = CellHead::parse([axes, depth, values, extent]).map_err(bad)?;
        let tree = Bintree { form, depth, halving, extent, nodes: Vec::new() };
        Ok((tree, start + head.len()))
    }

    /// Parses the entire tree, of at most `most` nodes.
    fn tree(&self, most: usize) -> Result<Bintree> {
        let (mut tree, mut at) = self.head()?;
        let TreeType { dimension, value } = tree.form;
        let (axes, full, raster_bounds) =
            (dimension.axes() as u8, value.splat(255u8), Bounds::of_extent(tree.extent));
        let mut made = preorder_builder();
        // Reserving avoids the doubling of a growing vector.
        made.reserve(most.min(self.text.len() - at));
        // Blocks whose symbols follow, each with its next axis if axes alternate. At most one per
        // halving, plus one.
        let mut pending = vec![(Bounds::space(dimension, tree.depth), 0)];
        let mut squares = 0u64;
        while let Some(letter) = self.text[at..].chars().next() {
            let (start, rest) = (at, &self.text[at + letter.len_utf8()..]);
            at += letter.len_utf8();
            if letter.is_whitespace() || matches!(letter, '(' | ')') {
                continue;
            }
            let Some((block, next)) = pending.pop() else {
                return Err(self.bad(start, "the end of the line"));
            };
            if made.len() >= most {
                return Err(too_many(most));
            }
            let axis = match (letter, tree.halving) {
                ('G' | 'M', Halving::Alternating) => Some(next),
                ('X'..='Z', Halving::Adaptive) => Some(letter as u8 - b'X'),
                _ => None,
            };
            if let Some(axis) = axis {
                if axis >= axes || block.size()[usize::from(axis)] < 2 {
                    return Err(
                        self.bad(start, "a leaf, or another axis: the block has one cell along this one")
                    );
                }
                made.divide(axis);
                let [first, second] = halves(block, axis);
                let next = (axis + 1) % axes;
                pending.extend([(second, next), (first, next)]);
                continue;
            }
            let leaf = match letter {
                'W' | 'V' => None,
                'B' | 'F' => Some(
                    full.ok_or_else(|| self.bad(start, &format!("a value of type {value}; 255 is none")))?,
                ),
                '[' => {
                    let list = rest.split(']').next().filter(|list| list.len() < rest.len());
                    let list = list.ok_or_else(|| self.bad(start, "a closing bracket"))?;
                    at += list.len() + 1;
                    let number = df::parse_value(value, list);
                    Some(
                        number.ok_or_else(|| {
                            self.bad(start, &format!("a value of type {value} in brackets"))
                        })?,
                    )
                }
                _ => Some(self.digit(letter, value).ok_or_else(|| {
                    let halves = if tree.halving == Halving::Adaptive { "X Y Z" } else { "G M" };
                    self.bad(start, &format!("one of {halves} W V B F, a digit, or [value]"))
                })?),
            };
            if leaf.is_some() && !raster_bounds.contains(&block) {
                return Err(self.bad(start, "W or V: the block reaches beyond the extent"));
            }
            made.leaf(leaf);
            squares = squares.saturating_add(squares_of(block, dimension));
        }
        if !pending.is_empty() {
            return Err(self.bad(at, "both halves of every node"));
        }
        tree.nodes = made.finish();
        self.check_squares(squares, tree.nodes.len(), dimension)?;
        Ok(tree)
    }

    /// Rejects short expressions with long thin blocks, which would become too many nodes of a
    /// quadtree or octree.
    fn check_squares(&self, squares: u64, nodes: usize, dimension: Dimension) -> Result<()> {
        let limit = MAX_CELLS.max(SQUARES_PER_NODE.saturating_mul(nodes as u64));
        if squares <= limit {
            return Ok(());
        }
        let (blocks, tree) = match dimension {
            Dimension::Quad => ("squares", "a quadtree"),
            Dimension::Oct => ("cubes", "an octree"),
        };
        let found = format!("{nodes} nodes with long thin blocks, which are {squares} {blocks} of {tree}");
        let expected = format!("at most {limit}; build such data from its raster or volume");
        Err(Error::invalid(self.place, found, expected))
    }

    fn digit(&self, letter: char, value: ValueType) -> Option<Value> {
        letter.to_digit(10).and_then(|digit| value.splat(digit))
    }
}
