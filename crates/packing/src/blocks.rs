//! Dense blocks of numbers: their channels and levels. Those of a segment are coded together, channel by channel.

use spinney_base::TreeType;
use spinney_base::value::{Rule, SampleType};
use spinney_container::{RecordLayout, VOID};

use crate::grids::Grid;
use crate::lanes::Lane;
use crate::nodes::Dense;
use crate::plain::write_dense_head;
use crate::planes::{BlockNumbers, BlockShape, ChannelForm, Pending, decode, encode};
use crate::samples::{Numbering, is_narrow, read_float};
use crate::symbols::{HeaderReader, HeaderWriter, SymbolReader, SymbolWriter};
use crate::void_nodes::VoidNodes;

/// The channels in the order in which they are coded, and of each the one that it is told from by difference.
pub(crate) fn channel_order(form: TreeType) -> &'static [(usize, Option<usize>)] {
    const PLAIN: [(usize, Option<usize>); 4] = [(0, None), (1, None), (2, None), (3, None)];
    // Red and blue are much like green.
    const COLOURS: [(usize, Option<usize>); 4] = [(1, None), (0, Some(1)), (2, Some(1)), (3, None)];
    let channels = usize::from(form.value.channels);
    if channels >= 3 && is_narrow(form.value.sample) { &COLOURS[..channels] } else { &PLAIN[..channels] }
}

/// The numbers of a channel of a block, from its root down.
type Levels<T> = Vec<Grid<T>>;

/// A dense block of numbers.
pub(crate) struct NumberBlock {
    /// The node that it begins at.
    pub(crate) node: u32,
    pub(crate) dense: Dense,
    /// The value of that node, or zeros.
    pub(crate) root: [u8; 16],
    /// The bits of the bottom nodes, if it has some.
    pub(crate) mask: Vec<u8>,
    /// The first of its bytes in the records.
    pub(crate) start: usize,
}

impl NumberBlock {
    /// One with the bits that its bytes have, or without any.
    pub(crate) fn new(layout: &RecordLayout, node: u32, dense: Dense, bytes: Option<&[u8]>) -> NumberBlock {
        let length =
            if dense.kind.has_mask() { layout.dimension.cells(dense.levels) as usize / 8 } else { 0 };
        let mask = match bytes {
            Some(bytes) => bytes[layout.dense_mask_at(dense.levels)..][..length].to_vec(),
            None => vec![0; length],
        };
        NumberBlock { node, dense, root: [0; 16], mask, start: 0 }
    }

    /// Begins in records at a place: puts its bits to its bytes.
    pub(crate) fn begin(&mut self, layout: &RecordLayout, start: usize, bytes: &mut [u8]) {
        self.start = start;
        bytes[layout.dense_mask_at(self.dense.levels)..][..self.mask.len()].copy_from_slice(&self.mask);
    }

    /// The nodes that are VOID, if some may be.
    fn void(&self, layout: &RecordLayout) -> Option<VoidNodes> {
        (self.dense.kind.states().1 == Some(VOID))
            .then(|| VoidNodes::new(layout, self.dense.levels, &self.mask))
    }

    /// The values of a level and all that follows them, in the records.
    fn values<'r>(&self, layout: &RecordLayout, level: u8, records: &'r [u8]) -> &'r [u8] {
        &records[self.start + layout.dense_values_at(level)..]
    }
}

/// Copies the values of dense blocks from records to others, where there is nothing but zeros for VOID nodes.
pub(crate) fn copy_values(form: TreeType, blocks: &[NumberBlock], from: &[u8], to: &mut [u8]) {
    let layout = RecordLayout::new(form);
    for block in blocks {
        let void = block.void(&layout);
        for level in 1..=block.dense.levels {
            let start = block.start + layout.dense_values_at(level);
            let values = start..start + layout.dimension.cells(level) as usize * layout.width;
            let to = &mut to[values.clone()];
            to.copy_from_slice(&from[values]);
            if let Some(void) = &void {
                let values = to.chunks_exact_mut(layout.width).zip(&void.nodes[usize::from(level)]);
                values.filter(|(_, void)| **void).for_each(|(value, _)| value.fill(0));
            }
        }
        write_dense_head(&layout, block.dense, &mut to[block.start..]);
    }
}

/// Form of all dense blocks of a segment.
#[derive(Clone, Copy)]
struct BlockForm {
    layout: RecordLayout,
    sample: SampleType,
    form: ChannelForm,
}

