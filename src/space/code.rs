//! FD locational codes: one integer per node.

use std::cmp::Ordering;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::marker::PhantomData;

use super::dimension::{Dimension, Oct, Quad};

/// Whole-number coordinates of a node at its own level: x (column), y (row), z; unused axes are 0.
pub type Cell = [u32; 3];

/// The fixed-length ("FD") locational code of a node (Slavik's survey calls it so): the path from the
/// root and the level in one integer whose order is preorder.
///
/// From the top: one zero bit (so that the code fits a signed 64-bit database key), the path with 2 or 3
/// bits per level, the root's child first, unused levels zero; the level in the low 5 bits. The level is
/// needed because a path of zeros does not tell its own length.
pub struct Code<D> {
    bits: u64,
    dimension: PhantomData<D>,
}

const LEVEL_BITS: u32 = 5;
const LEVEL_MASK: u64 = (1 << LEVEL_BITS) - 1;

impl<D: Dimension> Code<D> {
    /// The whole space.
    pub const ROOT: Code<D> = Code { bits: 0, dimension: PhantomData };

    /// The integer that is stored and sorted.
    #[inline]
    pub fn bits(self) -> u64 {
        self.bits
    }

    /// The code with these bits, if they are one: the level is within bounds and all unused bits are zero.
    #[inline]
    pub fn from_bits(bits: u64) -> Option<Code<D>> {
        let code = Code { bits, dimension: PhantomData };
        let valid = code.level() <= D::MAX_DEPTH && bits & code.unused() == 0 && bits >> 63 == 0;
        valid.then_some(code)
    }

    /// 0 for the root, the tree's depth for single cells.
    #[inline]
    pub fn level(self) -> u8 {
        (self.bits & LEVEL_MASK) as u8
    }

    /// Where the path bits of the step from `level` to `level + 1` start.
    #[inline]
    fn shift(level: u8) -> u32 {
        63 - D::AXES as u32 * (level as u32 + 1)
    }

    /// All bits below the path, but for the level.
    #[inline]
    fn unused(self) -> u64 {
        ((1u64 << (63 - D::AXES as u32 * self.level() as u32)) - 1) & !LEVEL_MASK
    }

    /// The `child`-th child.
    ///
    /// # Panics
    /// If this code is already at the deepest possible level, or there is no such child.
    #[inline]
    pub fn child(self, child: usize) -> Code<D> {
        assert!(self.level() < D::MAX_DEPTH && child < D::CHILDREN);
        Code { bits: (self.bits | (child as u64) << Self::shift(self.level())) + 1, dimension: PhantomData }
    }

    /// The node one level up; `None` for the root.
    pub fn parent(self) -> Option<Code<D>> {
        self.level().checked_sub(1).map(|level| self.ancestor(level))
    }

    /// The node at `level` on the way from the root to this one (itself, if it is there).
    ///
    /// # Panics
    /// If `level` is deeper than this node.
    #[inline]
    pub fn ancestor(self, level: u8) -> Code<D> {
        assert!(level <= self.level());
        let path = !((1u64 << (63 - D::AXES as u32 * level as u32)) - 1);
        Code { bits: self.bits & path | level as u64, dimension: PhantomData }
    }

    /// Which child of its ancestor at `level` the way to this node goes through.
    ///
    /// # Panics
    /// If this node is not deeper than `level`.
    #[inline]
    pub fn step(self, level: u8) -> usize {
        assert!(level < self.level());
        (self.bits >> Self::shift(level)) as usize & (D::CHILDREN - 1)
    }

    /// Whether `other` is this node or below it.
    #[inline]
    pub fn contains(self, other: Code<D>) -> bool {
        self.level() <= other.level() && other.ancestor(self.level()) == self
    }

    /// The largest integer that a code of this node's subtree can have: `bits() ..= last_bits()` is the
    /// subtree.
    pub fn last_bits(self) -> u64 {
        self.bits | self.unused() | LEVEL_MASK
    }

    /// The deepest node that contains both.
    #[inline]
    pub fn common_ancestor(self, other: Code<D>) -> Code<D> {
        let most = self.level().min(other.level());
        let differ = (self.bits ^ other.bits) & !LEVEL_MASK;
        let same = (differ.leading_zeros().saturating_sub(1) / D::AXES as u32) as u8;
        self.ancestor(most.min(same))
    }

