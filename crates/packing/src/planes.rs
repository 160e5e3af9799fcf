//! Numbers of dense blocks, coded level by level and plane by plane into the streams of a segment.

use crate::contexts::{Contexts, FlatContexts, MAX_PLANE_CONTEXTS};
use crate::defaults;
use crate::fit::fit;
use crate::grids::{Grid, Shape};
use crate::lanes::Lane;
use crate::plane_form::{
    MAX_FEATURES, MAX_FRACTION, MIN_FRACTION, Predictor, WEIGHT_BITS, Weights, default_weights, planes,
};
use crate::predict::Level;
use crate::symbols::{HeaderReader, HeaderWriter, Planes, SymbolReader, SymbolWriter};
use crate::tables::{Entry, STATES, Tables, choose, read, write_entries};
use spinney_container::MAX_DENSE_LEVELS;

/// VOID children of a group's nodes: for each level above the bottom and each node of its rows, a
/// bit per child. All bits of the columns between blocks are set.
pub(crate) type VoidChildren = Vec<Vec<u8>>;

/// Properties of all levels of a channel.
#[derive(Clone, Copy)]
pub(crate) struct ChannelForm {
    pub(crate) axes: usize,
    /// Whether representatives are means. The differences of siblings from their parent then add up
    /// to nearly 0.
    pub(crate) has_sums: bool,
    /// Mantissa bits, if numbers are the bit patterns of floating samples. Where the bits above the
    /// mantissa differ, the differences of siblings may add up to anything.
    pub(crate) mantissa: Option<u32>,
}

/// Header bits of a level's step: the number of lowest bits that are 0 in all its numbers.
const STEP_BITS: u32 = 6;
/// Offset of stored weights: this value means 0.
const WEIGHT_ZERO: i8 = 32;

/// Reused buffers of a thread.
#[derive(Default)]
pub(crate) struct Scratch<T> {
    level: Level<T>,
    entries: Vec<Entry>,
    /// Whether the entries of a context differ from the default ones.
    is_own: Vec<bool>,
    meanings: Vec<u16>,
    numbers: Vec<T>,
    /// Contexts of the nodes of a plane that are not VOID.
    contexts: Vec<u8>,
    /// Contiguous ranges of the coded nodes of a plane.
    ranges: Vec<(usize, usize)>,
    parents: Grid<T>,
    children: Grid<T>,
    /// Unused grids and planes of a writer.
    grids: Vec<Grid<T>>,
    planes: Vec<Planes<T>>,
}

impl<T: Lane> Scratch<T> {
    /// Returns a grid whose numbers are unspecified.
    pub(crate) fn grid(&mut self, shape: Shape) -> Grid<T> {
        let mut grid = self.grids.pop().unwrap_or_default();
        grid.reset(shape);
        grid
    }

    /// Takes grids back for reuse, at most as many as a group has levels.
    pub(crate) fn put_back(&mut self, grids: Vec<Grid<T>>) {
        self.grids.extend(grids);
        self.grids.truncate(usize::from(MAX_DENSE_LEVELS) + 1);
    }
}

impl<T: Lane> Level<T> {
    /// Predicts a plane of a level whose numbers are multiples of `2^step`. `void` has the VOID
    /// children of each parent as bits.
    fn prepare(
        &mut self,
        (number, step): (usize, u32),
        form: ChannelForm,
        weights: &Weights,
        parents: &Grid<T>,
        void: Option<&[u8]>,
    ) -> FlatContexts {
        let is_sum = form.has_sums && number + 1 == planes(form.axes).len();
        let (width, nodes) = (self.shape.width(), self.shape.nodes());
        let not_summed = if is_sum { self.not_summed(form, parents, void) } else { None };
        if step > 0 {
            self.predict(number, weights, false);
            for (index, row) in parents.shape.rows().enumerate() {
                let row = parents.row(row, [0; 3]).iter().zip(index * width..);
                for (own, at) in row {
                    let first = Contexts::<T>::residual(number == 0, 0);
                    if is_sum && !not_summed.as_ref().is_some_and(|not_summed| not_summed[at]) {
                        // (In units of the step, making the sum 0 is nearly always exact: hence the
                        // context of the smallest size.)
                        self.expected[at] = nearest(own.minus(self.others[at]), step).minus(*own);
                        self.contexts[at] = first;
                    } else {
                        self.expected[at] = nearest(own.plus(self.expected[at]), step).minus(*own);
                        let size = (self.contexts[at] - first).saturating_sub(step as u8);
                        self.contexts[at] = first + size;
                    }
                }
            }
            return Contexts::<T>::flat(number == 0, false);
        }
        if let Some(not_summed) = not_summed {
            self.predict(number, weights, false);
            let (expected, contexts) = (self.expected[..nodes].to_vec(), self.contexts[..nodes].to_vec());
            self.predict(number, weights, true);
            let own = self.expected.iter_mut().zip(&mut self.contexts);
            for ((own, not_summed), other) in own.zip(not_summed).zip(expected.iter().zip(&contexts)) {
                (*own.0, *own.1) = if not_summed { (*other.0, *other.1) } else { (*own.0, *own.1) };
            }
        } else {
            self.predict(number, weights, is_sum);
        }
        Contexts::<T>::flat(number == 0, is_sum)
    }

