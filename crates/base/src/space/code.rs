//! FD locational codes: one integer per node.

use std::fmt;

use super::bounds::Bounds;
use super::dimension::Dimension;

/// Integer coordinates of a node at its own level: x (column), y (row), z. Unused axes are 0.
pub type Cell = [u32; 3];

/// Fixed-length ("FD") locational code of a node (the term of Slavik's survey): path from the root
/// and level in one integer. Integer order is preorder.
///
/// Bits from the top: one zero bit (so that the code fits a signed 64-bit database key); the path,
/// 2 or 3 bits per level, the root's child first; zeros for unused levels; the level in the low 5
/// bits. The level is needed since leading zeros of a path do not determine its length.
///
/// ```
/// use spinney::{Code, Dimension};
/// let node = Code::root(Dimension::Quad).child(1).child(0).child(2).child(3);
/// assert_eq!((node.path(), node.level(), node.to_string().as_str()), (75, 4, "/1023"));
/// assert!(node.parent().unwrap() < node);
/// ```
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Code {
    /// The code. The top bit, which is zero in files, is set in an octree.
    tagged: u64,
}

const LEVEL_BITS: u32 = 5;
const LEVEL_MASK: u64 = (1 << LEVEL_BITS) - 1;
const OCTREE: u64 = 1 << 63;

impl Code {
    /// Returns the root: the whole space.
    #[inline]
    pub const fn root(dimension: Dimension) -> Code {
        Code { tagged: (dimension as u64) << 63 }
    }

    /// Returns the dimension of the node's tree.
    #[inline]
    pub const fn dimension(self) -> Dimension {
        if self.tagged & OCTREE == 0 { Dimension::Quad } else { Dimension::Oct }
    }

    /// Returns the number of path bits per level.
    #[inline]
    const fn axes(self) -> u32 {
        2 + (self.tagged >> 63) as u32
    }

    /// Returns the integer that is stored and sorted.
    #[inline]
    pub const fn bits(self) -> u64 {
        self.tagged & !OCTREE
    }

    /// Returns the code with these bits; `None` if the level is too deep or an unused bit is set.
    #[inline]
    pub fn from_bits(dimension: Dimension, bits: u64) -> Option<Code> {
        let code = Code { tagged: bits | Code::root(dimension).tagged };
        let valid = bits & OCTREE == 0 && code.level() <= dimension.max_depth() && bits & code.unused() == 0;
        valid.then_some(code)
    }

    /// Returns the level: 0 for the root, the tree's depth for single cells.
    #[inline]
    pub const fn level(self) -> u8 {
        (self.tagged & LEVEL_MASK) as u8
    }

    /// Returns the lowest bit of the path digit from `level` to `level + 1`.
    #[inline]
    const fn shift(self, level: u8) -> u32 {
        63 - self.axes() * (level as u32 + 1)
    }

    /// Returns a mask of all bits below the first `level` path digits.
    #[inline]
    const fn below(self, level: u8) -> u64 {
        (1u64 << (63 - self.axes() * level as u32)) - 1
    }

    /// Returns a mask of all bits below the path, except for the level.
    #[inline]
    const fn unused(self) -> u64 {
        self.below(self.level()) & !LEVEL_MASK
    }

    /// Returns the `child`-th child.
    ///
    /// # Panics
    /// If this node is at the maximum depth, or `child` is not less than the number of children.
    #[inline]
    pub fn child(self, child: usize) -> Code {
        let dimension = self.dimension();
        assert!(self.level() < dimension.max_depth() && child < dimension.children());
        // The level is below 31 here, so adding 1 does not carry into other bits.
        Code { tagged: (self.tagged | (child as u64) << self.shift(self.level())) + 1 }
    }

    /// Returns the node one level up; `None` for the root.
    #[inline]
    pub fn parent(self) -> Option<Code> {
        self.level().checked_sub(1).map(|level| self.ancestor(level))
    }

