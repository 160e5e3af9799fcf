//! Dense blocks of numbers: each level plane by plane, by the streams of a segment.

use crate::contexts::{Contexts, FlatContexts, MAX_CONTEXTS};
use crate::defaults;
use crate::fit::fit;
use crate::grids::Grid;
use crate::lanes::Lane;
use crate::plane_form::{
    MAX_FEATURES, MAX_FRACTION, MIN_FRACTION, Predictor, Weights, default_weights, planes,
};
use crate::predict::Level;
use crate::symbols::{HeaderReader, HeaderWriter, Planes, SymbolReader, SymbolWriter};
use crate::tables::{Entry, STATES, Tables, choose, read, write_entries};

/// The nodes of a dense block that are VOID, of each level above the bottom: a bit for each child.
pub(crate) type VoidChildren = Vec<Vec<u8>>;

/// Form of all levels of a channel.
#[derive(Clone, Copy)]
pub(crate) struct ChannelForm {
    pub(crate) axes: usize,
    /// Whether representatives are means, so that the differences of siblings from their parent add up to nearly 0.
    pub(crate) has_sums: bool,
    /// Of numbers that are the bits of floating samples, how many of these are the mantissa: differences of others add up to anything.
    pub(crate) mantissa: Option<u32>,
}

/// Bits of the number of lowest bits that are 0 in a level.
const STEP_BITS: u32 = 6;
/// Bits of a weight, which is at least -32.
const WEIGHT_BITS: u32 = 6;
const WEIGHT_ZERO: i8 = 32;

/// Reused memory of a thread.
#[derive(Default)]
pub(crate) struct Scratch<T> {
    level: Level<T>,
    entries: Vec<Entry>,
    /// Contexts whose entries are not the default ones.
    is_own: Vec<bool>,
    tokens: Vec<u16>,
    numbers: Vec<T>,
    /// Contexts and numbers of the nodes of a plane that are not VOID.
    contexts: Vec<u8>,
    parents: Grid<T>,
    children: Grid<T>,
}

