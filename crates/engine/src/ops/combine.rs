//! Set operations and similar: several trees over the same space, merged into one.

use smallvec::SmallVec;

use super::affine::{View, ViewNode};
use super::coverage;
use super::operation::CombineOperation;
use super::view_source::{ViewSource, check_form};
use crate::store::BuildOptions;
use crate::store::builder::{Join, MergeAction, Merging, Overlay, RecordRef, ReusableSource, StoredNode};
use crate::tree::{CellBlock, Child, Children, Source, no_children};
use spinney_base::TreeType;
use spinney_base::io::Output;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{SampleType, Value, ZoneStats};
use spinney_base::{Error, Progress, Result, SetOperation};

/// Result node, as far as the input nodes determine it.
enum Resolution {
    Void,
    Leaf(Value),
    /// Node of the tree at this index, with its whole subtree.
    Keep(usize),
    /// Undetermined: resolve its children.
    Split,
}

/// Result of the operations on a node's first trees.
enum Folded {
    /// Node of the tree at this index.
    Node(usize),
    /// One value, or VOID.
    Uniform(Option<Value>),
    /// Undetermined, like the INNER node of the tree at this index.
    Mixed(usize),
}

/// Several views of one tree type, merged into one tree by a [`CombineOperation`].
///
/// Views are traversed in parallel. Where one input decides, the others' detail is not read, and
/// stored subtrees are forwarded. Time is proportional to the visited nodes, at most the sum over
/// all views.
#[derive(Clone, Debug)]
pub struct Combined {
    views: Vec<View>,
    form: TreeType,
    operation: CombineOperation,
    /// How to merge two trees: see [`CombineOperation::mergings`].
    mergings: [Merging; 3],
    /// How to merge the result of the first trees and the next one, if there are more than two.
    folding: Merging,
    /// Value of cells that no tree has.
    fill: Value,
    /// Cells along each axis.
    extent: [u64; 3],
    /// Box in which cells of no tree can be present.
    universe: Bounds,
}

/// Input nodes at a result node, each with the index of its tree.
type Nodes = SmallVec<[(usize, Child<ViewNode>); 2]>;

/// INNER node of combined trees.
#[derive(Clone, Debug)]
pub enum CombinedNode {
    /// Unchanged node of one of the trees.
    Same(usize, ViewNode),
    /// Nodes of several trees, not merged yet. (Boxed to keep other nodes small, since they are
    /// moved often.)
    Open(Box<OpenNode>),
}

/// Nodes of several trees, not merged yet.
#[derive(Clone, Debug)]
pub struct OpenNode {
    /// Code of the result node.
    code: Code,
    nodes: Nodes,
}

/// Cells of a tree below a node.
enum Operand {
    /// One value, or VOID, in all cells.
    Uniform(Option<Value>),
    Cells(CellBlock),
}

impl Operand {
    /// Cell as a node.
    #[inline]
    fn cell(&self, at: usize, width: usize) -> Child<ViewNode> {
        Child::uniform(match self {
            Operand::Uniform(value) => *value,
            Operand::Cells(cells) if !cells.present[at] => None,
            Operand::Cells(cells) => Some(Value::from_bytes(&cells.values[at * width..(at + 1) * width])),
        })
    }
}

/// Node of a tree with its children. Children of a uniform node equal the node.
struct Below<'a> {
    tree: usize,
    node: &'a Child<ViewNode>,
    children: Option<&'a Children<ViewNode>>,
}

impl<'a> Below<'a> {
    /// Child of the node, with the index of the tree.
    #[inline]
    fn child(&self, step: usize) -> (usize, &'a Child<ViewNode>) {
        (self.tree, self.children.map_or(self.node, |children| &children[step]))
    }
}

