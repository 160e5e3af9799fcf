//! The layers of a stack.

use std::fmt::{self, Display};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::bands::select_channels;
use super::super::build::{MemoryBudget, RequestedCells, TargetGrid, slabs_for};
use super::super::plan::{ImportOptions, RasterImport, apply_options, kind, masked_value_type, metadata};
use super::super::sidecar::DescribedRaster;
use super::super::{Band, Raster, RasterInfo, RasterOptions, RasterSlabs, Transparent, open, spill};
use super::grid::GridAlignment;
use super::raster::{Masked, Padded, Repeated, TreeRaster};
use super::shared::alike;
use super::{InputImage, StackOptions};
use crate::index::{IndexPlan, SourceRecorder, not_indexable};
use spinney_base::value::{DataKind, Number, Rule, ValueType};
use spinney_base::{Error, Progress, Result, SubProgress};
use spinney_container::Metadata;
use spinney_crs::Frame;
use spinney_engine::dataset;
use spinney_engine::ops::{WarpGrid, WarpOptions};
use spinney_engine::store::{BuildOptions, depth_for};

/// A layer of a stack. Its file is opened when the layer is written: see [`StackLayer::slabs`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct StackLayer {
    /// Unique name.
    pub name: String,
    /// Description of the band in the file, if it has one.
    pub description: String,
    /// Colour role of a one-channel layer by GDAL's names ("Red", "NIR"), if the file has it.
    pub colour_role: String,
    /// Type of the values.
    pub value: ValueType,
    /// Kind of the values.
    pub kind: DataKind,
    /// Rule for the representatives of inner nodes.
    pub rule: Rule,
    /// The number that means VOID.
    pub nodata: Option<Number>,
    /// Other metadata of the layer; the frame is that of its own cells.
    pub metadata: Metadata,
    /// Levels that its tree has less than one of the finest cells: its cells are 2 to this power as
    /// wide as those.
    pub coarser: u8,
    /// Cells per side of a pixel of the file; 0 if the file is on another grid and is warped.
    pub repeat: u64,
    /// Cells along each axis.
    pub extent: [u64; 3],
    /// VOID cells of the stack's grid to the left of the file's first pixel and above it.
    pub offset: [u64; 2],
    pub(super) path: PathBuf,
    pub(super) options: RasterOptions,
    pub(super) page: Option<usize>,
    parts: LayerChannels,
    /// Whether the file, or the page, makes several layers.
    pub(super) is_one_of_several: bool,
    transparent: Transparent,
    /// Size of the image: columns, rows and channels.
    image: [u64; 3],
    warping: Option<Warping>,
}

/// Warping of an image to the grid of a stack.
#[derive(Clone, Debug)]
struct Warping {
    /// The image's own frame.
    frame: Frame,
    grid: WarpGrid,
    options: WarpOptions,
}

/// Channels of an image that form one layer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct LayerChannels {
    pub(super) channels: Vec<usize>,
    /// An extra channel whose zeros make the layer VOID.
    opacity: Option<usize>,
}

/// Divides an image into layers: one per requested band, or per band. A colour image is one layer.
pub(super) fn divide(path: &Path, info: &RasterInfo, bands: Option<&[Band]>) -> Result<Vec<LayerChannels>> {
    if let Some(bands) = bands {
        let alone = |band| Ok(LayerChannels { channels: vec![info.channel_of(path, band)?], opacity: None });
        return bands.iter().map(alone).collect();
    }
    if is_colour(info) {
        return Ok(vec![LayerChannels { channels: (0..info.channels).collect(), opacity: None }]);
    }
    let opacity = info.alpha.filter(|_| info.transparent != Transparent::Plain);
    let alone = |channel| LayerChannels {
        channels: vec![channel],
        opacity: opacity.filter(|other| *other != channel),
    };
    Ok((0..info.channels).map(alone).collect())
}

/// Whether the channels of an image are red, green and blue, or grey, with optional opacity.
fn is_colour(info: &RasterInfo) -> bool {
    let colours = match (info.channels, info.alpha) {
        (3, None) | (4, Some(3)) => 3,
        (2, Some(1)) => return ValueType::new(info.sample, 2).is_supported(),
        _ => return false,
    };
    // OpenEXR names channels by letters.
    let are = |names: &[String], colours: [&str; 3]| names.iter().eq(colours);
    let names = info.band_names.get(..colours).unwrap_or_default();
    let roles = info.colour_roles.get(..colours).unwrap_or_default();
    let is_rgb = are(roles, ["Red", "Green", "Blue"]) || are(names, ["R", "G", "B"]);
    is_rgb && ValueType::new(info.sample, info.channels as u8).is_supported()
}

/// Plans the layers of an index. A file is opened once for all of its bands, of which there may be
/// thousands.
///
/// # Errors
/// If a file cannot be read, or the cells of a layer are not pixels of its file.
pub(super) fn index_plans(layers: &[StackLayer], recorder: &Arc<SourceRecorder>) -> Result<Vec<IndexPlan>> {
    let (mut plans, mut rest) = (Vec::with_capacity(layers.len()), layers);
    while let Some(first) = rest.first() {
        let raster = first.open(first.options.memory)?;
        let (of_file, others) = rest.split_at(alike(rest));
        for layer in of_file {
            plans.push(layer.index_plan(&*raster, recorder)?);
        }
        rest = others;
    }
    Ok(plans)
}

