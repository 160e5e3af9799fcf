//! DF-expressions of trees of cells as files: `df:` with a description of the cells
//! (`cell_head.rs`), then the symbols ([`spinney_engine::tree::df`]).
//!
//! Without the description, an expression is one of values of type u8, as the literature prints it:
//! of a quadtree, or of an octree if it has one of the letters M, V and F. Its depth is that of the
//! deepest node.

use std::path::Path;

use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::value::{Rule, SampleType, Value, ValueType};
use spinney_base::{Error, Result, TreeType};
use spinney_engine::tree::{Child, MemTree, Source as _, df, no_children};

use crate::cell_head::CellHead;
use crate::text_file;

/// Word that expressions with a description begin with.
const NAME: &str = "df:";
/// Bytes of memory for each symbol.
const NODE_BYTES: usize = 160;

/// Tree of cells, read from a DF-expression.
///
/// ```
/// use spinney::raw::partitions::DfText;
/// use spinney::raw::tree::df;
///
/// let read = DfText::parse("notched.df", "M(VFFFFFFF)")?;
/// assert_eq!((read.depth(), read.extent), (1, [2, 2, 2]));
/// let wide = DfText::parse("wide.df", "df:xy:2:i16:4x3 G [-7]WW G 12WW")?;
/// assert_eq!(df::to_text(&wide.tree, None)?, "G[-7]WWG12WW");
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct DfText {
    /// The tree, condensed. Its INNER nodes have the values of their first leaves.
    pub tree: MemTree,
    /// Cells along each axis.
    pub extent: [u64; 3],
}

/// Formats the first word of the DF-expression of a tree of cells.
pub fn df_head(form: TreeType, depth: u8, extent: [u64; 3]) -> String {
    format!("{NAME}{}", CellHead { form, depth, extent }.text())
}

impl DfText {
    /// Number of levels below the root.
    pub fn depth(&self) -> u8 {
        self.tree.depth()
    }

    /// Reads a file. Its text and its nodes may use at most `memory` bytes.
    ///
    /// # Errors
    /// If the file cannot be read or exceeds `memory`, and those of [`DfText::parse`].
    pub fn read(path: &Path, memory: u64) -> Result<DfText> {
        let text = text_file::read(path, "DF-expression", NODE_BYTES, memory)?;
        DfText::parse(&path.display().to_string(), &text)
    }

    /// Parses an expression. `place` is its origin, for messages.
    ///
    /// # Errors
    /// If the text is no DF-expression, or has values beyond its extent.
    pub fn parse(place: &str, text: &str) -> Result<DfText> {
        let text = text.trim();
        let (head, symbols) = match text.strip_prefix(NAME) {
            None => (guessed(place, text)?, text),
            Some(rest) => {
                let (words, symbols) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                let parts: Vec<&str> = words.split(':').collect();
                let expected = "`df:xy:DEPTH:TYPE:WIDTHxHEIGHT`, or `df:xyz:DEPTH:TYPE:WIDTHxHEIGHTxDEPTH`";
                let bad = |part: &str| Error::invalid(place, format!("`{NAME}{part}`"), expected);
                let parts = <[&str; 4]>::try_from(parts).map_err(|_| bad(words))?;
                (CellHead::parse(parts).map_err(|_| bad(words))?, symbols)
            }
        };
        let CellHead { form, depth, extent } = head;
        let full = match form.value.splat(255u8) {
            Some(full) => full,
            None if symbols.contains(['B', 'F']) => {
                let expected = format!("values of type {}; 255, which B and F mean, is none", form.value);
                return Err(Error::invalid(place, "`B` or `F`", expected));
            }
            None => Value::ZERO,
        };
        let tree = df::from_text(form, symbols, depth, full, Rule::Nearest).map_err(|error| {
            Error::invalid(place, error.to_string(), "the DF-expression of a tree of cells")
        })?;
        match is_within(&tree, extent)? {
            true => Ok(DfText { tree, extent }),
            false => Err(Error::invalid(place, "values beyond the extent", "W or V (VOID) there")),
        }
    }
}

/// Whether all leaves with values are within an extent.
fn is_within(tree: &MemTree, extent: [u64; 3]) -> Result<bool> {
    let (form, within) = (tree.form(), Bounds::of_extent(extent));
    let mut children = no_children();
    let mut pending = vec![(tree.root()?, Code::root(form.dimension))];
    while let Some((child, code)) = pending.pop() {
        match child {
            Child::Void => {}
            Child::Leaf(_) if within.contains(&code.bounds(tree.depth())) => {}
            Child::Leaf(_) => return Ok(false),
            Child::Inner { node, .. } => {
                tree.children(&node, &mut children)?;
                let steps = 0..form.dimension.children();
                pending.extend(steps.map(|step| (children[step], code.child(step))));
            }
        }
    }
    Ok(true)
}

/// Returns the description of an expression that has none.
fn guessed(place: &str, text: &str) -> Result<CellHead> {
    let is_octree = text.contains(['M', 'V', 'F']);
    let dimension = if is_octree { Dimension::Oct } else { Dimension::Quad };
    // Children that are still to come of each node that is not complete.
    let mut missing: Vec<usize> = Vec::new();
    let (mut depth, mut is_in_brackets) = (0, false);
    for letter in text.chars() {
        match letter {
            '[' => is_in_brackets = true,
            ']' => is_in_brackets = false,
            _ if is_in_brackets || letter.is_whitespace() || matches!(letter, '(' | ')') => continue,
            'G' | 'M' => {
                missing.push(dimension.children());
                depth = depth.max(missing.len());
                continue;
            }
            _ => {}
        }
        if letter == '[' {
            continue;
        }
        while let Some(count) = missing.last_mut() {
            *count -= 1;
            if *count > 0 {
                break;
            }
            missing.pop();
        }
    }
    if depth > usize::from(dimension.max_depth()) {
        let expected = format!("at most {} levels", dimension.max_depth());
        return Err(Error::invalid(place, format!("nodes at level {depth}"), expected));
    }
    let mut extent = [1; 3];
    extent[..dimension.axes()].fill(1 << depth);
    Ok(CellHead {
        form: TreeType::new(dimension, ValueType::new(SampleType::U8, 1)),
        depth: depth as u8,
        extent,
    })
}
