//! A raster as what the tree builder takes.

use std::mem;

use super::validity::Validity;
use super::{Order, Pixels, Raster};
use spinney_base::Result;
use spinney_base::space::{Code, CodeRun, Dimension, Region};
use spinney_engine::store::{Slab, Slabs};

/// Cells along a side of the builder's blocks.
pub(super) const BLOCK: u64 = 256;
/// Cells along a side of a square, if memory allows: room for several tiles, and for all threads.
const SIDE: u64 = 1024;

/// The part of a raster or volume that is wanted: nodes of a run, in a tree of so many levels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted {
    pub(crate) run: CodeRun,
    pub(crate) depth: u8,
}

impl Wanted {
    /// The node that has a square or cube, whose side is a power of two, and which lies at a multiple of that; nothing where the tree has none.
    fn node(self, dimension: Dimension, first: [u64; 3], side: u64) -> Option<Code> {
        let height = self.depth.min(side.trailing_zeros() as u8);
        let cell = first.map(|place| u32::try_from(place >> height).ok());
        let [Some(x), Some(y), Some(z)] = cell else { return None };
        Code::from_cell(dimension, self.depth - height, [x, y, z])
    }

    fn node_of(self, square: &Region) -> Option<Code> {
        self.node(Dimension::Quad, [square.x, square.y, 0], square.width)
    }

    /// Whether something of a square is wanted.
    pub(super) fn touches(self, square: &Region) -> bool {
        self.node_of(square).is_some_and(|node| self.run.touches(node))
    }

    /// Whether all of it is.
    fn contains(self, square: &Region) -> bool {
        self.node_of(square).is_some_and(|node| self.run.contains(node))
    }

    /// Whether something of a cube is wanted, and whether all of it is.
    pub(crate) fn of_cube(self, first: [u64; 3], side: u64) -> (bool, bool) {
        let node = self.node(Dimension::Oct, first, side);
        node.map_or((false, false), |node| (self.run.touches(node), self.run.contains(node)))
    }
}

/// A raster slab by slab: bands of 256 rows, or squares in FD order for rasters that can be read anywhere, so
/// that parts of the tree are finished early and tiles are decoded once.
pub struct RasterSlabs {
    raster: Box<dyn Raster>,
    opacity: Validity,
    /// Squares that are still to be read, the next one last; larger ones than `side` are divided when their
    /// turn comes.
    squares: Vec<Region>,
    side: u64,
    next_row: u64,
    /// The part of the raster that squares are of.
    wanted: Option<Wanted>,
}

impl RasterSlabs {
    /// The slabs of a raster. Squares are chosen so small that two of them fit in `memory` bytes, if
    /// possible.
    pub fn new(raster: Box<dyn Raster>, memory: u64) -> RasterSlabs {
        let info = raster.info();
        // A flag per pixel may come with the samples.
        let cell = info.pixel_bytes() as u64 + 1;
        let mut side = SIDE;
        while side > BLOCK && 2 * side * side * cell > memory {
            side /= 2;
        }
        let whole = info.width.max(info.height).next_power_of_two().max(side);
        let opacity = Validity::by_opacity(info);
        let squares = vec![Region::new(0, 0, whole, whole)];
        RasterSlabs { raster, opacity, squares, side, next_row: 0, wanted: None }
    }

    /// Leaves only squares that have something wanted, of a raster that can be read anywhere.
    pub(super) fn within(self, wanted: Wanted) -> RasterSlabs {
        RasterSlabs { wanted: Some(wanted), ..self }
    }

    fn next_band(&mut self) -> Option<Region> {
        let info = self.raster.info();
        let y = self.next_row;
        let height = BLOCK.min(info.height - y);
        self.next_row += height;
        (height > 0).then(|| Region::new(0, y, info.width, height))
    }

    fn next_square(&mut self) -> Option<Region> {
        let info = self.raster.info();
        let extent = Region::new(0, 0, info.width, info.height);
        loop {
            let square = self.squares.pop()?;
            let inside = square.intersect(&extent);
            if inside.is_empty() || self.wanted.is_some_and(|wanted| !wanted.touches(&square)) {
                continue;
            }
            let is_whole = self.wanted.is_none_or(|wanted| wanted.contains(&square));
            if square.width <= self.side && (is_whole || square.width <= BLOCK) {
                return Some(inside);
            }
            let half = square.width / 2;
            // In reverse, since the last one is taken first.
            let quarters = [[half, half], [0, half], [half, 0], [0, 0]];
            let quarters = quarters.map(|[x, y]| Region::new(square.x + x, square.y + y, half, half));
            self.squares.extend(quarters);
        }
    }
}

impl Slabs for RasterSlabs {
    fn extent(&self) -> [u64; 3] {
        [self.raster.info().width, self.raster.info().height, 1]
    }