impl Combined {
    /// Combines views of one tree type and depth, whose extents lie within `extent`.
    ///
    /// # Errors
    /// If tree types or depths differ, or the operation takes another number of trees.
    pub fn new(views: Vec<View>, operation: CombineOperation, extent: [u64; 3]) -> Result<Combined> {
        let takes = operation.takes();
        if !takes.contains(&views.len()) {
            let expected = match takes.into_inner() {
                (2, usize::MAX) => "at least two",
                (_, 2) => "two",
                _ => "at least one",
            };
            return Err(Error::invalid("trees to combine", views.len().to_string(), expected));
        }
        let (form, depth) = (views[0].form(), views[0].depth());
        for view in &views[1..] {
            check_form((view.source().name(), view.form()), (views[0].source().name(), form))?;
        }
        if let Some(other) = views.iter().find(|view| view.depth() != depth) {
            let expected =
                format!("{depth}, the depth of the first tree; deepen the view of the shallower tree");
            return Err(Error::invalid("depth of a tree", other.depth().to_string(), expected));
        }
        let fill = if form.value.sample == SampleType::U8 { 255.0 } else { 1.0 };
        let fill = form.value.nearest(|_| fill);
        // Coverage operations apply only if all trees are coverage; else trees are combined by
        // presence.
        let full = views.iter().map(|view| coverage::full(form, view.source().header().rule));
        let full = full.reduce(Option::and).flatten();
        let (mergings, universe) = (operation.mergings(full), Bounds::of_extent(extent));
        let [folding, ..] = operation.without_complement().mergings(full);
        Ok(Combined { views, form, operation, mergings, folding, fill, extent, universe })
    }

    /// Limits the cells that can be present without being in any tree, if the operation makes such
    /// cells present. Default: the whole extent.
    #[must_use]
    pub fn within(self, universe: Bounds) -> Combined {
        Combined { universe, ..self }
    }

    /// Sets the value of cells that a set operation makes present and no tree has. Default: 255 for
    /// bytes, which is full coverage in solids, and 1 for other types.
    ///
    /// # Errors
    /// If cells store coverage and the value is not 255, the only value for a full cell.
    pub fn filled_with(self, fill: Value) -> Result<Combined> {
        if self.coverage().is_some_and(|full| full != fill) {
            let found = self.form.value.show(fill);
            return Err(Error::invalid(
                "fill value",
                found,
                "255, the value of full cells: these trees store coverage",
            ));
        }
        Ok(Combined { fill, ..self })
    }

    /// Value of full cells, if this is a set operation on coverage.
    fn coverage(&self) -> Option<Value> {
        self.mergings[0].full
    }

    /// Whether the result has what any of the trees has, so that VOID inputs can be ignored.
    fn is_union(&self) -> bool {
        self.operation == CombineOperation::Over
            || self.views.len() > 2
                && matches!(self.operation, CombineOperation::Set { operation: SetOperation::Union, .. })
    }

    /// The views.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// Cells along each axis.
    pub fn extent(&self) -> [u64; 3] {
        self.extent
    }

    /// Whether the nodes of both trees are the same node of one file.
    fn is_one_node(&self, nodes: &[(usize, &Child<ViewNode>)]) -> bool {
        let kept = |(tree, child): &(usize, &Child<ViewNode>)| match child {
            Child::Inner { node, .. } => self.views[*tree].kept(node),
            _ => None,
        };
        let [first, second] = nodes else { return false };
        kept(first).is_some_and(|record| kept(second) == Some(record))
    }

    /// Resolves a node whose subtree is the same in both trees, if the operation allows it.
    fn resolve_same(&self) -> Option<Resolution> {
        match self.operation {
            // Cells are in both trees or in neither. If the latter belong to the result, they have
            // to be filled, so the subtree cannot be copied.
            CombineOperation::Set { operation, .. } if operation.is_unbounded() => None,
            CombineOperation::Set { operation, .. } if operation.contains(true, true) => {
                Some(Resolution::Keep(0))
            }
            CombineOperation::Set { .. } => Some(Resolution::Void),
            CombineOperation::Over
            | CombineOperation::Min
            | CombineOperation::Max
            | CombineOperation::Equal => Some(Resolution::Keep(0)),
            CombineOperation::Changed => Some(Resolution::Void),
            _ => None,
        }
    }

