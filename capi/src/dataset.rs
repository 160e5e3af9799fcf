//! Opening files, and reading their metadata. No cells are read.

use std::ffi::{CStr, CString, c_char};
use std::path::PathBuf;
use std::sync::OnceLock;

use engine::raw::dataset;
use engine::raw::store::TreeFormat;
use engine::{DataKind, Dataset, FileAccess, OpenOptions, SampleType, ViewOperation};

use crate::metadata;
use crate::status::{Failure, guarded, spinney_status, text_of};

/// A file, or a view of one.
pub struct spinney_dataset {
    pub(crate) dataset: Dataset,
    /// The JSON document of spinney_metadata().
    metadata: CString,
    /// Names of the file's layers, read at the first request.
    layers: OnceLock<Vec<CString>>,
}

impl spinney_dataset {
    fn new(dataset: Dataset) -> spinney_dataset {
        let metadata = metadata::json(&dataset);
        spinney_dataset { dataset, metadata, layers: OnceLock::new() }
    }

    /// Returns the names of the file's layers.
    pub(crate) fn layers(&self) -> Result<&[CString], Failure> {
        if let Some(names) = self.layers.get() {
            return Ok(names);
        }
        let names = self.dataset.layers()?.into_iter().map(|layer| text_of(layer.name)).collect();
        Ok(self.layers.get_or_init(|| names))
    }

    /// Returns a dataset to the caller, through a pointer that is not NULL.
    pub(crate) unsafe fn write_handle(dataset: Dataset, output: *mut *mut spinney_dataset) {
        let handle = Box::new(spinney_dataset::new(dataset));
        // SAFETY: `output` is not NULL, and the caller has a pointer there.
        unsafe { output.write(Box::into_raw(handle)) };
    }
}

/// For spinney_open(): use positioned reads instead of mapping the file.
pub const SPINNEY_POSITIONED: u32 = 1;

/// Type of a sample. Samples have the machine's byte order, which is little-endian on all supported
/// machines.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum spinney_sample_type {
    SPINNEY_U8 = 0,
    SPINNEY_U16 = 1,
    SPINNEY_I16 = 2,
    SPINNEY_U32 = 3,
    SPINNEY_I32 = 4,
    SPINNEY_F32 = 5,
    SPINNEY_F64 = 6,
    SPINNEY_I8 = 7,
    SPINNEY_U64 = 8,
    SPINNEY_I64 = 9,
}

impl From<SampleType> for spinney_sample_type {
    fn from(sample: SampleType) -> Self {
        use spinney_sample_type::*;
        match sample {
            SampleType::U8 => SPINNEY_U8,
            SampleType::U16 => SPINNEY_U16,
            SampleType::I16 => SPINNEY_I16,
            SampleType::U32 => SPINNEY_U32,
            SampleType::I32 => SPINNEY_I32,
            SampleType::F32 => SPINNEY_F32,
            SampleType::F64 => SPINNEY_F64,
            SampleType::I8 => SPINNEY_I8,
            SampleType::U64 => SPINNEY_U64,
            SampleType::I64 => SPINNEY_I64,
        }
    }
}

/// Type, size and georeferencing of a dataset.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_info {
    /// 2 for quadtrees (rasters), 3 for octrees (volumes and solids).
    pub axes: u32,
    /// Type of a sample.
    pub sample: spinney_sample_type,
    /// Samples per cell, 1 to 4.
    pub channels: u32,
    /// Bytes per cell: those of all its samples.
    pub cell_size: u32,
    /// The level of the cells. Level 0 is the whole space as one node; each further level doubles
    /// the resolution along each axis.
    pub depth: u32,
    /// Index of the opacity channel, or -1.
    pub alpha: i32,
    /// Size in cells along x, y and z; z is 1 in quadtrees.
    pub size: [u64; 3],
    /// Georeferencing of the cells: rows x, y, z of the matrix that maps x, y, z, 1 in cells to
    /// world coordinates. Cell 0 spans 0 to 1.
    pub matrix: [f64; 12],
    /// The input's nodata number, if has_nodata: the nearest double of it (see spinney_nodata()).
    pub nodata: f64,
    pub has_nodata: bool,
    /// Whether the matrix is known.
    pub has_georeference: bool,
    /// Whether values are classes (categorical).
    pub is_categorical: bool,
    /// Whether the file is an Autumnal file: editable, with commits.
    pub is_autumnal: bool,
    /// Number of the commit, or 0.
    pub commit: u64,
}

