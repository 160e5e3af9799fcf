//! Building trees from arrays and from files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use numpy::{PyArrayDyn, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use spinney::import::mesh::{Resolution, SolidOptions};
use spinney::import::raster::{ImportOptions, StackOptions};
use spinney::import::volume::VolumeOptions;
use spinney::raw::dataset;
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::import::raster::{self, Band, TargetGrid};
use spinney::raw::import::{mesh, volume};
use spinney::raw::io::any_file;
use spinney::raw::ops::WarpGrid;
use spinney::raw::space::CodeRange;
use spinney::raw::store::{SlabBoxes, WantedCells, depth_for};
use spinney::raw::value::Palette;
use spinney::tree::{Slab, Slabs};
use spinney::{
    BuildOptions, Crs, DataKind, Dimension, Frame, Metadata, Result, Rule, SampleType, TreeType, Value,
    ValueType, WarpOptions,
};

use crate::error::{OrRaise, invalid};
use crate::files::check_output;
use crate::jobs::{self, Terms, Work, access};
use crate::meshes::{arrays_of, models_of};
use crate::numbers::{PyNumber, names_of};
use crate::packing::Packing;
use crate::samples::{copy_bytes, sample_of};

/// Description of an array.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ArrayOptions {
    /// Columns, rows and planes.
    extent: [u64; 3],
    octree: bool,
    dtype: String,
    channels: u8,
    /// Whether the array has to be read in bands of rows, top down.
    in_order: bool,
    kind: Option<String>,
    rule: Option<String>,
    nodata: Option<PyNumber>,
    /// Number that VOID gets in outputs if no number of the array means VOID.
    void_number: Option<PyNumber>,
    /// Index of the opacity channel.
    alpha: Option<u8>,
    transform: Option<Vec<f64>>,
    crs: Option<String>,
    memory: u64,
    share: bool,
    packing: Packing,
    /// Time of an Autumnal file's first commit.
    time: Option<i64>,
    categories: BTreeMap<PyNumber, String>,
    colormap: Option<Vec<[u8; 4]>>,
    descriptions: Vec<String>,
    scale_offset: Vec<(f64, f64)>,
    units: Vec<String>,
    tags: BTreeMap<String, String>,
    /// Acquisition time of the layer's content.
    seen: Option<String>,
}

/// Planned tree of an array.
pub(crate) struct ArrayTree {
    pub(crate) form: TreeType,
    /// The value that means VOID.
    pub(crate) nodata: Option<Value>,
    pub(crate) build: BuildOptions,
}

impl ArrayOptions {
    /// Plans the tree of the array.
    pub(crate) fn plan(&self) -> PyResult<ArrayTree> {
        let value = self.value()?;
        let nodata = match self.nodata.map(|number| number.0) {
            Some(number) if !number.is_nan() => {
                let stored = if value.sample.is_float() { value.sample.nearest(number) } else { number };
                let found = value.splat(stored);
                let none =
                    || invalid(format!("nodata: got {number}, expected a number that {value} can hold"));
                Some(found.ok_or_else(none)?)
            }
            _ => None,
        };
        let dimension = if self.octree { Dimension::Oct } else { Dimension::Quad };
        Ok(ArrayTree { form: TreeType::new(dimension, value), nodata, build: self.options(value.sample)? })
    }

