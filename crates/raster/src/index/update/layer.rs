//! Layers of an updated index: where their cells are, and which of them are new.

use std::path::PathBuf;

use super::super::{IndexPlan, SourceWindow};
use super::files::{FileFinder, UpdatedFile, UpdatedFiles};
use super::properties::LayerProperties;
use super::{is_of_virtual_raster, refused};
use crate::import::{RasterInfo, Validity, depth_of};
use spinney_base::Result;
use spinney_base::space::{Dimension, Region};
use spinney_chunks::ChunkFormat;
use spinney_container::{Header, Metadata};
use spinney_engine::store::goblin::Goblin;
use spinney_references::{IndexContents, MappedWindow, MappedWindowIndex, PixelRule};

/// A layer of an updated index.
pub(super) struct UpdatedLayer {
    pub(super) header: Header,
    pub(super) metadata: Metadata,
    pub(super) plan: IndexPlan,
    /// Regions whose cells are new.
    pub(super) new_cells: MappedWindowIndex,
    /// Position of its first file among the listed ones.
    pub(super) position: usize,
}

/// A window of a layer, and its file.
type FileWindow<'a> = (SourceWindow, &'a UpdatedFile);

/// Plans a layer of an updated index.
pub(super) struct LayerPlanner<'a> {
    pub(super) finder: &'a FileFinder<'a>,
    pub(super) contents: &'a IndexContents,
    pub(super) files: &'a UpdatedFiles,
    pub(super) old: &'a Goblin,
    /// Placements of the old index.
    pub(super) placements: &'a [MappedWindow],
    pub(super) properties: LayerProperties<'a>,
}