    /// Returns for each parent whether the differences of its children may add up to anything, as
    /// far as the planes before the last one show. Returns `None` if the sums of all parents are
    /// nearly 0.
    fn not_summed(&self, form: ChannelForm, parents: &Grid<T>, void: Option<&[u8]>) -> Option<Vec<bool>> {
        // (Where a child is VOID, the mean says less about the others.)
        let is_void = void.map(|void| void.iter().map(|void| *void != 0).collect());
        let Some(mantissa) = form.mantissa else { return is_void };
        let planes = planes(form.axes);
        let width = self.shape.width();
        let mut unlike = vec![T::default(); self.shape.nodes()];
        for (index, row) in parents.shape.rows().enumerate() {
            let (parents, nodes) = (parents.row(row, [0; 3]), index * width..(index + 1) * width);
            for plane in &planes[..planes.len() - 1] {
                let all = unlike[nodes.clone()].iter_mut().zip(&self.changes[plane.child][nodes.clone()]);
                for ((unlike, change), parent) in all.zip(parents) {
                    *unlike = unlike.or(parent.plus(*change).xor(*parent));
                }
            }
        }
        let mut not_summed = is_void.unwrap_or_else(|| vec![false; unlike.len()]);
        let all = not_summed.iter_mut().zip(unlike);
        all.for_each(|(not_summed, unlike)| *not_summed |= unlike.right(mantissa) != T::default());
        Some(not_summed)
    }
}

/// Returns the multiple of `2^step` that is nearest to a number.
#[inline(always)]
fn nearest<T: Lane>(number: T, step: u32) -> T {
    let half = T::from_i64(1 << (step - 1));
    number.plus(half).right(step).left(step)
}

/// Numbers of a channel of some dense blocks side by side, from their roots down, and their VOID
/// nodes. VOID nodes have the numbers of their parents. The columns between blocks are VOID.
pub(crate) struct GroupNumbers<'v, T> {
    pub(crate) grids: Vec<Grid<T>>,
    pub(crate) void: Option<&'v VoidChildren>,
}

/// Fills in the contiguous ranges of the coded nodes of a plane, in their order: start and length.
/// `void` has the VOID children of each node, and the child of the plane.
fn coded_ranges(shape: Shape, void: Option<(&[u8], usize)>, ranges: &mut Vec<(usize, usize)>) {
    ranges.clear();
    match void {
        None if shape.count == 1 => ranges.push((0, shape.nodes())),
        None => {
            for row in (0..shape.nodes()).step_by(shape.width()) {
                let blocks = (0..shape.count).map(|block| (row + block * (shape.side + 2), shape.side));
                ranges.extend(blocks);
            }
        }
        Some((void, child)) => {
            let is_void = |void: &u8| *void >> child & 1 == 1;
            let mut at = 0;
            for run in void.chunk_by(|one, other| is_void(one) == is_void(other)) {
                if !is_void(&run[0]) {
                    ranges.push((at, run.len()));
                }
                at += run.len();
            }
        }
    }
}

/// Channel whose states are still to be written.
pub(crate) struct PendingChannel<T> {
    planes: Planes<T>,
    tables: Tables,
}

/// States of a [`PendingChannel`] of lanes of any width.
pub(crate) trait PendingStates {
    /// Writes the states of the channel.
    fn states(self: Box<Self>, writer: &mut SymbolWriter);
}

impl<T: Lane> PendingStates for PendingChannel<T> {
    fn states(mut self: Box<Self>, writer: &mut SymbolWriter) {
        writer.states(&self.planes, &self.tables);
        self.planes.clear();
        T::with_scratch(|scratch| scratch.planes.push(self.planes));
    }
}

