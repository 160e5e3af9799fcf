//! Encodes the levels of a block in rows as a run of records, like [`encode`](super::super::encode)
//! for blocks in Z order.

use zerocopy::{FromBytes, IntoBytes};

use super::super::encode::{SubtreeSlots, dense_sizes};
use super::{RowLevel, reduce};
use crate::store::records::{Record, RecordHead};
use spinney_base::array;
use spinney_container::DenseKind;
use spinney_container::{CUT, INNER, LEAF};

/// The levels from the root down to a bottom, and the record slots of their nodes.
struct Encoder<'a, R: Record> {
    /// From the bottom to the root.
    levels: &'a [RowLevel],
    /// Whether nodes at the bottom that are not uniform become CUT.
    is_cut: bool,
    /// Maximum number of levels of dense blocks.
    most_dense: u8,
    /// For each level from the lowest one that has nodes which are not uniform.
    slots: Vec<Vec<SubtreeSlots>>,
    layout: std::marker::PhantomData<R>,
}

/// Returns the records of a block, without the levels below `bottom`; `levels` are ordered from the
/// cells up. Returns nothing if the root is uniform. Dense blocks have at most `most_dense` levels.
pub(super) fn encode<R: Record>(levels: &[RowLevel], bottom: usize, most_dense: u8) -> Vec<u8> {
    let root = &levels[levels.len() - 1];
    if root.uniform[0] == 1 {
        return Vec::new();
    }
    let layout = std::marker::PhantomData;
    let mut encoder =
        Encoder::<R> { levels: &levels[bottom..], is_cut: bottom > 0, most_dense, slots: Vec::new(), layout };
    encoder.count();
    let up = encoder.levels.len() - 1;
    let mut bytes = vec![0; encoder.slots(up, [0; 3]).0 * size_of::<R>()];
    encoder.node(up, [0; 3], <[R]>::mut_from_bytes(&mut bytes).expect("whole records"));
    bytes
}

impl<R: Record> Encoder<'_, R> {
    /// Returns the number of nodes along each axis, `up` levels above the bottom.
    fn side(&self, up: usize) -> usize {
        1 << (self.levels.len() - 1 - up)
    }

    /// Returns the index of a node in its level.
    #[inline]
    fn index(&self, up: usize, [x, y, z]: [usize; 3]) -> usize {
        (z * self.side(up) + y) * self.side(up) + x
    }

    /// Counts the record slots of all nodes above the bottom.
    fn count(&mut self) {
        let leaf = SubtreeSlots::of_state(LEAF);
        // The lowest level with nodes that are not uniform, and the slots of each of these.
        let (lowest, other) = if self.is_cut {
            (0, SubtreeSlots::of_state(CUT))
        } else {
            let together = (1..R::CHILDREN).fold(leaf, |together, _| together.join(leaf));
            (1, together.parent(&dense_sizes::<R>(1, self.most_dense)))
        };
        self.slots = vec![Vec::new(); lowest];
        let of = |uniform: &u8| if *uniform == 1 { leaf } else { other };
        self.slots.push(self.levels[lowest].uniform.iter().map(of).collect());
        for (up, level) in self.levels.iter().enumerate().skip(lowest + 1) {
            let sizes = dense_sizes::<R>(up as u8, self.most_dense);
            let mut here = vec![leaf; level.uniform.len()];
            let below = &self.slots[up - 1];
            reduce(R::AXES, self.side(up - 1), below, &mut here, |slots| slots, SubtreeSlots::join);
            for (here, uniform) in here.iter_mut().zip(&level.uniform) {
                *here = if *uniform == 1 { leaf } else { here.parent(&sizes) };
            }
            self.slots.push(here);
        }
    }

    /// Returns the number of slots of an INNER node, and the kind of its dense block if it is one.
    #[inline]
    fn slots(&self, up: usize, at: [usize; 3]) -> (usize, Option<DenseKind>) {
        let slots = self.slots[up][self.index(up, at)];
        (slots.count() as usize, slots.dense())
    }

    /// Writes an INNER node of a level to the first slots of `records`; returns the number of
    /// slots.
    fn node(&self, up: usize, at: [usize; 3], records: &mut [R]) -> usize {
        let (count, dense) = self.slots(up, at);
        let records = &mut records[..count];
        let below = &self.levels[up - 1];
        let mut values = [R::ZERO; 8];
        let (mut next, mut states) = (1, 0);
        for (step, value) in values[..R::CHILDREN].iter_mut().enumerate() {
            let child = array::from_fn(|axis| at[axis] << 1 | step >> axis & 1);
            let index = self.index(up - 1, child);
            *value = below.values_of::<R>()[index];
            let state = match below.uniform[index] {
                0 if up > 1 => INNER,
                0 => CUT,
                _ => LEAF,
            };
            states |= u32::from(state) << (2 * step);
            if state == INNER && dense.is_none() {
                next += self.node(up - 1, child, &mut records[next..]);
            }
        }
        let head = RecordHead { states, skip: count as u32, dense: dense.map_or(0, DenseKind::number) };
        records[0] = R::new(head, &values[..R::CHILDREN]);
        if let Some(kind) = dense {
            self.dense((up, at), kind, records[1..].as_mut_bytes());
        }
        count
    }

    /// Writes the payload of a dense block.
    fn dense(&self, (up, at): (usize, [usize; 3]), kind: DenseKind, payload: &mut [u8]) {
        let mut rest = payload;
        for below in (0..=up - 2).rev() {
            let side = 1 << (up - below);
            let values = self.levels[below].values_of::<R>();
            for y in self.rows(below, (up, at)) {
                let (row, tail) = rest.split_at_mut(side * size_of::<R::Bytes>());
                row.copy_from_slice(values[y..y + side].as_bytes());
                rest = tail;
            }
        }
        let (first, second) = kind.states();
        if second.is_some() {
            // (Only at a cut, where nodes are CUT or LEAF.)
            let uniform = &self.levels[0].uniform;
            let nodes = self.rows(0, (up, at)).flat_map(|row| row..row + (1 << up));
            for (bit, node) in nodes.enumerate() {
                let state = if uniform[node] == 0 { CUT } else { LEAF };
                rest[bit / 8] |= u8::from(state == first) << (bit % 8);
            }
        }
    }

    /// Returns, for each row below a node, the index of its first node in a level.
    fn rows(
        &self,
        below: usize,
        (up, [x, y, z]): (usize, [usize; 3]),
    ) -> impl Iterator<Item = usize> + use<'_, R> {
        let bits = up - below;
        let depth = if R::AXES > 2 { 1 << bits } else { 1 };
        let first = [x << bits, y << bits, if R::AXES > 2 { z << bits } else { 0 }];
        (0..depth).flat_map(move |dz| {
            (0..1 << bits).map(move |dy| self.index(below, [first[0], first[1] + dy, first[2] + dz]))
        })
    }
}
