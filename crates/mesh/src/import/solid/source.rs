//! Solid bounded by triangles, as a tree source. Space is divided until a node has no triangles, or
//! down to blocks of cells.
//!
//! ```text
//!     |<--------- block: 64 cells per axis ---------->|
//! min +-------+-------+-------+---         ---+-------+
//!     |   o   |   o   |   o   |               |   o   |
//!     +-------+-------+-------+---         ---+-------+
//!     |   o   |   o   |   o   |               |   o   |
//!     +-------+-------+-------+---         ---+-------+
//!     |<----->| cell: 2^fraction grid units, the fixed-point units of the snapped vertices
//!     |<->| half a cell, from a node's minimum corner to its first lattice point
//!
//! o  lattice point: the centre of a cell, where inside and outside are decided
//! ```
//!
//! The lattice has one point per cell. A region is a node above the blocks, with the winding state
//! at its first lattice point. Dividing a region follows seven lines from this point to the first
//! lattice points of its eight children ([`Lines`]). A block's winding numbers spread from its
//! first lattice point along z, y and x to all lattice points ([`windings`](super::windings)).

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use glam::DVec3;

use super::bits::{Bits, Cells, Content, Pyramid};
use super::fill;
use super::grid::Triangle;
use super::inside::{Attribute, FULL, FillOptions, Inside, State};
use super::octants::Octants;
use super::open;
use super::survey::{SolidSurvey, SurfaceAtPoint, SurveyedNode};
use super::triangles::{OctantSorter, Triangles};
use super::union::{Overlaps, SurfaceInBlock};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::sort;
use spinney_base::space::{Code, CodeRange, Dimension, EdgeRule};
use spinney_base::value::Value;
use spinney_brep::exact::lattice::Projected;
use spinney_brep::geometry::Stages;
use spinney_engine::store::builder::ReusableSource;
use spinney_engine::tree::{Child, Children, Source};

/// Counters of a traversal, shared by all threads.
#[derive(Debug, Default)]
pub(super) struct Counters {
    /// Cells without faces whose state is in doubt by the winding field of an open surface.
    pub(super) undecided: AtomicU64,
    /// Counts of the tests that decided whether triangles cut octants.
    pub(super) stages: Mutex<Stages>,
}

/// Surface with its own inside test. The solid is the union of what the surfaces enclose. Where
/// several enclose a cell, the first one defines its value.
pub(super) struct Surface {
    pub(super) inside: Inside,
    pub(super) triangles: Triangles,
}

impl Surface {
    pub(super) fn new(inside: Inside, triangles: Triangles) -> Surface {
        Surface { inside, triangles }
    }
}

/// Shard of a solid: the run whose triangles are available, and the survey of the whole surface.
pub(super) struct SurveyedShard {
    pub(super) run: CodeRange,
    pub(super) survey: SolidSurvey,
}

/// Solid, or its surface, with values derived from attributes.
pub(super) struct Solid<'a> {
    form: TreeType,
    pub(super) fill: FillOptions<'a>,
    /// Inside tests of the surfaces.
    tests: Vec<Inside>,
    /// Shard that is built; `None` for the whole solid.
    part: Option<SurveyedShard>,
    /// Maximum number of triangles that are loaded into memory at once.
    held: usize,
    root: UpperNode,
    /// Maps attributes to values.
    value: fn(u32) -> Value,
    pub(super) counters: Counters,
}

/// Node above the blocks.
#[derive(Clone, Debug)]
pub(super) struct UpperNode {
    level: u8,
    /// Position at its level.
    position: [u32; 3],
    /// Sheet of each surface that has one here, in the order of the surfaces.
    sheets: Vec<Sheet>,
}

impl UpperNode {
    /// Number of triangles of all surfaces.
    fn triangles(&self) -> usize {
        self.sheets.iter().map(|sheet| sheet.triangles.len()).sum()
    }

    fn code(&self) -> Code {
        Code::from_cell(Dimension::Oct, self.level, self.position).expect("regions are nodes")
    }
}

/// Fragment of a surface in a node.
#[derive(Clone, Debug)]
struct Sheet {
    /// Index of the surface.
    surface: usize,
    triangles: Triangles,
    /// State at the node's first lattice point.
    state: State,
}