    /// Resolves a node from the input nodes.
    fn resolve(&self, code: Code, nodes: &[(usize, &Child<ViewNode>)]) -> Resolution {
        // Two commits of a file share the records of everything unchanged between them: no need to
        // read those.
        if self.is_one_node(nodes)
            && let Some(resolution) = self.resolve_same()
        {
            return resolution;
        }
        match (self.operation, nodes) {
            _ if self.is_union() && self.coverage().is_none() => match nodes {
                [] => Resolution::Void,
                [(_, Child::Leaf(value)), ..] => Resolution::Leaf(*value),
                [_] => Resolution::Keep(0),
                _ => Resolution::Split,
            },
            (CombineOperation::Set { .. }, []) => Resolution::Void,
            // A complement may have no second tree.
            (CombineOperation::Set { .. }, [first]) => self.resolve_two(code, first.1, &Child::Void),
            (_, [first, second]) => self.resolve_two(code, first.1, second.1),
            (CombineOperation::Set { .. }, nodes) if self.is_union() => {
                self.resolve_many(self.mergings[0].join, nodes)
            }
            (CombineOperation::Set { .. }, nodes) => self.resolve_folded(code, nodes),
            (operation, nodes) => {
                operation.join().map_or(Resolution::Split, |join| self.resolve_many(join, nodes))
            }
        }
    }

    /// Resolves a node of two trees.
    fn resolve_two(&self, code: Code, first: &Child<ViewNode>, second: &Child<ViewNode>) -> Resolution {
        // Only complements fill cells that no tree has.
        let part = match self.operation {
            CombineOperation::Set { .. } if self.operation.needs_universe() => {
                match self.inside_and_outside(code) {
                    (true, false) => 0,
                    (false, _) => 1,
                    (true, true) => 2,
                }
            }
            _ => 0,
        };
        self.resolve_by(&self.mergings[part], first, second)
    }

    fn resolve_by(&self, merging: &Merging, first: &Child<ViewNode>, second: &Child<ViewNode>) -> Resolution {
        match merging.action([first, second]) {
            MergeAction::Void => Resolution::Void,
            MergeAction::Keep(tree) => Resolution::Keep(tree),
            MergeAction::Fill => Resolution::Leaf(self.fill),
            MergeAction::Join => {
                let [a, b] = [first, second].map(|node| node.value().unwrap_or(Value::ZERO));
                let joined = merging.join.values(self.form.value, a, b);
                joined.map_or(Resolution::Void, Resolution::Leaf)
            }
            MergeAction::Split => Resolution::Split,
        }
    }

    /// Resolves a node of more than two trees: the operation of the first two, then of the result
    /// and each further tree. A complement is that of the last operation only.
    fn resolve_folded(&self, code: Code, nodes: &[(usize, &Child<ViewNode>)]) -> Resolution {
        let mut folded = Folded::Node(0);
        for next in 1..nodes.len() {
            let uniform;
            let first = match &folded {
                Folded::Node(index) => nodes[*index].1,
                Folded::Uniform(value) => {
                    uniform = Child::uniform(*value);
                    &uniform
                }
                // (The tables need the state only.)
                Folded::Mixed(index) => nodes[*index].1,
            };
            let second = nodes[next].1;
            let resolution = match next + 1 == nodes.len() {
                true => self.resolve_two(code, first, second),
                false => self.resolve_by(&self.folding, first, second),
            };
            folded = match (resolution, folded) {
                (Resolution::Void, _) => Folded::Uniform(None),
                (Resolution::Leaf(value), _) => Folded::Uniform(Some(value)),
                (Resolution::Keep(0), folded) => folded,
                (Resolution::Keep(_), _) => Folded::Node(next),
                (Resolution::Split, _) => {
                    let is_inner = |index: &usize| matches!(nodes[*index].1, Child::Inner { .. });
                    Folded::Mixed((0..=next).find(is_inner).unwrap_or(next))
                }
            };
        }
        match folded {
            Folded::Mixed(_) => Resolution::Split,
            Folded::Uniform(value) => value.map_or(Resolution::Void, Resolution::Leaf),
            Folded::Node(index) => match nodes[index].1 {
                Child::Void => Resolution::Void,
                Child::Leaf(value) => Resolution::Leaf(*value),
                Child::Inner { .. } => Resolution::Keep(index),
            },
        }
    }