    /// Returns the ancestor at `level`; the node itself if that is its level.
    ///
    /// # Panics
    /// If `level` is deeper than this node.
    #[inline]
    pub fn ancestor(self, level: u8) -> Code {
        assert!(level <= self.level());
        Code { tagged: self.tagged & !self.below(level) | level as u64 }
    }

    /// Returns the child number, below the ancestor at `level`, of the subtree that contains this
    /// node.
    ///
    /// # Panics
    /// If this node is not deeper than `level`.
    #[inline]
    pub fn step(self, level: u8) -> usize {
        assert!(level < self.level());
        (self.tagged >> self.shift(level)) as usize & (self.dimension().children() - 1)
    }

    /// Whether `other` is this node or in its subtree.
    #[inline]
    pub fn contains(self, other: Code) -> bool {
        self.level() <= other.level() && other.ancestor(self.level()) == self
    }

    /// Returns the largest integer that a code of this node's subtree can have: the codes of the
    /// subtree are within `bits() ..= last_bits()`.
    #[inline]
    pub fn last_bits(self) -> u64 {
        self.bits() | self.unused() | LEVEL_MASK
    }

    /// Returns the deepest node that contains both. Both must be of one dimension.
    #[inline]
    pub fn common_ancestor(self, other: Code) -> Code {
        // Bit 63 is the dimension and never differs. The equal leading bits after it are common
        // path digits, the last one maybe incomplete. Zeros after the end of the shorter path may
        // equal digits of the longer one, hence the minimum of the levels.
        let most = self.level().min(other.level());
        let differ = (self.tagged ^ other.tagged) & !LEVEL_MASK;
        let same = (differ.leading_zeros().saturating_sub(1) / self.axes()) as u8;
        self.ancestor(most.min(same))
    }

    /// Returns the node at `level` with these coordinates; `None` if they are out of range.
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

    /// Returns the node at `level` with this path, which must fit that level.
    #[inline]
    fn with_path(self, level: u8, path: u64) -> Code {
        let bits = if level == 0 { 0 } else { path << self.shift(level - 1) };
        Code { tagged: self.tagged & OCTREE | bits | level as u64 }
    }

    /// Returns the coordinates of the node at its own level.
    #[inline]
    pub fn cell(self) -> Cell {
        let path = self.path();
        match self.dimension() {
            Dimension::Quad => [morton_decode_2(path), morton_decode_2(path >> 1), 0],
            Dimension::Oct => [morton_decode_3(path), morton_decode_3(path >> 1), morton_decode_3(path >> 2)],
        }
    }

    /// Returns the node's cells in a tree of depth `depth`.
    ///
    /// # Panics
    /// If the node is deeper than `depth`.
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

    /// Returns the path as an integer in base 4 (or 8), with the root's child as the highest digit.
    /// It does not include the level: 75 is <1,0,2,3> as well as <0,0,0,1,0,2,3>.
    #[inline]
    pub fn path(self) -> u64 {
        if self.level() == 0 { 0 } else { self.bits() >> self.shift(self.level() - 1) }
    }

    /// Returns the node at `level` with this path; `None` if there is none.
    #[inline]
    pub fn from_path(dimension: Dimension, level: u8, path: u64) -> Option<Code> {
        let fits = level <= dimension.max_depth() && path >> (dimension.axes() * level as usize) == 0;
        fits.then(|| Code::root(dimension).with_path(level, path))
    }

    /// Returns the child numbers on the path from the root to this node.
    pub fn digits(self) -> impl ExactSizeIterator<Item = usize> {
        (0..self.level()).map(move |level| self.step(level))
    }

    /// Returns the node with these child numbers from the root; `None` if one is invalid or there
    /// are too many.
    pub fn from_digits(dimension: Dimension, digits: impl IntoIterator<Item = usize>) -> Option<Code> {
        digits.into_iter().try_fold(Code::root(dimension), |code, digit| {
            let fits = code.level() < dimension.max_depth() && digit < dimension.children();
            fits.then(|| code.child(digit))
        })
    }