/// Sets how many bytes of unpacked segments all open files together keep in memory. The default is
/// 64 MiB.
#[unsafe(no_mangle)]
pub extern "C" fn spinney_set_cache_memory(bytes: u64) {
    FileAccess::default().unpacked().set_limit(bytes);
}

/// Opens a tree file of either format and any type. `map.autumn@12` is commit 12 of `map.autumn`;
/// `stack.goblin:B08` is the layer `B08` of `stack.goblin`. The first layer is opened if none is
/// named. `steps` are the `step_count` operations of a view, in the syntax of `spinney transform`
/// ("rotate=30", "crop"); NULL and 0 open the file itself. `flags` is 0 or SPINNEY_POSITIONED.
/// Close the dataset with spinney_close().
///
/// Reads a few pages, whatever the file's size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_open(
    path: *const c_char,
    steps: *const *const c_char,
    step_count: usize,
    flags: u32,
    dataset: *mut *mut spinney_dataset,
) -> spinney_status {
    guarded(|| {
        if path.is_null() || dataset.is_null() || (steps.is_null() && step_count > 0) {
            return Err(Failure::invalid(
                "spinney_open: got NULL, expected a path, and a pointer to the dataset",
            ));
        }
        if flags & !SPINNEY_POSITIONED != 0 {
            return Err(Failure::invalid(format!(
                "spinney_open: got flags {flags}, expected 0 or SPINNEY_POSITIONED"
            )));
        }
        // SAFETY: the caller passes a zero-terminated string.
        let path = path_of(unsafe { CStr::from_ptr(path) })?;
        let mut options = OpenOptions::new();
        if flags & SPINNEY_POSITIONED != 0 {
            options.access = options.access.positioned(None);
        }
        engine::raw::register();
        let mut opened = dataset::open(&path, &options)?;
        let mut chain: Vec<ViewOperation> = Vec::new();
        for step in 0..step_count {
            // SAFETY: the caller passes `step_count` pointers to zero-terminated strings.
            let text = unsafe {
                let text = *steps.add(step);
                if text.is_null() {
                    return Err(Failure::invalid("spinney_open: got NULL, expected an operation of a view"));
                }
                CStr::from_ptr(text)
            };
            let text = text.to_str().map_err(|_| {
                Failure::invalid("spinney_open: got other bytes, expected an operation in UTF-8")
            })?;
            chain.push(text.parse()?);
        }
        if !chain.is_empty() {
            opened = opened.view(&chain)?;
        }
        // SAFETY: `dataset` is not NULL, and points to the caller's pointer.
        unsafe { spinney_dataset::write_handle(opened, dataset) };
        Ok(())
    })
}

#[cfg(unix)]
pub(crate) fn path_of(path: &CStr) -> Result<PathBuf, Failure> {
    use std::os::unix::ffi::OsStrExt;
    Ok(std::ffi::OsStr::from_bytes(path.to_bytes()).into())
}

#[cfg(not(unix))]
pub(crate) fn path_of(path: &CStr) -> Result<PathBuf, Failure> {
    path.to_str().map(PathBuf::from).map_err(|_| Failure::invalid("path: got other bytes, expected UTF-8"))
}

/// Closes a dataset. Does nothing for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_close(dataset: *mut spinney_dataset) {
    guarded(|| {
        if !dataset.is_null() {
            // SAFETY: it comes from spinney_open(), and no other thread uses it any more.
            drop(unsafe { Box::from_raw(dataset) });
        }
        Ok(())
    });
}

/// Returns the dataset of a handle.
pub(crate) unsafe fn opened<'a>(dataset: *const spinney_dataset) -> Result<&'a spinney_dataset, Failure> {
    // SAFETY: it is NULL, or comes from spinney_open() and is not closed.
    unsafe { dataset.as_ref() }
        .ok_or_else(|| Failure::invalid("dataset: got NULL, expected one from spinney_open"))
}

