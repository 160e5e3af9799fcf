//! Channels and levels of dense blocks of numbers. All dense blocks of a segment are coded
//! together, channel by channel.

use spinney_base::TreeType;
use spinney_base::value::{Rule, SampleType};
use spinney_container::RecordLayout;

use crate::grids::Grid;
use crate::groups::Group;
use crate::lanes::Lane;
use crate::nodes::Dense;
use crate::plain::write_dense_head;
use crate::planes::{ChannelForm, GroupNumbers, GroupShape, PendingStates, Scratch, decode, encode};
use crate::samples::{Numbering, is_narrow, read_float};
use crate::symbols::{HeaderReader, HeaderWriter, SymbolReader, SymbolWriter};

/// Returns the channels in coding order, and for each the channel that it is coded as the
/// difference from. Only samples of at most 16 bits are coded as differences.
pub(crate) fn channel_order(form: TreeType) -> &'static [(usize, Option<usize>)] {
    const PLAIN: [(usize, Option<usize>); 4] = [(0, None), (1, None), (2, None), (3, None)];
    // Red and blue are similar to green.
    const COLOURS: [(usize, Option<usize>); 4] = [(1, None), (0, Some(1)), (2, Some(1)), (3, None)];
    let channels = usize::from(form.value.channels);
    if channels >= 3 && is_narrow(form.value.sample) { &COLOURS[..channels] } else { &PLAIN[..channels] }
}

/// Numbers of a channel of a group of blocks, from the roots down.
type Levels<T> = Vec<Grid<T>>;

/// Dense block of numbers.
pub(crate) struct NumberBlock {
    /// Node that the block begins at.
    pub(crate) node: u32,
    pub(crate) dense: Dense,
    /// Value of that node, or zeros.
    pub(crate) root: [u8; 16],
    /// State bits of the bottom nodes; empty if the kind has none.
    pub(crate) mask: Vec<u8>,
    /// Offset of the block's first byte in the records.
    pub(crate) start: usize,
}

impl NumberBlock {
    /// Creates a block with the state bits in its bytes, or with zeros.
    pub(crate) fn new(layout: &RecordLayout, node: u32, dense: Dense, bytes: Option<&[u8]>) -> NumberBlock {
        let length =
            if dense.kind.has_mask() { layout.dimension.cells(dense.levels) as usize / 8 } else { 0 };
        let mask = match bytes {
            Some(bytes) => bytes[layout.dense_mask_at(dense.levels)..][..length].to_vec(),
            None => vec![0; length],
        };
        NumberBlock { node, dense, root: [0; 16], mask, start: 0 }
    }

    /// Sets the block's offset in the records, and writes its state bits there.
    pub(crate) fn begin(&mut self, layout: &RecordLayout, start: usize, bytes: &mut [u8]) {
        self.start = start;
        bytes[layout.dense_mask_at(self.dense.levels)..][..self.mask.len()].copy_from_slice(&self.mask);
    }

    /// Returns the records from the values of a level on.
    fn values<'r>(&self, layout: &RecordLayout, level: u8, records: &'r [u8]) -> &'r [u8] {
        &records[self.start + layout.dense_values_at(level)..]
    }
}

/// Copies the values of dense blocks between records. VOID nodes get zeros, and heads are written
/// as a reader writes them. Nothing is coded or decoded: it lets a writer compare all else with
/// what a reader will find.
pub(crate) fn copy_values(
    form: TreeType,
    (blocks, groups): (&[NumberBlock], &[Group]),
    from: &[u8],
    to: &mut [u8],
) {
    let layout = RecordLayout::new(form);
    for group in groups {
        for (at, block) in group.blocks.iter().map(|block| &blocks[*block]).enumerate() {
            for level in 1..=group.levels {
                let start = block.start + layout.dense_values_at(level);
                let values = start..start + layout.dimension.cells(level) as usize * layout.width;
                let to = &mut to[values.clone()];
                to.copy_from_slice(&from[values]);
                if let Some(void) = group.void(at, level) {
                    let values = to.chunks_exact_mut(layout.width).zip(void);
                    values.filter(|(_, void)| **void).for_each(|(value, _)| value.fill(0));
                }
            }
            write_dense_head(&layout, block.dense, &mut to[block.start..]);
        }
    }
}