impl StackLayer {
    /// Plans the layer of some channels of an image.
    pub(super) fn plan(
        image: &InputImage,
        parts: &LayerChannels,
        several: bool,
        alignment: GridAlignment,
        finest: &Frame,
        import: &ImportOptions,
    ) -> Result<StackLayer> {
        let mut info = image.info.of_channels(&parts.channels);
        // Channels may have nodata numbers of their own.
        apply_options(&mut info, import, &mut None);
        if info.channels == 1 {
            // Opacity as a layer of its own is an ordinary number.
            info.alpha = None;
        }
        let value = masked_value_type(&image.path, &info)?;
        let (kind, _) = kind(&info, import);
        let rule = import.rule.unwrap_or(kind.default_rule());
        kind.check_rule(rule, &image.path)?;
        let numbers = parts.channels.iter().map(|channel| Band::Number(channel + 1)).collect();
        let said = ImportOptions {
            bands: several.then_some(numbers),
            page: image.page.or(import.page),
            ..import.clone()
        };
        let frame = finest.coarser(alignment.levels);
        let [left, top] = alignment.offset;
        let (width, height) = (left + info.width * alignment.repeat, top + info.height * alignment.repeat);
        let one = |strings: &[String]| if let [text] = strings { text.clone() } else { String::new() };
        Ok(StackLayer {
            name: String::new(),
            description: one(&info.band_names),
            colour_role: one(&info.colour_roles),
            value,
            kind,
            rule,
            nodata: info.nodata,
            metadata: metadata(frame, std::slice::from_ref(&image.path), &info, &said),
            coarser: alignment.levels,
            repeat: alignment.repeat,
            extent: [width, height, 1],
            offset: alignment.offset,
            path: image.path.clone(),
            options: image.options.clone(),
            page: image.page,
            parts: parts.clone(),
            is_one_of_several: several,
            transparent: info.transparent,
            image: [image.info.width, image.info.height, image.info.channels as u64],
            warping: (alignment.repeat == 0).then(|| Warping {
                frame: image.info.frame.clone(),
                grid: WarpGrid { frame: finest.coarser(alignment.levels), extent: [1; 3] },
                options: WarpOptions::default(),
            }),
        })
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the file is on another grid, so that it is warped as a whole.
    pub fn is_warped(&self) -> bool {
        self.warping.is_some()
    }

    /// Plans the warping of the layer to the grid of a stack.
    ///
    /// # Errors
    /// If that is impossible.
    pub(super) fn warp_to(&mut self, finest: &Frame, extent: [u64; 3], how: &StackOptions) -> Result<()> {
        let Some(warping) = &mut self.warping else { return Ok(()) };
        let [width, height, _] = extent.map(|side| side.div_ceil(1 << self.coarser));
        self.extent = [width, height, 1];
        warping.grid = WarpGrid { frame: finest.coarser(self.coarser), extent: self.extent };
        (warping.options.resampling, warping.options.allow_ballpark) = (how.resampling, how.allow_ballpark);
        Ok(())
    }

    /// The first of its channels in the file, from 0.
    pub(super) fn channel(&self) -> usize {
        self.parts.channels[0]
    }

    /// All of its channels in the file, from 0, followed by the opacity that makes cells VOID.
    pub(super) fn channels(&self) -> Vec<usize> {
        [self.parts.channels.as_slice(), self.parts.opacity.as_slice()].concat()
    }

    /// Whether its cells are the pixels of the file, at the same columns and rows.
    pub(super) fn has_cells_of_file(&self) -> bool {
        self.repeat == 1 && self.offset == [0; 2]
    }

    /// Opens the file and yields all cells, with `memory` bytes for reading. A file that can only
    /// be read from the top down is first copied to a temporary file in the directory, if its rows
    /// exceed the memory or its pixels are repeated.
    ///
    /// # Errors
    /// If the file cannot be read or has changed, or the temporary file cannot be written; on
    /// cancellation.
    pub fn slabs(&self, directory: &Path, memory: u64, progress: &dyn Progress) -> Result<RasterSlabs> {
        self.slabs_for(RequestedCells::All, (directory, memory), progress)
    }

    /// Yields the requested cells: see [`StackLayer::slabs`].
    pub(super) fn slabs_for(
        &self,
        requested: RequestedCells,
        (directory, memory): (&Path, u64),
        progress: &dyn Progress,
    ) -> Result<RasterSlabs> {
        let raster = select_channels(self.open(memory / 2)?, &self.channels());
        self.slabs_of(raster, requested, (directory, memory), progress)
    }

    /// Opens the file.
    pub(super) fn open(&self, memory: u64) -> Result<Box<dyn Raster>> {
        let raster = open(&self.path, &RasterOptions { memory, ..self.options.clone() })?;
        let found = raster.info();
        if [found.width, found.height, found.channels as u64] != self.image {
            return Err(Error::Changed { path: self.path.clone(), what: "was overwritten" });
        }
        Ok(raster)
    }

    /// Yields the requested cells from a raster of the layer's channels.
    pub(super) fn slabs_of(
        &self,
        raster: Box<dyn Raster>,
        requested: RequestedCells,
        (directory, memory): (&Path, u64),
        progress: &dyn Progress,
    ) -> Result<RasterSlabs> {
        let mut raster = self.described(raster);
        if raster.info().sample != self.value.sample
            || raster.info().channels != usize::from(self.value.channels)
        {
            return Err(Error::Changed { path: self.path.clone(), what: "was overwritten" });
        }
        let half = memory / 2;
        if let Some(warping) = &self.warping {
            raster = self.warped(raster, warping, directory, memory, progress)?;
        }
        if self.repeat > 1 {
            if !raster.reads_anywhere() {
                raster = spill(raster, directory, half / 2, progress)?;
            }
            raster = Box::new(Repeated::new(raster, self.repeat));
        }
        if self.offset != [0; 2] {
            raster = Box::new(Padded::new(raster, self.offset));
        }
        let budget = MemoryBudget { bands: memory, slabs: half };
        slabs_for(requested, raster, self.value.size(), (directory, budget), progress)
    }

    /// Adds the layer's treatment of transparent pixels to a raster of its channels.
    fn described(&self, raster: Box<dyn Raster>) -> Box<dyn Raster> {
        let mut info = raster.info().clone();
        info.transparent = self.transparent;
        info.alpha = info.alpha.filter(|_| info.channels > 1);
        let described = Box::new(DescribedRaster { raster, info });
        if self.parts.opacity.is_some() { Box::new(Masked::new(described)) } else { described }
    }

    /// Plans the layer of an index from the raster of its file.
    ///
    /// # Errors
    /// If the layer's cells are not pixels of the file.
    fn index_plan(&self, raster: &dyn Raster, recorder: &Arc<SourceRecorder>) -> Result<IndexPlan> {
        if self.repeat != 1 || self.warping.is_some() {
            let found = format!("layer {} of an index, on another grid than the finest", self.name);
            let advice =
                "index the files on each grid by themselves, or build a tree (`spinney build --stack`)";
            return Err(Error::unsupported(&self.path, found, advice));
        }
        let separate = raster.separate_channels(&self.channels()).ok_or_else(|| {
            let found = raster.source_windows().err();
            not_indexable(&self.path, found.unwrap_or_else(|| "bands that cannot be separated".into()))
        })?;
        let mut raster = self.described(separate);
        if self.offset != [0; 2] {
            raster = Box::new(Padded::new(raster, self.offset));
        }
        let nodata = self.nodata.and_then(|number| self.value.splat(number));
        IndexPlan::of(&*raster, (self.value, nodata), recorder.clone(), &self.options.access)
    }

    /// Warps the raster to the stack's grid, by means of trees in a temporary directory.
    fn warped(
        &self,
        raster: Box<dyn Raster>,
        warping: &Warping,
        directory: &Path,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Raster>> {
        let Warping { frame, grid, options } = warping;
        let size = [raster.info().width, raster.info().height, 1];
        let metadata = Metadata { frame: frame.clone(), ..self.metadata.clone() };
        let how = BuildOptions::new(self.kind, depth_for(size))
            .rule(self.rule)
            .memory(memory / 2)
            .metadata(metadata);
        let import = RasterImport::of(raster, self.value, self.nodata, how, memory);
        let temporary = tempfile::Builder::new().prefix(".spinney-").tempdir_in(directory);
        let temporary = temporary.map_err(Error::io(directory, "create a temporary directory in it"))?;
        let path = temporary.path().join("warped.goblin");
        let cells = self.extent.iter().product();
        let target = TargetGrid::Cells(Box::new(grid.clone()));
        // Progress counts the cells when the layer is written.
        let access = &self.options.access;
        let output = access.create(&path)?;
        import.build_warped(&target, options, output, &SubProgress::new(progress, 0, cells))?;
        let tree = dataset::open(&path, &access.into())?;
        Ok(Box::new(TreeRaster::new(tree, temporary, &self.path, self.nodata)))
    }
}

impl Display for StackLayer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = [0, 1].map(|axis| (self.extent[axis] - self.offset[axis]) / self.repeat.max(1));
        write!(
            f,
            "{}: {width} x {height} pixels of {}, {}, {}",
            self.name, self.value, self.kind, self.rule
        )?;
        if let Some(nodata) = self.nodata {
            write!(f, ", nodata {nodata}")?;
        }
        let wide = (1 << self.coarser) * self.repeat;
        match (wide, self.repeat) {
            (1, _) => Ok(()),
            (0, _) => write!(f, ", warped to cells {} times as wide", 1 << self.coarser),
            (wide, 1) => write!(f, ", {wide} times as wide"),
            (wide, repeat) => write!(f, ", {wide} times as wide: {repeat} x {repeat} cells each"),
        }
    }
}
