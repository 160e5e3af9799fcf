//! Dense blocks of numbers: their bits, channels and levels.

use spinney_base::TreeType;
use spinney_base::value::Rule;
use spinney_container::{RecordLayout, VOID};

use crate::adaptive::Adaptive;
use crate::bits::BitCoder;
use crate::errors::PlaneContexts;
use crate::masks::{MaskContexts, code_mask};
use crate::nodes::Dense;
use crate::planes::{Grid, LevelCoder, for_rows};
use crate::samples::{Numbering, Whole, is_narrow, read_float};

/// The channels in the order in which they are coded, and of each the one that it is told from by difference.
pub(crate) fn channel_order(form: TreeType) -> &'static [(usize, Option<usize>)] {
    const PLAIN: [(usize, Option<usize>); 4] = [(0, None), (1, None), (2, None), (3, None)];
    // Red and blue are much like green.
    const COLOURS: [(usize, Option<usize>); 4] = [(1, None), (0, Some(1)), (2, Some(1)), (3, None)];
    let channels = usize::from(form.value.channels);
    if channels >= 3 && is_narrow(form.value.sample) { &COLOURS[..channels] } else { &PLAIN[..channels] }
}

/// Probabilities for the dense blocks of a segment.
pub(crate) struct BlockContexts {
    mask: MaskContexts,
    channels: Vec<PlaneContexts>,
}

impl BlockContexts {
    pub(crate) fn new(form: TreeType) -> BlockContexts {
        let channels = (0..form.value.channels).map(|_| PlaneContexts::new(form.children())).collect();
        BlockContexts { mask: [Adaptive::default(); 64], channels }
    }
}

/// A dense block of numbers that is coded.
pub(crate) struct NumberBlock<'b> {
    pub(crate) form: TreeType,
    pub(crate) rule: Rule,
    pub(crate) dense: Dense,
    /// The value of the node that it begins at, or zeros.
    pub(crate) root: &'b [u8],
    /// All its bytes, or the room for them; states and places of its record do not count.
    pub(crate) bytes: &'b mut [u8],
}

/// Codes a dense block.
pub(crate) fn code_block<K: BitCoder>(coder: &mut K, contexts: &mut BlockContexts, block: NumberBlock<'_>) {
    match is_narrow(block.form.value.sample) {
        true => code_numbers::<K, i32>(coder, contexts, block),
        false => code_numbers::<K, i64>(coder, contexts, block),
    }
}

fn code_numbers<K: BitCoder, T: Whole>(
    coder: &mut K,
    contexts: &mut BlockContexts,
    NumberBlock { form, rule, dense, root, bytes: block }: NumberBlock<'_>,
) {
    let (layout, sample) = (RecordLayout::new(form), form.value.sample);
    let void = dense.kind.has_mask().then(|| {
        let bits = &mut block[layout.dense_mask_at(dense.levels)..]
            [..layout.dimension.cells(dense.levels) as usize / 8];
        code_mask(coder, &mut contexts.mask, (layout.dimension.axes(), dense.levels), bits);
        (dense.kind.states().1 == Some(VOID)).then(|| VoidNodes::new(&layout, dense.levels, bits))
    });
    let void = void.flatten();
    let void_children = |level: u8| void.as_ref().map(|void| &void.children[usize::from(level)][..]);
    let is_void = |level: u8| void.as_ref().map(|void| &void.nodes[usize::from(level)][..]);
    let mut coded: Vec<Vec<Grid<T>>> = vec![Vec::new(); usize::from(form.value.channels)];
    for &(channel, like) in channel_order(form) {
        let from = channel * sample.size();
        let numbering = choose_numbering::<K>(form, channel, &layout, dense, root, block, is_void);
        let numbering = numbering.code(coder, &mut contexts.channels[channel].is_scaled);
        let number = |value: &[u8]| T::from_i64(numbering.read(&value[from..]));
        let mut top = Grid::new(1, layout.dimension.axes());
        top.row_mut(0, 0)[0] = number(root);
        if let Some(like) = like {
            let other = coded[like][0].at(0, 0, [0; 3])[0];
            top.row_mut(0, 0)[0] = number(root).sub(other);
        }
        top.pad();
        let mut grids = vec![top];
        let has_sums = rule == Rule::Mean;
        let mut levels = LevelCoder::new(&mut contexts.channels[channel], layout.dimension.axes(), has_sums);
        for level in 1..=dense.levels {
            let mut grid = Grid::<T>::new(1 << level, layout.dimension.axes());
            let other = like.map(|like| &coded[like][usize::from(level)]);
            let bytes = &mut block[layout.dense_values_at(level) + from..];
            if !K::READS {
                take_level(&mut grid, other, numbering, layout.width, bytes);
            }
            levels.level(coder, &grids[usize::from(level) - 1], &mut grid, void_children(level - 1));
            if K::READS {
                put_level(&grid, other, numbering, (layout.width, is_void(level)), bytes);
            }
            grid.pad();
            grids.push(grid);
        }
        coded[channel] = grids;
    }
}