impl BlockForm {
    /// Form of the levels of a channel with such numbers.
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

/// Packs the numbers of dense blocks in records: a header, and streams.
pub(crate) fn pack_blocks(
    form: TreeType,
    rule: Rule,
    blocks: &[NumberBlock],
    records: &[u8],
) -> (Vec<u8>, Vec<u8>) {
    let common = BlockForm::new(form, rule);
    let void: Vec<Option<VoidNodes>> = blocks.iter().map(|block| block.void(&common.layout)).collect();
    let (mut header, mut writer) = (HeaderWriter::default(), SymbolWriter::default());
    let mut channels: Vec<Box<dyn Pending>> = Vec::new();
    for &(channel, like) in channel_order(form) {
        let numbering = choose_numbering(&common, channel, (blocks, records), &void);
        numbering.write(&mut header);
        let sink = (&mut header, &mut writer);
        channels.push(match numbering.lanes {
            16 => pack_channel::<i16>(sink, &common, numbering, (channel, like), (blocks, &void, records)),
            32 => pack_channel::<i32>(sink, &common, numbering, (channel, like), (blocks, &void, records)),
            _ => pack_channel::<i64>(sink, &common, numbering, (channel, like), (blocks, &void, records)),
        });
    }
    channels.iter().rev().for_each(|channel| channel.states(&mut writer));
    (header.finish(), writer.finish())
}

fn pack_channel<T: Lane>(
    (header, writer): (&mut HeaderWriter, &mut SymbolWriter),
    common: &BlockForm,
    numbering: Numbering,
    (channel, like): (usize, Option<usize>),
    (blocks, void, records): (&[NumberBlock], &[Option<VoidNodes>], &[u8]),
) -> Box<dyn Pending> {
    let numbers: Vec<BlockNumbers<'_, T>> = blocks
        .iter()
        .zip(void)
        .map(|(block, void)| BlockNumbers {
            grids: take_block(common, numbering, (channel, like), (block, records), void.as_ref()),
            void: void.as_ref().map(|void| &void.children),
        })
        .collect();
    Box::new(encode(header, writer, common.channel(numbering), &numbers))
}

/// Takes the numbers of a channel of a block, or what they are more than those of another channel, from the root down; VOID nodes have
/// the numbers of their parents.
fn take_block<T: Lane>(
    common: &BlockForm,
    numbering: Numbering,
    (channel, like): (usize, Option<usize>),
    (block, records): (&NumberBlock, &[u8]),
    void: Option<&VoidNodes>,
) -> Levels<T> {
    let (layout, size) = (&common.layout, numbering.size());
    let number = |value: &[u8]| {
        let own = T::from_i64(numbering.read(&value[channel * size..]));
        like.map_or(own, |like| own.minus(T::from_i64(numbering.read(&value[like * size..]))))
    };
    let mut top = Grid::new(1, common.form.axes);
    top.row_mut([0, 0])[0] = number(&block.root);
    top.pad();
    let mut grids = vec![top];
    for level in 1..=block.dense.levels {
        let mut grid = Grid::<T>::new(1 << level, common.form.axes);
        let above = &grids[grids.len() - 1];
        let void = void.map(|void| &void.nodes[usize::from(level)][..]);
        let values = block.values(layout, level, records);
        let mut other = vec![T::default(); 1 << level];
        for (index, [y, z]) in grid.rows().enumerate() {
            let row = grid.row_mut([y, z]);
            let values = &values[index * row.len() * layout.width..][..row.len() * layout.width];
            numbering.read_all(&values[channel * size..], layout.width, row);
            if let Some(like) = like {
                numbering.read_all(&values[like * size..], layout.width, &mut other);
                row.iter_mut().zip(&other).for_each(|(to, other)| *to = to.minus(*other));
            }
            if let Some(void) = void {
                let parents = above.row([y / 2, z / 2], [0; 3]);
                let void = &void[index * row.len()..][..row.len()];
                for (x, to) in row.iter_mut().enumerate().filter(|(x, _)| void[*x]) {
                    *to = parents[x / 2];
                }
            }
        }
        grid.pad();
        grids.push(grid);
    }
    grids
}

/// How the samples of a channel become integers.
fn choose_numbering(
    common: &BlockForm,
    channel: usize,
    (blocks, records): (&[NumberBlock], &[u8]),
    void: &[Option<VoidNodes>],
) -> Numbering {
    let (layout, sample) = (&common.layout, common.sample);
    if !sample.is_float() {
        return Numbering::ordered(sample);
    }
    let number = |bytes: &[u8]| read_float(sample, &bytes[channel * sample.size()..]);
    let of_level = |block: usize, level: u8| {
        let bytes = blocks[block].values(layout, level, records).chunks_exact(layout.width);
        let void = void[block].as_ref().map_or(&[][..], |void| &void.nodes[usize::from(level)]);
        let samples = bytes.take(layout.dimension.cells(level) as usize).enumerate();
        let samples = samples.filter(|(at, _)| !void.get(*at).copied().unwrap_or_default());
        samples.map(|(_, bytes)| number(bytes))
    };
    let blocks = || blocks.iter().enumerate();
    let above =
        blocks().flat_map(|(at, block)| (1..block.dense.levels).flat_map(move |level| of_level(at, level)));
    let bottom = || blocks().flat_map(|(at, block)| of_level(at, block.dense.levels));
    let roots = blocks().map(|(_, block)| number(&block.root));
    Numbering::choose(sample, above.chain(roots).chain(bottom()), bottom())
}

/// Reads the numbers of dense blocks into records. `None` if these are not their bytes.
pub(crate) fn unpack_blocks(
    form: TreeType,
    rule: Rule,
    (blocks, records): (&[NumberBlock], &mut [u8]),
    (header, bytes): (&[u8], &[u8]),
) -> Option<()> {
    let common = BlockForm::new(form, rule);
    let void: Vec<Option<VoidNodes>> = blocks.iter().map(|block| block.void(&common.layout)).collect();
    let mut header = HeaderReader::new(header);
    let mut reader = SymbolReader::new(bytes)?;
    let mut kept = Vec::new();
    for &(channel, like) in channel_order(form) {
        let numbering = Numbering::read_from(common.sample, &mut header);
        let is_kept = like.is_none() && channel_order(form).iter().any(|(_, like)| *like == Some(channel));
        let source = (&mut header, &mut reader);
        match numbering.lanes {
            16 => {
                let other = like.map(|_| &kept[..]);
                let mut own = Vec::new();
                let keep = is_kept.then_some(&mut own);
                unpack_channel::<i16>(
                    source,
                    &common,
                    numbering,
                    channel,
                    (blocks, &void, records),
                    other,
                    keep,
                );
                if is_kept {
                    kept = own;
                }
            }
            32 => unpack_channel::<i32>(
                source,
                &common,
                numbering,
                channel,
                (blocks, &void, records),
                None,
                None,
            ),
            _ => unpack_channel::<i64>(
                source,
                &common,
                numbering,
                channel,
                (blocks, &void, records),
                None,
                None,
            ),
        }
    }
    for block in blocks {
        write_dense_head(&common.layout, block.dense, &mut records[block.start..]);
    }
    (header.is_whole() && reader.is_whole()).then_some(())
}

fn unpack_channel<T: Lane>(
    (header, reader): (&mut HeaderReader<'_>, &mut SymbolReader<'_>),
    common: &BlockForm,
    numbering: Numbering,
    channel: usize,
    (blocks, void, records): (&[NumberBlock], &[Option<VoidNodes>], &mut [u8]),
    other: Option<&[Levels<T>]>,
    mut keep: Option<&mut Vec<Levels<T>>>,
) {
    let number =
        |value: &[u8], channel: usize| T::from_i64(numbering.read(&value[channel * numbering.size()..]));
    let mut shapes = Vec::with_capacity(blocks.len());
    for (at, (block, void)) in blocks.iter().zip(void).enumerate() {
        let mut root = number(&block.root, channel);
        if let Some(other) = other {
            root = root.minus(other[at][0].row([0, 0], [0; 3])[0]);
        }
        if let Some(keep) = &mut keep {
            let mut top = Grid::new(1, common.form.axes);
            top.row_mut([0, 0])[0] = root;
            keep.push(vec![top]);
        }
        let void = void.as_ref().map(|void| &void.children);
        shapes.push(BlockShape { root, levels: block.dense.levels, void });
    }
    T::with_scratch(|scratch| {
        decode(scratch, header, reader, common.channel(numbering), &shapes, |at, level, grid| {
            let void = void[at].as_ref().map(|void| &void.nodes[usize::from(level)][..]);
            let other = other.map(|other| &other[at][usize::from(level)]);
            let start = blocks[at].start + common.layout.dense_values_at(level) + channel * numbering.size();
            let values = &mut records[start..];
            put_level(grid, other, numbering, (common.layout.width, void), values);
            if let Some(keep) = &mut keep {
                keep[at].push(grid.copy());
            }
        });
    });
}

/// Puts the numbers of a level to bytes that begin with the first sample; the next ones are so many bytes apart. VOID nodes
/// have zeros.
fn put_level<T: Lane>(
    grid: &Grid<T>,
    other: Option<&Grid<T>>,
    numbering: Numbering,
    (width, void): (usize, Option<&[bool]>),
    bytes: &mut [u8],
) {
    let side = grid.side;
    for (index, row) in grid.rows().enumerate() {
        let bytes = &mut bytes[index * side * width..];
        let numbers = grid.row(row, [0; 3]).iter();
        match other.map(|other| other.row(row, [0; 3])) {
            None => numbering.write_all(numbers.map(|number| number.to_i64()), bytes, width),
            Some(other) => {
                let sums = numbers.zip(other).map(|(number, other)| number.plus(*other).to_i64());
                numbering.write_all(sums, bytes, width);
            }
        }
        if let Some(void) = void {
            let void = void[index * side..][..side].iter().zip(bytes.chunks_mut(width));
            void.filter(|(void, _)| **void).for_each(|(_, bytes)| bytes[..numbering.size()].fill(0));
        }
    }
}
