//! Bintrees as DF-expressions: one line, whose first word describes the tree.
//!
//! ```text
//! line    = head " " symbols
//! head    = "bintree:" halving ":" axes ":" depth ":" values ":" extent
//! halving = "alternating" | "adaptive"
//! axes    = "xy" | "xyz"
//! depth   = levels of the quadtree or octree, each of one halving along every axis
//! values  = type ["x" channels] ["+alpha" | "+missing=" number]      as in u8, f32x3, u8x4+alpha
//! extent  = cells along each axis, as in 200x150
//! symbols = one per node, in preorder: the node, its first half (west, north or above),
//!           its second half (east, south or below)
//! ```
//!
//! A dividing node is `G` (`M` in volumes) if axes alternate, otherwise the axis: `X`, `Y` or `Z`.
//! Leaves are `W` (`V`) for VOID, `B` (`F`) for 255 in each channel, a digit, or numbers in
//! brackets. White space and round parentheses are ignored.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use spinney_base::space::{Bounds, Dimension};
use spinney_base::value::{Mask, Number, SampleType, Value, ValueType};
use spinney_base::{Error, Result, TreeType};
use spinney_engine::tree::df;

use super::{Bintree, BintreeNode, Halving, MAX_CELLS, halves, preorder_builder, too_many};
use crate::preorder::BinaryNode;

/// Word that all expressions begin with.
const NAME: &str = "bintree";

impl Bintree {
    /// Formats the tree as a DF-expression, without a trailing line break.
    pub fn to_text(&self) -> String {
        let TreeType { dimension, value } = self.form;
        let (halving, axes, [void, black, inner]) = match (self.halving, dimension) {
            (Halving::Alternating, Dimension::Quad) => ("alternating", "xy", ['W', 'B', 'G']),
            (Halving::Alternating, Dimension::Oct) => ("alternating", "xyz", ['V', 'F', 'M']),
            (Halving::Adaptive, Dimension::Quad) => ("adaptive", "xy", ['W', 'B', 'G']),
            (Halving::Adaptive, Dimension::Oct) => ("adaptive", "xyz", ['V', 'F', 'M']),
        };
        let extent: Vec<_> = self.extent[..dimension.axes()].iter().map(u64::to_string).collect();
        let (values, extent) = (values_text(value), extent.join("x"));
        let mut text = format!("{NAME}:{halving}:{axes}:{}:{values}:{extent} ", self.depth);
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
        let mut file = File::open(path).map_err(Error::io(path, "open"))?;
        let size = file.metadata().map_err(Error::io(path, "read"))?.len();
        // Each node takes at least one byte of the file. The limit also covers a file that grows
        // while it is read.
        let most = memory / (1 + size_of::<BintreeNode>() as u64);
        let mut bytes = Vec::new();
        (&mut file).take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(Error::io(path, "read"))?;
        if bytes.len() as u64 > most {
            return Err(Error::TooLarge {
                path: path.to_path_buf(),
                what: "the bintree".into(),
                needed: size.saturating_mul(1 + size_of::<BintreeNode>() as u64),
                limit: memory,
                advice: "raise --memory".into(),
            });
        }
        let place = path.display().to_string();
        let text = std::str::from_utf8(&bytes).map_err(|error| {
            let found = format!("invalid UTF-8 at byte {}", error.valid_up_to());
            Error::invalid(place.as_str(), found, "the DF-expression of a bintree")
        })?;
        Parser { place: &place, text }.tree(bytes.len())
    }
}

fn values_text(value: ValueType) -> String {
    match (value.mask, value.all_missing()) {
        (Mask::Alpha, _) => format!("{value}+alpha"),
        (Mask::Missing(_), Some(missing)) => format!("{value}+missing={}", value.first_number(missing)),
        _ => value.to_string(),
    }
}

fn parse_values(text: &str) -> Option<ValueType> {
    let (name, mask) = text.split_once('+').unwrap_or((text, ""));
    let (sample, channels) = name.split_once('x').unwrap_or((name, "1"));
    let sample = SampleType::ALL.into_iter().find(|known| known.name() == sample)?;
    let plain = ValueType::new(sample, channels.parse().ok()?);
    let value = match mask.strip_prefix("missing=") {
        Some(number) => plain.with_missing(number.parse::<Number>().ok()?),
        None if mask == "alpha" => plain.with_alpha(),
        None => plain,
    };
    // Only the canonical spelling is accepted.
    (value.is_supported() && values_text(value) == text).then_some(value)
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
        let dimension = match axes {
            "xy" => Dimension::Quad,
            "xyz" => Dimension::Oct,
            _ => return Err(bad(axes)),
        };
        let known = depth.parse().ok().filter(|depth| *depth <= dimension.max_depth());
        let depth: u8 = known.ok_or_else(|| bad(depth))?;
        let form = TreeType::new(dimension, parse_values(values).ok_or_else(|| bad(values))?);
        let sizes: Option<Vec<u64>> = extent.split('x').map(|size| size.parse().ok()).collect();
        let sizes = sizes.filter(|sizes| {
            sizes.len() == dimension.axes() && sizes.iter().all(|size| (1..=1 << depth).contains(size))
        });
        let mut extent_of = [1; 3];
        let sizes = sizes.ok_or_else(|| bad(extent))?;
        extent_of[..sizes.len()].copy_from_slice(&sizes);
        let tree = Bintree { form, depth, halving, extent: extent_of, nodes: Vec::new() };
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
