//! All that an index says about its sources, for an update.

use super::list::{IndexedFile, SourceList};
use super::pages::DescribedSource;
use super::pixels::PixelRule;
use super::placements::MappedWindow;
use super::sources::Sources;
use spinney_base::Result;
use spinney_chunks::ChunkFormat;
use spinney_engine::store::goblin::ReferringFile;

/// All that an index says about its sources.
pub struct IndexContents {
    /// How chunks are stored, by number.
    pub formats: Vec<ChunkFormat>,
    /// Rules for VOID pixels, by number.
    pub rules: Vec<PixelRule>,
    /// Lists of channels, by number.
    pub channels: Vec<Vec<u16>>,
    /// Placements of each layer, from the bottom to the top.
    pub layers: Vec<Vec<MappedWindow>>,
    /// Virtual rasters that arrange sources.
    pub virtual_rasters: Vec<IndexedFile>,
    /// Sources, and the chunks of their images and masks.
    pub sources: Vec<DescribedSource>,
}

impl IndexContents {
    /// Reads the contents of an index.
    ///
    /// # Errors
    /// If they are corrupt, or cannot be read.
    pub fn read(file: &ReferringFile<'_>) -> Result<IndexContents> {
        let list = SourceList::read(file)?;
        let layers = (0..file.headers.len()).map(|layer| list.placements(file.path, layer));
        let layers = layers.collect::<Result<Vec<_>>>()?;
        let all = Sources::new(file.path, list, file.pages, file.access);
        let mut sources = Vec::new();
        for page in 0..all.list.pages.len() {
            for source in all.read_page(file.bytes, page)?.1 {
                let open = all.opened(source);
                let mut chunks = [Vec::new(), Vec::new()];
                for (image, chunks) in chunks.iter_mut().enumerate() {
                    for number in 0..open.source.image(image).map_or(0, |image| image.chunks) {
                        let at = all.position(&open.source, image, number);
                        chunks.push(all.chunk_of(file.bytes, &open, at)?.1);
                    }
                }
                sources.push((open.source, chunks));
            }
        }
        let SourceList { formats, rules, channels, virtual_rasters, .. } = all.list;
        Ok(IndexContents { formats, rules, channels, layers, virtual_rasters, sources })
    }
}