    /// Returns the cells of a code range, read block by block with `read`.
    pub(crate) fn slabs<'w>(
        &self,
        read: &'w Py<PyAny>,
        (form, depth, run): (TreeType, u8, CodeRange),
        work: &'w Work,
    ) -> ArraySlabs<'w> {
        ArraySlabs::new(read, self, (form, depth, run), self.memory / 8, work)
    }

    /// Columns, rows and planes.
    pub(crate) fn extent(&self) -> [u64; 3] {
        self.extent
    }

    fn value(&self) -> PyResult<ValueType> {
        let sample = sample_of(&self.dtype).ok_or_else(|| {
            PyTypeError::new_err(format!(
                "samples of {} cannot be stored; convert to uint8, uint16, int16, uint32, int32, float32, float64, int8, uint64 or int64",
                self.dtype
            ))
        })?;
        let value = ValueType::new(sample, self.channels);
        if !value.is_supported() {
            let text = "expected 1 to 4 bands of uint8, uint16 or float32, or 1 band of another type";
            return Err(PyTypeError::new_err(format!(
                "got {} bands of {}, {text}",
                self.channels, self.dtype
            )));
        }
        if self.channels > 1 && self.alpha == Some(self.channels - 1) {
            return Ok(value.with_alpha());
        }
        Ok(self.nodata.map_or(value, |nodata| value.with_missing(nodata.0)))
    }

    fn frame(&self) -> PyResult<Frame> {
        let mut frame = Frame::identity();
        if let Some(numbers) = &self.transform {
            frame.matrix = matrix_of(numbers)?;
        }
        frame.crs = self.crs.as_deref().map(Crs::parse).transpose().or_raise()?;
        Ok(frame)
    }

    fn options(&self, sample: SampleType) -> PyResult<BuildOptions> {
        let has_classes = self.channels == 1 && !(self.categories.is_empty() && self.colormap.is_none());
        let usual =
            if has_classes && !sample.is_float() { DataKind::Categorical } else { DataKind::Continuous };
        let kind = self.kind.as_ref().map_or(Ok(usual), |name| name.parse()).or_raise()?;
        let rule: Rule =
            self.rule.as_ref().map_or(Ok(kind.default_rule()), |name| name.parse()).or_raise()?;
        kind.check_rule(rule, Path::new("array")).or_raise()?;
        let metadata = Metadata {
            frame: self.frame()?,
            nodata: self.nodata.or(self.void_number).map(|number| number.0),
            alpha: self.alpha,
            palette: self.colormap.clone().map(|colours| Palette { colours }),
            class_names: names_of(&self.categories),
            band_names: self.descriptions.clone(),
            scale_offset: self.scale_offset.clone(),
            units: self.units.clone(),
            tags: self.tags.clone(),
            time: self.seen.clone(),
            provenance: vec![format!("array of {} in Python", self.dtype)],
            ..Metadata::default()
        };
        let options = BuildOptions::new(kind, depth_for(self.extent)).rule(rule).metadata(metadata);
        let options = options.written(self.packing.with(self.memory / 2));
        Ok(options.share(self.share).time(self.time))
    }
}

/// Returns the cell-to-world matrix from 6 or 12 numbers.
pub(crate) fn matrix_of(numbers: &[f64]) -> PyResult<[[f64; 4]; 3]> {
    let frame = match *numbers {
        [a, b, c, d, e, f] => Frame::planar([a, b, c, d, e, f]),
        [a, b, c, d, e, f, g, h, i, j, k, l] => {
            Frame { matrix: [[a, b, c, d], [e, f, g, h], [i, j, k, l]], ..Frame::identity() }
        }
        _ => return Err(invalid("transform: expected 6 numbers a, b, c, d, e, f, or a 3 x 4 matrix")),
    };
    let is_finite = frame.matrix.iter().flatten().all(|number| number.is_finite());
    if !is_finite || frame.to_cells([0.0; 3]).is_none() {
        return Err(invalid("transform: has no inverse"));
    }
    Ok(frame.matrix)
}

/// Cells of an array, in the blocks that Python delivers.
pub(crate) struct ArraySlabs<'w> {
    /// Function from a block's first cell and size to its samples and, optionally, flags.
    read: &'w Py<PyAny>,
    extent: [u64; 3],
    sample: SampleType,
    boxes: Boxes,
    work: &'w Work,
}

/// Boxes of an array, in reading order.
enum Boxes {
    /// In FD order.
    Anywhere(SlabBoxes),
    /// Bands of `rows` rows, or planes, along `axis`; `next` is the first row of the next band.
    FromTheTop { axis: usize, rows: u64, next: u64 },
}

impl<'w> ArraySlabs<'w> {
    /// Creates the cells of `run`, in a tree of `depth` levels; `memory` is the limit of a block in
    /// bytes.
    fn new(
        read: &'w Py<PyAny>,
        options: &ArrayOptions,
        (form, depth, run): (TreeType, u8, CodeRange),
        memory: u64,
        work: &'w Work,
    ) -> ArraySlabs<'w> {
        let extent = options.extent;
        let least = SlabBoxes::least_side(form.dimension);
        let mut side = least.max(1 << depth_for(extent).min(62));
        let bytes = |side: u64| {
            let cells = extent.iter().fold(1u64, |cells, length| cells.saturating_mul(side.min(*length)));
            cells.saturating_mul(form.value.size() as u64 + 1)
        };
        while side > least && bytes(side) > memory {
            side /= 2;
        }
        let boxes = match options.in_order {
            true => Boxes::FromTheTop { axis: form.axes() - 1, rows: least, next: 0 },
            false => {
                let wanted = WantedCells { dimension: form.dimension, depth, run };
                Boxes::Anywhere(SlabBoxes::new(extent, wanted, side))
            }
        };
        ArraySlabs { read, extent, sample: form.value.sample, boxes, work }
    }

    /// Returns the first cell and the size of the next block.
    fn next_block(&mut self) -> Option<([u64; 3], [u64; 3])> {
        match &mut self.boxes {
            Boxes::Anywhere(boxes) => boxes.next(),
            Boxes::FromTheTop { axis, rows, next } => {
                let (mut first, mut size) = ([0; 3], self.extent);
                first[*axis] = *next;
                size[*axis] = (*rows).min(self.extent[*axis] - *next);
                *next += size[*axis];
                (size[*axis] > 0).then_some((first, size))
            }
        }
    }
}