/// Moves a dataset to the newest commit of a file that is edited. `is_newer` (which may be NULL) is
/// set to whether there was a newer one. A dataset that was opened at a certain commit, and a view,
/// is not changed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_refresh(
    dataset: *mut spinney_dataset,
    is_newer: *mut bool,
) -> spinney_status {
    guarded(|| {
        // SAFETY: it is NULL, or comes from spinney_open(), and no other thread uses it during the
        // call.
        let handle = unsafe { dataset.as_mut() };
        let handle =
            handle.ok_or_else(|| Failure::invalid("dataset: got NULL, expected one from spinney_open"))?;
        let newer = handle.dataset.refresh()?;
        if newer {
            handle.metadata = metadata::json(&handle.dataset);
            handle.layers = OnceLock::new();
        }
        // SAFETY: it is NULL, or points to the caller's variable.
        if let Some(output) = unsafe { is_newer.as_mut() } {
            *output = newer;
        }
        Ok(())
    })
}

/// Fails with SPINNEY_CHANGED if the file was overwritten or truncated after it was opened: results
/// may then mix the old and the new contents. Call it at the end of long work.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_check_unchanged(dataset: *const spinney_dataset) -> spinney_status {
    // SAFETY: see `opened`.
    guarded(|| Ok(unsafe { opened(dataset) }?.dataset.check_unchanged()?))
}

/// Writes type, size and georeferencing of a dataset to `info`. `info_size` is
/// `sizeof(spinney_info)`, so that later versions can add fields.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_describe(
    dataset: *const spinney_dataset,
    info: *mut spinney_info,
    info_size: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened`.
        let dataset = &unsafe { opened(dataset) }?.dataset;
        if info.is_null() || info_size != size_of::<spinney_info>() {
            let expected = size_of::<spinney_info>();
            return Err(Failure::invalid(format!(
                "info: got {info_size} bytes, expected a pointer to {expected}"
            )));
        }
        let (header, metadata) = (dataset.header(), dataset.metadata());
        let matrix = metadata.frame.matrix;
        let known = spinney_info {
            axes: header.form.axes() as u32,
            sample: header.form.value.sample.into(),
            channels: header.form.value.channels.into(),
            cell_size: header.form.width() as u32,
            depth: header.depth().into(),
            alpha: metadata.alpha.map_or(-1, i32::from),
            size: header.extent,
            matrix: std::array::from_fn(|i| matrix[i / 4][i % 4]),
            nodata: metadata.nodata.unwrap_or_default().to_f64(),
            has_nodata: metadata.nodata.is_some(),
            has_georeference: !metadata.frame.is_identity() || metadata.frame.crs.is_some(),
            is_categorical: header.kind == DataKind::Categorical,
            is_autumnal: dataset.format() == TreeFormat::Autumnal,
            commit: dataset.commit().map_or(0, |commit| commit.number),
        };
        // SAFETY: it is not NULL, and has the size of the struct.
        unsafe { info.write(known) };
        Ok(())
    })
}

/// Writes the size of a level in its cells, along x, y and z. A level deeper than the cells counts
/// as the cells' level.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_level_size(
    dataset: *const spinney_dataset,
    level: u32,
    size: *mut [u64; 3],
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened`.
        let dataset = &unsafe { opened(dataset) }?.dataset;
        // SAFETY: it is NULL, or points to the caller's array.
        let size =
            unsafe { size.as_mut() }.ok_or_else(|| Failure::invalid("size: got NULL, expected a pointer"))?;
        *size = dataset.extent_at(level_of(level)).max;
        Ok(())
    })
}

/// Converts a level to the library's type. A level that is too deep remains too deep.
pub(crate) fn level_of(level: u32) -> u8 {
    u8::try_from(level).unwrap_or(u8::MAX)
}

/// Returns the other metadata of a dataset as JSON: "name" (of the layer), "time", "crs", "bands"
/// (name, unit, scale, offset of each), "categories" (names by value), "palette" (red, green, blue,
/// opacity by value), "tags", "scoped_tags", "provenance".
///
/// The "crs" has its original "form" and "definition", and a "text" for other programs: "EPSG:4326"
/// or the like, or else WKT 2. If neither can express the system, "problem" has the reason, and
/// "text" is null, or the original WKT 1, PROJJSON or PROJ string.
///
/// The string belongs to the dataset, and is valid until the dataset is closed or refreshed. NULL
/// if the dataset is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_metadata(dataset: *const spinney_dataset) -> *const c_char {
    // SAFETY: it is NULL, or comes from spinney_open() and is not closed.
    unsafe { dataset.as_ref() }.map_or(std::ptr::null(), |dataset| dataset.metadata.as_ptr())
}