/// Node of a solid.
#[derive(Clone)]
pub(super) enum Node {
    Region(Arc<UpperNode>),
    /// Node in a block of cells: `above` levels over the cells, at a position at that level.
    Cells {
        block: Arc<Pyramid>,
        above: u8,
        at: [u8; 3],
    },
}

impl std::fmt::Debug for Node {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Node::Region(region) => write!(f, "{} {:?}", region.level, region.position),
            Node::Cells { above, at, .. } => write!(f, "{above} above {at:?}"),
        }
    }
}

/// Levels of cells in a block.
const BLOCK: u8 = 6;

impl<'a> Solid<'a> {
    /// Solid of these surfaces. Up to `held` triangles are loaded into memory at once.
    pub(super) fn new(
        form: TreeType,
        fill: FillOptions<'a>,
        (surfaces, part): (Vec<Surface>, Option<SurveyedShard>),
        held: usize,
        value: fn(u32) -> Value,
    ) -> Result<Self> {
        let root = UpperNode { level: 0, position: [0; 3], sheets: Vec::new() };
        let (tests, counters) = (Vec::new(), Counters::default());
        let mut solid = Solid { form, fill, tests, part, held, root, value, counters };
        for (number, Surface { inside, triangles }) in surfaces.into_iter().enumerate() {
            let state = match inside {
                _ if solid.fill.shell => State::default(),
                _ if solid.part.is_some() => State::outside(&inside),
                Inside::Field(_) => State::default(),
                Inside::Winding | Inside::Parity => solid.outside_in(&triangles, State::outside(&inside))?,
            };
            solid.root.sheets.push(Sheet { surface: number, triangles, state });
            solid.tests.push(inside);
        }
        let mut root = solid.root.clone();
        solid.set_states(&mut root, false);
        solid.root = root;
        Ok(solid)
    }

    /// Sets the states of a region from the survey if the region's triangles are complete but its
    /// parent's are not.
    fn set_states(&self, region: &mut UpperNode, is_parent_whole: bool) {
        let Some(part) = self.part.as_ref().filter(|_| !is_parent_whole && !self.fill.shell) else { return };
        let code = region.code();
        if part.run.contains(code) {
            for sheet in &mut region.sheets {
                let outside = State::outside(&self.tests[sheet.surface]);
                sheet.state = part.survey.state(code, sheet.surface, outside);
            }
        }
    }

    /// Nodes at a level in the order of their codes, with the data that shards need. Nodes above
    /// the level without triangles replace their descendants.
    pub(super) fn nodes(&self, level: u8) -> Result<Vec<SurveyedNode>> {
        let (mut nodes, mut open) = (Vec::new(), vec![self.root.clone()]);
        while let Some(region) = open.pop() {
            let triangles = region.triangles() as u64;
            if region.level < level && triangles > 0 {
                open.extend(self.split(&region)?.into_iter().rev());
                continue;
            }
            let at_point = |sheet: &Sheet| {
                let (surface, State { winding, attribute, .. }) = (sheet.surface as u32, sheet.state);
                (winding != 0).then_some(SurfaceAtPoint { surface, winding, attribute })
            };
            let inside = region.sheets.iter().filter_map(at_point).collect();
            nodes.push(SurveyedNode { code: region.code(), triangles, inside });
        }
        Ok(nodes)
    }

    /// State at the root's first lattice point, coming along x from the outside.
    fn outside_in(&self, triangles: &Triangles, outside: State) -> Result<State> {
        let first = self.fill.lattice.first([0; 3]);
        let mut events = Events::default();
        triangles.each(|_, triangle| {
            self.fill.progress.check()?;
            if let Some(projected) = Projected::<0>::new(&triangle.corners)
                .filter(|projected| projected.is_met(first) && projected.is_beyond(first))
            {
                events.push(0, &projected, first, triangle.attribute);
            }
            Ok(())
        })?;
        let mut states = [outside; 8];
        events.apply(&mut states, |_| (0, 0));
        Ok(states[0])
    }