impl Slabs for ArraySlabs<'_> {
    fn extent(&self) -> [u64; 3] {
        self.extent
    }

    fn are_in_order(&self) -> bool {
        matches!(self.boxes, Boxes::Anywhere(_))
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        let Some((origin, size)) = self.next_block() else { return Ok(false) };
        (slab.origin, slab.size) = (origin, size);
        slab.bytes.clear();
        let read = Python::attach(|py| -> PyResult<()> {
            let (samples, valid): (Bound<'_, PyAny>, Option<Bound<'_, PyArrayDyn<bool>>>) =
                self.read.bind(py).call1((origin, size))?.extract()?;
            copy_bytes(&samples, self.sample, &mut slab.bytes)?;
            slab.valid = match valid {
                Some(valid) => {
                    Some(valid.try_readonly().map_err(|e| invalid(e.to_string()))?.as_slice()?.to_vec())
                }
                None => None,
            };
            Ok(())
        });
        read.map(|()| true).map_err(|exception| self.work.fail(exception))
    }
}

/// Channel, by number or by name.
#[derive(FromPyObject)]
pub(crate) enum BandName {
    Number(usize),
    Name(String),
}

impl BandName {
    fn band(&self) -> Band {
        match self {
            BandName::Number(number) => Band::Number(*number),
            BandName::Name(name) => Band::Name(name.clone()),
        }
    }
}

/// Pages of a TIFF file.
#[derive(FromPyObject)]
pub(crate) enum Pages {
    /// One page, by its number from 0.
    One(usize),
    /// All pages, as `layers` or as `z`.
    All(String),
}

/// Options of an import from files.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct FileOptions {
    pub(crate) kind: Option<String>,
    pub(crate) rule: Option<String>,
    pub(crate) bands: Option<Vec<BandName>>,
    pub(crate) nodata: Option<PyNumber>,
    pub(crate) transform: Option<Vec<f64>>,
    pub(crate) crs: Option<String>,
    pub(crate) depth: Option<u8>,
    pub(crate) layer: Option<String>,
    pub(crate) pages: Option<Pages>,
    pub(crate) stack: bool,
    pub(crate) names: Option<Vec<String>>,
    pub(crate) times: Option<Vec<String>>,
    pub(crate) keep_transparent: bool,
    /// Value of features: a number, or the name of an attribute.
    pub(crate) value: Option<String>,
    pub(crate) overlaps: Option<String>,
    pub(crate) sample: Option<String>,
    pub(crate) width: Option<String>,
    pub(crate) fractions: bool,
    #[pyo3(item("where"))]
    pub(crate) filter: Option<String>,
    pub(crate) memory: u64,
    pub(crate) share: bool,
    pub(crate) packing: Packing,
    /// Time of an Autumnal file's first commit.
    pub(crate) time: Option<i64>,
    pub(crate) cells: Option<u64>,
    pub(crate) cell: Option<f64>,
    pub(crate) grid: Option<PathBuf>,
    pub(crate) max_zoom: Option<u8>,
    pub(crate) resampling: Option<String>,
    pub(crate) allow_ballpark: bool,
    pub(crate) edge: Option<String>,
    pub(crate) attribute: Option<String>,
    pub(crate) shell: bool,
    pub(crate) up: Option<String>,
    pub(crate) unit: Option<String>,
    /// Levels between the cells and the finest stored level of an index.
    pub(crate) referenced: Option<u8>,
}