impl<T: Lane> Level<T> {
    /// Predicts a plane of a level whose numbers are multiples of `2^step`, and whose VOID children are those of bits.
    fn prepare(
        &mut self,
        (number, step): (usize, u32),
        form: ChannelForm,
        weights: &Weights,
        parents: &Grid<T>,
        void: Option<&[u8]>,
    ) -> FlatContexts {
        let is_sum = form.has_sums && number + 1 == planes(form.axes).len();
        let nodes = self.side.pow(form.axes as u32);
        let not_summed = if is_sum { self.not_summed(form, parents, void) } else { None };
        if step > 0 {
            self.predict(number, weights, false);
            for (index, row) in parents.rows().enumerate() {
                let row = parents.row(row, [0; 3]).iter().zip(index * self.side..);
                for (own, at) in row {
                    let error = Contexts::<T>::error(number == 0, 0);
                    if is_sum && !not_summed.as_ref().is_some_and(|not_summed| not_summed[at]) {
                        // (In steps there is little but what makes the sum 0.)
                        self.expected[at] = nearest(own.minus(self.others[at]), step).minus(*own);
                        self.contexts[at] = error;
                    } else {
                        self.expected[at] = nearest(own.plus(self.expected[at]), step).minus(*own);
                        let size = (self.contexts[at] - error).saturating_sub(step as u8);
                        self.contexts[at] = error + size;
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

    /// Of each parent whether the differences of its children may add up to anything, as far as is known before the last plane; `None` if
    /// those of all add up to nearly 0.
    fn not_summed(&self, form: ChannelForm, parents: &Grid<T>, void: Option<&[u8]>) -> Option<Vec<bool>> {
        // (Where a child is VOID, a mean says less of the others.)
        let is_void = void.map(|void| void.iter().map(|void| *void != 0).collect());
        let Some(mantissa) = form.mantissa else { return is_void };
        let planes = planes(form.axes);
        let mut unlike = vec![T::default(); self.side.pow(form.axes as u32)];
        for (index, row) in parents.rows().enumerate() {
            let (parents, nodes) = (parents.row(row, [0; 3]), index * self.side..(index + 1) * self.side);
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

/// The multiple of a power of two that is nearest to a number.
#[inline(always)]
fn nearest<T: Lane>(number: T, step: u32) -> T {
    let half = T::from_i64(1 << (step - 1));
    number.plus(half).right(step).left(step)
}

/// The numbers of a dense block's channel, from its root down, and its VOID nodes. VOID nodes have the numbers of their parents.
pub(crate) struct BlockNumbers<'v, T> {
    pub(crate) grids: Vec<Grid<T>>,
    pub(crate) void: Option<&'v VoidChildren>,
}

/// A channel whose states are to be written.
pub(crate) struct PendingChannel<T> {
    planes: Planes<T>,
    tables: Tables,
}

/// A channel of any lanes.
pub(crate) trait Pending {
    /// Writes the states.
    fn states(&self, writer: &mut SymbolWriter);
}

impl<T: Lane> Pending for PendingChannel<T> {
    fn states(&self, writer: &mut SymbolWriter) {
        writer.states(&self.planes, &self.tables);
    }
}

/// Writes the channel of some blocks: predictor, steps and tables to the header, raw bits to the writer.
pub(crate) fn encode<T: Lane>(
    header: &mut HeaderWriter,
    writer: &mut SymbolWriter,
    form: ChannelForm,
    blocks: &[BlockNumbers<'_, T>],
) -> PendingChannel<T> {
    let mut level = Level::default();
    let predictor = fit(&mut level, blocks.iter().map(|block| &block.grids[..]), form.axes);
    write_predictor(header, form.axes, &predictor);
    let mut all = Planes::default();
    let (mut contexts, mut numbers) = (Vec::new(), Vec::new());
    for block in blocks {
        for (above, pair) in block.grids.windows(2).enumerate() {
            let (parents, children) = (&pair[0], &pair[1]);
            let void = block.void.map(|void| &void[above][..]);
            level.begin(predictor.fraction, parents);
            level.take(parents, children);
            let step = step_of(&level, form.axes, parents, void);
            header.put(u64::from(step > 0), 1);
            if step > 0 {
                header.put(step.into(), STEP_BITS);
            }
            for (number, plane) in planes(form.axes).iter().enumerate() {
                let flat = level.prepare((number, step), form, &predictor.weights, parents, void);
                let nodes = parents.side.pow(form.axes as u32);
                let changes = level.changes[plane.child][..nodes].iter();
                let errors = changes.zip(&level.expected[..nodes]);
                let errors = errors.map(|(change, expected)| change.minus(*expected).right(step).fold());
                match void {
                    None => {
                        numbers.clear();
                        numbers.extend(errors);
                        all.push(flat, &level.contexts[..nodes], &numbers);
                    }
                    Some(void) => {
                        contexts.clear();
                        numbers.clear();
                        for ((error, context), void) in errors.zip(&level.contexts).zip(void) {
                            if void >> plane.child & 1 == 0 {
                                contexts.push(*context);
                                numbers.push(error);
                            }
                        }
                        all.push(flat, &contexts, &numbers);
                    }
                }
                level.finish(number);
            }
        }
    }
    let histograms = all.count();
    let tables = choose::<T>(&histograms, header);
    writer.raw(&mut all, &tables);
    PendingChannel { planes: all, tables }
}

/// How many of the lowest bits are 0 in the numbers of all children that are not VOID.
fn step_of<T: Lane>(level: &Level<T>, axes: usize, parents: &Grid<T>, void: Option<&[u8]>) -> u32 {
    let mut all = T::default();
    for (index, row) in parents.rows().enumerate() {
        for (at, parent) in (index * level.side..).zip(parents.row(row, [0; 3])) {
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

/// A channel of a block that is read: its root, its levels, and its VOID nodes.
pub(crate) struct BlockShape<'v, T> {
    pub(crate) root: T,
    pub(crate) levels: u8,
    pub(crate) void: Option<&'v VoidChildren>,
}

/// Reads the channel of some blocks: calls with the block's number, each level from that of the root's children down, and its numbers.
pub(crate) fn decode<T: Lane>(
    scratch: &mut Scratch<T>,
    header: &mut HeaderReader<'_>,
    reader: &mut SymbolReader<'_>,
    form: ChannelForm,
    blocks: &[BlockShape<'_, T>],
    mut each: impl FnMut(usize, u8, &Grid<T>),
) {
    let predictor = read_predictor(header, form.axes);
    let steps: Vec<u32> = blocks
        .iter()
        .flat_map(|block| 0..block.levels)
        .map(|_| if header.take(1) == 1 { (header.take(STEP_BITS) as u32).min(T::BITS - 1) } else { 0 })
        .collect();
    scratch.read_tables(header);
    let mut steps = steps.into_iter();
    let (mut parents, mut children) =
        (std::mem::take(&mut scratch.parents), std::mem::take(&mut scratch.children));
    for (number, block) in blocks.iter().enumerate() {
        parents.reset(1, form.axes);
        parents.row_mut([0, 0])[0] = block.root;
        parents.pad();
        for above in 0..block.levels {
            let void = block.void.map(|void| &void[usize::from(above)][..]);
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
    /// Reads tables, and makes entries of them.
    fn read_tables(&mut self, header: &mut HeaderReader<'_>) {
        let default = defaults::entries::<T>();
        if self.entries.is_empty() {
            self.entries = vec![0; MAX_CONTEXTS * STATES];
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
        let Scratch { level, entries, tokens, numbers, contexts, .. } = self;
        let Ok(entries) = <&[Entry; MAX_CONTEXTS * STATES]>::try_from(&entries[..]) else { return };
        level.begin(predictor.fraction, parents);
        let nodes = parents.side.pow(form.axes as u32);
        tokens.resize(nodes.max(tokens.len()), 0);
        numbers.resize(nodes.max(numbers.len()), T::default());
        for (number, plane) in planes(form.axes).iter().enumerate() {
            let flat = level.prepare((number, step), form, &predictor.weights, parents, void);
            let is_coded = |void: &u8| void >> plane.child & 1 == 0;
            let coded = match void {
                None => &level.contexts[..nodes],
                Some(void) => {
                    contexts.clear();
                    let all = level.contexts.iter().zip(void);
                    contexts.extend(all.filter(|(_, void)| is_coded(void)).map(|(context, _)| *context));
                    &contexts[..]
                }
            };
            let count = coded.len();
            reader.tokens(entries, flat, coded, &mut tokens[..count]);
            reader.numbers(&tokens[..count], &mut numbers[..count]);
            let changes = &mut level.changes[plane.child][..nodes];
            let expected = &level.expected[..nodes];
            match void {
                None if step == 0 => correct(expected, &numbers[..nodes], changes),
                None => {
                    for ((change, number), expected) in changes.iter_mut().zip(&*numbers).zip(expected) {
                        *change = expected.plus(number.unfold().left(step));
                    }
                }
                Some(void) => {
                    changes.fill(T::default());
                    let all = changes.iter_mut().zip(expected).zip(void).filter(|(_, void)| is_coded(void));
                    for (((change, expected), _), number) in all.zip(&*numbers) {
                        *change = expected.plus(number.unfold().left(step));
                    }
                }
            }
            level.finish(number);
        }
    }
}

#[inline(never)]
fn correct<T: Lane>(expected: &[T], errors: &[T], changes: &mut [T]) {
    for ((change, error), expected) in changes.iter_mut().zip(errors).zip(expected) {
        *change = expected.plus(error.unfold());
    }
}
