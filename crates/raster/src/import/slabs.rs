//! Adapter from a raster to the slabs of the tree builder.

use std::collections::VecDeque;
use std::mem;

use super::validity::Validity;
use super::{Order, Pixels, Raster};
use spinney_base::Result;
use spinney_base::space::{CodeRange, Dimension, Region};
use spinney_engine::store::{Slab, SlabBoxes, Slabs, WantedCells, depth_for};

/// Cells per side of the builder's blocks.
pub(super) const BLOCK: u64 = SlabBoxes::least_side(Dimension::Quad);
/// Cells per side of a square, if memory allows: several tiles, and enough work for all threads.
const SIDE: u64 = 1024;

/// A raster in slabs: bands of 256 rows, or squares in FD order for rasters that can be read
/// anywhere. In FD order subtrees are completed early, and tiles are decoded once.
pub struct RasterSlabs {
    raster: Box<dyn Raster>,
    opacity: Validity,
    squares: SlabBoxes,
    /// Maximum number of cells per side of a square.
    side: u64,
    /// The next squares.
    ahead: VecDeque<Region>,
    /// Number of these that were announced to the raster.
    announced: usize,
    next_row: u64,
}

/// Maximum number of squares that are announced together: in FD order, a square of four by four.
const AHEAD: usize = 16;

impl RasterSlabs {
    /// The slabs of a raster. Squares are so small that two of them fit `memory` bytes, if
    /// possible.
    pub fn new(raster: Box<dyn Raster>, memory: u64) -> RasterSlabs {
        let info = raster.info();
        // A validity flag per pixel may be added to the samples.
        let cell = info.pixel_bytes() as u64 + 1;
        let mut side = SIDE;
        while side > BLOCK && 2 * side * side * cell > memory {
            side /= 2;
        }
        let opacity = Validity::by_opacity(info);
        let extent = [info.width, info.height, 1];
        let all = WantedCells { dimension: Dimension::Quad, depth: depth_for(extent), run: CodeRange::ALL };
        RasterSlabs {
            raster,
            opacity,
            squares: SlabBoxes::new(extent, all, side),
            side,
            ahead: VecDeque::new(),
            announced: 0,
            next_row: 0,
        }
    }

    /// Restricts a raster that can be read anywhere to squares with wanted cells.
    pub(super) fn within(self, wanted: WantedCells) -> RasterSlabs {
        RasterSlabs { squares: SlabBoxes::new(self.extent(), wanted, self.side), ..self }
    }

    fn next_band(&mut self) -> Option<Region> {
        let info = self.raster.info();
        let y = self.next_row;
        let height = BLOCK.min(info.height - y);
        self.next_row += height;
        (height > 0).then(|| Region::new(0, y, info.width, height))
    }

    fn next_square(&mut self) -> Result<Option<Region>> {
        if self.announced == 0 {
            let square =
                |([x, y, _], [width, height, _]): ([u64; 3], [u64; 3])| Region::new(x, y, width, height);
            self.ahead.extend(self.squares.by_ref().take(AHEAD - self.ahead.len()).map(square));
            self.announced = self.raster.prefetch(self.ahead.make_contiguous())?;
        }
        self.announced = self.announced.saturating_sub(1);
        Ok(self.ahead.pop_front())
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
            Order::Anywhere => self.next_square()?,
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
    fn transparent_pixels_are_void() {
        let info = RasterInfo { alpha: Some(1), ..RasterInfo::plain([3, 1], SampleType::U8, 2) };
        let mut slabs = RasterSlabs::new(Box::new(Fake::new(info, vec![1, 0, 2, 1, 3, 255])), 0);
        let mut slab = Slab::default();
        assert!(slabs.next(&mut slab).unwrap());
        assert_eq!(slab.valid, Some(vec![false, true, true]));
        assert!(!slabs.next(&mut slab).unwrap());
    }
}
