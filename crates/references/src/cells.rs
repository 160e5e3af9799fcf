//! Cells of regions, gathered from the chunks of sources.

use std::path::Path;

use super::list::SourceList;
use super::pixels::{apply_opacity, paint};
use super::placements::{MappedWindow, MappedWindowIndex, union};
use super::sources::{ChunkPosition, Decoder, OpenSource, Sources};
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::io::{FileStat, ReadBackend};
use spinney_base::space::Region;
use spinney_base::value::{Value, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_chunks::ChunkSelection;
use spinney_container::{Codec, Finding, Header, MAX_FINDINGS};
use spinney_engine::store::Slab;
use spinney_engine::store::goblin::{ReferencedCells, ReferringFile, register_references};

/// Lets the engine read cells of indexes in this process.
pub fn register() {
    register_references(open);
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
        // (Painting relies on the number of channels, and on the rule's channel. Windows and
        // channels of sources are checked when a source is read.)
        let fits = |placement: &MappedWindow| {
            let rule = &list.rules[placement.rule as usize];
            all.contains(&placement.cells)
                && list.channels[placement.channels as usize].len() == usize::from(value.channels)
                && rule.opacity.is_none_or(|channel| channel < value.channels.into())
                && rule.nodata.as_ref().is_none_or(|nodata| nodata.len() == value.size())
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
    let cells = IndexedCells { sources, layers };
    // A single page is fetched with what else opening reads.
    if let [page] = &cells.sources.list.pages[..] {
        let start = file.pages.offset + page.location.offset;
        let range = start..start + u64::from(page.location.length);
        file.bytes.prefetch(std::slice::from_ref(&range))?;
    }
    Ok(Box::new(cells))
}

/// The cells of an index.
struct IndexedCells {
    sources: Sources,
    layers: Vec<IndexedLayer>,
}

struct IndexedLayer {
    placements: MappedWindowIndex,
    value: ValueType,
    nodata: Option<Value>,
}

/// Maximum number of placements that touch a region that is read.
const MAX_TOUCHING: usize = 1 << 16;

/// Pixels of a region that are known so far.
struct Canvas {
    region: Region,
    bytes: Vec<u8>,
    covered: Vec<bool>,
}

impl Canvas {
    fn new(region: Region, value: ValueType) -> Canvas {
        let area = region.area() as usize;
        Canvas { region, bytes: vec![0; area * value.size()], covered: vec![false; area] }
    }

    /// Returns whether the pixels of a part are known, row by row.
    fn rows(&mut self, part: Region) -> impl Iterator<Item = &mut [bool]> {
        let [left, top] = [part.x - self.region.x, part.y - self.region.y].map(|at| at as usize);
        let rows = self.covered.chunks_exact_mut(self.region.width as usize);
        let rows = rows.skip(top).take(part.height as usize);
        rows.map(move |row| &mut row[left..left + part.width as usize])
    }

    /// Marks the pixels of a part as known.
    fn cover(&mut self, part: Region) {
        self.rows(part).for_each(|row| row.fill(true));
    }

    /// Returns the smallest part of some cells that has all of their pixels that are not known;
    /// `None` if all are known.
    fn unknown(&mut self, cells: Region) -> Option<Region> {
        let part = cells.intersect(&self.region);
        let of_row = |(y, row): (u64, &mut [bool])| {
            let first = row.iter().position(|known| !known)?;
            let end = row.iter().rposition(|known| !known)? + 1;
            Some(Region::new(part.x + first as u64, y, (end - first) as u64, 1))
        };
        (part.y..).zip(self.rows(part)).filter_map(of_row).reduce(union)
    }
}

impl ReferencedCells for IndexedCells {
    fn read(&self, bytes: &dyn ReadBackend, layer: usize, region: Region) -> Result<Slab> {
        let IndexedLayer { placements, value, .. } = &self.layers[layer];
        let touching = placements.touching(&region);
        if touching.len() > MAX_TOUCHING {
            let found = format!("{} sources in cells {region:?}", touching.len());
            return Err(Error::corrupt(
                &self.sources.path,
                "list of sources",
                found,
                MAX_TOUCHING.to_string(),
            ));
        }
        let mut canvas = Canvas::new(region, *value);
        let mut decoder = self.sources.decoder();
        let mut is_unread = false;
        // From the top down: a source is read only where no other is above it.
        for placement in touching.into_iter().rev() {
            let Some(part) = canvas.unknown(placement.cells) else { continue };
            let painted = self.paint(bytes, *value, (placement, part), &mut canvas, &mut decoder);
            if defer_missing(painted, &mut is_unread)?.is_none() && self.is_opaque(bytes, placement) {
                // (This pass is discarded. The sources below are not needed in the next one
                // either.)
                canvas.cover(part);
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
            for image in (0..2).filter(|image| open.source.image(*image).is_some()) {
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

    fn verify(
        &self,
        bytes: &dyn ReadBackend,
        with_files: bool,
        progress: &dyn Progress,
    ) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        let corrupt = |error: Error| Finding { place: "sources".into(), problem: error.to_string() };
        if with_files {
            let files: Vec<_> =
                self.sources.list.virtual_rasters.iter().map(|file| (&*file.name, file.stat())).collect();
            self.compare_files(&files, &mut findings)?;
        }
        for page in 0..self.sources.list.pages.len() {
            progress.check()?;
            let sources = match self.sources.read_page(bytes, page) {
                Ok((_, sources)) => sources,
                Err(error @ Error::Corrupt { .. }) => {
                    findings.push(corrupt(error));
                    continue;
                }
                Err(error) => return Err(error),
            };
            if with_files {
                let files: Vec<_> = sources.iter().map(|source| (&*source.name, source.stat())).collect();
                self.compare_files(&files, &mut findings)?;
            }
            for source in sources {
                match self.sources.check_tables(bytes, source) {
                    Err(error @ Error::Corrupt { .. }) => findings.push(corrupt(error)),
                    checked => checked?,
                }
            }
            findings.truncate(MAX_FINDINGS);
        }
        Ok(findings)
    }

    fn sources(&self) -> usize {
        self.sources.list.sources as usize
    }

    fn visit_sources(
        &self,
        bytes: &dyn ReadBackend,
        visit: &mut dyn FnMut(&str, FileStat) -> Result<bool>,
    ) -> Result<()> {
        for page in 0..self.sources.list.pages.len() {
            for source in self.sources.read_page(bytes, page)?.1 {
                if !visit(&source.name, source.stat())? {
                    return Ok(());
                }
            }
        }
        Ok(())
    }
}

/// Returns the pixels of a placement's source for some of its cells.
fn source_region(placement: &MappedWindow, cells: &Region) -> Region {
    let MappedWindow { cells: all, from, .. } = placement;
    Region::new(cells.x - all.x + from[0], cells.y - all.y + from[1], cells.width, cells.height)
}

impl IndexedCells {
    /// Compares files with their names, lengths and versions in the index.
    fn compare_files(&self, files: &[(&str, FileStat)], findings: &mut Vec<Finding>) -> Result<()> {
        let paths = files.iter().map(|(name, _)| self.sources.path_of(name)).collect::<Result<Vec<_>>>()?;
        let paths: Vec<&Path> = paths.iter().map(|path| &**path).collect();
        for ((name, indexed), found) in files.iter().zip(self.sources.access.stat(&paths)?) {
            let problem = match found {
                Ok(Some(found)) if found.agrees(indexed) => continue,
                Ok(Some(found)) if found.length != indexed.length => {
                    format!("{} bytes, expected {}", found.length, indexed.length)
                }
                Ok(Some(_)) => "another version than was indexed".into(),
                Ok(None) => "it is missing".into(),
                Err(error) => error.to_string(),
            };
            findings.push(Finding { place: format!("source {name}"), problem });
        }
        Ok(())
    }

    /// Whether no pixel of a placement is VOID, according to what is known of its source.
    fn is_opaque(&self, bytes: &dyn ReadBackend, placement: &MappedWindow) -> bool {
        let rule = &self.sources.list.rules[placement.rule as usize];
        let has_no_mask = || {
            let source = self.sources.source(bytes, placement.source);
            rule.ignores_mask || source.is_ok_and(|open| open.source.mask.is_none())
        };
        rule.is_none() && rule.hidden_opacity.is_none() && has_no_mask()
    }

    /// Paints the cells of a part of a placement that are not known yet.
    fn paint(
        &self,
        bytes: &dyn ReadBackend,
        value: ValueType,
        (placement, part): (&MappedWindow, Region),
        canvas: &mut Canvas,
        decoder: &mut Decoder,
    ) -> Result<()> {
        let open = self.sources.source(bytes, placement.source)?;
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
        if let Some(channel) = rule.hidden_opacity {
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
                        // (Pixels of a mask are 0 already.)
                        if image == 1 {
                            continue;
                        }
                        let hole = &open.source.hole[..];
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