    /// Resolves a node of one tree, or of more than two, by joining values: VOID where one input is
    /// VOID.
    fn resolve_many(&self, join: Join, nodes: &[(usize, &Child<ViewNode>)]) -> Resolution {
        let mut result: Option<Value> = None;
        let mut inner = false;
        for (_, child) in nodes {
            match child {
                Child::Void => return Resolution::Void,
                Child::Inner { .. } => inner = true,
                Child::Leaf(value) => {
                    result = match result {
                        None => Some(*value),
                        Some(before) => join.values(self.form.value, before, *value),
                    };
                }
            }
        }
        match result {
            _ if inner && nodes.len() == 1 => Resolution::Keep(0),
            _ if inner => Resolution::Split,
            // (Coverages that are all 0 join to VOID.)
            result => result.map_or(Resolution::Void, Resolution::Leaf),
        }
    }

    /// Whether some of a node's cells are inside the universe, and whether some are outside.
    fn inside_and_outside(&self, code: Code) -> (bool, bool) {
        let size = self.depth() - code.level();
        let (mut inside, mut outside) = (true, false);
        let Bounds { min, max } = self.universe;
        for (axis, cell) in code.cell().into_iter().enumerate().take(self.form.axes()) {
            let (first, end) = (u64::from(cell) << size, (u64::from(cell) + 1) << size);
            inside &= first < max[axis] && end > min[axis];
            outside |= first < min[axis] || end > max[axis];
        }
        (inside, outside)
    }

