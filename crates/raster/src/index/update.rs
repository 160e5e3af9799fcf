//! Updates of indexes: only sources that were changed or added are read.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::names::name_in_index;
use super::recorder::RecordedSource;
use super::{IndexPlan, RecordedChunks, RecordedImage, SourceRecorder, SourceWindow, write_sections};
use crate::import::{Raster, RasterInfo, RasterOptions, Validity, grid_offset, open};
use spinney_base::io::{FileAccess, FileStat, FileVersion, Output, listed_path, shown};
use spinney_base::space::{Dimension, Region};
use spinney_base::value::Value;
use spinney_base::{Error, Progress, Result};
use spinney_chunks::ChunkFormat;
use spinney_container::{Header, Metadata, Section};
use spinney_engine::ops::write_updated_layer;
use spinney_engine::store::goblin::{Goblin, ReferringFile};
use spinney_engine::store::{BuildOptions, TreeWriter, depth_for};
use spinney_references::{
    Chunk, IndexContents, IndexedSource, MappedWindow, MappedWindowIndex, PixelRule, SourceImage,
    SourceVersion,
};

/// Options of an update of an index.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct IndexUpdate {
    /// The files that the index has afterwards, those on top last; `None` keeps them.
    pub sources: Option<Vec<PathBuf>>,
    /// Beginnings of names of sources, and their replacements.
    pub prefixes: Vec<(String, String)>,
    /// Memory budget in bytes.
    pub memory: u64,
}

/// Numbers of files by what an update did with them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct UpdateReport {
    /// Files that were not read.
    pub unchanged: usize,
    /// Files that had changed.
    pub changed: usize,
    /// Files that were added.
    pub added: usize,
    /// Files that were removed.
    pub removed: usize,
}

/// A layer while it is updated.
struct UpdatedLayer {
    header: Header,
    old: Goblin,
    plan: IndexPlan,
    /// Regions whose cells are new.
    new_cells: MappedWindowIndex,
}

/// Writes an index again, in which only the cells of sources that were changed, added or removed
/// are computed again. The result is the index that would be made of all sources.
///
/// # Errors
/// If a source is missing or does not fit, a source begins to the north or west of the index, or
/// the output cannot be written.
pub fn update_index(
    index: &Path,
    update: &IndexUpdate,
    output: Output,
    progress: &dyn Progress,
) -> Result<UpdateReport> {
    let access = output.access().clone();
    let old = Goblin::open(index, &(&access).into())?;
    let contents = old.referring(IndexContents::read).ok_or_else(|| {
        Error::unsupported(index, "a tree that is not an index", "build it again from its input")
    })??;
    let mut updater =
        Updater { index, access: &access, recorder: Arc::default(), report: UpdateReport::default() };
    let memory = update.memory;
    let files = updater.files(&contents, update)?;
    let layers = (0..old.layers().len())
        .map(|number| updater.layer(old.open_layer(number)?, &contents, number, &files))
        .collect::<Result<Vec<_>>>()?;
    let (headers, plans): (Vec<Header>, Vec<&IndexPlan>) =
        layers.iter().map(|layer| (layer.header.clone(), &layer.plan)).unzip();
    let (list, pages) = write_sections(output.path(), &plans, progress)?;
    let path = output.path().to_path_buf();
    let depth = headers.iter().map(Header::depth).max().unwrap_or(0);
    let mut file = TreeWriter::create(output, (Dimension::Quad, depth), headers.len() as u32)?;
    let bytes: Vec<u8> = [&list[..], &pages].concat();
    let section = |offset: usize, bytes: &[u8]| Section {
        offset: offset as u64,
        length: bytes.len() as u64,
        checksum: crc32c::crc32c(bytes),
    };
    let (sources, page_section) = (section(0, &list), section(list.len(), &pages));
    let cells = spinney_references::open(&ReferringFile {
        path: &path,
        bytes: &bytes,
        access: &access,
        sources,
        pages: page_section,
        headers: &headers,
    })?;
    for (number, layer) in layers.iter().enumerate() {
        let UpdatedLayer { header, old, new_cells, .. } = layer;
        let is_new = |region: &Region| !new_cells.touching(region).is_empty();
        let options = BuildOptions::like(header, memory / 4)
            .metadata(Metadata {
                provenance: updater.provenance(old, &contents, &files),
                ..old.metadata().clone()
            })
            .referenced(header.shape.stride);
        let new_cells = ((&*cells as _, &bytes as _, number), &is_new as _);
        write_updated_layer(&mut file, old, new_cells, (&options, header.extent), progress)?;
    }
    file.set_references(list, pages);
    file.finish()?;
    Ok(updater.report)
}