    /// Whether crossings decide what is inside a surface.
    fn is_crossed(&self, sheet: &Sheet) -> bool {
        !self.fill.shell && !matches!(self.tests[sheet.surface], Inside::Field(_))
    }

    /// Grid coordinates of a region's minimum corner, and its width.
    fn bounds(&self, region: &UpperNode) -> ([i32; 3], i32) {
        let width = self.fill.cell() << (self.fill.grid.depth - region.level);
        (region.position.map(|position| (i64::from(position) * i64::from(width)) as i32), width)
    }

    /// Whether a region is divided into regions, rather than filled as a block: if it is too large
    /// for a block, or has more triangles than fit into memory.
    fn is_split(&self, region: &UpperNode) -> bool {
        let height = self.fill.grid.depth - region.level;
        height > BLOCK || (height > 1 && region.triangles() > self.held)
    }

    /// Eight child regions of a region.
    fn split(&self, region: &UpperNode) -> Result<Vec<UpperNode>> {
        let child = |child: u32| UpperNode {
            level: region.level + 1,
            position: std::array::from_fn(|axis| 2 * region.position[axis] + (child >> axis & 1)),
            sheets: Vec::new(),
        };
        let mut regions: Vec<UpperNode> = (0..8).map(child).collect();
        let is_held = region.triangles() <= self.held;
        for sheet in &region.sheets {
            for (region, sheet) in regions.iter_mut().zip(self.split_sheet(region, sheet, is_held)?) {
                region.sheets.push(sheet);
            }
        }
        let is_whole = self.part.as_ref().is_none_or(|part| part.run.contains(region.code()));
        regions.iter_mut().for_each(|child| self.set_states(child, is_whole));
        Ok(regions)
    }

    /// Fragments of a surface in the eight children of a region. If `is_held`, the triangles are
    /// loaded into memory.
    fn split_sheet(&self, region: &UpperNode, sheet: &Sheet, is_held: bool) -> Result<Vec<Sheet>> {
        let triangles = if is_held { sheet.triangles.clone().held()? } else { sheet.triangles.clone() };
        let is_crossed = self.is_crossed(sheet);
        let (min, width) = self.bounds(region);
        let half = width / 2;
        let lines = Lines::new(self.fill.lattice.first(min), half);
        let mut events = Events::default();
        let mut sorter = OctantSorter::of(&triangles);
        let mut stages = Stages::default();
        triangles.each(|number, triangle| {
            self.fill.progress.check()?;
            if is_crossed {
                lines.meet(triangle, &mut events);
            }
            let octants = Octants::of(triangle, min, width);
            for child in 0..8 {
                let found = octants.test(child);
                stages.count(found);
                if found.cuts {
                    sorter.push(child, number, triangle)?;
                }
            }
            Ok(())
        })?;
        self.counters.stages.lock().expect("no thread panics while it has this lock").add(&stages);
        let mut states = [sheet.state; 8];
        events.apply(&mut states, Lines::leads);
        let of = |(child, triangles)| Sheet { triangles, state: states[child], ..*sheet };
        Ok(sorter.finish()?.into_iter().enumerate().map(of).collect())
    }

    /// Returns a region as a child: void, a leaf, or an inner node.
    fn child(&self, mut region: UpperNode) -> Result<Child<Node>> {
        if let Some(part) = &self.part
            && !part.run.contains(region.code())
        {
            // Incomplete triangles do not determine the state; the traversal continues to the nodes
            // of the run.
            return Ok(match part.run.touches(region.code()) {
                true => self.inner(Node::Region(Arc::new(region))),
                false => Child::Void,
            });
        }
        let mut sheets = Vec::new();
        for sheet in std::mem::take(&mut region.sheets) {
            match self.uniform(&region, &sheet)? {
                Some(None) => {}
                // Later surfaces cannot change it.
                Some(Some(attribute)) if sheets.is_empty() => return Ok(Child::Leaf(self.full(attribute))),
                Some(Some(_)) => {
                    sheets.push(sheet);
                    break;
                }
                None => sheets.push(sheet),
            }
        }
        if sheets.is_empty() {
            return Ok(Child::Void);
        }
        Ok(self.inner(Node::Region(Arc::new(UpperNode { sheets, ..region }))))
    }

