//! Cells of regions, gathered from the chunks of sources.

use std::path::Path;

use super::list::SourceList;
use super::pixels::{apply_opacity, paint};
use super::placements::{MappedWindow, MappedWindowIndex};
use super::sources::{ChunkPosition, Decoder, OpenSource, Sources};
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::io::{FileStat, ReadBackend};
use spinney_base::space::Region;
use spinney_base::value::{Value, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_chunks::ChunkSelection;
use spinney_container::{Codec, Finding, Header, MAX_FINDINGS, Section};
use spinney_engine::store::Slab;
use spinney_engine::store::goblin::{OpenReferences, ReferencedCells, ReferringFile, register_references};

/// Lets the engine read cells of indexes in this process.
pub fn register() {
    register_references(&Reader);
}

/// The reader of cells in other files.
struct Reader;

impl OpenReferences for Reader {
    fn open(&self, file: &ReferringFile<'_>) -> Result<Box<dyn ReferencedCells>> {
        open(file)
    }
}

/// Opens the cells that a file refers to. Opens none of the other files.
///
/// # Errors
/// If the sections are corrupt, or cannot be read.
pub fn open(file: &ReferringFile<'_>) -> Result<Box<dyn ReferencedCells>> {
    let list = SourceList::read(file)?;
    let layer = |(number, header): (usize, &Header)| {
        let (value, extent) = (header.form.value, header.extent);
        let placements = list.placements(file.path, number)?;
        let all = Region::new(0, 0, extent[0], extent[1]);
        let fits = |placement: &MappedWindow| {
            let alpha = list.rules[placement.rule as usize].alpha;
            all.contains(&placement.cells)
                && list.channels[placement.channels as usize].len() == usize::from(value.channels)
                && alpha.is_none_or(|alpha| alpha < value.channels.into())
        };
        if header.codec == Codec::Reference && !placements.iter().all(fits) {
            let expected = "cells within the extent, and as many channels as the layer has";
            return Err(Error::corrupt(file.path, "list of sources", "other placements", expected));
        }
        let nodata = list.layers[number].nodata.as_ref();
        if let Some(other) = nodata.filter(|nodata| nodata.len() != value.size()) {
            let found = format!("a nodata value of {} bytes", other.len());
            return Err(Error::corrupt(file.path, "list of sources", found, value.size().to_string()));
        }
        let nodata = nodata.map(|bytes| Value::from_bytes(bytes));
        Ok(IndexedLayer { placements: MappedWindowIndex::new(placements), value, nodata })
    };
    let layers = file.headers.iter().enumerate().map(layer).collect::<Result<_>>()?;
    let sources = Sources::new(file.path, list, file.pages, file.access);
    let cells = IndexedCells { sources, layers, pages: file.pages };
    // A single page is fetched with what else opening reads.
    if cells.sources.list.pages.len() == 1 {
        file.bytes.prefetch(&[cells.page_range(0)])?;
    }
    Ok(Box::new(cells))
}

/// The cells of an index.
struct IndexedCells {
    sources: Sources,
    layers: Vec<IndexedLayer>,
    pages: Section,
}

struct IndexedLayer {
    placements: MappedWindowIndex,
    value: ValueType,
    nodata: Option<Value>,
}

/// Pixels of a region that are known so far.
struct Canvas {
    region: Region,
    bytes: Vec<u8>,
    covered: Vec<bool>,
}

impl ReferencedCells for IndexedCells {
    fn read(&self, bytes: &dyn ReadBackend, layer: usize, region: Region) -> Result<Slab> {
        let IndexedLayer { placements, value, .. } = &self.layers[layer];
        let area = region.area() as usize;
        let mut canvas = Canvas { region, bytes: vec![0; area * value.size()], covered: vec![false; area] };
        let mut decoder = self.sources.decoder();
        let mut is_unread = false;
        // From the top down, until all cells are known.
        for placement in placements.touching(&region).into_iter().rev() {
            let painted = self.paint(bytes, *value, placement, &mut canvas, &mut decoder);
            defer_missing(painted, &mut is_unread)?;
            if !canvas.covered.contains(&false) {
                break;
            }
        }
        self.sources.put_back(decoder);
        finish_deferred(is_unread)?;
        let Canvas { bytes, covered, .. } = canvas;
        let valid = covered.contains(&false).then_some(covered);
        Ok(Slab { origin: [region.x, region.y, 0], size: [region.width, region.height, 1], bytes, valid })
    }

    fn nodata(&self, layer: usize) -> Option<Value> {
        self.layers[layer].nodata
    }

    fn announce(&self, bytes: &dyn ReadBackend, layer: usize, region: Region) {
        for placement in self.layers[layer].placements.touching(&region) {
            let Ok(open) = self.sources.source(bytes, placement.source) else { continue };
            let part = placement.cells.intersect(&region);
            let from = source_region(placement, &part);
            for image in 0..1 + usize::from(open.source.mask.is_some()) {
                let format = self.sources.format(&open.source, image);
                let (across, down) = (from.x / format.chunk_width, from.y / format.chunk_height);
                if across * format.chunk_width < open.source.size[0]
                    && down * format.chunk_height < open.source.size[1]
                {
                    // (Its missing bytes are recorded.)
                    let _ =
                        self.sources.chunk_of(bytes, &open, ChunkPosition { image, plane: 0, across, down });
                }
            }
        }
    }

    fn verify(&self, bytes: &dyn ReadBackend, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        for page in 0..self.sources.list.pages.len() {
            progress.check()?;
            let sources = match self.sources.read_page(bytes, page) {
                Ok((_, sources)) => sources,
                Err(error @ Error::Corrupt { .. }) => {
                    findings.push(Finding { place: "sources".into(), problem: error.to_string() });
                    continue;
                }
                Err(error) => return Err(error),
            };
            let paths =
                sources.iter().map(|source| self.sources.path_of(source)).collect::<Result<Vec<_>>>()?;
            let paths: Vec<&Path> = paths.iter().map(|path| &**path).collect();
            for (source, found) in sources.iter().zip(self.sources.access.stat(&paths)?) {
                let problem = match found {
                    Ok(Some(found)) if found.agrees(&source.stat()) => continue,
                    Ok(Some(found)) if found.length != source.length => {
                        format!("{} bytes, expected {}", found.length, source.length)
                    }
                    Ok(Some(_)) => "another version than was indexed".into(),
                    Ok(None) => "it is missing".into(),
                    Err(error) => error.to_string(),
                };
                if findings.len() < MAX_FINDINGS {
                    findings.push(Finding { place: format!("source {}", source.name), problem });
                }
            }
            for source in sources {
                match self.sources.check_tables(bytes, source) {
                    Err(error @ Error::Corrupt { .. }) => {
                        findings.push(Finding { place: "sources".into(), problem: error.to_string() });
                    }
                    checked => checked?,
                }
            }
        }
        Ok(findings)
    }

    fn sources(&self) -> usize {
        self.sources.list.sources as usize
    }

    fn source(&self, bytes: &dyn ReadBackend, number: usize) -> Result<(String, u64)> {
        let open = self.sources.source(bytes, number as u32)?;
        Ok((open.source.name.clone(), open.source.length))
    }

    fn source_stat(&self, bytes: &dyn ReadBackend, number: usize) -> Result<FileStat> {
        Ok(self.sources.source(bytes, number as u32)?.source.stat())
    }
}

/// Returns the pixels of a placement's source for some of its cells.
fn source_region(placement: &MappedWindow, cells: &Region) -> Region {
    let MappedWindow { cells: all, from, .. } = placement;
    Region::new(cells.x - all.x + from[0], cells.y - all.y + from[1], cells.width, cells.height)
}

impl IndexedCells {
    fn page_range(&self, page: usize) -> std::ops::Range<u64> {
        let at = self.sources.list.pages[page].location;
        let start = self.pages.offset.saturating_add(at.offset).min(self.pages.range().end);
        start..start.saturating_add(at.length.into()).min(self.pages.range().end)
    }

    /// Paints the cells of a placement that are not known yet.
    fn paint(
        &self,
        bytes: &dyn ReadBackend,
        value: ValueType,
        placement: &MappedWindow,
        canvas: &mut Canvas,
        decoder: &mut Decoder,
    ) -> Result<()> {
        let open = self.sources.source(bytes, placement.source)?;
        let part = placement.cells.intersect(&canvas.region);
        let from = source_region(placement, &part);
        let channels = &self.sources.list.channels[placement.channels as usize];
        let channels: Vec<usize> = channels.iter().map(|channel| usize::from(*channel)).collect();
        let format = self.sources.format(&open.source, 0);
        let [width, height] = open.source.size;
        let is_good = Region::new(0, 0, width, height).contains(&from)
            && format.sample_format.sample() == value.sample
            && channels.iter().all(|channel| *channel < format.channels());
        if !is_good {
            let found = format!("pixels {from:?} of channels {channels:?} of {}", open.source.name);
            let expected = format!("{width}x{height} pixels of {} channels", format.channels());
            return Err(Error::corrupt(&self.sources.path, "list of sources", found, expected));
        }
        let rule = &self.sources.list.rules[placement.rule as usize];
        let mut samples = vec![0; from.area() as usize * value.size()];
        let mut valid = None;
        let mut is_unread = false;
        let image = self.pixels(bytes, &open, (0, &channels), from, &mut samples, decoder);
        defer_missing(image, &mut is_unread)?;
        if open.source.mask.is_some() && !rule.ignores_mask {
            let format = self.sources.format(&open.source, 1);
            let all: Vec<usize> = (0..format.channels()).collect();
            let mut flags = vec![0; from.area() as usize * format.pixel_bytes()];
            let mask = self.pixels(bytes, &open, (1, &all), from, &mut flags, decoder);
            defer_missing(mask, &mut is_unread)?;
            let flags = flags.chunks_exact(format.pixel_bytes());
            valid = Some(flags.map(|flags| flags.iter().any(|flag| *flag != 0)).collect());
        }
        if let Some(channel) = rule.opacity {
            let channel = usize::from(channel);
            if channel >= format.channels() {
                let found = format!("opacity in channel {channel} of {}", open.source.name);
                let expected = format!("one of {} channels", format.channels());
                return Err(Error::corrupt(&self.sources.path, "list of sources", found, expected));
            }
            let mut opacity = vec![0; from.area() as usize * value.sample.size()];
            let read = self.pixels(bytes, &open, (0, &[channel]), from, &mut opacity, decoder);
            defer_missing(read, &mut is_unread)?;
            apply_opacity(value.sample, &opacity, &mut valid);
        }
        finish_deferred(is_unread)?;
        rule.apply((value.sample, channels.len()), &samples, &mut valid);
        let size = value.size();
        for row in 0..part.height {
            let own = (row * part.width) as usize..((row + 1) * part.width) as usize;
            let to = (part.y - canvas.region.y + row) * canvas.region.width + part.x - canvas.region.x;
            let to = to as usize..to as usize + own.len();
            paint(
                &mut canvas.bytes[to.start * size..to.end * size],
                &mut canvas.covered[to],
                &samples[own.start * size..own.end * size],
                valid.as_ref().map(|valid: &Vec<bool>| &valid[own]),
                size,
            );
        }
        Ok(())
    }

    /// Reads channels of a region of an image of a source.
    fn pixels(
        &self,
        bytes: &dyn ReadBackend,
        open: &OpenSource,
        (image, channels): (usize, &[usize]),
        region: Region,
        out: &mut [u8],
        decoder: &mut Decoder,
    ) -> Result<()> {
        let format = self.sources.format(&open.source, image);
        let (chunk_width, chunk_height) = (format.chunk_width, format.chunk_height);
        let pixel = format.sample_format.sample().size() * channels.len();
        let row_bytes = region.width as usize * pixel;
        let mut is_unread = false;
        for down in region.y / chunk_height..region.bottom().div_ceil(chunk_height) {
            for across in region.x / chunk_width..region.right().div_ceil(chunk_width) {
                let chunk = Region::new(across * chunk_width, down * chunk_height, chunk_width, chunk_height);
                let part = chunk.intersect(&region);
                let left = (part.x - region.x) as usize * pixel;
                let top = (part.y - region.y) as usize;
                let rows = out.chunks_exact_mut(row_bytes).skip(top).take(part.height as usize);
                let mut rows: Vec<&mut [u8]> =
                    rows.map(|row| &mut row[left..left + part.width as usize * pixel]).collect();
                let planes = if format.planes > 1 { channels } else { &[0][..] };
                for (slot, plane) in planes.iter().enumerate() {
                    let at = ChunkPosition { image, plane: *plane as u64, across, down };
                    let decoded = self.sources.decoded(bytes, open, at, decoder);
                    let Some(decoded) = defer_missing(decoded, &mut is_unread)? else { continue };
                    let Some(decoded) = decoded else {
                        let hole = if image == 0 { &open.source.hole[..] } else { &[0][..] };
                        let (skip, step) = if format.planes > 1 { (slot, channels.len()) } else { (0, 1) };
                        let samples = rows
                            .iter_mut()
                            .flat_map(|row| row.chunks_exact_mut(hole.len()).skip(skip).step_by(step));
                        samples.for_each(|sample| sample.copy_from_slice(hole));
                        continue;
                    };
                    let selection = ChunkSelection {
                        left: (part.x - chunk.x) as usize,
                        top: (part.y - chunk.y) as usize,
                        width: part.width as usize,
                        chosen: channels,
                        slot,
                    };
                    format.copy(&mut decoder.states, &decoded, &selection, &mut rows);
                }
            }
        }
        finish_deferred(is_unread)
    }
}