impl LayerPlanner<'_> {
    pub(super) fn plan(&self) -> Result<UpdatedLayer> {
        // (Only a virtual raster may have no sources.)
        let is_virtual = self.placements.is_empty()
            || self.placements.iter().any(|placement| is_of_virtual_raster(self.rule(placement)));
        if is_virtual && self.files.is_listed {
            return Err(refused(self.old.path(), "other files for an index of a virtual raster"));
        }
        let kept = self.placements.iter().filter(|placement| self.file(placement).is_some()).count();
        let are_several = kept + self.files.added.len() > 1;
        let mut windows = Vec::new();
        let mut new_cells = Vec::new();
        for placement in self.placements {
            let file = self.file(placement);
            if let Some(file) = file {
                windows.push((self.kept_window(placement, file, are_several)?, file));
            }
            if file.is_none_or(|file| file.info.is_some()) {
                new_cells.push(*placement);
            }
        }
        if !windows.is_sorted_by_key(|(_, file)| file.position) {
            new_cells.extend_from_slice(self.placements);
        }
        for file in &self.files.added {
            let window = self.added_window(file, are_several)?;
            let cells = window.cells;
            new_cells.push(MappedWindow { source: 0, channels: 0, rule: 0, cells, from: [0; 2] });
            windows.push((window, file));
        }
        if windows.is_empty() && !self.placements.is_empty() {
            let name = &self.old.metadata().name;
            return Err(refused(self.old.path(), format!("a layer without sources ({name})")));
        }
        let metadata = if is_virtual {
            self.old.metadata().clone()
        } else {
            windows.sort_by_key(|(_, file)| file.position);
            self.check_nodata(&windows, are_several)?;
            if !are_several {
                windows.iter_mut().for_each(|(window, _)| {
                    window.rule = PixelRule { nodata: None, nan: false, ..window.rule.clone() };
                });
            }
            self.metadata(&windows, are_several)?
        };
        let header = self.header(&windows, is_virtual)?;
        let position = windows.first().map_or(0, |(_, file)| file.position);
        let plan = IndexPlan {
            recorder: self.finder.recorder.clone(),
            access: self.finder.access.clone(),
            windows: windows.into_iter().map(|(window, _)| window).collect(),
            value: header.form.value,
            nodata: self.old.references().and_then(|(cells, _)| cells.nodata(self.old.layer_number())),
        };
        Ok(UpdatedLayer { header, metadata, plan, new_cells: MappedWindowIndex::new(new_cells), position })
    }

    /// Returns the header of the layer with windows.
    ///
    /// # Errors
    /// If no tree is that large.
    fn header(&self, windows: &[FileWindow<'_>], is_virtual: bool) -> Result<Header> {
        let mut header = self.old.header().clone();
        // A virtual raster has its own size.
        if is_virtual {
            return Ok(header);
        }
        let grown = |[width, height, _]: [u64; 3], (window, _): &FileWindow<'_>| {
            [window.cells.right().max(width), window.cells.bottom().max(height), 1]
        };
        header.extent = windows.iter().fold([1; 3], grown);
        let size = format!("{} x {} pixels", header.extent[0], header.extent[1]);
        let depth = depth_of(Dimension::Quad, header.extent, (self.old.path(), &size), None)?;
        header.shape.depth = depth.max(header.depth());
        Ok(header)
    }

    fn rule(&self, placement: &MappedWindow) -> &PixelRule {
        &self.contents.rules[placement.rule as usize]
    }

    /// Returns the file of a placement, unless it was removed.
    fn file(&self, placement: &MappedWindow) -> Option<&UpdatedFile> {
        self.files.kept[placement.source as usize].as_ref()
    }

    fn channels(&self, placement: &MappedWindow) -> Vec<usize> {
        let channels = &self.contents.channels[placement.channels as usize];
        channels.iter().map(|channel| usize::from(*channel)).collect()
    }

    /// Returns the window of a placement, with the rule that it has among several sources.
    ///
    /// # Errors
    /// If its file was changed in more than the values of pixels.
    fn kept_window(
        &self,
        placement: &MappedWindow,
        file: &UpdatedFile,
        are_several: bool,
    ) -> Result<SourceWindow> {
        let (channels, old) = (self.channels(placement), self.rule(placement));
        let is_virtual = is_of_virtual_raster(old);
        if let Some(info) = &file.info {
            self.check_alike(placement, file, info)?;
        }
        let rule = match &file.info {
            _ if is_virtual => old.clone(),
            // A single source leaves nodata to the layer, so that its rule is empty. Of several
            // sources, a nodata pixel must show what is below it: only a placement's rule does
            // that.
            None => self.properties.complete(old),
            Some(found) => {
                let info = self.properties.of_file(found, &channels, are_several);
                // (A file on another grid has no position.)
                let is_in_place = || {
                    let position = self.properties.position(&info, &file.path);
                    position.is_ok_and(|position| position == origin(placement))
                };
                let difference = self.properties.difference(&info);
                if let Some(difference) = difference.or_else(|| (!is_in_place()).then_some("georeference")) {
                    return Err(refused(
                        &file.path,
                        format!("a source with another {difference} than before"),
                    ));
                }
                self.check_opacity(placement, file, found)?;
                PixelRule { hidden_opacity: old.hidden_opacity, ..Validity::by_all(&info).rule().clone() }
            }
        };
        Ok(SourceWindow { source: file.number, channels, rule, cells: placement.cells, from: placement.from })
    }

    /// Checks that a changed file has the size, bands, samples and mask that it had.
    fn check_alike(&self, placement: &MappedWindow, file: &UpdatedFile, info: &RasterInfo) -> Result<()> {
        let before = &self.contents.sources[placement.source as usize].0;
        let now = self.finder.recorder.get(file.number);
        let pixels = |format: &ChunkFormat| (format.channels(), format.sample_format.sample());
        let is_alike = now.size == before.size
            && pixels(&self.contents.formats[before.image.format as usize]) == pixels(&now.image.format)
            && now.mask.is_some() == before.mask.is_some();
        if is_alike {
            return Ok(());
        }
        let found = format!(
            "a source with another size, type or mask than before ({} x {} pixels of {} x {})",
            info.width,
            info.height,
            info.channels,
            info.sample.name()
        );
        Err(refused(&file.path, found))
    }

    /// Checks that the channel of a changed file that hides pixels of a stack's layer is the one of
    /// a new stack.
    fn check_opacity(&self, placement: &MappedWindow, file: &UpdatedFile, info: &RasterInfo) -> Result<()> {
        let old = self.rule(placement).opacity.map(usize::from);
        let is_layer = |channel: usize| {
            let mut all = self.contents.layers.iter().flatten();
            all.any(|other| other.source == placement.source && self.channels(other) == [channel])
        };
        let own = self.channels(placement);
        let is_same = match (old, info.alpha) {
            (Some(old), now) => now == Some(old),
            // Without opacity among the layers, the user has selected other bands, which none
            // hides.
            (None, Some(now)) => own.contains(&now) || !self.is_stacked() || !is_layer(now),
            (None, None) => true,
        };
        if is_same {
            return Ok(());
        }
        Err(refused(&file.path, "a source with another opacity than before"))
    }

    fn is_stacked(&self) -> bool {
        self.contents.layers.len() > 1
    }

    /// Locates an added file on the index's grid.
    fn added_window(&self, file: &UpdatedFile, are_several: bool) -> Result<SourceWindow> {
        let (path, unlike) = (&file.path, |found: &str| LayerProperties::unlike(&file.path, found));
        if self.is_stacked() {
            return Err(unlike("a file that is added to an index of several layers"));
        }
        let (Some(first), Some(found)) = (self.placements.first(), &file.info) else {
            return Err(unlike("a file that is added to nothing"));
        };
        if self.placements.iter().any(|other| other.channels != first.channels) {
            return Err(unlike("a file that is added to sources of different bands"));
        }
        let channels = self.channels(first);
        let count = found.channels;
        let has_bands = match self.properties.has_selected_bands() {
            true => channels.iter().all(|channel| *channel < count),
            false => channels.len() == count,
        };
        if !has_bands {
            return Err(unlike("a file of another number of bands than the sources"));
        }
        let info = self.properties.of_file(found, &channels, are_several);
        if let Some(difference) = self.properties.difference(&info) {
            return Err(unlike(&format!("a file of another {difference} than the sources")));
        }
        let [x, y] = self.properties.position(&info, path)?;
        let (Ok(x), Ok(y)) = (u64::try_from(x), u64::try_from(y)) else {
            return Err(refused(path, "a file that begins to the north or west of the index"));
        };
        let rule = Validity::by_all(&info).rule().clone();
        let cells = Region::new(x, y, info.width, info.height);
        Ok(SourceWindow { source: file.number, channels, rule, cells, from: [0; 2] })
    }

    fn check_nodata(&self, windows: &[FileWindow<'_>], are_several: bool) -> Result<()> {
        let described = |(window, file): &FileWindow<'_>| {
            file.info.as_ref().map(|info| self.properties.of_file(info, &window.channels, are_several))
        };
        let sources: Vec<_> =
            windows.iter().map(|window| (&window.0.rule, &*window.1.path, described(window))).collect();
        self.properties.check_nodata(&sources)
    }

    /// Returns the metadata of the layer of files, from the bottom to the top.
    fn metadata(&self, windows: &[FileWindow<'_>], are_several: bool) -> Result<Metadata> {
        let Some((window, file)) = windows.first() else { return Ok(self.old.metadata().clone()) };
        let was_first = self.placements.first().and_then(|placement| self.file(placement));
        let found = match &file.info {
            Some(info) => Some(info.clone()),
            None if was_first.is_some_and(|first| first.number == file.number) => None,
            None => Some(self.finder.properties(file)?),
        };
        let info = found.map(|info| self.properties.of_file(&info, &window.channels, are_several));
        self.properties.check_values(info.as_ref(), are_several)?;
        let paths = || windows.iter().map(|(_, file)| file.path.clone()).collect::<Vec<PathBuf>>();
        let inputs = (self.files.is_listed || self.files.are_moved).then(paths);
        self.properties.metadata(info.as_ref(), inputs)
    }
}

/// Returns the cell at which a placement's whole source begins.
fn origin(placement: &MappedWindow) -> [i64; 2] {
    let MappedWindow { cells, from, .. } = placement;
    [cells.x as i64 - from[0] as i64, cells.y as i64 - from[1] as i64]
}
