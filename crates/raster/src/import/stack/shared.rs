//! A file of several layers, opened and read once for all of them.

use std::path::Path;

use super::super::build::RequestedCells;
use super::super::spill::{SpilledChannels, spill_channels};
use super::super::{Raster, RasterOptions};
use super::StackLayer;
use spinney_base::{Progress, Result};

/// A raster whose channels make several layers.
pub(super) enum SharedRaster {
    /// Each layer's channels can be read from the file without the others.
    Separate(Box<dyn Raster>),
    /// Channels are interleaved in the file, so all were read once, into a temporary file.
    Spilled(Box<SpilledChannels>),
}

impl SharedRaster {
    /// Opens the raster of several layers from one image. If its channels are interleaved, the
    /// samples that the first layer needs are read. Temporary files are created in a directory.
    ///
    /// # Errors
    /// If the file cannot be read or has changed, or the temporary file cannot be written; on
    /// cancellation.
    pub(super) fn open(
        layers: &[StackLayer],
        requested: RequestedCells,
        (directory, memory): (&Path, u64),
        progress: &dyn Progress,
    ) -> Result<SharedRaster> {
        let raster = layers[0].open(memory / 2)?;
        if raster.has_separate_channels() {
            return Ok(SharedRaster::Separate(raster));
        }
        let wanted = match requested {
            RequestedCells::Range(wanted) if layers[0].has_cells_of_file() => Some(wanted),
            _ => None,
        };
        let groups = layers.iter().map(StackLayer::channels).collect();
        let spilled = spill_channels(raster, groups, wanted, directory, memory / 2, progress)?;
        Ok(SharedRaster::Spilled(Box::new(spilled)))
    }

    /// The raster of one of the layers, by its index among these.
    pub(super) fn of_layer(&self, number: usize, layer: &StackLayer) -> Option<Box<dyn Raster>> {
        match self {
            SharedRaster::Separate(raster) => raster.separate_channels(&layer.channels()),
            SharedRaster::Spilled(channels) => Some(channels.group(number)),
        }
    }
}

/// Number of layers, from the first on, that share one image.
pub(super) fn alike(layers: &[StackLayer]) -> usize {
    let source = |layer: &StackLayer| {
        let RasterOptions { page, directory, .. } = layer.options;
        (layer.path.clone(), page, directory)
    };
    let first = layers.first().map(source);
    layers.iter().take_while(|layer| Some(source(layer)) == first).count()
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::super::{StackOptions, plan_stack, write_stack};
    use super::*;
    use spinney_base::io::Output;
    use spinney_base::space::Bounds;
    use spinney_base::value::Number;
    use spinney_engine::dataset;

    /// A TIFF file of `bands` bands of 5 x 3 bytes, in separate planes or interleaved.
    fn write(path: &Path, bands: u32, are_planes: bool) {
        let sample = |band: u32, pixel: u32| (band * 7 + pixel) as u8;
        let samples: Vec<u8> = match are_planes {
            true => (0..bands).flat_map(|band| (0..15).map(move |pixel| sample(band, pixel))).collect(),
            false => (0..15).flat_map(|pixel| (0..bands).map(move |band| sample(band, pixel))).collect(),
        };
        let chunks = if are_planes { bands } else { 1 };
        let each = samples.len() as u32 / chunks;
        let tables = 8 + samples.len().next_multiple_of(2) as u32;
        let mut bytes = b"II*\0".to_vec();
        bytes.extend((tables + 8 * chunks).to_le_bytes());
        bytes.extend(&samples);
        bytes.resize(tables as usize, 0);
        (0..chunks).for_each(|chunk| bytes.extend((8 + chunk * each).to_le_bytes()));
        (0..chunks).for_each(|_| bytes.extend(each.to_le_bytes()));
        let [offsets, counts] = if chunks == 1 { [8, each] } else { [tables, tables + 4 * chunks] };
        let tags = [
            (256u16, 1, 5),
            (257, 1, 3),
            (258, 1, 8),
            (259, 1, 1),
            (262, 1, 1),
            (273, chunks, offsets),
            (277, 1, bands),
            (278, 1, 3),
            (279, chunks, counts),
            (284, 1, 1 + u32::from(are_planes)),
        ];
        bytes.extend((tags.len() as u16).to_le_bytes());
        for (tag, count, value) in tags {
            bytes.extend(tag.to_le_bytes());
            bytes.extend(4u16.to_le_bytes());
            bytes.extend(u32::to_le_bytes(count));
            bytes.extend(u32::to_le_bytes(value));
        }
        bytes.extend([0; 4]);
        std::fs::write(path, bytes).unwrap();
    }

    /// Moves a file away when the first cells are written.
    struct Moving(PathBuf, AtomicU64);

    impl Progress for Moving {
        fn advance(&self, _: u64, _: u64) {
            if self.1.fetch_add(1, Ordering::Relaxed) == 0 {
                std::fs::rename(&self.0, self.0.with_extension("moved")).unwrap();
            }
        }
    }

    /// The file is gone when the second layer is written: everything that the layers need was read,
    /// or is open.
    #[test]
    fn a_file_of_many_bands_is_opened_once() {
        let directory = tempfile::tempdir().unwrap();
        let (input, output) = (directory.path().join("a.tif"), directory.path().join("a.goblin"));
        for are_planes in [false, true] {
            write(&input, 300, are_planes);
            let stack = plan_stack(std::slice::from_ref(&input), &StackOptions::new()).unwrap();
            assert_eq!(alike(&stack.layers), 300);
            let moving = Moving(input.clone(), AtomicU64::new(0));
            write_stack(&stack, Output::create(&output).unwrap(), &moving).unwrap();
            assert!(!input.exists(), "{are_planes}: moved before it was read to the end");
            for band in [0u32, 1, 150, 299] {
                let access = spinney_base::io::FileAccess::default();
                let tree = dataset::open(&output, &(&access).into())
                    .unwrap()
                    .layer(&format!("a_{}", band + 1))
                    .unwrap();
                let mut cells = [0; 15];
                let bounds = Bounds { min: [0; 3], max: [5, 3, 1] };
                tree.window(tree.depth(), &bounds, Number::default(), &mut cells, None).unwrap();
                assert!(cells.iter().zip(0..).all(|(cell, pixel)| *cell == (band * 7 + pixel) as u8));
            }
        }
    }
}