    /// The node at `level` with these coordinates; `None` where there is none.
    #[inline]
    pub fn from_cell(level: u8, cell: Cell) -> Option<Code<D>> {
        let fits = |axis: usize| (cell[axis] as u64) < if axis < D::AXES { 1 << level } else { 1 };
        if level > D::MAX_DEPTH || !(0..3).all(fits) {
            return None;
        }
        let path = (0..D::AXES).fold(0, |path, axis| path | spread::<D>(cell[axis]) << axis);
        let bits = if level == 0 { 0 } else { path << Self::shift(level - 1) };
        Some(Code { bits: bits | level as u64, dimension: PhantomData })
    }

    /// Coordinates of the node at its own level.
    #[inline]
    pub fn cell(self) -> Cell {
        let path = self.path();
        std::array::from_fn(|axis| if axis < D::AXES { gather::<D>(path >> axis) } else { 0 })
    }

    /// The path as a plain number: base 4 (or 8) with the root's child as the highest digit. It does not
    /// tell the level: 75 is <1,0,2,3> as well as <0,0,0,1,0,2,3>.
    pub fn path(self) -> u64 {
        if self.level() == 0 { 0 } else { self.bits >> Self::shift(self.level() - 1) }
    }

    /// The node at `level` whose path is this number; `None` where there is none.
    pub fn from_path(level: u8, path: u64) -> Option<Code<D>> {
        if level > D::MAX_DEPTH || path >> (D::AXES * level as usize) != 0 {
            return None;
        }
        let bits = if level == 0 { 0 } else { path << Self::shift(level - 1) };
        Some(Code { bits: bits | level as u64, dimension: PhantomData })
    }

    /// The steps from the root to this node.
    pub fn digits(self) -> impl ExactSizeIterator<Item = usize> {
        (0..self.level()).map(move |level| self.step(level))
    }

    /// The node at the end of these steps from the root; `None` if a step is no child or there are too many.
    pub fn from_digits(digits: impl IntoIterator<Item = usize>) -> Option<Code<D>> {
        digits.into_iter().try_fold(Code::ROOT, |code: Code<D>, digit| {
            (code.level() < D::MAX_DEPTH && digit < D::CHILDREN).then(|| code.child(digit))
        })
    }

    /// The code with one more symbol per digit (base 5 or 9; digits 1 to 4 or 8), which tells its own
    /// length: <2,1,3,4> is 294. It can be longer than 64 bits.
    pub fn self_delimiting(self) -> u128 {
        self.digits().fold(0, |code, digit| code * (D::CHILDREN as u128 + 1) + digit as u128 + 1)
    }

    /// The node with this [`Code::self_delimiting`] code; `None` if it has a digit 0 or is too long.
    pub fn from_self_delimiting(mut number: u128) -> Option<Code<D>> {
        let base = D::CHILDREN as u128 + 1;
        let mut digits = Vec::new();
        while number > 0 {
            digits.push(((number % base) as usize).checked_sub(1)?);
            number /= base;
        }
        Code::from_digits(digits.into_iter().rev())
    }
}

impl Code<Quad> {
    /// The key of a web map tile: one digit 0 to 3 per level, empty for the whole world.
    pub fn quadkey(self) -> String {
        self.digits().map(|digit| (b'0' + digit as u8) as char).collect()
    }

    /// The node with this quadkey; `None` if it is not one.
    pub fn from_quadkey(key: &str) -> Option<Code<Quad>> {
        key.bytes().try_fold(Code::ROOT, |code: Code<Quad>, digit| {
            let digit = digit.checked_sub(b'0').filter(|digit| *digit < 4)?;
            (code.level() < Quad::MAX_DEPTH).then(|| code.child(digit as usize))
        })
    }

    /// Zoom, column and row of the web map tile (`z/x/y`).
    pub fn zxy(self) -> (u8, u32, u32) {
        let [x, y, _] = self.cell();
        (self.level(), x, y)
    }

