//! Traversal of a view: finds the source nodes that a node of the view covers, and whether they
//! make it VOID, a LEAF or INNER.

use glam::DVec3;

use super::area::{Area, child_at};
use super::polyhedron::Polyhedron;
use super::view::{Lookup, Sampling, TINY, View};
use crate::ops::view_source::ViewSourceNode;
use crate::store::builder::{RecordRef, ReusableSource, StoredNode};
use crate::tree::{CellBlock, Child, Children, Source, no_children};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::space::{Code, Dimension};
use spinney_base::value::{Rule, Value, ZoneStats};

/// INNER node of a view.
#[derive(Clone, Debug)]
pub enum ViewNode {
    /// Unchanged node of the source.
    Same(ViewSourceNode),
    /// Any other node: the source nodes around its image.
    Around(Box<Around>),
}

/// Source nodes of one size around the image of a view's node: at most two along each axis.
#[derive(Clone, Debug)]
pub struct Around {
    /// Code of the view's node.
    code: Code,
    /// Source nodes have `2^size` cells along each axis.
    size: u8,
    /// Coordinates of the first source node, in nodes of this size.
    corner: [i64; 3],
    /// Source nodes. Bit 0 of the index selects the first or second node along x, bit 1 along y,
    /// bit 2 along z.
    nodes: Children<ViewSourceNode>,
}

impl Around {
    /// Empty set of source nodes around the image of a node, each with at most `2^most` cells along
    /// each axis.
    #[inline]
    fn new(code: Code, image: &Image, most: u8) -> Around {
        // Nodes as large as the image: regardless of its position, it intersects at most two along
        // each axis.
        let size = (image.longest as u64).next_power_of_two().trailing_zeros() as u8;
        let size = size.min(most);
        Around { code, size, corner: image.low.map(|cell| cell >> size), nodes: no_children() }
    }

    /// Code of the view's node.
    pub(super) fn code(&self) -> Code {
        self.code
    }

    /// Coordinates of a source node, in nodes of their size.
    #[inline]
    fn coordinates(&self, index: usize) -> [i64; 3] {
        std::array::from_fn(|axis| self.corner[axis] + (index as i64 >> axis & 1))
    }
}

/// Common state of source nodes.
enum Common {
    /// All are VOID.
    Void,
    /// All are LEAFs of this value.
    Leaf(Value),
    Nothing,
}

/// Node of a view and its cells.
struct Block {
    /// Levels below the node.
    height: u8,
    /// Cells along each axis.
    side: i64,
    /// First cell.
    first: [i64; 3],
    /// Box of all cells.
    start: DVec3,
    end: DVec3,
}

/// Cells of a block that may have values.
struct Shown {
    from: DVec3,
    to: DVec3,
    /// Whether windows hide some of the source's cells in the block.
    is_cut: bool,
}

impl Shown {
    /// Whether the block is fully shown and no window hides any of it.
    fn is_all_of(&self, block: &Block) -> bool {
        !self.is_cut && self.from == block.start && self.to == block.end
    }
}

/// Visible source cells that a block is computed from: first and last along each axis.
struct Image {
    low: [i64; 3],
    high: [i64; 3],
    /// Cells along the longest axis.
    longest: i64,
    /// Whether some of the cells that the block would be computed from are not visible.
    sticks_out: bool,
}

/// Classifies the children of a view's node. Reads the children of each surrounding source node at
/// most once.
///
/// Compiled for both numbers of axes, since views spend most of their time here.
struct Classifier<'a, const AXES: usize> {
    view: &'a View,
    around: &'a Around,
    /// Children of the surrounding source nodes that were read so far.
    children: [Option<Children<ViewSourceNode>>; 8],
}

/// Half a cell along each axis: from a cell's corner to its centre.
const HALF: DVec3 = DVec3::splat(0.5);

impl<'a, const AXES: usize> Classifier<'a, AXES> {
    fn new(view: &'a View, around: &'a Around) -> Self {
        Classifier { view, around, children: [const { None }; 8] }
    }

