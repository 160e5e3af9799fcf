//! Extended octrees as modified DF-expressions (P. Slavík, *Datové struktury pro počítačovou
//! grafiku*): nodes in preorder, and the planes that the leaves refer to.
//!
//! ```text
//! text    = head planes symbols
//! planes  = { number ":" plane }            one a line, numbered from 1
//! symbols = { "M" | "V" | "F" | ("A" | "E" | "X" | "B") "[" inside "]" }
//! inside  = term | plane-term "&" factor | plane-term "|" factor
//! factor  = inside, in parentheses if its operator is the other one
//! term    = plane-term | "in" | "out" | "(" number "?" inside ":" inside ")"
//! plane-term = ["!"] number
//! ```
//!
//! `M` is MIXED, and followed by its eight children; `V` is VOID and `F` is FULL. A leaf that faces
//! cut is `A` (FACE: one plane), `E` (EDGE: its planes share a line), `X` (VERTEX: they share a
//! point) or `B` (they share nothing; the literature has no such leaf). Its inside is an expression
//! of half-spaces: `3` is the back of plane 3, `!3` the front, `(3?x:y)` is x at the back and y in
//! front. White space between symbols is ignored.
//!
//! The walls between cells are in the middle between grid points.

use std::collections::HashMap;
use std::fmt::Write as _;

use spinney_base::io::shown;
use spinney_base::space::Dimension;
use spinney_base::{Error, Progress, Result};
use spinney_brep::{
    ExactModel, ExactPlane, FaceBuffer, Faces, LeafRule, ModelNode, ModelNodeState, NodeKind,
};

use crate::bsp::{Bsp, BspNode, Division, Fragments};
use crate::preorder::{BinaryNode, PreorderBuilder};
use crate::solid_text::{Lines, head, push_plane};

/// Maximum number of faces of a leaf, and of levels of an expression.
const MAX_FACES: usize = 1024;
/// Maximum number of symbols in a line.
const LINE: usize = 96;

/// Returns the modified DF-expression of an exact model's octree.
///
/// # Errors
/// If the model has faces with off-grid vertices, or leaves with more than 1024 faces; if it cannot
/// be read; or on cancellation.
pub fn extended_octree_text(model: &ExactModel, progress: &dyn Progress) -> Result<String> {
    check_on_grid(model)?;
    let mut planes = Planes::default();
    let mut symbols = String::new();
    let mut width = 0;
    let mut pending = vec![model.root()?];
    while let Some(node) = pending.pop() {
        progress.check()?;
        let start = symbols.len();
        match node.state() {
            ModelNodeState::Void => symbols.push('V'),
            ModelNodeState::Full => symbols.push('F'),
            ModelNodeState::Inner => {
                symbols.push('M');
                let children = model.children(&node)?;
                pending.extend(children.into_iter().flatten().rev());
            }
            ModelNodeState::Leaf { kind, rule, inside } => {
                let inside = leaf_expression(model, &node, (rule, inside), &mut planes)?;
                let _ = write!(symbols, "{}[{inside}]", letter(kind));
            }
        }
        width += symbols.len() - start;
        if width >= LINE {
            symbols.push('\n');
            width = 0;
        }
    }
    let mut text = head("df:planes", model.grid(), model.unit());
    for (number, plane) in (1..).zip(&planes.list) {
        let _ = write!(text, "{number}: ");
        push_plane(&mut text, plane);
        text.push('\n');
    }
    text.push_str(symbols.trim_end());
    text.push('\n');
    Ok(text)
}

/// Refuses models that are unbounded, or have faces with vertices off the grid.
pub(crate) fn check_on_grid(model: &ExactModel) -> Result<()> {
    let (found, expected) = match model.exact_faces() {
        _ if model.is_unbounded() => ("everything outside of its faces", "a bounded model"),
        (0, _) => return Ok(()),
        _ => (
            "faces with vertices off the grid",
            "vertices on the grid: export it as .ply, which rounds them, and build that",
        ),
    };
    Err(Error::invalid(shown(model.path()), found, expected))
}

fn letter(kind: NodeKind) -> char {
    match kind {
        NodeKind::Face => 'A',
        NodeKind::Edge => 'E',
        NodeKind::Vertex => 'X',
        NodeKind::Boolean => 'B',
    }
}

/// Distinct planes, numbered from 1.
#[derive(Default)]
struct Planes {
    list: Vec<ExactPlane>,
    numbers: HashMap<([i64; 3], i128), usize>,
}

impl Planes {
    fn number(&mut self, plane: &ExactPlane) -> usize {
        let plane = plane.reduced();
        *self.numbers.entry((plane.normal, plane.offset)).or_insert_with(|| {
            self.list.push(plane);
            self.list.len()
        })
    }
}

