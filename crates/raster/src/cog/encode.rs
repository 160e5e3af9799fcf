//! Encoder of tiles: reads their cells from the tree and compresses them.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::layout::LevelTiles;
use crate::image::ImageSpec;
use crate::image::tiff::{MASK_CODER, mask_rows};
use crate::image::tiff_coding::Coding;
use spinney_base::Result;
use spinney_base::space::Bounds;
use spinney_base::value::Number;
use spinney_engine::dataset::Dataset;

/// Maximum number of cached uniform tiles; most maps have fewer values.
const MAX_KEPT: usize = 1 << 10;

/// An encoded tile.
pub(super) struct EncodedTile {
    pub(super) cells: Arc<Vec<u8>>,
    pub(super) mask: Option<Arc<Vec<u8>>>,
}

/// Encoder of tiles.
pub(super) struct Encoder<'a> {
    tree: &'a Dataset,
    /// Bytes per value.
    width: usize,
    /// Whether cells may be VOID, and the number for VOID.
    void: bool,
    fill: Number,
    coding: Coding,
    side: u64,
    has_masks: bool,
    /// Cached tiles of a single value, by the value.
    uniform: Mutex<HashMap<Vec<u8>, Arc<Vec<u8>>>>,
    full_mask: Arc<Vec<u8>>,
}

impl Encoder<'_> {
    pub(super) fn new<'a>(
        tree: &'a Dataset,
        spec: &ImageSpec,
        fill: Number,
        coding: Coding,
        side: u64,
        has_masks: bool,
    ) -> Encoder<'a> {
        let full_mask = Arc::new(MASK_CODER.compress(vec![0xff; (side * side / 8) as usize]));
        let (width, void) = (spec.value.size(), spec.void);
        let uniform = Mutex::default();
        Encoder { tree, width, void, fill, coding, side, has_masks, uniform, full_mask }
    }

    /// Encodes a tile of a level, or returns `None` if all of its cells are VOID. Cells outside of
    /// the raster are VOID.
    pub(super) fn encode(&self, level: &LevelTiles, number: u64) -> Result<Option<EncodedTile>> {
        let [column, row] = level.corner(number);
        let bounds = Bounds { min: [column, row, 0], max: [column + self.side, row + self.side, 1] };
        let cells = (self.side * self.side) as usize;
        let mut bytes = vec![0; cells * self.width];
        let mut valid = vec![false; if self.void { cells } else { 0 }];
        let flags = self.void.then_some(valid.as_mut_slice());
        self.tree.window(level.level, &bounds, self.fill, &mut bytes, flags)?;
        if self.void && !valid.contains(&true) {
            return Ok(None);
        }
        let mask = self.has_masks.then(|| self.mask(&valid));
        Ok(Some(EncodedTile { cells: self.compress(bytes), mask }))
    }

    fn compress(&self, bytes: Vec<u8>) -> Arc<Vec<u8>> {
        let (value, is_uniform) =
            (&bytes[..self.width], bytes[self.width..] == bytes[..bytes.len() - self.width]);
        if !is_uniform {
            return Arc::new(self.coding.compress(bytes));
        }
        let value = value.to_vec();
        let kept = || self.uniform.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(tile) = kept().get(&value) {
            return tile.clone();
        }
        let tile = Arc::new(self.coding.compress(bytes));
        let mut kept = kept();
        if kept.len() < MAX_KEPT {
            kept.insert(value, tile.clone());
        }
        tile
    }

    fn mask(&self, valid: &[bool]) -> Arc<Vec<u8>> {
        if !valid.contains(&false) {
            return self.full_mask.clone();
        }
        let mut rows = Vec::new();
        mask_rows(valid, self.side as usize, &mut rows);
        Arc::new(MASK_CODER.compress(rows))
    }
}