/// Writes a channel of some groups of blocks: predictor, steps and tables to the header, and raw
/// bits to the writer. The states are left to the returned channel.
pub(crate) fn encode<T: Lane>(
    scratch: &mut Scratch<T>,
    header: &mut HeaderWriter,
    writer: &mut SymbolWriter,
    form: ChannelForm,
    groups: &[GroupNumbers<'_, T>],
) -> PendingChannel<T> {
    let Scratch { level, ranges, planes: unused, .. } = scratch;
    let predictor = fit(level, groups.iter().map(|group| &group.grids[..]), form.axes);
    write_predictor(header, form.axes, &predictor);
    let mut all = unused.pop().unwrap_or_default();
    for group in groups {
        for (above, pair) in group.grids.windows(2).enumerate() {
            let (parents, children) = (&pair[0], &pair[1]);
            let void = group.void.map(|void| &void[above][..]);
            level.begin(predictor.fraction, parents);
            level.take(parents, children);
            let step = step_of(level, form.axes, parents, void);
            header.put(u64::from(step > 0), 1);
            if step > 0 {
                header.put(step.into(), STEP_BITS);
            }
            for (number, plane) in planes(form.axes).iter().enumerate() {
                let flat = level.prepare((number, step), form, &predictor.weights, parents, void);
                let (changes, expected) = (&level.changes[plane.child], &level.expected);
                coded_ranges(parents.shape, void.map(|void| (void, plane.child)), ranges);
                for &(at, count) in &*ranges {
                    let residuals = changes[at..at + count].iter().zip(&expected[at..at + count]);
                    let residuals =
                        residuals.map(|(change, expected)| change.minus(*expected).right(step).fold());
                    all.push(&level.contexts[at..at + count], residuals);
                }
                all.end(flat);
                level.finish(number);
            }
        }
    }
    let histograms = all.count();
    let tables = choose::<T>(&histograms, header);
    writer.raw(&mut all, &tables);
    PendingChannel { planes: all, tables }
}

/// Returns how many of the lowest bits are 0 in the numbers of all children that are not VOID.
fn step_of<T: Lane>(level: &Level<T>, axes: usize, parents: &Grid<T>, void: Option<&[u8]>) -> u32 {
    let (mut all, shape) = (T::default(), parents.shape);
    for (index, row) in shape.rows().enumerate() {
        let nodes = (index * shape.width()..).zip(parents.row(row, [0; 3]));
        for (at, parent) in
            nodes.enumerate().filter(|(x, _)| x % (shape.side + 2) < shape.side).map(|(_, node)| node)
        {
            for child in (0..1 << axes).filter(|child| void.is_none_or(|void| void[at] >> child & 1 == 0)) {
                all = all.or(parent.plus(level.changes[child][at]));
            }
        }
        if all.bits() & 1 == 1 {
            return 0;
        }
    }
    if all == T::default() { 0 } else { all.bits().trailing_zeros() }
}

fn write_predictor(header: &mut HeaderWriter, axes: usize, predictor: &Predictor) {
    header.put((predictor.fraction - MIN_FRACTION).into(), 3);
    let is_own = predictor.weights != default_weights(axes);
    header.put(is_own.into(), 1);
    if is_own {
        for (plane, weights) in planes(axes).iter().zip(&predictor.weights) {
            weights[..plane.features(axes)]
                .iter()
                .for_each(|weight| header.put((weight + WEIGHT_ZERO) as u64, WEIGHT_BITS));
        }
    }
}

fn read_predictor(header: &mut HeaderReader<'_>, axes: usize) -> Predictor {
    let fraction = (header.take(3) as u32 + MIN_FRACTION).min(MAX_FRACTION);
    let mut weights = default_weights(axes);
    if header.take(1) == 1 {
        for (plane, weights) in planes(axes).iter().zip(&mut weights) {
            *weights = [0; MAX_FEATURES];
            weights[..plane.features(axes)]
                .iter_mut()
                .for_each(|weight| *weight = header.take(WEIGHT_BITS) as i8 - WEIGHT_ZERO);
        }
    }
    Predictor { fraction, weights }
}

/// Channel of a group of blocks to be read: numbers of the roots, levels, and VOID nodes.
pub(crate) struct GroupShape<'v, T> {
    pub(crate) roots: Vec<T>,
    pub(crate) levels: u8,
    pub(crate) void: Option<&'v VoidChildren>,
}

impl<T: Lane> GroupShape<'_, T> {
    /// Fills a grid with the roots.
    pub(crate) fn top(&self, axes: usize, top: &mut Grid<T>) {
        let shape = Shape { side: 1, axes, count: self.roots.len() };
        top.reset(shape);
        let row = shape.blocks_mut(top.row_mut([0, 0])).zip(&self.roots);
        row.for_each(|(to, root)| to[0] = *root);
        top.pad();
    }
}