/// Properties of all dense blocks of a segment.
#[derive(Clone, Copy)]
struct BlockForm {
    layout: RecordLayout,
    sample: SampleType,
    form: ChannelForm,
}

impl BlockForm {
    /// Returns the properties of a channel with a numbering.
    fn channel(&self, numbering: Numbering) -> ChannelForm {
        ChannelForm { mantissa: numbering.mantissa(), ..self.form }
    }

    fn new(form: TreeType, rule: Rule) -> BlockForm {
        let layout = RecordLayout::new(form);
        let form_of =
            ChannelForm { axes: layout.dimension.axes(), has_sums: rule == Rule::Mean, mantissa: None };
        BlockForm { layout, sample: form.value.sample, form: form_of }
    }
}

/// Packs the numbers of dense blocks in records. Returns a header and streams.
pub(crate) fn pack_blocks(
    form: TreeType,
    rule: Rule,
    (blocks, groups): (&[NumberBlock], &[Group]),
    records: &[u8],
) -> (Vec<u8>, Vec<u8>) {
    let common = BlockForm::new(form, rule);
    let (mut header, mut writer) = (HeaderWriter::default(), SymbolWriter::default());
    let mut channels: Vec<Box<dyn PendingStates>> = Vec::new();
    for &(channel, like) in channel_order(form) {
        let numbering = choose_numbering(&common, channel, (blocks, records), groups);
        numbering.write(&mut header);
        let sink = (&mut header, &mut writer);
        channels.push(match numbering.lanes {
            16 => pack_channel::<i16>(sink, &common, numbering, (channel, like), (blocks, groups, records)),
            32 => pack_channel::<i32>(sink, &common, numbering, (channel, like), (blocks, groups, records)),
            _ => pack_channel::<i64>(sink, &common, numbering, (channel, like), (blocks, groups, records)),
        });
    }
    channels.into_iter().rev().for_each(|channel| channel.states(&mut writer));
    (header.finish(), writer.finish())
}

fn pack_channel<T: Lane>(
    (header, writer): (&mut HeaderWriter, &mut SymbolWriter),
    common: &BlockForm,
    numbering: Numbering,
    (channel, like): (usize, Option<usize>),
    (blocks, groups, records): (&[NumberBlock], &[Group], &[u8]),
) -> Box<dyn PendingStates> {
    T::with_scratch(|scratch| {
        let taken = groups.iter().map(|group| GroupNumbers {
            grids: take_group(scratch, common, numbering, (channel, like), (blocks, group, records)),
            void: group.void_children.as_ref(),
        });
        let taken: Vec<GroupNumbers<'_, T>> = taken.collect();
        let pending = encode(scratch, header, writer, common.channel(numbering), &taken);
        taken.into_iter().for_each(|group| scratch.put_back(group.grids));
        Box::new(pending) as Box<dyn PendingStates>
    })
}

