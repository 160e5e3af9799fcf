//! FD locational codes: one integer per node.

use std::fmt;

use super::bounds::Bounds;
use super::dimension::Dimension;

/// Whole-number coordinates of a node at its own level: x (column), y (row), z; unused axes are 0.
pub type Cell = [u32; 3];

/// The fixed-length ("FD") locational code of a node (Slavik's survey calls it so): the path from the
/// root and the level in one integer whose order is preorder.
///
/// From the top: one zero bit (so that the code fits a signed 64-bit database key), the path with 2 or 3
/// bits per level, the root's child first, unused levels zero; the level in the low 5 bits. The level is
/// needed because a path of zeros does not tell its own length.
///
/// ```
/// use spinney::{Code, Dimension};
/// let node = Code::root(Dimension::Quad).child(1).child(0).child(2).child(3);
/// assert_eq!((node.path(), node.level(), node.to_string().as_str()), (75, 4, "/1023"));
/// assert!(node.parent().unwrap() < node);
/// ```
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Code {
    /// The code; its top bit, which is zero in files, says that it is one of an octree.
    tagged: u64,
}

const LEVEL_BITS: u32 = 5;
const LEVEL_MASK: u64 = (1 << LEVEL_BITS) - 1;
const OCTREE: u64 = 1 << 63;

impl Code {
    /// The whole space.
    #[inline]
    pub const fn root(dimension: Dimension) -> Code {
        Code { tagged: (dimension as u64) << 63 }
    }

    /// Whether it is a node of a quadtree or of an octree.
    #[inline]
    pub const fn dimension(self) -> Dimension {
        if self.tagged & OCTREE == 0 { Dimension::Quad } else { Dimension::Oct }
    }

    /// Bits of one step of the path.
    #[inline]
    const fn axes(self) -> u32 {
        2 + (self.tagged >> 63) as u32
    }

    /// The integer that is stored and sorted.
    #[inline]
    pub const fn bits(self) -> u64 {
        self.tagged & !OCTREE
    }

    /// The code with these bits, if they are one: the level is within bounds and all unused bits are zero.
    #[inline]
    pub fn from_bits(dimension: Dimension, bits: u64) -> Option<Code> {
        let code = Code { tagged: bits | Code::root(dimension).tagged };
        let valid = bits & OCTREE == 0 && code.level() <= dimension.max_depth() && bits & code.unused() == 0;
        valid.then_some(code)
    }

    /// 0 for the root, the tree's depth for single cells.
    #[inline]
    pub const fn level(self) -> u8 {
        (self.tagged & LEVEL_MASK) as u8
    }

    /// Lowest bit of the path's step from `level` to `level + 1`.
    #[inline]
    const fn shift(self, level: u8) -> u32 {
        63 - self.axes() * (level as u32 + 1)
    }

    /// All bits below the path of `level` levels.
    #[inline]
    const fn below(self, level: u8) -> u64 {
        (1u64 << (63 - self.axes() * level as u32)) - 1
    }

    /// All bits below the path, but for the level.
    #[inline]
    const fn unused(self) -> u64 {
        self.below(self.level()) & !LEVEL_MASK
    }

    /// The `child`-th child.
    ///
    /// # Panics
    /// If this code is already at the deepest possible level, or there is no such child.
    #[inline]
    pub fn child(self, child: usize) -> Code {
        let dimension = self.dimension();
        assert!(self.level() < dimension.max_depth() && child < dimension.children());
        // The level is below 31 here, so adding 1 to it carries into no other bit.
        Code { tagged: (self.tagged | (child as u64) << self.shift(self.level())) + 1 }
    }

    /// The node one level up; `None` for the root.
    #[inline]
    pub fn parent(self) -> Option<Code> {
        self.level().checked_sub(1).map(|level| self.ancestor(level))
    }

    /// The node at `level` on the way from the root to this one (itself, if it is there).
    ///
    /// # Panics
    /// If `level` is deeper than this node.
    #[inline]
    pub fn ancestor(self, level: u8) -> Code {
        assert!(level <= self.level());
        Code { tagged: self.tagged & !self.below(level) | level as u64 }
    }

    /// Number of the child of its ancestor at `level` that the way to this node goes through.
    ///
    /// # Panics
    /// If this node is not deeper than `level`.
    #[inline]
    pub fn step(self, level: u8) -> usize {
        assert!(level < self.level());
        (self.tagged >> self.shift(level)) as usize & (self.dimension().children() - 1)
    }

    /// Whether `other` is this node or below it.
    #[inline]
    pub fn contains(self, other: Code) -> bool {
        self.level() <= other.level() && other.ancestor(self.level()) == self
    }

    /// The largest integer that a code of this node's subtree can have: `bits() ..= last_bits()` is the
    /// subtree.
    #[inline]
    pub fn last_bits(self) -> u64 {
        self.bits() | self.unused() | LEVEL_MASK
    }