impl FileOptions {
    pub(crate) fn raster_options(&self) -> PyResult<ImportOptions> {
        let mut options = ImportOptions::new();
        options.access = access().clone();
        options.kind = self.kind.as_ref().map(|name| name.parse()).transpose().or_raise()?;
        options.rule = self.rule.as_ref().map(|name| name.parse()).transpose().or_raise()?;
        options.crs = self.crs.as_deref().map(Crs::parse).transpose().or_raise()?;
        options.bands = self.bands.as_ref().map(|bands| bands.iter().map(BandName::band).collect());
        options.nodata = self.nodata.map(|number| number.0);
        options.transform = match self.transform.as_deref() {
            None => None,
            Some(&[a, b, c, d, e, f]) => Some([a, b, c, d, e, f]),
            Some(_) => return Err(invalid("transform: got a matrix, expected six numbers for a raster")),
        };
        (options.depth, options.layer) = (self.depth, self.layer.clone());
        if let Some(Pages::One(page)) = self.pages {
            options.page = Some(page);
        }
        (options.keep_transparent, options.share) = (self.keep_transparent, self.share);
        (options.memory, options.time) = (Some(self.memory), self.time);
        options.packing = self.packing.0;
        if let Some(levels) = self.referenced.filter(|levels| ![1, 2, 4].contains(levels)) {
            return Err(invalid(format!("stored_level: got {levels}, expected 1, 2 or 4 levels")));
        }
        options.referenced = self.referenced;
        Ok(options)
    }

    /// Returns whether all pages of a file are requested, as `way`.
    fn has_pages(&self, way: &str) -> bool {
        matches!(&self.pages, Some(Pages::All(name)) if name == way)
    }

    /// Returns the options of a stack if one is requested, or if the bands of the only file do not
    /// form one value; otherwise `None`.
    pub(crate) fn stack(&self, paths: &[PathBuf]) -> PyResult<Option<StackOptions>> {
        let every_page = self.has_pages("layers");
        let is_single = self.grid.is_some() || self.max_zoom.is_some();
        if !self.stack
            && !every_page
            && (is_single || !raster::needs_layers(paths, &self.raster_options()?).or_raise()?)
        {
            return match self.names.is_some() || self.times.is_some() {
                true => Err(invalid("names, times: are for stack=True")),
                false => Ok(None),
            };
        }
        if self.grid.is_some() || self.max_zoom.is_some() {
            let text =
                "stack: layers use the grid of the finest file; grid and max_zoom are for single rasters";
            return Err(invalid(text));
        }
        let mut options = StackOptions::new();
        options.import = self.raster_options()?;
        (options.names, options.times) = (self.names.clone(), self.times.clone());
        options.every_page = every_page;
        options.resampling = self.resampling.as_ref().map(|way| way.parse()).transpose().or_raise()?;
        options.allow_ballpark = self.allow_ballpark;
        Ok(Some(options))
    }

    fn volume(&self) -> PyResult<VolumeOptions> {
        if self.bands.is_some()
            || self.layer.is_some()
            || (self.pages.is_some() && !self.has_pages("z"))
            || self.keep_transparent
            || self.grid.is_some()
            || self.stack
            || self.names.is_some()
            || self.times.is_some()
        {
            let text =
                "bands, layer, pages, stack, names, times, keep_transparent and grid do not apply to volumes";
            return Err(invalid(text));
        }
        let mut options = VolumeOptions::new();
        options.access = access().clone();
        options.kind = self.kind.as_ref().map(|name| name.parse()).transpose().or_raise()?;
        options.rule = self.rule.as_ref().map(|name| name.parse()).transpose().or_raise()?;
        options.crs = self.crs.as_deref().map(Crs::parse).transpose().or_raise()?;
        options.transform = self.transform.as_deref().map(matrix_of).transpose()?;
        options.nodata = self.nodata.map(|number| number.0);
        (options.depth, options.share) = (self.depth, self.share);
        (options.memory, options.time) = (Some(self.memory), self.time);
        options.packing = self.packing.0;
        Ok(options)
    }

    /// Returns the grid that rasters are warped to, if it is not their own.
    pub(crate) fn target(&self) -> PyResult<Option<TargetGrid>> {
        let Some(path) = &self.grid else {
            return match self.max_zoom.is_some() || self.resampling.is_some() || self.allow_ballpark {
                true => Err(invalid("max_zoom, resampling, allow_ballpark: need grid=")),
                false => Ok(None),
            };
        };
        if path.as_os_str() == "xyz" {
            return Ok(Some(TargetGrid::WebMercator(self.max_zoom)));
        }
        let tree = dataset::open(path, &access().into()).or_raise()?;
        if self.max_zoom.is_some() {
            return Err(invalid("max_zoom: works only with grid='xyz'"));
        }
        if tree.header().form.axes() != 2 {
            return Err(invalid(format!("grid: {} is an octree, expected a quadtree", path.display())));
        }
        let (frame, extent) = (tree.metadata().frame.clone(), tree.header().extent);
        Ok(Some(TargetGrid::Like(Box::new(WarpGrid { frame, extent }))))
    }