/// The files of an updated index.
struct Files {
    /// Number in the recorder, and whether the file is new or changed, by number in the old index.
    old: Vec<Option<(usize, bool)>>,
    /// Rasters that were changed, by number in the old index.
    changed: HashMap<u32, Box<dyn Raster>>,
    /// Rasters that were added, and their numbers in the recorder, from the bottom to the top.
    added: Vec<(Box<dyn Raster>, usize)>,
    /// Positions of the files among those that were requested, by number in the recorder.
    positions: HashMap<usize, usize>,
}

struct Updater<'a> {
    index: &'a Path,
    access: &'a FileAccess,
    recorder: Arc<SourceRecorder>,
    report: UpdateReport,
}

impl Updater<'_> {
    /// Compares the sources with the files, and opens those that were changed or added.
    fn files(&mut self, contents: &IndexContents, update: &IndexUpdate) -> Result<Files> {
        let names: Vec<String> =
            contents.sources.iter().map(|(source, _)| moved(&source.name, update)).collect();
        let wanted = match &update.sources {
            None => None,
            Some(sources) => {
                let named = sources.iter().map(|path| Ok((name_in_index(self.index, path)?, path)));
                Some(named.collect::<Result<Vec<_>>>()?)
            }
        };
        let is_kept =
            |name: &str| wanted.as_ref().is_none_or(|wanted| wanted.iter().any(|(known, _)| known == name));
        let paths = names.iter().map(|name| listed_path(self.index, name)).collect::<Result<Vec<_>>>()?;
        let borrowed: Vec<&Path> = paths.iter().map(|path| &**path).collect();
        let stats = self.access.stat(&borrowed)?;
        let (old, changed, added, positions) = Default::default();
        let mut files = Files { old, changed, added, positions };
        for (((source, chunks), (name, path)), stat) in
            contents.sources.iter().zip(names.iter().zip(&paths)).zip(stats)
        {
            if !is_kept(name) {
                self.report.removed += 1;
                files.old.push(None);
                continue;
            }
            let found = stat?.ok_or_else(|| {
                let doing = "find, a source of the index; `spinney index --update INDEX FILES` makes one of other files";
                Error::io(path, doing)(std::io::ErrorKind::NotFound.into())
            })?;
            let is_changed = found != stat_of(source);
            let number = match is_changed {
                true => {
                    let (raster, number) = self.opened(path, source.page)?;
                    files.changed.insert(files.old.len() as u32, raster);
                    number
                }
                false => self.recorder.add(recorded(path, source, chunks, contents, found)),
            };
            if let Some(wanted) = &wanted {
                let position = wanted.iter().position(|(known, _)| known == name);
                files.positions.insert(number, position.unwrap_or_default());
            }
            *if is_changed { &mut self.report.changed } else { &mut self.report.unchanged } += 1;
            files.old.push(Some((number, is_changed)));
        }
        let known: HashSet<&String> = names.iter().collect();
        for (position, (name, path)) in wanted.iter().flatten().enumerate() {
            if !known.contains(name) {
                let (raster, number) = self.opened(path, 0)?;
                files.positions.insert(number, position);
                files.added.push((raster, number));
                self.report.added += 1;
            }
        }
        Ok(files)
    }

    /// Returns the lines on the inputs of a layer: without files that were removed, and with those
    /// that were added.
    fn provenance(&self, old: &Goblin, contents: &IndexContents, files: &Files) -> Vec<String> {
        let removed = contents.sources.iter().zip(&files.old).filter(|(_, kept)| kept.is_none());
        let removed: Vec<String> = removed
            .filter_map(|((source, _), _)| listed_path(self.index, &source.name).ok())
            .map(|path| format!("raster {} (", path.display()))
            .collect();
        let mut lines: Vec<String> = old.metadata().provenance.clone();
        lines.retain(|line| !removed.iter().any(|removed| line.starts_with(removed)));
        let last = lines.iter().rposition(|line| line.starts_with("raster ")).map_or(0, |last| last + 1);
        let added = files
            .added
            .iter()
            .map(|(raster, _)| format!("raster {} ({})", shown(raster.path()), raster.info().layout));
        lines.splice(last..last, added);
        lines
    }

    /// Opens a file that is recorded, and returns its number.
    fn opened(&self, path: &Path, page: u32) -> Result<(Box<dyn Raster>, usize)> {
        let mut options = RasterOptions { access: self.access.clone(), ..RasterOptions::default() };
        options.page = (page > 0).then_some(page as usize);
        options.recorder = Some(self.recorder.clone());
        let raster = open(path, &options)?;
        let windows = raster.source_windows();
        let [window] = windows.as_deref().unwrap_or_default() else {
            let advice = "index it by itself, or build a tree (`spinney build`)";
            return Err(Error::unsupported(
                path,
                "a source that is not a TIFF file, or has a mask file,",
                advice,
            ));
        };
        let number = window.source;
        Ok((raster, number))
    }

    /// Plans a layer.
    fn layer(
        &self,
        old: Goblin,
        contents: &IndexContents,
        number: usize,
        files: &Files,
    ) -> Result<UpdatedLayer> {
        let (header, metadata) = (old.header(), old.metadata());
        let value = header.form.value;
        let placements = &contents.layers[number];
        let (mut windows, mut new_cells) = (Vec::new(), Vec::new());
        for placement in placements {
            let is_changed = match files.old[placement.source as usize] {
                None => true,
                Some((source, is_changed)) => {
                    if let Some(raster) = files.changed.get(&placement.source) {
                        let before = &contents.sources[placement.source as usize].0;
                        self.check_alike(source, before, contents)?;
                        let is_whole = !contents.rules[placement.rule as usize].ignores_mask;
                        if is_whole && self.position(&old, raster.info(), raster.path())? != origin(placement)
                        {
                            let found = "a source with another georeference than before";
                            let advice = "make the index again (`spinney index`)";
                            return Err(Error::unsupported(raster.path(), found, advice));
                        }
                    }
                    windows.push(window_of(placement, source, contents));
                    is_changed
                }
            };
            if is_changed {
                new_cells.push(*placement);
            }
        }
        // What an index of a single source leaves to the layer, one of several decides by
        // placement.
        let nodata = metadata.nodata.and_then(|number| value.splat(number));
        let by_layer = PixelRule {
            nodata: nodata.map(|value_of| value_of.to_bytes()[..value.size()].to_vec()),
            nan: value.sample.is_float(),
            ..PixelRule::default()
        };
        if windows.len() + files.added.len() > 1 {
            for window in &mut windows {
                if window.rule.nodata.is_none() && !window.rule.ignores_mask {
                    window.rule = PixelRule {
                        nodata: by_layer.nodata.clone(),
                        nan: by_layer.nan,
                        ..window.rule.clone()
                    };
                }
            }
        }
        let mut extent = windows.iter().fold([1, 1, 1], |extent, window| grown(extent, &window.cells));
        for (raster, source) in &files.added {
            let window = self.added_window(&old, placements, contents, (&**raster, *source))?;
            new_cells.push(MappedWindow {
                source: 0,
                channels: 0,
                rule: 0,
                cells: window.cells,
                from: [0; 2],
            });
            extent = grown(extent, &window.cells);
            windows.push(window);
        }
        // (A layer of a stack has one file.)
        if !files.positions.is_empty() && old.layers().len() == 1 {
            self.arrange(old.path(), &mut windows, placements, files, &mut new_cells)?;
        }
        let depth = depth_for(extent).max(header.depth());
        let mut header = header.clone();
        (header.extent, header.shape.depth) = (extent, depth);
        let plan = IndexPlan {
            recorder: self.recorder.clone(),
            access: self.access.clone(),
            windows,
            value,
            nodata: nodata_of(&old, nodata),
        };
        Ok(UpdatedLayer { header, old, plan, new_cells: MappedWindowIndex::new(new_cells) })
    }

    /// Brings windows into the order of the requested files. If files that the index has are in
    /// another order than before, all cells are computed again.
    fn arrange(
        &self,
        index: &Path,
        windows: &mut [SourceWindow],
        placements: &[MappedWindow],
        files: &Files,
        new_cells: &mut Vec<MappedWindow>,
    ) -> Result<()> {
        if windows.iter().any(|window| window.rule.ignores_mask) {
            let found = "other files for an index of a virtual raster";
            return Err(Error::unsupported(index, found, "make the index again (`spinney index`)"));
        }
        let position =
            |window: &SourceWindow| files.positions.get(&window.source).copied().unwrap_or_default();
        let kept = placements.iter().filter_map(|placement| files.old[placement.source as usize]);
        let kept: Vec<usize> = kept.filter_map(|(source, _)| files.positions.get(&source).copied()).collect();
        if !kept.is_sorted() {
            new_cells.extend_from_slice(placements);
        }
        windows.sort_by_key(position);
        Ok(())
    }

    /// Returns the cell of an index at which a raster begins.
    fn position(&self, old: &Goblin, info: &RasterInfo, path: &Path) -> Result<[i64; 2]> {
        let [width, height, _] = old.header().extent;
        let grid = RasterInfo {
            frame: old.metadata().frame.clone(),
            alpha: info.alpha,
            scale_offset: info.scale_offset.clone(),
            ..RasterInfo::plain([width, height], info.sample, info.channels)
        };
        grid_offset((&grid, old.path()), (info, path))
    }

    /// Checks that a changed file has the size, bands, samples and nodata that it had.
    fn check_alike(&self, number: usize, before: &IndexedSource, contents: &IndexContents) -> Result<()> {
        let now = self.recorder.get(number);
        let [old, new] = [&contents.formats[before.image.format as usize], &now.image.format];
        let pixels = |format: &ChunkFormat| (format.channels(), format.sample_format.sample());
        let is_alike = now.size == before.size
            && pixels(old) == pixels(new)
            && now.hole == before.hole
            && now.mask.is_some() == before.mask.is_some();
        if is_alike {
            return Ok(());
        }
        let ([width, height], (channels, sample)) = (now.size, pixels(new));
        let found = format!(
            "a source with another size, type, nodata number or mask than before ({width} x {height} pixels of {channels} x {})",
            sample.name()
        );
        Err(Error::unsupported(&now.path, found, "make the index again (`spinney index`)"))
    }

    /// Locates a raster that was added on the index's grid.
    fn added_window(
        &self,
        old: &Goblin,
        placements: &[MappedWindow],
        contents: &IndexContents,
        (raster, source): (&dyn Raster, usize),
    ) -> Result<SourceWindow> {
        let (header, metadata) = (old.header(), old.metadata());
        let unlike = |found: &str| {
            let advice = "index the files of each type by themselves (`spinney index`)";
            Error::unsupported(raster.path(), found, advice)
        };
        if old.layers().len() > 1 {
            return Err(unlike("a file that is added to an index of several layers"));
        }
        let Some(first) = placements.first() else { return Err(unlike("a file that is added to nothing")) };
        let channels: Vec<usize> =
            contents.channels[first.channels as usize].iter().map(|channel| usize::from(*channel)).collect();
        if placements.iter().any(|other| other.channels != first.channels) {
            return Err(unlike("a file that is added to sources of different bands"));
        }
        let mut info = raster.info().clone();
        if channels.iter().any(|channel| *channel >= info.channels) {
            return Err(unlike("a file of fewer bands than the sources have"));
        }
        info = info.of_channels(&channels);
        info.nodata = info.nodata.or(metadata.nodata);
        let value = header.form.value;
        if (info.sample, info.channels) != (value.sample, usize::from(value.channels)) {
            return Err(unlike("a file of another type than the sources"));
        }
        let [x, y] = self.position(old, &info, raster.path())?;
        let (Ok(x), Ok(y)) = (u64::try_from(x), u64::try_from(y)) else {
            let found = "a file that begins to the north or west of the index";
            return Err(Error::unsupported(raster.path(), found, "make the index again (`spinney index`)"));
        };
        let rule = Validity::by_all(&info).rule().clone();
        let cells = Region::new(x, y, info.width, info.height);
        Ok(SourceWindow { source, channels, rule, cells, from: [0; 2] })
    }
}