    /// The deepest node that contains both, which must be of one dimension.
    #[inline]
    pub fn common_ancestor(self, other: Code) -> Code {
        // Bit 63 tells the dimension and never differs; behind it the equal leading bits are common steps, in
        // full or in part. Zeros behind the shorter path may be equal to steps of the longer one: hence the
        // minimum of the levels.
        let most = self.level().min(other.level());
        let differ = (self.tagged ^ other.tagged) & !LEVEL_MASK;
        let same = (differ.leading_zeros().saturating_sub(1) / self.axes()) as u8;
        self.ancestor(most.min(same))
    }

    /// The node at `level` with these coordinates; `None` where there is none.
    #[inline]
    pub fn from_cell(dimension: Dimension, level: u8, cell: Cell) -> Option<Code> {
        let axes = dimension.axes();
        let fits = |axis: usize| (cell[axis] as u64) < if axis < axes { 1 << level } else { 1 };
        if level > dimension.max_depth() || !(fits(0) && fits(1) && fits(2)) {
            return None;
        }
        let path = match dimension {
            Dimension::Quad => morton_encode_2(cell[0]) | morton_encode_2(cell[1]) << 1,
            Dimension::Oct => {
                morton_encode_3(cell[0]) | morton_encode_3(cell[1]) << 1 | morton_encode_3(cell[2]) << 2
            }
        };
        Some(Code::root(dimension).with_path(level, path))
    }

    /// The node at `level` with this path, which must have no more digits.
    #[inline]
    fn with_path(self, level: u8, path: u64) -> Code {
        let bits = if level == 0 { 0 } else { path << self.shift(level - 1) };
        Code { tagged: self.tagged & OCTREE | bits | level as u64 }
    }

    /// Coordinates of the node at its own level.
    #[inline]
    pub fn cell(self) -> Cell {
        let path = self.path();
        match self.dimension() {
            Dimension::Quad => [morton_decode_2(path), morton_decode_2(path >> 1), 0],
            Dimension::Oct => [morton_decode_3(path), morton_decode_3(path >> 1), morton_decode_3(path >> 2)],
        }
    }

    /// Cells of the node in a tree of `depth` levels.
    ///
    /// # Panics
    /// If the node is deeper than that.
    #[inline]
    pub fn bounds(self, depth: u8) -> Bounds {
        let size = depth - self.level();
        let axes = self.dimension().axes();
        let cell = self.cell().map(u64::from);
        let axis = |axis: usize, cell: u64| if axis < axes { cell << size } else { cell };
        Bounds {
            min: std::array::from_fn(|i| axis(i, cell[i])),
            max: std::array::from_fn(|i| axis(i, cell[i] + 1)),
        }
    }

    /// The path as a plain number: base 4 (or 8) with the root's child as the highest digit. It does not
    /// tell the level: 75 is <1,0,2,3> as well as <0,0,0,1,0,2,3>.
    #[inline]
    pub fn path(self) -> u64 {
        if self.level() == 0 { 0 } else { self.bits() >> self.shift(self.level() - 1) }
    }

    /// The node at `level` whose path is this number; `None` where there is none.
    #[inline]
    pub fn from_path(dimension: Dimension, level: u8, path: u64) -> Option<Code> {
        let fits = level <= dimension.max_depth() && path >> (dimension.axes() * level as usize) == 0;
        fits.then(|| Code::root(dimension).with_path(level, path))
    }

    /// The steps from the root to this node.
    pub fn digits(self) -> impl ExactSizeIterator<Item = usize> {
        (0..self.level()).map(move |level| self.step(level))
    }

    /// The node at the end of these steps from the root; `None` if a step is no child or there are too many.
    pub fn from_digits(dimension: Dimension, digits: impl IntoIterator<Item = usize>) -> Option<Code> {
        digits.into_iter().try_fold(Code::root(dimension), |code, digit| {
            let fits = code.level() < dimension.max_depth() && digit < dimension.children();
            fits.then(|| code.child(digit))
        })
    }

    /// The code with one more symbol per digit (base 5 or 9; digits 1 to 4 or 8), which tells its own
    /// length: <2,1,3,4> is 294. It can be longer than 64 bits.
    #[inline]
    pub fn self_delimiting(self) -> u128 {
        let base = self.dimension().children() as u128 + 1;
        self.digits().fold(0, |code, digit| code * base + digit as u128 + 1)
    }

    /// The node with this [`Code::self_delimiting`] code; `None` if it has a digit 0 or is too long.
    pub fn from_self_delimiting(dimension: Dimension, mut number: u128) -> Option<Code> {
        let base = dimension.children() as u128 + 1;
        let mut digits = Vec::new();
        while number > 0 {
            digits.push(((number % base) as usize).checked_sub(1)?);
            number /= base;
        }
        Code::from_digits(dimension, digits.into_iter().rev())
    }

    /// The node that `Display` prints so: `/` and a digit for each level.
    ///
    /// # Errors
    /// If the text is no code of a tree of this dimension.
    pub fn parse(dimension: Dimension, text: &str) -> Result<Code, crate::Error> {
        let digits = text.strip_prefix('/').and_then(|digits| {
            let digits: Option<Vec<usize>> =
                digits.chars().map(|c| c.to_digit(10).map(|d| d as usize)).collect();
            digits.and_then(|digits| Code::from_digits(dimension, digits))
        });
        digits.ok_or_else(|| {
            let (most, children) = (dimension.max_depth(), dimension.children());
            let expected = format!("`/` and up to {most} digits below {children}");
            crate::Error::invalid("FD code", format!("`{text}`"), expected)
        })
    }