    /// State of a region for a surface: `None` if it is mixed or in doubt, `Some(None)` if it is
    /// entirely outside, and the attribute if it is entirely inside.
    fn uniform(&self, region: &UpperNode, sheet: &Sheet) -> Result<Option<Option<u32>>> {
        let inside = &self.tests[sheet.surface];
        if !sheet.triangles.is_empty() {
            return Ok(None);
        }
        if self.fill.shell {
            return Ok(Some(None));
        }
        let Inside::Field(field) = inside else {
            return Ok(Some(inside.has(sheet.state.winding).then_some(sheet.state.attribute)));
        };
        let (min, width) = self.bounds(region);
        if field.is_outside_bounds(min, width) {
            return Ok(Some(None));
        }
        let value = field.uniform(min, width, self.fill.cell(), self.fill.progress)?;
        let middle = DVec3::from_array(min.map(f64::from)) + f64::from(width) / 2.0;
        let attribute = |value: f32| {
            if self.fill.attribute == Attribute::Occupancy { 0 } else { field.attribute(middle, value < 0.0) }
        };
        Ok(value.map(|value| (value.abs() >= 0.5).then(|| attribute(value))))
    }

    fn full(&self, attribute: u32) -> Value {
        (self.value)(if self.fill.attribute == Attribute::Occupancy { FULL } else { attribute })
    }

    /// Inner node. Its representative is a placeholder: the tree writer computes it from the
    /// children.
    fn inner(&self, node: Node) -> Child<Node> {
        Child::Inner { representative: self.full(0), node }
    }

    /// Fills the block of a region.
    fn block(&self, region: &UpperNode) -> Result<Pyramid> {
        let (min, _) = self.bounds(region);
        let height = self.fill.grid.depth - region.level;
        let join = |one: u32, other: u32| {
            if self.fill.edge == EdgeRule::Area { one.max(other) } else { one }
        };
        let is_covered = self.fill.edge == EdgeRule::Area && !self.fill.shell;
        let mut all: Option<Cells> = None;
        let (mut surfaces_in_block, mut overlaps) = (Vec::new(), Overlaps::default());
        for (number, sheet) in (0..).zip(&region.sheets) {
            let mut triangles: Vec<Triangle> = Vec::with_capacity(sheet.triangles.len());
            sheet.triangles.each(|_, triangle| {
                triangles.push(*triangle);
                Ok(())
            })?;
            let inside = &self.tests[sheet.surface];
            let cells = match inside {
                Inside::Field(field) if !self.fill.shell => {
                    let (cells, undecided) = open::block(&self.fill, field, &triangles, min, height)?;
                    self.counters.undecided.fetch_add(undecided, Ordering::Relaxed);
                    cells
                }
                inside => fill::block((&self.fill, inside), &triangles, min, height, sheet.state)?,
            };
            match &mut all {
                Some(all) => {
                    if is_covered {
                        overlaps.note(all, number, &cells);
                    }
                    all.add(&cells, join);
                }
                none => *none = Some(cells),
            }
            if is_covered && region.sheets.len() > 1 {
                surfaces_in_block.push(SurfaceInBlock { inside, triangles, state: sheet.state });
            }
        }
        if let Some(all) = all.as_mut().filter(|_| is_covered) {
            overlaps.settle(&self.fill, &surfaces_in_block, min, all)?;
        }
        Ok(Pyramid::new(all.unwrap_or_else(|| Cells { bits: Bits::new(height), values: None })))
    }

    fn in_block(&self, block: &Arc<Pyramid>, above: u8, at: [u8; 3]) -> Child<Node> {
        match block.node(above, at.map(usize::from)) {
            Content::Nothing => Child::Void,
            Content::Uniform(value) => Child::Leaf((self.value)(value.unwrap_or(FULL))),
            Content::Mixed => self.inner(Node::Cells { block: block.clone(), above, at }),
        }
    }
}