    /// Children of a tree's node, read into `children` if there are any.
    #[inline]
    fn below<'a>(
        &self,
        (tree, node): &'a (usize, Child<ViewNode>),
        children: &'a mut Children<ViewNode>,
    ) -> Result<Below<'a>> {
        let children = match node {
            Child::Inner { node, .. } => {
                self.views[*tree].children(node, children)?;
                Some(&*children)
            }
            _ => None,
        };
        Ok(Below { tree: *tree, node, children })
    }

    /// Cells of an unmerged node where one tree is computed block by block: traversing that tree's
    /// nodes would cost more than its cells.
    fn merged_cells(&self, open: &OpenNode, levels: u8) -> Result<Option<CellBlock>> {
        let is_made = |tree: usize| matches!(**self.views[tree].source(), ViewSource::Blockwise(_));
        // (Complements also depend on the cell's position.)
        if self.operation.needs_universe() {
            return Ok(None);
        }
        let made = open.nodes.iter().enumerate().find_map(|(number, (tree, child))| match child {
            Child::Inner { node, .. } if is_made(*tree) => Some((number, *tree, node)),
            _ => None,
        });
        let Some((number, tree, node)) = made else { return Ok(None) };
        let Some(cells) = self.views[tree].cells(node, levels)? else { return Ok(None) };
        let (bounds, width) = (open.code.bounds(self.depth()), self.form.width());
        let draw = |(other, (tree, child)): (usize, &(usize, Child<ViewNode>))| match child {
            _ if other == number => Ok(Operand::Cells(cells.clone())),
            Child::Inner { .. } => {
                let mut drawn = CellBlock::void(bounds.volume() as usize, width);
                self.views[*tree].draw_at(self.depth(), &bounds, &mut drawn.values, &mut drawn.present)?;
                Ok(Operand::Cells(drawn))
            }
            uniform => Ok(Operand::Uniform(uniform.value())),
        };
        let operands = open.nodes.iter().enumerate().map(draw).collect::<Result<Vec<_>>>()?;
        let mut merged = CellBlock::void(bounds.volume() as usize, width);
        let mut here: SmallVec<[Child<ViewNode>; 2]> = SmallVec::new();
        for at in 0..merged.present.len() {
            here.clear();
            here.extend(operands.iter().map(|operand| operand.cell(at, width)));
            let nodes: SmallVec<[(usize, &Child<ViewNode>); 2]> =
                open.nodes.iter().map(|(tree, _)| *tree).zip(&here).collect();
            if let Some(value) = self.merge(open.code, &nodes).value() {
                merged.present[at] = true;
                merged.values[at * width..(at + 1) * width].copy_from_slice(&value.to_bytes()[..width]);
            }
        }
        Ok(Some(merged))
    }

    /// Result node from the input nodes.
    fn merge(&self, code: Code, nodes: &[(usize, &Child<ViewNode>)]) -> Child<CombinedNode> {
        if !self.is_union() {
            return self.resolved(code, nodes);
        }
        let present = nodes.iter().filter(|(_, child)| !matches!(child, Child::Void));
        let mut seen: SmallVec<[(usize, &Child<ViewNode>); 2]> = present.copied().collect();
        let leaf = |(_, child): &(usize, &Child<ViewNode>)| match child {
            Child::Leaf(value) => Some(*value),
            _ => None,
        };
        match self.coverage() {
            // The first LEAF hides all later trees. Earlier INNER nodes may still have VOID cells.
            None => {
                let first = seen.iter().position(|node| leaf(node).is_some());
                first.into_iter().for_each(|first| seen.truncate(first + 1));
            }
            // A full node hides all others.
            Some(full) => {
                let full = seen.iter().find(|node| leaf(node) == Some(full)).copied();
                full.into_iter().for_each(|full| seen = SmallVec::from_elem(full, 1));
            }
        }
        self.resolved(code, &seen)
    }

    /// Result node from those input nodes that matter to it.
    #[inline]
    fn resolved(&self, code: Code, nodes: &[(usize, &Child<ViewNode>)]) -> Child<CombinedNode> {
        match self.resolve(code, nodes) {
            Resolution::Void => Child::Void,
            Resolution::Leaf(value) => Child::Leaf(value),
            Resolution::Keep(index) => {
                let (tree, child) = nodes[index];
                child.clone().map_node(|node| CombinedNode::Same(tree, node))
            }
            Resolution::Split => {
                let representative = nodes.iter().find_map(|(_, child)| child.value()).unwrap_or_default();
                let nodes = nodes.iter().map(|(tree, child)| (*tree, (*child).clone())).collect();
                Child::Inner { representative, node: CombinedNode::Open(Box::new(OpenNode { code, nodes })) }
            }
        }
    }
}

impl Source for Combined {
    type Node = CombinedNode;

    fn form(&self) -> TreeType {
        self.form
    }

    fn depth(&self) -> u8 {
        self.views[0].depth()
    }

    fn root(&self) -> Result<Child<CombinedNode>> {
        let roots = self.views.iter().map(View::root).collect::<Result<Vec<_>>>()?;
        let nodes: Vec<_> = roots.iter().enumerate().collect();
        Ok(self.merge(Code::root(self.form.dimension), &nodes))
    }