/// Returns the value that means VOID in all of a layer's cells.
fn nodata_of(old: &Goblin, nodata: Option<Value>) -> Option<Value> {
    let (cells, _) = old.references()?;
    cells.nodata(old.layer_number()).and(nodata)
}

/// Returns the cell at which a placement's whole source begins.
fn origin(placement: &MappedWindow) -> [i64; 2] {
    let MappedWindow { cells, from, .. } = placement;
    [cells.x as i64 - from[0] as i64, cells.y as i64 - from[1] as i64]
}

fn grown([width, height, _]: [u64; 3], cells: &Region) -> [u64; 3] {
    [width.max(cells.right()), height.max(cells.bottom()), 1]
}

/// Returns the name of a source after the replacement of prefixes.
fn moved(name: &str, update: &IndexUpdate) -> String {
    let found = update.prefixes.iter().find_map(|(old, new)| Some((new, name.strip_prefix(old.as_str())?)));
    found.map_or_else(|| name.to_string(), |(new, rest)| format!("{new}{rest}"))
}

fn stat_of(source: &IndexedSource) -> FileStat {
    let version = match &source.version {
        SourceVersion::Modified(time) => FileVersion::Modified(*time),
        SourceVersion::Tag(tag) => FileVersion::Tag(tag.clone()),
    };
    FileStat { length: source.length, version }
}

fn window_of(placement: &MappedWindow, source: usize, contents: &IndexContents) -> SourceWindow {
    let channels = &contents.channels[placement.channels as usize];
    SourceWindow {
        source,
        channels: channels.iter().map(|channel| usize::from(*channel)).collect(),
        rule: contents.rules[placement.rule as usize].clone(),
        cells: placement.cells,
        from: placement.from,
    }
}

/// Returns the record of a file that was not changed, from the index.
fn recorded(
    path: &Path,
    source: &IndexedSource,
    [chunks, mask]: &[Vec<Chunk>; 2],
    contents: &IndexContents,
    stat: FileStat,
) -> RecordedSource {
    let image = |image: &SourceImage, chunks: &[Chunk]| RecordedImage {
        format: contents.formats[image.format as usize].clone(),
        chunks: Arc::new(RecordedChunks::known(chunks)),
    };
    RecordedSource {
        path: path.to_path_buf(),
        stat,
        page: source.page,
        size: source.size,
        image: image(&source.image, chunks),
        mask: source.mask.as_ref().map(|of_mask| image(of_mask, mask)),
        hole: source.hole.clone(),
    }
}