impl Source for Solid<'_> {
    type Node = Node;

    fn form(&self) -> TreeType {
        self.form
    }

    fn depth(&self) -> u8 {
        self.fill.grid.depth
    }

    fn root(&self) -> Result<Child<Node>> {
        self.child(self.root.clone())
    }

    fn children(&self, node: &Node, children: &mut Children<Node>) -> Result<()> {
        let (block, above, at) = match node {
            Node::Region(region) if self.is_split(region) => {
                for (child, region) in children.iter_mut().zip(self.split(region)?) {
                    *child = self.child(region)?;
                }
                return Ok(());
            }
            Node::Region(region) => {
                (&Arc::new(self.block(region)?), self.fill.grid.depth - region.level, [0; 3])
            }
            Node::Cells { block, above, at } => (block, *above, *at),
        };
        for (step, child) in (0..).zip(children) {
            let at = std::array::from_fn(|axis| 2 * at[axis] + (step >> axis & 1));
            *child = self.in_block(block, above - 1, at);
        }
        Ok(())
    }
}

impl ReusableSource for Solid<'_> {}

/// Lines between the first lattice points of a region's eight children: one along z, two along y,
/// four along x. Each leads to a child that differs from a known one along one axis only.
struct Lines {
    first: [i32; 3],
    half: i32,
}

impl Lines {
    fn new(first: [i32; 3], half: i32) -> Lines {
        Lines { first, half }
    }

    /// Children that a line leads from and to. The order of lines ensures that the start's state is
    /// known.
    fn leads(line: usize) -> (usize, usize) {
        [(0, 4), (0, 2), (4, 6), (0, 1), (2, 3), (4, 5), (6, 7)][line]
    }

    /// Adds the crossings of a triangle with the lines.
    #[inline]
    fn meet(&self, triangle: &Triangle, events: &mut Events) {
        let near = |axis: usize, up: bool| {
            let at = self.first[axis] + if up { self.half } else { 0 };
            triangle.min(axis) <= at && at <= triangle.max(axis)
        };
        let (y, z) = ([near(1, false), near(1, true)], [near(2, false), near(2, true)]);
        let x = near(0, false);
        if x && y[0] {
            self.meet_along::<2>(triangle, 0, [0, 0, 0], events);
        }
        for up in [0, 1] {
            if x && z[up] {
                self.meet_along::<1>(triangle, 1 + up, [0, 0, up], events);
            }
        }
        for line in 0..4 {
            if y[line & 1] && z[line >> 1] {
                self.meet_along::<0>(triangle, 3 + line, [0, line & 1, line >> 1], events);
            }
        }
    }

    fn meet_along<const D: usize>(
        &self,
        triangle: &Triangle,
        line: usize,
        from: [usize; 3],
        events: &mut Events,
    ) {
        let from: [i32; 3] = std::array::from_fn(|axis| self.first[axis] + from[axis] as i32 * self.half);
        let mut to = from;
        to[D] += self.half;
        let projected = Projected::<D>::new(&triangle.corners);
        if let Some(projected) = projected.filter(|projected| {
            projected.is_met(from) && !projected.is_beyond(from) && projected.is_beyond(to)
        }) {
            events.push(line, &projected, from, triangle.attribute);
        }
    }
}

/// Crossings of lines with triangles.
#[derive(Default)]
struct Events {
    /// Line, height on it, change of the winding number, attribute.
    passed: Vec<(usize, f64, i32, u32)>,
}

impl Events {
    fn push<const D: usize>(
        &mut self,
        line: usize,
        projected: &Projected<D>,
        from: [i32; 3],
        attribute: u32,
    ) {
        self.passed.push((line, projected.height_over(from), projected.change(), attribute));
    }

    /// Follows all lines in order: the state at a line's end follows from the state at its start.
    fn apply(mut self, states: &mut [State; 8], leads: impl Fn(usize) -> (usize, usize)) {
        // At equal heights, changes of -1 come first: touching bodies are left before the next one
        // is entered. The attribute makes the order independent of the triangles' order.
        sort::by(&mut self.passed, &mut |a, b| {
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)).then(a.3.cmp(&b.3))
        });
        let mut passed = self.passed.into_iter().peekable();
        for line in 0..7 {
            let (from, to) = leads(line);
            let mut state = states[from];
            while let Some((_, _, change, attribute)) = passed.next_if(|event| event.0 == line) {
                state.pass(change, attribute);
            }
            states[to] = state;
        }
    }
}