    fn are_in_order(&self) -> bool {
        self.raster.info().order == Order::Anywhere
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        let region = match self.raster.info().order {
            Order::Bands => self.next_band(),
            Order::Anywhere => self.next_square(),
        };
        let Some(region) = region else { return Ok(false) };
        let mut pixels = Pixels { bytes: mem::take(&mut slab.bytes), valid: slab.valid.take() };
        self.raster.read(region, &mut pixels)?;
        self.opacity.apply(&mut pixels);
        let Pixels { bytes, valid } = pixels;
        *slab =
            Slab { origin: [region.x, region.y, 0], size: [region.width, region.height, 1], bytes, valid };
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::super::fake::Fake;
    use super::super::{Order, RasterInfo};
    use super::*;
    use spinney_base::value::SampleType;

    fn slabs(size: [u64; 2], order: Order, memory: u64) -> Vec<Slab> {
        let info = RasterInfo { order, ..RasterInfo::plain(size, SampleType::U8, 1) };
        let bytes = (0..size[0] * size[1]).map(|i| (i * 7 / 5) as u8).collect();
        let mut slabs = RasterSlabs::new(Box::new(Fake::new(info, bytes)), memory);
        let mut slab = Slab::default();
        std::iter::from_fn(|| slabs.next(&mut slab).unwrap().then(|| slab.clone())).collect()
    }

    #[test]
    fn slabs_cover_the_raster_once() {
        for (size, order, memory, expected) in [
            ([700, 600], Order::Bands, 0, 3),
            ([700, 600], Order::Anywhere, 0, 9),
            ([700, 600], Order::Anywhere, 1 << 20, 4),
            ([700, 600], Order::Anywhere, 1 << 30, 1),
            ([3000, 1], Order::Anywhere, 1 << 30, 3),
            ([1, 1], Order::Anywhere, 1 << 30, 1),
            ([1, 1], Order::Bands, 1 << 30, 1),
        ] {
            let slabs = slabs(size, order, memory);
            assert_eq!(slabs.len(), expected, "{size:?} {order:?} {memory}");
            let mut covered = vec![false; (size[0] * size[1]) as usize];
            for slab in slabs {
                assert!(slab.origin.iter().all(|start| start % BLOCK == 0));
                let cells = (0..slab.size[1]).flat_map(|y| (0..slab.size[0]).map(move |x| (x, y)));
                for ((x, y), byte) in cells.zip(&slab.bytes) {
                    let index = (slab.origin[1] + y) * size[0] + slab.origin[0] + x;
                    assert_eq!(*byte, (index * 7 / 5) as u8);
                    assert!(!std::mem::replace(&mut covered[index as usize], true));
                }
            }
            assert!(!covered.contains(&false));
        }
    }

    #[test]
    fn squares_come_in_fd_order() {
        let origins: Vec<_> = slabs([1000, 600], Order::Anywhere, 0).iter().map(|slab| slab.origin).collect();
        let first = [[0, 0], [256, 0], [0, 256], [256, 256], [512, 0], [768, 0]].map(|[x, y]| [x, y, 0]);
        assert_eq!(origins[..6], first);
    }

    #[test]
    fn squares_of_a_run_are_those_that_it_touches() {
        let info = RasterInfo { order: Order::Anywhere, ..RasterInfo::plain([1000, 900], SampleType::U8, 1) };
        let fake = || Box::new(Fake::new(info.clone(), vec![1; 900_000]));
        let node = |digits: &[usize]| Code::from_digits(Dimension::Quad, digits.iter().copied()).unwrap();
        let origins = |run| {
            let mut slabs = RasterSlabs::new(fake(), 1 << 30).within(Wanted { run, depth: 10 });
            let mut slab = Slab::default();
            std::iter::from_fn(|| slabs.next(&mut slab).unwrap().then_some((slab.origin, slab.size[0])))
                .collect::<Vec<_>>()
        };
        let run = CodeRun::of(node(&[0, 3]), node(&[1])).unwrap();
        assert_eq!(origins(run), [([256, 256, 0], 256), ([512, 0, 0], 488)]);
        assert_eq!(origins(CodeRun::ALL), [([0, 0, 0], 1000)]);
    }

    #[test]
    fn transparent_pixels_are_void() {
        let info = RasterInfo { alpha: Some(1), ..RasterInfo::plain([3, 1], SampleType::U8, 2) };
        let mut slabs = RasterSlabs::new(Box::new(Fake::new(info, vec![1, 0, 2, 1, 3, 255])), 0);
        let mut slab = Slab::default();
        assert!(slabs.next(&mut slab).unwrap());
        assert_eq!(slab.valid, Some(vec![false, true, true]));
        assert!(!slabs.next(&mut slab).unwrap());
    }
}