    fn solids(&self) -> PyResult<SolidOptions> {
        let mut options = SolidOptions::new();
        options.resolution = match (self.cells, self.cell, &self.grid, self.depth) {
            (None, None, None, None) => Resolution::Cells(256),
            (Some(cells), None, None, None) => Resolution::Cells(cells),
            (None, Some(width), None, None) => Resolution::Cell(width),
            (None, None, Some(path), None) => {
                let tree = dataset::open(path, &access().into()).or_raise()?;
                if tree.header().form.axes() != 3 {
                    return Err(invalid(format!(
                        "grid: {} is a quadtree, expected an octree",
                        path.display()
                    )));
                }
                Resolution::Like(tree.metadata().frame.clone(), tree.depth())
            }
            (None, None, None, Some(depth)) => Resolution::Depth(depth),
            _ => return Err(invalid("cells, cell, grid, depth: got several, expected one of them")),
        };
        let edge = self.edge.as_ref().map(|name| name.parse()).transpose().or_raise()?;
        options.edge = edge.unwrap_or_default();
        let attribute = self.attribute.as_ref().map(|name| name.parse()).transpose().or_raise()?;
        options.attribute = attribute.unwrap_or_default();
        options.up = self.up.as_ref().map(|name| name.parse()).transpose().or_raise()?.unwrap_or_default();
        options.crs = self.crs.as_deref().map(Crs::parse).transpose().or_raise()?;
        (options.shell, options.memory, options.share) = (self.shell, self.memory, self.share);
        options.time = self.time;
        options.packing = self.packing.0;
        Ok(options)
    }
}

/// Builds a tree from raster files (the last is on top), from models of solids, from meshes in
/// memory, or from features.
#[pyfunction]
#[pyo3(signature = (paths, meshes, out, options, terms))]
pub(crate) fn build_files(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    meshes: Vec<Bound<'_, PyDict>>,
    out: PathBuf,
    options: FileOptions,
    terms: Terms,
) -> PyResult<()> {
    check_output(&paths, &out)?;
    if let Some(Pages::All(way)) = &options.pages
        && !["layers", "z"].contains(&way.as_str())
    {
        return Err(invalid(format!("pages: got {way:?}, expected \"layers\", \"z\" or a number from 0")));
    }
    if paths.iter().any(|path| is_feature_file(path)) {
        let features = options.features()?;
        return jobs::run(py, terms, |work| {
            spinney::import::feature::plan_features(&paths, &features, work)?
                .build(work.create_tree(&out)?, work)
        });
    }
    if options.has_feature_options() {
        return Err(invalid("value, overlaps, dtype, width, fractions, where: are for features"));
    }
    if !meshes.is_empty() || any_file(&paths, &|path| mesh::is_model(path, access())).or_raise()? {
        let (mut solid, meshes) = (options.solids()?, arrays_of(&meshes)?);
        return jobs::run(py, terms, |work| {
            let mut models = spinney::raw::import::mesh::open_all_with(&paths, options.memory, access())?;
            models.extend(models_of(meshes)?);
            let unit = models.iter().find_map(|model| model.info().unit.clone());
            solid.unit = options.unit.clone().or(unit);
            spinney::import::mesh::plan_models(models, &solid)?.build(work.create_tree(&out)?, work).map(drop)
        });
    }
    if options.has_pages("z") {
        let volume = options.volume()?;
        return jobs::run(py, terms, |work| {
            volume::plan_sections(&paths, &volume)?.build(work.create_tree(&out)?, work).map(drop)
        });
    }
    if paths.iter().any(|path| volume::is_volume(path)) {
        let [path] = &paths[..] else {
            return Err(invalid(
                "source: got several files with a volume (NPY or NRRD) among them; build one volume at a time",
            ));
        };
        let volume = options.volume()?;
        return jobs::run(py, terms, |work| {
            spinney::import::volume::plan(path, &volume)?.build(work.create_tree(&out)?, work).map(drop)
        });
    }
    if let Some(stack) = options.stack(&paths)? {
        return jobs::run(py, terms, |work| {
            raster::write_stack(
                &spinney::import::raster::plan_stack(&paths, &stack)?,
                work.create_tree(&out)?,
                work,
            )
        });
    }
    let (raster_options, target) = (options.raster_options()?, options.target()?);
    let mut warp = WarpOptions::default();
    warp.resampling = options.resampling.as_ref().map(|way| way.parse()).transpose().or_raise()?;
    warp.allow_ballpark = options.allow_ballpark;
    jobs::run(py, terms, |work| {
        let import = spinney::import::raster::plan(&paths, &raster_options)?;
        let output = work.create_tree(&out)?;
        match &target {
            None => import.build(output, work),
            Some(target) => import.build_warped(target, &warp, output, work).map(drop),
        }
    })
}