    fn children(&self, node: &CombinedNode, children: &mut Children<CombinedNode>) -> Result<()> {
        let (code, nodes) = match node {
            CombinedNode::Same(tree, node) => {
                let node_of = |node| CombinedNode::Same(*tree, node);
                return self.views[*tree].children_as(node, children, node_of);
            }
            CombinedNode::Open(open) => (open.code, &open.nodes),
        };
        let results = || (0..self.form.children()).map(|step| (step, code.child(step)));
        // One or two nodes, the common case, need no lists.
        match &nodes[..] {
            [node] => {
                let mut below = no_children();
                let below = self.below(node, &mut below)?;
                for (step, code) in results() {
                    children[step] = self.merge(code, &[below.child(step)]);
                }
            }
            [first, second] => {
                let (mut below_first, mut below_second) = (no_children(), no_children());
                let below_first = self.below(first, &mut below_first)?;
                let below_second = self.below(second, &mut below_second)?;
                for (step, code) in results() {
                    children[step] = self.merge(code, &[below_first.child(step), below_second.child(step)]);
                }
            }
            _ => {
                let mut below = vec![no_children(); nodes.len()];
                let below = nodes.iter().zip(&mut below).map(|(node, children)| self.below(node, children));
                let below = below.collect::<Result<Vec<_>>>()?;
                for (step, code) in results() {
                    let nodes: Vec<_> = below.iter().map(|below| below.child(step)).collect();
                    children[step] = self.merge(code, &nodes);
                }
            }
        }
        Ok(())
    }

    fn check_unchanged(&self) -> Result<()> {
        self.views.iter().try_for_each(View::check_unchanged)
    }

    fn cells(&self, node: &CombinedNode, levels: u8) -> Result<Option<CellBlock>> {
        match node {
            CombinedNode::Same(tree, node) => self.views[*tree].cells(node, levels),
            CombinedNode::Open(open) => self.merged_cells(open, levels),
        }
    }

    fn tally(&self, node: &CombinedNode) -> Result<Option<ZoneStats>> {
        match node {
            CombinedNode::Same(tree, node) => self.views[*tree].tally(node),
            CombinedNode::Open(..) => Ok(None),
        }
    }
}

impl ReusableSource for Combined {
    fn stored(&self, node: &CombinedNode) -> Option<StoredNode<'_>> {
        match node {
            CombinedNode::Same(tree, node) => self.views[*tree].stored(node),
            CombinedNode::Open(..) => None,
        }
    }

    fn kept(&self, node: &CombinedNode) -> Option<RecordRef> {
        match node {
            CombinedNode::Same(tree, node) => self.views[*tree].kept(node),
            CombinedNode::Open(..) => None,
        }
    }

    fn overlay(&self, node: &CombinedNode) -> Option<Overlay<'_>> {
        // Complements depend on the universe, too, not only on the states of the two nodes.
        let has_table = !self.operation.needs_universe();
        // Joined values of samples that may be missing depend on more than the states, too.
        let is_masked =
            self.form.value.is_masked() && self.operation.join().is_some_and(|join| join.computes_samples());
        let CombinedNode::Open(open) = node else { return None };
        let [first, second] = &open.nodes[..] else { return None };
        let stored = |(tree, child): &(usize, Child<ViewNode>)| {
            Some(match child {
                Child::Void => Child::Void,
                Child::Leaf(value) => Child::Leaf(*value),
                Child::Inner { representative, node } => {
                    let node = self.views[*tree].stored(node)?;
                    Child::Inner { representative: *representative, node }
                }
            })
        };
        let nodes = (has_table && !is_masked).then(|| Some([stored(first)?, stored(second)?]))??;
        Some(Overlay { nodes, merging: self.mergings[0] })
    }
}

/// Builds a file from combined views, in the format of the output's name; returns the tally of all
/// cells. Subtrees that the views' files have stored with the same rule are copied unchanged.
///
/// # Errors
/// If a file is corrupt, the output cannot be written, the depth differs from the source's, or on
/// cancellation. No output is left then.
pub fn build(
    source: &Combined,
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<ZoneStats> {
    crate::store::build(source, source.extent, options, output, progress)
}