    /// The node of a web map tile; `None` where there is none.
    pub fn from_zxy(z: u8, x: u32, y: u32) -> Option<Code<Quad>> {
        Code::from_cell(z, [x, y, 0])
    }
}

/// Moves bit `i` of a coordinate to bit `i * AXES`: what Z order is made of.
pub(crate) fn spread<D: Dimension>(x: u32) -> u64 {
    let mut x = x as u64;
    if D::AXES == 2 {
        for (shift, mask) in [
            (16, 0x0000_FFFF_0000_FFFF),
            (8, 0x00FF_00FF_00FF_00FF),
            (4, 0x0F0F_0F0F_0F0F_0F0F),
            (2, 0x3333_3333_3333_3333),
            (1, 0x5555_5555_5555_5555),
        ] {
            x = (x | x << shift) & mask;
        }
    } else {
        x &= 0x1F_FFFF;
        for (shift, mask) in [
            (32, 0x001F_0000_0000_FFFF),
            (16, 0x001F_0000_FF00_00FF),
            (8, 0x100F_00F0_0F00_F00F),
            (4, 0x10C3_0C30_C30C_30C3),
            (2, 0x1249_2492_4924_9249),
        ] {
            x = (x | x << shift) & mask;
        }
    }
    x
}

/// The inverse of [`spread`]; other bits are ignored.
fn gather<D: Dimension>(path: u64) -> u32 {
    let mut x = path;
    if D::AXES == 2 {
        x &= 0x5555_5555_5555_5555;
        for (shift, mask) in [
            (1, 0x3333_3333_3333_3333),
            (2, 0x0F0F_0F0F_0F0F_0F0F),
            (4, 0x00FF_00FF_00FF_00FF),
            (8, 0x0000_FFFF_0000_FFFF),
            (16, 0x0000_0000_FFFF_FFFF),
        ] {
            x = (x | x >> shift) & mask;
        }
    } else {
        x &= 0x1249_2492_4924_9249;
        for (shift, mask) in [
            (2, 0x10C3_0C30_C30C_30C3),
            (4, 0x100F_00F0_0F00_F00F),
            (8, 0x001F_0000_FF00_00FF),
            (16, 0x001F_0000_0000_FFFF),
            (32, 0x0000_0000_001F_FFFF),
        ] {
            x = (x | x >> shift) & mask;
        }
    }
    x as u32
}

// By hand, because deriving would ask the dimension for each trait.
impl<D> Clone for Code<D> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<D> Copy for Code<D> {}
impl<D> PartialEq for Code<D> {
    fn eq(&self, other: &Self) -> bool {
        self.bits == other.bits
    }
}
impl<D> Eq for Code<D> {}
impl<D> PartialOrd for Code<D> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl<D> Ord for Code<D> {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bits.cmp(&other.bits)
    }
}
impl<D> Hash for Code<D> {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.bits.hash(state);
    }
}

/// The path as digits, `0` to `3` or `7`, with a slash before them: `/` is the root, `/103` a level-3 node.
impl<D: Dimension> fmt::Display for Code<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("/")?;
        self.digits().try_for_each(|digit| write!(f, "{digit}"))
    }
}

impl<D: Dimension> fmt::Debug for Code<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Parses what `Display` prints.
impl<D: Dimension> std::str::FromStr for Code<D> {
    type Err = crate::Error;

    fn from_str(text: &str) -> Result<Code<D>, crate::Error> {
        let digits = text.strip_prefix('/').and_then(|digits| {
            let digits: Option<Vec<usize>> =
                digits.chars().map(|c| c.to_digit(10).map(|d| d as usize)).collect();
            digits.and_then(Code::from_digits)
        });
        digits.ok_or_else(|| {
            crate::Error::invalid(
                "FD code",
                format!("`{text}`"),
                format!("`/` and up to {} digits below {}", D::MAX_DEPTH, D::CHILDREN),
            )
        })
    }
}

const _: () = assert!(Quad::AXES * Quad::MAX_DEPTH as usize + LEVEL_BITS as usize <= 63);
const _: () = assert!(Oct::AXES * Oct::MAX_DEPTH as usize + LEVEL_BITS as usize <= 63);