/// Takes the numbers of a level, or what they are more than those of another channel, from bytes that begin with the first sample; the next
/// ones stand so many bytes behind each other.
fn take_level<T: Whole>(
    grid: &mut Grid<T>,
    other: Option<&Grid<T>>,
    numbering: Numbering,
    width: usize,
    bytes: &[u8],
) {
    let mut samples = bytes.chunks(width).map(|bytes| T::from_i64(numbering.read(bytes)));
    for_rows(grid.side, grid.axes, |_, y, z| {
        let out = grid.row_mut(y, z);
        out.iter_mut().zip(&mut samples).for_each(|(out, number)| *out = number);
        if let Some(other) = other {
            let other = other.at(y, z, [0; 3]);
            out.iter_mut().zip(other).for_each(|(out, other)| *out = out.sub(*other));
        }
    });
}

/// Puts them there, but for those of VOID nodes, which have zeros.
fn put_level<T: Whole>(
    grid: &Grid<T>,
    other: Option<&Grid<T>>,
    numbering: Numbering,
    (width, void): (usize, Option<&[bool]>),
    bytes: &mut [u8],
) {
    let side = grid.side;
    grid.each_row(|row, y, z| {
        let bytes = &mut bytes[row * side * width..];
        let numbers = grid.at(y, z, [0; 3]).iter();
        match other.map(|other| other.at(y, z, [0; 3])) {
            None => numbering.write_all(numbers.map(|number| number.to_i64()), bytes, width),
            Some(other) => {
                let sums = numbers.zip(other).map(|(number, other)| number.add(*other).to_i64());
                numbering.write_all(sums, bytes, width);
            }
        }
        if let Some(void) = void {
            let void = void[row * side..][..side].iter().zip(bytes.chunks_mut(width));
            void.filter(|(void, _)| **void).for_each(|(_, bytes)| bytes[..numbering.size()].fill(0));
        }
    });
}

/// How the samples of a channel become whole numbers, where they are to be written.
fn choose_numbering<'v, K: BitCoder>(
    form: TreeType,
    channel: usize,
    layout: &RecordLayout,
    dense: Dense,
    root: &[u8],
    block: &[u8],
    is_void: impl Fn(u8) -> Option<&'v [bool]>,
) -> Numbering {
    let sample = form.value.sample;
    if K::READS || !sample.is_float() {
        return Numbering::ordered(sample);
    }
    let number = |bytes: &[u8]| read_float(sample, &bytes[channel * sample.size()..]);
    let of_level = |level: u8| {
        let bytes = block[layout.dense_values_at(level)..].chunks_exact(layout.width);
        let void = is_void(level).unwrap_or_default();
        let samples = bytes.take(layout.dimension.cells(level) as usize).enumerate();
        samples.filter(|(at, _)| !void.get(*at).copied().unwrap_or_default()).map(|(_, bytes)| number(bytes))
    };
    let all = (1..=dense.levels).flat_map(of_level).chain([number(root)]);
    Numbering::choose(sample, all, of_level(dense.levels))
}

/// Which nodes of a dense block are VOID, level by level.
struct VoidNodes {
    nodes: Vec<Vec<bool>>,
    /// Of each node above the bottom: a bit for each child that is VOID.
    children: Vec<Vec<u8>>,
}

impl VoidNodes {
    /// By the bits of the bottom nodes.
    fn new(layout: &RecordLayout, levels: u8, bits: &[u8]) -> VoidNodes {
        let bottom = (0..layout.dimension.cells(levels) as usize)
            .map(|at| bits[at / 8] >> (at % 8) & 1 == 0)
            .collect();
        let mut all = VoidNodes { nodes: vec![bottom], children: Vec::new() };
        for level in (0..levels).rev() {
            let (side, below) = (1 << level, &all.nodes[all.nodes.len() - 1]);
            let mut children = vec![0; layout.dimension.cells(level) as usize];
            for_rows(side, layout.dimension.axes(), |row, y, z| {
                let out = &mut children[row * side..][..side];
                for child in 0..layout.children() {
                    let row = (2 * z + (child >> 2)) * 2 * side + 2 * y + (child >> 1 & 1);
                    let void = below[row * 2 * side..][..2 * side].iter().skip(child & 1).step_by(2);
                    out.iter_mut().zip(void).for_each(|(out, void)| *out |= u8::from(*void) << child);
                }
            });
            let whole = u8::MAX >> (8 - layout.children());
            all.nodes.push(children.iter().map(|children: &u8| *children == whole).collect());
            all.children.push(children);
        }
        all.nodes.reverse();
        all.children.reverse();
        all
    }
}