    /// Writes all children of the view's node.
    fn children<N>(&mut self, children: &mut Children<N>, node_of: impl Fn(ViewNode) -> N) -> Result<()> {
        let mut is_unread = false;
        for (step, child) in children[..1 << AXES].iter_mut().enumerate() {
            let found = defer_missing(self.classify(self.around.code.child(step)), &mut is_unread)?;
            *child = found.unwrap_or(Child::Void).map_node(&node_of);
        }
        finish_deferred(is_unread)
    }

    /// Node of the view below the classifier's node.
    fn classify(&mut self, code: Code) -> Result<Child<ViewNode>> {
        let block = self.block(code);
        let Some(shown) = self.shown(&block) else { return Ok(Child::Void) };
        if let Some(at) = self.aligned(&block) {
            return Ok(self.source_node(at, block.height)?.map_node(ViewNode::Same));
        }
        let Some(image) = self.image(&block, &shown) else { return Ok(Child::Void) };
        let mut around = Around::new(code, &image, self.around.size);
        // A block of one value need not be split if no window cuts it and it does not reach beyond
        // the source: otherwise some of its cells are VOID. If all source nodes are VOID, neither
        // matters.
        match self.find_nodes(&mut around, &image)? {
            Common::Void => return Ok(Child::Void),
            Common::Leaf(value) if shown.is_all_of(&block) && !image.sticks_out => {
                return Ok(Child::Leaf(value));
            }
            _ => {}
        }
        let in_middle = self.in_middle(&around, &image, &shown);
        if block.height == 0 {
            let value = match self.view.sampling {
                Sampling::Area(rule) if self.lookup().by_area => {
                    self.area_value(rule, &around, &image, &shown)?
                }
                _ => in_middle,
            };
            return Ok(Child::uniform(value));
        }
        // Any value will do, since a builder that stores the view computes averages. The middle is
        // the best estimate otherwise.
        let representative = in_middle.or_else(|| around.nodes.iter().find_map(Child::value));
        let node = ViewNode::Around(Box::new(around));
        Ok(Child::Inner { representative: representative.unwrap_or_default(), node })
    }