/// Reads the numbers of a channel of a group of blocks, or their differences from another channel,
/// from the roots down. VOID nodes have the numbers of their parents.
fn take_group<T: Lane>(
    scratch: &mut Scratch<T>,
    common: &BlockForm,
    numbering: Numbering,
    (channel, like): (usize, Option<usize>),
    (blocks, group, records): (&[NumberBlock], &Group, &[u8]),
) -> Levels<T> {
    let (layout, size) = (&common.layout, numbering.size());
    let number = |value: &[u8]| {
        let own = T::from_i64(numbering.read(&value[channel * size..]));
        like.map_or(own, |like| own.minus(T::from_i64(numbering.read(&value[like * size..]))))
    };
    let mut top = scratch.grid(group.shape(0));
    for (to, block) in group.shape(0).blocks_mut(top.row_mut([0, 0])).zip(&group.blocks) {
        to[0] = number(&blocks[*block].root);
    }
    top.pad();
    let mut grids = vec![top];
    for level in 1..=group.levels {
        let shape = group.shape(level);
        let (mut grid, above) = (scratch.grid(shape), &grids[grids.len() - 1]);
        let mut other = vec![T::default(); shape.side];
        for (index, [y, z]) in shape.rows().enumerate() {
            let parents = above.shape.blocks(above.row([y / 2, z / 2], [0; 3]));
            let all = shape.blocks_mut(grid.row_mut([y, z])).zip(parents).zip(&group.blocks);
            for (at, ((row, parents), block)) in all.enumerate() {
                let values = blocks[*block].values(layout, level, records);
                let values = &values[index * row.len() * layout.width..][..row.len() * layout.width];
                numbering.read_all(&values[channel * size..], layout.width, row);
                if let Some(like) = like {
                    numbering.read_all(&values[like * size..], layout.width, &mut other);
                    row.iter_mut().zip(&other).for_each(|(to, other)| *to = to.minus(*other));
                }
                if let Some(void) = group.void(at, level) {
                    let void = &void[index * row.len()..][..row.len()];
                    for (x, to) in row.iter_mut().enumerate().filter(|(x, _)| void[*x]) {
                        *to = parents[x / 2];
                    }
                }
            }
        }
        grid.pad();
        grids.push(grid);
    }
    grids
}

/// Chooses how the samples of a channel become integers.
fn choose_numbering(
    common: &BlockForm,
    channel: usize,
    (blocks, records): (&[NumberBlock], &[u8]),
    groups: &[Group],
) -> Numbering {
    let (layout, sample) = (&common.layout, common.sample);
    if !sample.is_float() {
        return Numbering::ordered(sample);
    }
    let number = |bytes: &[u8]| read_float(sample, &bytes[channel * sample.size()..]);
    let of_level = |group: usize, level: u8| {
        let group = &groups[group];
        let samples = group.blocks.iter().enumerate().flat_map(move |(at, block)| {
            let bytes = blocks[*block].values(layout, level, records).chunks_exact(layout.width);
            let void = group.void(at, level).unwrap_or_default();
            let samples = bytes.take(layout.dimension.cells(level) as usize).enumerate();
            samples.filter(|(at, _)| !void.get(*at).copied().unwrap_or_default())
        });
        samples.map(|(_, bytes)| number(bytes))
    };
    let all = || groups.iter().map(|group| group.levels).enumerate();
    let above = all().flat_map(|(at, levels)| (1..levels).flat_map(move |level| of_level(at, level)));
    let bottom = || all().flat_map(|(at, levels)| of_level(at, levels));
    let roots = blocks.iter().map(|block| number(&block.root));
    Numbering::choose(sample, above.chain(roots).chain(bottom()), bottom())
}

/// Reads the numbers of dense blocks into records. Returns `None` if the bytes are not those of
/// such blocks.
pub(crate) fn unpack_blocks(
    form: TreeType,
    rule: Rule,
    (blocks, records): (&[NumberBlock], &mut [u8]),
    (header, bytes): (&[u8], &[u8]),
) -> Option<()> {
    let common = BlockForm::new(form, rule);
    let groups = Group::all(&common.layout, blocks);
    let mut header = HeaderReader::new(header);
    let mut reader = SymbolReader::new(bytes)?;
    let mut kept = Vec::new();
    for &(channel, like) in channel_order(form) {
        let numbering = Numbering::read_from(common.sample, &mut header);
        let is_kept = like.is_none() && channel_order(form).iter().any(|(_, like)| *like == Some(channel));
        let source = (&mut header, &mut reader);
        let parts = (blocks, &groups[..], &mut records[..]);
        match numbering.lanes {
            16 => {
                let other = like.map(|_| &kept[..]);
                let own = unpack_channel::<i16>(source, &common, (numbering, channel), parts, other, is_kept);
                kept = if is_kept { own } else { kept };
            }
            // (Channels of wider samples are not coded as differences: see `channel_order`.)
            32 => _ = unpack_channel::<i32>(source, &common, (numbering, channel), parts, None, false),
            _ => _ = unpack_channel::<i64>(source, &common, (numbering, channel), parts, None, false),
        }
    }
    for block in blocks {
        write_dense_head(&common.layout, block.dense, &mut records[block.start..]);
    }
    (header.is_whole() && reader.is_whole()).then_some(())
}