/// Reads a channel of some groups of blocks. Calls `each` with the index of the group and each
/// level, from that of the roots' children down, with its numbers.
pub(crate) fn decode<T: Lane>(
    scratch: &mut Scratch<T>,
    header: &mut HeaderReader<'_>,
    reader: &mut SymbolReader<'_>,
    form: ChannelForm,
    groups: &[GroupShape<'_, T>],
    mut each: impl FnMut(usize, u8, &Grid<T>),
) {
    let predictor = read_predictor(header, form.axes);
    let steps: Vec<u32> = groups
        .iter()
        .flat_map(|group| 0..group.levels)
        .map(|_| if header.take(1) == 1 { (header.take(STEP_BITS) as u32).min(T::BITS - 1) } else { 0 })
        .collect();
    scratch.read_tables(header);
    let mut steps = steps.into_iter();
    let (mut parents, mut children) =
        (std::mem::take(&mut scratch.parents), std::mem::take(&mut scratch.children));
    for (number, group) in groups.iter().enumerate() {
        group.top(form.axes, &mut parents);
        for above in 0..group.levels {
            let void = group.void.map(|void| &void[usize::from(above)][..]);
            let step = steps.next().unwrap_or(0);
            scratch.level(reader, form, &predictor, (step, void), &parents);
            scratch.level.children(&parents, &mut children);
            std::mem::swap(&mut parents, &mut children);
            each(number, above + 1, &parents);
        }
    }
    (scratch.parents, scratch.children) = (parents, children);
}

impl<T: Lane> Scratch<T> {
    /// Reads the tables, and builds their entries.
    fn read_tables(&mut self, header: &mut HeaderReader<'_>) {
        let default = defaults::entries::<T>();
        if self.entries.is_empty() {
            self.entries = vec![0; MAX_PLANE_CONTEXTS * STATES];
            self.entries[..default.len()].copy_from_slice(default);
            self.is_own = vec![false; Contexts::<T>::COUNT];
        }
        let tables = read::<T>(header);
        let entries = self.entries.chunks_exact_mut(STATES).zip(default.chunks_exact(STATES));
        for (context, ((entries, default), table)) in entries.zip(tables).enumerate() {
            match table {
                Some(table) => write_entries::<T>(&table, context, entries),
                None if self.is_own[context] => entries.copy_from_slice(default),
                None => {}
            }
            self.is_own[context] = table.is_some();
        }
    }

    /// Reads a level.
    fn level(
        &mut self,
        reader: &mut SymbolReader<'_>,
        form: ChannelForm,
        predictor: &Predictor,
        (step, void): (u32, Option<&[u8]>),
        parents: &Grid<T>,
    ) {
        let Scratch { level, entries, meanings, numbers, contexts, ranges, .. } = self;
        let Ok(entries) = <&[Entry; MAX_PLANE_CONTEXTS * STATES]>::try_from(&entries[..]) else { return };
        level.begin(predictor.fraction, parents);
        let shape = parents.shape;
        let nodes = shape.nodes();
        meanings.resize(nodes.max(meanings.len()), 0);
        numbers.resize(nodes.max(numbers.len()), T::default());
        for (number, plane) in planes(form.axes).iter().enumerate() {
            let flat = level.prepare((number, step), form, &predictor.weights, parents, void);
            coded_ranges(shape, void.map(|void| (void, plane.child)), ranges);
            let coded = if void.is_none() && shape.count == 1 {
                &level.contexts[..nodes]
            } else {
                contexts.clear();
                for &(at, count) in &*ranges {
                    contexts.extend_from_slice(&level.contexts[at..at + count]);
                }
                &contexts[..]
            };
            let count = coded.len();
            reader.meanings(entries, flat, coded, &mut meanings[..count]);
            reader.numbers(&meanings[..count], &mut numbers[..count]);
            let (changes, expected) = (&mut level.changes[plane.child][..nodes], &level.expected[..nodes]);
            if void.is_some() {
                changes.fill(T::default());
            }
            let mut rest = &numbers[..count];
            for &(at, count) in &*ranges {
                let (own, others) = rest.split_at(count);
                rest = others;
                correct((&expected[at..at + count], own, step), &mut changes[at..at + count]);
            }
            level.finish(number);
        }
    }
}

/// Computes differences from parents: expected differences plus residuals, which are folded and in
/// units of `2^step`.
#[inline(never)]
fn correct<T: Lane>((expected, residuals, step): (&[T], &[T], u32), changes: &mut [T]) {
    for ((change, residual), expected) in changes.iter_mut().zip(residuals).zip(expected) {
        *change = expected.plus(residual.unfold().left(step));
    }
}