/// Returns the expression of a leaf's inside.
fn leaf_expression(
    model: &ExactModel,
    node: &ModelNode<'_>,
    (rule, is_corner_inside): (LeafRule, bool),
    planes: &mut Planes,
) -> Result<String> {
    let faces: Vec<u64> = node.faces().collect();
    if faces.len() > MAX_FACES {
        return Err(Error::invalid(
            shown(model.path()),
            format!("a leaf with {} faces", faces.len()),
            format!("at most {MAX_FACES}; build it with a finer grid (--snap) or a smaller --leaf-size"),
        ));
    }
    let (mut buffer, mut fragments) = (FaceBuffer::default(), Fragments::default());
    let mut numbers = Vec::new();
    for number in faces {
        model.face(number, &mut buffer)?;
        match rule {
            LeafRule::All | LeafRule::Any => {
                numbers.extend(buffer.face().plane().map(|plane| planes.number(&plane)));
            }
            LeafRule::Crossings => fragments.push(&buffer.points, &buffer.ring_ends, number as usize)?,
        }
    }
    if rule != LeafRule::Crossings {
        numbers.sort_unstable();
        numbers.dedup();
        let numbers: Vec<String> = numbers.iter().map(usize::to_string).collect();
        return Ok(numbers.join(if rule == LeafRule::All { "&" } else { "|" }));
    }
    // Invariant: walls of cells are between grid points, so no face lies in a wall, and a cell's
    // inside depends on the fragments within it alone. A face in a wall would belong to two cells,
    // and to none after rounding.
    let tree = Bsp::of_cell(fragments, node.bounds(model.grid()), is_corner_inside)?;
    Ok(expression(tree.nodes(), 0, planes).0)
}

/// Expression of a tree's node, and its operator, if it has one outside of parentheses.
fn expression(nodes: &[BspNode], at: usize, planes: &mut Planes) -> (String, Option<char>) {
    let (by, second) = match &nodes[at] {
        BinaryNode::Leaf(is_inside) => return (if *is_inside { "in" } else { "out" }.into(), None),
        BinaryNode::Divided { by, second } => (by, *second),
    };
    let number = planes.number(by.plane());
    let leaf = |at: usize| match nodes[at] {
        BinaryNode::Leaf(is_inside) => Some(is_inside),
        BinaryNode::Divided { .. } => None,
    };
    let mut joined = |sign: &str, operator: char, rest: usize| {
        let (text, inner) = expression(nodes, rest, planes);
        let is_mixed = inner.is_some_and(|inner| inner != operator);
        let text = if is_mixed { format!("({text})") } else { text };
        (format!("{sign}{number}{operator}{text}"), Some(operator))
    };
    match (leaf(at + 1), leaf(second)) {
        (Some(true), Some(false)) => (number.to_string(), None),
        (Some(false), Some(true)) => (format!("!{number}"), None),
        (_, Some(false)) => joined("", '&', at + 1),
        (Some(true), _) => joined("", '|', second),
        (Some(false), _) => joined("!", '&', second),
        (_, Some(true)) => joined("!", '|', at + 1),
        (None, None) => {
            let back = expression(nodes, at + 1, planes).0;
            let front = expression(nodes, second, planes).0;
            (format!("({number}?{back}:{front})"), None)
        }
    }
}

/// Part of a tree of space that is still to be parsed, or division that is still to be added.
enum Pending {
    /// A symbol of a node at this level with this position.
    Node(u8, [u32; 3]),
    /// The division of a MIXED node along an axis.
    Division(usize, u8, [u32; 3]),
}

/// Parses planes and symbols.
pub(crate) fn parse(lines: &mut Lines<'_>, bits: u8) -> Result<Bsp> {
    let mut planes: Vec<ExactPlane> = Vec::new();
    let mut line = lines.next();
    while let Some((number, plane)) =
        line.filter(|line| !line.contains('[')).and_then(|line| line.split_once(':'))
    {
        if number.trim().parse() != Ok(planes.len() + 1) {
            return Err(lines.bad(number, format!("the number {} of the next plane", planes.len() + 1)));
        }
        planes.push(lines.plane(plane, Dimension::Oct)?);
        line = lines.next();
    }
    let mut made = PreorderBuilder::new(|_: &Division| false);
    // Invariant: children are parsed in the order of a BSP tree that divides along z, then y, then
    // x, the back first. So symbols become nodes without a tree in between.
    // The outermost cell is within half a grid unit around the grid: nothing is inside beyond it.
    for axis in 0..3 {
        made.divide(wall(axis, -1));
        made.leaf(false);
        made.divide(wall(axis, (2 << bits) - 1));
    }
    let mut pending = vec![Pending::Node(0, [0; 3])];
    let mut symbols = Symbols { lines, rest: line.unwrap_or_default(), planes: &planes };
    while let Some(next) = pending.pop() {
        let (level, position) = match next {
            Pending::Division(axis, level, position) => {
                let cell = 2i64 << (bits - level);
                made.divide(wall(axis, i64::from(position[axis]) * cell - 1 + cell / 2));
                continue;
            }
            Pending::Node(level, position) => (level, position),
        };
        match symbols.letter()? {
            'V' => made.leaf(false),
            'F' => made.leaf(true),
            'M' if level < bits => {
                let child = |child: u32| {
                    let at = |axis: usize| 2 * position[axis] + (child >> axis & 1);
                    Pending::Node(level + 1, [0, 1, 2].map(at))
                };
                let divide = |axis: usize| Pending::Division(axis, level, position);
                let mut next = Vec::new();
                for number in 0..8 {
                    // A BSP tree of the eight children divides along z, then y, then x.
                    let axes = (0..3).rev().filter(|axis| number & ((1 << (axis + 1)) - 1) == 0);
                    next.extend({ axes }.map(divide));
                    next.push(child(number));
                }
                pending.extend(next.into_iter().rev());
            }
            'M' => return Err(symbols.bad("V, F, A, E, X or B: a cell of one grid unit is not divided")),
            'A' | 'E' | 'X' | 'B' => symbols.leaf(&mut made)?,
            _ => return Err(symbols.bad("one of M V F A E X B")),
        }
    }
    symbols.end()?;
    for _ in 0..3 {
        made.leaf(false);
    }
    Ok(Bsp::of_nodes(Dimension::Oct, made.finish()))
}