    /// The key of a web map tile: one digit 0 to 3 per level, empty for the whole world. Made for quadtrees.
    pub fn quadkey(self) -> String {
        self.digits().map(|digit| (b'0' + digit as u8) as char).collect()
    }

    /// The quadtree's node with this quadkey; `None` if it is not one.
    pub fn from_quadkey(key: &str) -> Option<Code> {
        let digits: Option<Vec<usize>> =
            key.bytes().map(|digit| digit.checked_sub(b'0').map(usize::from)).collect();
        Code::from_digits(Dimension::Quad, digits?)
    }

    /// Zoom, column and row of the web map tile (`z/x/y`). Made for quadtrees.
    pub fn zxy(self) -> (u8, u32, u32) {
        let [x, y, _] = self.cell();
        (self.level(), x, y)
    }

    /// The quadtree's node of a web map tile; `None` where there is none.
    pub fn from_zxy(z: u8, x: u32, y: u32) -> Option<Code> {
        Code::from_cell(Dimension::Quad, z, [x, y, 0])
    }
}

/// Moves bit `i` of a coordinate to bit `i * axes` (Morton's interleaving, for one coordinate): what Z order
/// is made of.
#[inline]
pub fn morton_encode(dimension: Dimension, x: u32) -> u64 {
    match dimension {
        Dimension::Quad => morton_encode_2(x),
        Dimension::Oct => morton_encode_3(x),
    }
}

/// One step of [`morton_encode_2`] and of [`morton_encode_3`]. (Steps one by one, since loops over arrays are slow without optimization.)
#[inline(always)]
fn spread(x: u64, shift: u32, mask: u64) -> u64 {
    (x | x << shift) & mask
}

/// One step of the inverses.
#[inline(always)]
fn gather(x: u64, shift: u32, mask: u64) -> u64 {
    (x | x >> shift) & mask
}

#[inline]
fn morton_encode_2(x: u32) -> u64 {
    // Each step moves the upper half of every group of bits away and leaves a gap as wide as the half: five
    // steps take groups of 32 bits down to single ones.
    let mut x = x as u64;
    x = spread(x, 16, 0x0000_FFFF_0000_FFFF);
    x = spread(x, 8, 0x00FF_00FF_00FF_00FF);
    x = spread(x, 4, 0x0F0F_0F0F_0F0F_0F0F);
    x = spread(x, 2, 0x3333_3333_3333_3333);
    x = spread(x, 1, 0x5555_5555_5555_5555);
    x
}

#[inline]
fn morton_encode_3(x: u32) -> u64 {
    // As for two axes, with gaps twice as wide. Three times 21 bits are all that 64 have room for.
    let mut x = x as u64 & 0x1F_FFFF;
    x = spread(x, 32, 0x001F_0000_0000_FFFF);
    x = spread(x, 16, 0x001F_0000_FF00_00FF);
    x = spread(x, 8, 0x100F_00F0_0F00_F00F);
    x = spread(x, 4, 0x10C3_0C30_C30C_30C3);
    x = spread(x, 2, 0x1249_2492_4924_9249);
    x
}

/// The inverse of [`morton_encode_2`]; other bits are ignored.
#[inline]
fn morton_decode_2(path: u64) -> u32 {
    let mut x = path & 0x5555_5555_5555_5555;
    x = gather(x, 1, 0x3333_3333_3333_3333);
    x = gather(x, 2, 0x0F0F_0F0F_0F0F_0F0F);
    x = gather(x, 4, 0x00FF_00FF_00FF_00FF);
    x = gather(x, 8, 0x0000_FFFF_0000_FFFF);
    x = gather(x, 16, 0x0000_0000_FFFF_FFFF);
    x as u32
}

/// The inverse of [`morton_encode_3`]; other bits are ignored.
#[inline]
fn morton_decode_3(path: u64) -> u32 {
    let mut x = path & 0x1249_2492_4924_9249;
    x = gather(x, 2, 0x10C3_0C30_C30C_30C3);
    x = gather(x, 4, 0x100F_00F0_0F00_F00F);
    x = gather(x, 8, 0x001F_0000_FF00_00FF);
    x = gather(x, 16, 0x001F_0000_0000_FFFF);
    x = gather(x, 32, 0x0000_0000_001F_FFFF);
    x as u32
}

/// The path as digits, `0` to `3` or `7`, with a slash before them: `/` is the root, `/103` a level-3 node.
impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("/")?;
        self.digits().try_for_each(|digit| write!(f, "{digit}"))
    }
}

impl fmt::Debug for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

const _: () = assert!(2 * Dimension::Quad.max_depth() as usize + LEVEL_BITS as usize <= 63);
const _: () = assert!(3 * Dimension::Oct.max_depth() as usize + LEVEL_BITS as usize <= 63);
