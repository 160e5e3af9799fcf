//! Packing of the face lists of leaves, predicted by the lists of nearby leaves.

use spinney_packing::Columns;

/// A cell, in units of the smallest ones.
#[derive(Clone, Copy)]
pub(super) struct Cell {
    pub at: [u32; 3],
    pub width: u32,
}

/// Number of relations of two cells: apart, with a common edge or corner, or with a common wall
/// across x, y or z.
const RELATIONS: usize = 5;

impl Cell {
    /// No cell; it is apart from all cells.
    const NONE: Cell = Cell { at: [u32::MAX; 3], width: 0 };

    /// Returns the relation of another cell, with a disjoint interior, to this one.
    fn relation_of(&self, other: &Cell) -> usize {
        let (mut common, mut wall) = (0, 0);
        for axis in 0..3 {
            let [low, other_low] = [self, other].map(|cell| cell.at[axis]);
            let [high, other_high] = [low + self.width, other_low + other.width];
            if low > other_high || other_low > high {
                return 0;
            }
            if low == other_high || other_low == high {
                (common, wall) = (common + 1, 2 + axis);
            }
        }
        if common == 1 { wall } else { 1 }
    }
}

/// Maximum number of candidates for a leaf's faces: those that leaves had most recently.
const RECENT: usize = 128;

/// Contexts of bits: whether a face is in a list, by the last two cells that had it, and by rank.
const RANKS: usize = 8;
/// Contexts of numbers: count and numbers of faces of distant cells, count of new faces, and the
/// numbers of new faces in the model, the first one and others.
const FAR: usize = 0;
const FAR_NUMBER: usize = 1;
const NEW: usize = 2;
const FIRST: usize = 3;
const NEXT: usize = 4;
/// Contexts of bits, and of numbers.
pub(super) const CONTEXTS: (usize, usize) = (RELATIONS * RELATIONS * RANKS, 5);

/// A face of a leaf, and the last two cells that had it, the last one first.
#[derive(Clone, Copy)]
struct Recent {
    face: u32,
    cells: [Cell; 2],
}

/// Faces of one kind (on the grid, or with off-grid vertices) in leaves.
pub(super) struct FaceLists {
    bits: usize,
    counts: usize,
    /// The newest last; may have a few more than are used.
    recent: Vec<Recent>,
    /// Numbers in the model of all faces of the segment; a reader fills them in as faces occur.
    pub numbers: Vec<u32>,
    /// Number of faces that have occurred.
    known: usize,
    /// The number in the model of the last new face.
    last: u32,
}

impl FaceLists {
    pub(super) fn new(bits: usize, counts: usize, numbers: Vec<u32>) -> FaceLists {
        FaceLists { bits, counts, recent: Vec::new(), numbers, known: 0, last: 0 }
    }

    /// Codes the segment's numbers of the faces of a cell, ascending. Each takes at least a byte of
    /// `capacity`. Returns `None` if the faces are invalid, or not numbered by first occurrence.
    pub(super) fn code(
        &mut self,
        columns: &mut Columns<'_>,
        cell: &Cell,
        given: &[u32],
        capacity: usize,
    ) -> Option<Vec<u32>> {
        let oldest = self.recent.len().saturating_sub(RECENT);
        let mut list = self.of_cells_nearby(columns, cell, given, oldest);
        let mut expected = list.first().map(|recent| self.numbers[recent.face as usize]);
        let is_in = |list: &[Recent], face: u32| list.iter().any(|recent| recent.face == face);
        // Faces that no cell nearby had recently, the last ones first.
        let known = self.known as u32;
        let far = given.iter().rev().filter(|face| **face < known && !is_in(&list, **face));
        let far: Vec<u32> = far.copied().collect();
        let count = columns.count(self.counts + FAR, far.len() as u64);
        let count = usize::try_from(count).ok().filter(|count| *count <= capacity)?;
        let mut next = known;
        for index in 0..count {
            let face = far.get(index).copied().unwrap_or(0);
            let less =
                columns.count(self.counts + FAR_NUMBER, next.wrapping_sub(1).wrapping_sub(face).into());
            next = next.checked_sub(1)?.checked_sub(u32::try_from(less).ok()?)?;
            list.push(self.take(next, oldest).unwrap_or(Recent { face: next, cells: [Cell::NONE; 2] }));
        }
        let new = given.iter().filter(|face| **face >= known).count();
        let new = columns.count(self.counts + NEW, new as u64);
        let new = usize::try_from(new).ok().filter(|new| *new <= self.numbers.len() - self.known)?;
        for index in 0..new {
            let number = &mut self.numbers[self.known];
            let expected = expected.take().unwrap_or(self.last);
            let context = self.counts + if index == 0 { FIRST } else { NEXT };
            let more = columns.near(context, i64::from(number.wrapping_sub(expected) as i32));
            *number = expected.wrapping_add(more as u32);
            self.last = *number;
            list.push(Recent { face: self.known as u32, cells: [Cell::NONE; 2] });
            self.known += 1;
        }
        list.sort_unstable_by_key(|recent| recent.face);
        if list.is_empty() || list.windows(2).any(|pair| pair[0].face == pair[1].face) {
            return None;
        }
        self.recent.extend(list.iter().map(|recent| Recent { cells: [*cell, recent.cells[0]], ..*recent }));
        if self.recent.len() > 2 * RECENT {
            self.recent.drain(..self.recent.len() - RECENT);
        }
        Some(list.iter().map(|recent| recent.face).collect())
    }

    /// Codes which recent faces are in a cell, of those whose last cell touches it. They are
    /// removed from the recent faces.
    fn of_cells_nearby(
        &mut self,
        columns: &mut Columns<'_>,
        cell: &Cell,
        given: &[u32],
        oldest: usize,
    ) -> Vec<Recent> {
        let mut list = Vec::new();
        let mut first = self.recent.len();
        for (rank, at) in (oldest..self.recent.len()).rev().enumerate() {
            let recent = &mut self.recent[at];
            let last = cell.relation_of(&recent.cells[0]);
            if last == 0 {
                continue;
            }
            let before = cell.relation_of(&recent.cells[1]);
            let rank = (usize::BITS - rank.leading_zeros()) as usize;
            let context = self.bits + (RELATIONS * last + before) * RANKS + rank;
            if columns.bit(context, given.binary_search(&recent.face).is_ok()) {
                list.push(*recent);
                recent.cells = [Cell::NONE; 2];
                recent.face = u32::MAX;
                first = at;
            }
        }
        // (Compacts the remaining faces.)
        let mut next = first;
        for at in first..self.recent.len() {
            if self.recent[at].face != u32::MAX {
                self.recent[next] = self.recent[at];
                next += 1;
            }
        }
        self.recent.truncate(next);
        list
    }

    /// Removes a face from the recent faces, from index `oldest` on, and returns it.
    fn take(&mut self, face: u32, oldest: usize) -> Option<Recent> {
        let at = self.recent[oldest..].iter().position(|recent| recent.face == face)?;
        Some(self.recent.remove(oldest + at))
    }
}