    fn lookup(&self) -> &'a Lookup {
        &self.view.lookup
    }

    /// Cells of a node.
    fn block(&self, code: Code) -> Block {
        let height = self.view.depth() - code.level();
        let side = 1i64 << height;
        let cell = code.cell();
        let first = std::array::from_fn(|axis| if axis < AXES { i64::from(cell[axis]) << height } else { 0 });
        let start = DVec3::from(first.map(|cell| cell as f64));
        // Quadtrees are one cell thick along z, so that boxes have a volume in either dimension.
        let size = std::array::from_fn(|axis| if axis < AXES { side as f64 } else { 1.0 });
        Block { height, side, first, start, end: start + DVec3::from_array(size) }
    }

    /// Part of a block that may have values; `None` if all of it is VOID.
    fn shown(&self, block: &Block) -> Option<Shown> {
        let lookup = self.lookup();
        // The source's content there, and what windows along the axes leave of it.
        let (low, high) = (block.start.max(lookup.content.0), block.end.min(lookup.content.1));
        let (from, to) = (low.max(lookup.shown.0), high.min(lookup.shown.1));
        if from.cmpge(to).any() {
            return None;
        }
        let mut is_cut = from != low || to != high;
        for (map, size) in &lookup.askew {
            // A cell is in a window if its centre is. The centres of the corner cells are the
            // outermost. Of a cell of a solid, any part may be in the window.
            let inset = if lookup.is_coverage { DVec3::ZERO } else { HALF };
            let (low, high) = map.bounding_box(from + inset, to - inset);
            if high.cmplt(DVec3::ZERO).any() || low.cmpge(*size).any() {
                return None;
            }
            is_cut |= low.cmplt(DVec3::ZERO).any() || high.cmpge(*size).any();
        }
        Some(Shown { from, to, is_cut })
    }

    /// Coordinates of the source node that equals the block, if there is one and all of it is
    /// visible.
    fn aligned(&self, block: &Block) -> Option<[i64; 3]> {
        let lookup = self.lookup();
        let moved = lookup.moved.as_ref().filter(|_| lookup.askew.is_empty())?;
        let image: [i64; 3] = std::array::from_fn(|axis| block.first[axis] + moved.by[axis]);
        let aligned = image[..AXES].iter().all(|cell| *cell >= 0 && cell & (block.side - 1) == 0);
        // (Nodes larger than the surrounding ones are not accessible here.)
        let is_node = aligned && block.height <= self.around.size && moved.shows_all(image, block.side, AXES);
        is_node.then(|| image.map(|cell| cell >> block.height))
    }

    /// Source cells that the shown part of a block is computed from; `None` if none of them is
    /// visible.
    fn image(&self, block: &Block, shown: &Shown) -> Option<Image> {
        let lookup = self.lookup();
        let (low, high) = if lookup.by_area {
            // All cells that are touched, except for contact within rounding errors.
            let (low, high) = lookup.to_source.bounding_box(shown.from, shown.to);
            (low + TINY, high - TINY)
        } else {
            // All cells that centres can fall into. For a single cell, the centre is used without
            // tolerance.
            let (low, high) = lookup.to_source.bounding_box(shown.from + HALF, shown.to - HALF);
            let tiny = if block.height == 0 { 0.0 } else { TINY };
            (low - tiny, high + tiny)
        };
        let low = low.floor().to_array().map(|cell| cell as i64);
        let high = high.floor().to_array().map(|cell| cell as i64);
        let (visible_start, visible_end) = lookup.visible;
        let mut image = Image { low: [0; 3], high: [0; 3], longest: 1, sticks_out: false };
        for axis in 0..AXES {
            image.low[axis] = low[axis].max(visible_start[axis]);
            image.high[axis] = high[axis].min(visible_end[axis] - 1);
            if image.low[axis] > image.high[axis] {
                return None;
            }
            image.sticks_out |= low[axis] < image.low[axis] || high[axis] > image.high[axis];
            image.longest = image.longest.max(image.high[axis] - image.low[axis] + 1);
        }
        Some(image)
    }

    /// Finds the source nodes around an image, and their common state.
    fn find_nodes(&mut self, around: &mut Around, image: &Image) -> Result<Common> {
        let size = around.size;
        let last = image.high.map(|cell| cell >> size);
        let mut uniform = None;
        let (mut same, mut void, mut is_unread) = (true, true, false);
        for index in 0..1 << AXES {
            let at = around.coordinates(index);
            if (0..AXES).any(|axis| at[axis] > last[axis]) {
                continue;
            }
            let Some(child) = defer_missing(self.source_node(at, size), &mut is_unread)? else { continue };
            void &= matches!(child, Child::Void);
            match (child, uniform) {
                (Child::Leaf(value), None) => uniform = Some(value),
                (Child::Leaf(value), Some(first)) if value == first => {}
                _ => same = false,
            }
            around.nodes[index] = child;
        }
        finish_deferred(is_unread)?;
        Ok(match uniform {
            _ if void => Common::Void,
            Some(value) if same => Common::Leaf(value),
            _ => Common::Nothing,
        })
    }

    /// Source node of `2^size` cells along each axis, at most as large as the surrounding ones;
    /// `at` counts nodes of that size.
    fn source_node(&mut self, at: [i64; 3], size: u8) -> Result<Child<ViewSourceNode>> {
        // The bits of the coordinates above the lowest `up` select the surrounding node; those
        // below give the path down.
        let mut up = self.around.size - size;
        let step = |up: u8, corner: [i64; 3]| {
            (0..AXES).map(|axis| (((at[axis] >> up) - corner[axis]) as usize & 1) << axis).sum::<usize>()
        };
        let first = step(up, self.around.corner);
        let node = match &self.around.nodes[first] {
            Child::Inner { node, .. } if up > 0 => node,
            // All descendants of a uniform node equal it.
            child => return Ok(*child),
        };
        up -= 1;
        let source = &self.view.source;
        // Siblings are queried consecutively: their parent's children are read once.
        let children = match &mut self.children[first] {
            Some(children) => children,
            unknown => {
                let mut children = no_children();
                source.children(node, &mut children)?;
                unknown.insert(children)
            }
        };
        let mut child = children[step(up, [0; 3])];
        while let (Child::Inner { node, .. }, true) = (&child, up > 0) {
            up -= 1;
            let mut children = no_children();
            source.children(node, &mut children)?;
            child = children[step(up, [0; 3])];
        }
        Ok(child)
    }

    /// Value at the centre of the shown part, as far as the surrounding nodes determine it.
    fn in_middle(&self, around: &Around, image: &Image, shown: &Shown) -> Option<Value> {
        let centre = self.lookup().to_source.apply(((shown.from + shown.to) * 0.5).to_array());
        let index = (0..AXES)
            .map(|axis| {
                let cell = (centre[axis].floor().max(0.0) as i64).clamp(image.low[axis], image.high[axis]);
                (((cell >> around.size) - around.corner[axis]) as usize & 1) << axis
            })
            .sum::<usize>();
        around.nodes[index].value()
    }

    /// Value of a single cell from all source cells that it covers.
    fn area_value(&self, rule: Rule, around: &Around, image: &Image, shown: &Shown) -> Result<Option<Value>> {
        let Lookup { to_source, visible, is_coverage, is_turned, .. } = self.lookup();
        // (Most turned cells are far enough from the surface. This takes a tenth of the time.)
        if *is_turned && let Some(value) = self.uniform_in(around, image, shown)? {
            return Ok(value);
        }
        let image = to_source.bounding_box(shown.from, shown.to);
        let covered = self.visible_part(image, *is_coverage);
        let cell = (shown.to - shown.from).element_product();
        let whole = cell * to_source.determinant().abs();
        let mut area = Area::new(&self.view.source, self.view.form, rule, covered, whole);
        // (A view of a coarser level may use approximate values.)
        if self.view.source.is_approximate() && !self.view.is_level {
            area.go_to_cells();
        }
        let turned = match is_turned {
            true => {
                let (start, end) = (as_point(visible.0), as_point(visible.1));
                self.turned_cell(shown).in_box(start, end)
            }
            false => None,
        };
        let mut is_unread = false;
        for (index, child) in around.nodes.iter().enumerate() {
            let at = around.coordinates(index).map(|at| at << around.size);
            let added = match (is_turned, &turned) {
                (true, Some(turned)) => area.add_turned(child, (at, around.size), turned),
                (true, None) => Ok(()),
                (false, _) => area.add(child, at, around.size),
            };
            defer_missing(added, &mut is_unread)?;
        }
        finish_deferred(is_unread)?;
        Ok(area.value())
    }

    /// Value of all source cells in an image, `None` for VOID, if they are equal, and all of a cell
    /// is covered by them.
    fn uniform_in(&self, around: &Around, image: &Image, shown: &Shown) -> Result<Option<Option<Value>>> {
        let mut found = None;
        for (index, child) in around.nodes.iter().enumerate() {
            let at = around.coordinates(index).map(|at| at << around.size);
            if !self.is_uniform(child, (at, around.size), image, &mut found)? {
                return Ok(None);
            }
        }
        let is_part = shown.is_cut || image.sticks_out;
        Ok(found.filter(|value| value.is_none() || !is_part))
    }

    /// Whether all cells of a node in an image have the same value as all that were found before.
    fn is_uniform(
        &self,
        child: &Child<ViewSourceNode>,
        (at, size): ([i64; 3], u8),
        image: &Image,
        found: &mut Option<Option<Value>>,
    ) -> Result<bool> {
        let side = 1i64 << size;
        if (0..AXES).any(|axis| at[axis] > image.high[axis] || at[axis] + side <= image.low[axis]) {
            return Ok(true);
        }
        let Child::Inner { node, .. } = child else {
            return Ok(*found.get_or_insert(child.value()) == child.value());
        };
        let mut children = no_children();
        self.view.source.children(node, &mut children)?;
        for (step, child) in children[..1 << AXES].iter().enumerate() {
            if !self.is_uniform(child, (child_at(at, size, step), size - 1), image, found)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Part of a box of the source that is visible. Of solids it includes what lies beyond the end
    /// of the source, which is empty, so that whole nodes there can be used.
    fn visible_part(&self, (mut low, mut high): (DVec3, DVec3), is_coverage: bool) -> (DVec3, DVec3) {
        let Lookup { visible, askew, to_source, is_turned, .. } = self.lookup();
        for axis in 0..AXES {
            low[axis] = low[axis].max(visible.0[axis] as f64);
            if !is_coverage || visible.1[axis] < self.view.source_extent[axis] as i64 {
                high[axis] = high[axis].min(visible.1[axis] as f64);
            }
        }
        if is_coverage && !is_turned {
            for (map, size) in askew {
                // (The map from the view's cells has an inverse: it is one of the operations.)
                if let Ok(inverse) = map.inverse() {
                    let (start, end) = inverse.then(to_source).bounding_box(DVec3::ZERO, *size);
                    (low, high) = (low.max(start), high.min(end).max(low));
                }
            }
        }
        (low, high)
    }

    /// Image of a view's cell in the source, without what windows hide.
    fn turned_cell(&self, shown: &Shown) -> Polyhedron {
        let Lookup { askew, to_source, .. } = self.lookup();
        let cell = Polyhedron::of_box(shown.from, shown.to);
        askew.iter().fold(cell, |cell, (map, size)| cell.in_mapped_box(map, *size)).mapped(to_source)
    }
}

fn as_point(cell: [i64; 3]) -> DVec3 {
    DVec3::from(cell.map(|cell| cell as f64))
}

impl View {
    /// Writes the children of an INNER node as nodes of a source that derives from this view.
    /// Equivalent to [`Source::children`], without a second array for sources with their own node
    /// type.
    pub(in crate::ops) fn children_as<N>(
        &self,
        node: &ViewNode,
        children: &mut Children<N>,
        node_of: impl Fn(ViewNode) -> N,
    ) -> Result<()> {
        match (node, self.form.dimension) {
            (ViewNode::Same(node), _) => {
                self.source.children_as(node, children, |node| node_of(ViewNode::Same(node)))
            }
            (ViewNode::Around(around), Dimension::Quad) => {
                Classifier::<2>::new(self, around).children(children, node_of)
            }
            (ViewNode::Around(around), Dimension::Oct) => {
                Classifier::<3>::new(self, around).children(children, node_of)
            }
        }
    }
}

impl Source for View {
    type Node = ViewNode;

    fn form(&self) -> TreeType {
        self.form
    }

    fn depth(&self) -> u8 {
        View::depth(self)
    }

    fn root(&self) -> Result<Child<ViewNode>> {
        let mut nodes = no_children();
        nodes[0] = self.source.root()?;
        let code = Code::root(self.form.dimension);
        let around = Around { code, size: self.source.depth(), corner: [0; 3], nodes };
        match self.form.dimension {
            Dimension::Quad => Classifier::<2>::new(self, &around).classify(code),
            Dimension::Oct => Classifier::<3>::new(self, &around).classify(code),
        }
    }

    fn children(&self, node: &ViewNode, children: &mut Children<ViewNode>) -> Result<()> {
        self.children_as(node, children, |node| node)
    }

    fn cells(&self, node: &ViewNode, levels: u8) -> Result<Option<CellBlock>> {
        match node {
            ViewNode::Same(node) => self.source.cells(node, levels),
            ViewNode::Around(around) => self.draw_block(around.code(), levels),
        }
    }

    fn check_unchanged(&self) -> Result<()> {
        self.source.check_unchanged()
    }

    fn tally(&self, node: &ViewNode) -> Result<Option<ZoneStats>> {
        match node {
            ViewNode::Same(node) => self.source.tally(node),
            ViewNode::Around(_) => Ok(None),
        }
    }
}

impl ReusableSource for View {
    fn stored(&self, node: &ViewNode) -> Option<StoredNode<'_>> {
        match node {
            ViewNode::Same(node) => self.source.stored(node),
            ViewNode::Around(_) => None,
        }
    }

    fn kept(&self, node: &ViewNode) -> Option<RecordRef> {
        match node {
            ViewNode::Same(node) => self.source.kept(node),
            ViewNode::Around(_) => None,
        }
    }
}