/// Reads a channel into records. If `other` is given, the channel is stored as the difference from
/// it. Returns the channel's levels if `is_kept`.
fn unpack_channel<T: Lane>(
    (header, reader): (&mut HeaderReader<'_>, &mut SymbolReader<'_>),
    common: &BlockForm,
    (numbering, channel): (Numbering, usize),
    (blocks, groups, records): (&[NumberBlock], &[Group], &mut [u8]),
    other: Option<&[Levels<T>]>,
    is_kept: bool,
) -> Vec<Levels<T>> {
    let root =
        |block: &usize| T::from_i64(numbering.read(&blocks[*block].root[channel * numbering.size()..]));
    let (mut shapes, mut kept) = (Vec::with_capacity(groups.len()), Vec::new());
    for (at, group) in groups.iter().enumerate() {
        let mut roots: Vec<T> = group.blocks.iter().map(root).collect();
        if let Some(other) = other {
            let others = group.shape(0).blocks(other[at][0].row([0, 0], [0; 3]));
            roots.iter_mut().zip(others).for_each(|(root, other)| *root = root.minus(other[0]));
        }
        let shape = GroupShape { roots, levels: group.levels, void: group.void_children.as_ref() };
        if is_kept {
            let mut top = Grid::default();
            shape.top(common.form.axes, &mut top);
            kept.push(vec![top]);
        }
        shapes.push(shape);
    }
    T::with_scratch(|scratch| {
        decode(scratch, header, reader, common.channel(numbering), &shapes, |at, level, grid| {
            let (group, other) = (&groups[at], other.map(|other| &other[at][usize::from(level)]));
            let first = common.layout.dense_values_at(level) + channel * numbering.size();
            let starts: Vec<usize> = group.blocks.iter().map(|block| blocks[*block].start + first).collect();
            put_level((group, level), (grid, other), (numbering, common.layout.width), &starts, records);
            if is_kept {
                kept[at].push(grid.copy());
            }
        });
    });
    kept
}

/// Writes the numbers of a level to the records, for each block from its start on, with `width`
/// bytes from sample to sample. VOID nodes get zeros.
#[inline(never)]
fn put_level<T: Lane>(
    (group, level): (&Group, u8),
    (grid, other): (&Grid<T>, Option<&Grid<T>>),
    (numbering, width): (Numbering, usize),
    starts: &[usize],
    records: &mut [u8],
) {
    let shape = grid.shape;
    for (index, row) in shape.rows().enumerate() {
        let numbers = shape.blocks(grid.row(row, [0; 3]));
        let mut others = other.map(|other| shape.blocks(other.row(row, [0; 3])));
        for (at, (numbers, start)) in numbers.zip(starts).enumerate() {
            let bytes = &mut records[start + index * shape.side * width..];
            let numbers = numbers.iter();
            match others.as_mut().and_then(Iterator::next) {
                None => numbering.write_all(numbers.map(|number| number.to_i64()), bytes, width),
                Some(other) => {
                    let sums = numbers.zip(other).map(|(number, other)| number.plus(*other).to_i64());
                    numbering.write_all(sums, bytes, width);
                }
            }
            if let Some(void) = group.void(at, level) {
                let void = void[index * shape.side..][..shape.side].iter().zip(bytes.chunks_mut(width));
                void.filter(|(void, _)| **void).for_each(|(_, bytes)| bytes[..numbering.size()].fill(0));
            }
        }
    }
}