/// A wall between cells, at half of a coordinate.
fn wall(axis: usize, twice: i64) -> Division {
    let mut normal = [0; 3];
    normal[axis] = 2;
    Division::by(ExactPlane { normal, offset: twice.into() })
}

/// Symbols of the expression that are still to be parsed.
struct Symbols<'a, 'l> {
    lines: &'a mut Lines<'l>,
    rest: &'l str,
    planes: &'a [ExactPlane],
}

impl Symbols<'_, '_> {
    fn bad(&self, expected: &str) -> Error {
        self.lines.bad(self.rest, expected)
    }

    /// Takes the next symbol's letter, from the next line if necessary.
    fn letter(&mut self) -> Result<char> {
        self.rest = self.rest.trim_start();
        if self.rest.is_empty() {
            self.rest = self.lines.next().unwrap_or_default();
        }
        let letter = self.rest.chars().next().ok_or_else(|| self.bad("a symbol: eight follow each M"))?;
        if "MVFAEXB".contains(letter) {
            self.rest = &self.rest[1..];
        }
        Ok(letter)
    }

    /// Checks that nothing is left.
    fn end(&mut self) -> Result<()> {
        self.rest = self.rest.trim_start();
        if self.rest.is_empty() {
            self.rest = self.lines.next().unwrap_or_default();
        }
        if self.rest.is_empty() { Ok(()) } else { Err(self.bad("the end of the text: the tree is complete")) }
    }

    fn take(&mut self, prefix: &str) -> bool {
        match self.rest.strip_prefix(prefix) {
            Some(rest) => {
                self.rest = rest;
                true
            }
            None => false,
        }
    }

    fn expect(&mut self, prefix: &str) -> Result<()> {
        if self.take(prefix) { Ok(()) } else { Err(self.bad(&format!("`{prefix}`"))) }
    }

    /// Takes an expression in brackets.
    fn leaf(&mut self, made: &mut PreorderBuilder<Division, bool>) -> Result<()> {
        self.expect("[")?;
        self.inside(made, None, 0)?;
        self.expect("]")
    }

    /// Takes an expression, after an operator if one is given.
    fn inside(
        &mut self,
        made: &mut PreorderBuilder<Division, bool>,
        before: Option<&str>,
        depth: usize,
    ) -> Result<()> {
        if depth > MAX_FACES {
            return Err(self.bad(&format!("at most {MAX_FACES} operators and parentheses within others")));
        }
        for (word, is_inside) in [("in", true), ("out", false)] {
            if self.take(word) {
                made.leaf(is_inside);
                return Ok(());
            }
        }
        if self.take("(") {
            // (A plane before `?` divides; otherwise the parentheses only group.)
            let start = self.rest;
            if let Some(plane) = self.number().ok().filter(|_| self.take("?")) {
                made.divide(Division::by(plane));
                self.inside(made, None, depth + 1)?;
                self.expect(":")?;
            } else {
                self.rest = start;
            }
            self.inside(made, None, depth + 1)?;
            return self.expect(")");
        }
        let is_turned = self.take("!");
        let plane = self.number()?;
        made.divide(Division::by(plane));
        let operator = ["&", "|"].into_iter().find(|operator| self.take(operator));
        if let (Some(operator), Some(before)) = (operator, before)
            && operator != before
        {
            return Err(self.bad("parentheses around one of the operators & and |"));
        }
        // At the back of the plane, or in front of a turned one, the rest of an `&` decides; on the
        // other side the rest of an `|`.
        for is_back in [true, false] {
            let is_on = is_back != is_turned;
            match operator {
                Some("&") if is_on => self.inside(made, operator, depth + 1)?,
                Some("|") if !is_on => self.inside(made, operator, depth + 1)?,
                _ => made.leaf(is_on),
            }
        }
        Ok(())
    }

    /// Takes the number of a plane.
    fn number(&mut self) -> Result<ExactPlane> {
        let end = self.rest.bytes().take_while(u8::is_ascii_digit).count();
        let (digits, rest) = self.rest.split_at(end);
        let plane = digits.parse::<usize>().ok().and_then(|number| self.planes.get(number.checked_sub(1)?));
        let plane =
            *plane.ok_or_else(|| self.bad(&format!("the number of a plane, 1 to {}", self.planes.len())))?;
        self.rest = rest;
        Ok(plane)
    }
}