    /// Returns the path in base 5 or 9 with digits 1 to 4 or 8, which determines its own length:
    /// <2,1,3,4> is 294. It can exceed 64 bits.
    #[inline]
    pub fn self_delimiting(self) -> u128 {
        let base = self.dimension().children() as u128 + 1;
        self.digits().fold(0, |code, digit| code * base + digit as u128 + 1)
    }

    /// Returns the node with this [`Code::self_delimiting`] code; `None` if a digit is 0 or there
    /// are too many.
    pub fn from_self_delimiting(dimension: Dimension, mut number: u128) -> Option<Code> {
        let base = dimension.children() as u128 + 1;
        let mut digits = Vec::new();
        while number > 0 {
            digits.push(((number % base) as usize).checked_sub(1)?);
            number /= base;
        }
        Code::from_digits(dimension, digits.into_iter().rev())
    }

    /// Parses the format of `Display`: `/` and a digit for each level.
    ///
    /// # Errors
    /// If the string is no code of a tree of this dimension.
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

    /// Returns the quadkey of a web map tile: one digit 0 to 3 per level, empty for the whole
    /// world. For quadtrees.
    pub fn quadkey(self) -> String {
        self.digits().map(|digit| (b'0' + digit as u8) as char).collect()
    }

    /// Returns the quadtree node with this quadkey; `None` if the key is invalid.
    pub fn from_quadkey(key: &str) -> Option<Code> {
        let digits: Option<Vec<usize>> =
            key.bytes().map(|digit| digit.checked_sub(b'0').map(usize::from)).collect();
        Code::from_digits(Dimension::Quad, digits?)
    }

    /// Returns zoom, column and row of the web map tile (`z/x/y`). For quadtrees.
    pub fn zxy(self) -> (u8, u32, u32) {
        let [x, y, _] = self.cell();
        (self.level(), x, y)
    }

    /// Returns the quadtree node of a web map tile; `None` if there is none.
    pub fn from_zxy(z: u8, x: u32, y: u32) -> Option<Code> {
        Code::from_cell(Dimension::Quad, z, [x, y, 0])
    }
}

/// Moves bit `i` of a coordinate to bit `i * axes`: Morton interleaving for one coordinate. Z order
/// is the order of the combined bits of all coordinates.
#[inline]
pub fn morton_encode(dimension: Dimension, x: u32) -> u64 {
    match dimension {
        Dimension::Quad => morton_encode_2(x),
        Dimension::Oct => morton_encode_3(x),
    }
}

/// One step of [`morton_encode_2`] and [`morton_encode_3`]. They are unrolled, since loops over
/// arrays are slow without optimization.
#[inline(always)]
fn spread(x: u64, shift: u32, mask: u64) -> u64 {
    (x | x << shift) & mask
}

/// One step of the inverse functions.
#[inline(always)]
fn gather(x: u64, shift: u32, mask: u64) -> u64 {
    (x | x >> shift) & mask
}

#[inline]
fn morton_encode_2(x: u32) -> u64 {
    // Each step splits every group of bits and leaves a gap between its halves as wide as one half.
    // Five steps reduce groups of 32 bits to single bits.
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
    // As for two axes, with gaps twice as wide. 64 bits hold three times 21 bits.
    let mut x = x as u64 & 0x1F_FFFF;
    x = spread(x, 32, 0x001F_0000_0000_FFFF);
    x = spread(x, 16, 0x001F_0000_FF00_00FF);
    x = spread(x, 8, 0x100F_00F0_0F00_F00F);
    x = spread(x, 4, 0x10C3_0C30_C30C_30C3);
    x = spread(x, 2, 0x1249_2492_4924_9249);
    x
}

/// Inverse of [`morton_encode_2`]; ignores the other axis's bits.
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

/// Inverse of [`morton_encode_3`]; ignores the other axes' bits.
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

/// Formats the path as digits, `0` to `3` or `7`, after a slash: `/` is the root, `/103` a node at
/// level 3.
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
