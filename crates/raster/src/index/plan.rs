//! Plans of layers of an index: their sources' windows, and the recorder of the sources.

use std::path::Path;
use std::sync::Arc;

use super::{SourceRecorder, SourceWindow};
use crate::import::{Raster, Validity};
use spinney_base::io::FileAccess;
use spinney_base::value::{Value, ValueType};
use spinney_base::{Error, Result};
use spinney_references::PixelRule;

/// Where the cells of a layer are, and the records of these files.
pub(crate) struct IndexPlan {
    pub(crate) recorder: Arc<SourceRecorder>,
    pub(crate) access: FileAccess,
    /// Windows of files, from the bottom to the top.
    pub(crate) windows: Vec<SourceWindow>,
    pub(crate) value: ValueType,
    /// The value that means VOID.
    pub(crate) nodata: Option<Value>,
}

impl IndexPlan {
    /// Plans the layer of a raster.
    ///
    /// # Errors
    /// If its pixels are not those of recorded files.
    pub(crate) fn of(
        raster: &dyn Raster,
        (value, nodata): (ValueType, Option<Value>),
        recorder: Arc<SourceRecorder>,
        access: &FileAccess,
    ) -> Result<IndexPlan> {
        let mut windows = raster.source_windows().map_err(|found| not_indexable(raster.path(), found))?;
        let info = raster.info();
        let opacity = Validity::by_opacity(info);
        let opacity = opacity.rule();
        for window in &mut windows {
            if window.rule == PixelRule::default() {
                window.rule = opacity.clone();
            }
            // (Otherwise transparent pixels of a virtual raster would show others below.)
            if (window.rule.opacity, window.rule.zeros) != (opacity.opacity, opacity.zeros) {
                return Err(not_indexable(raster.path(), "a virtual raster with opacity"));
            }
        }
        Ok(IndexPlan { recorder, access: access.clone(), windows, value, nodata })
    }
}

/// Returns the error for a raster whose pixels are not those of TIFF files.
pub(crate) fn not_indexable(path: &Path, found: impl Into<String>) -> Error {
    let advice = "build a tree (`spinney build`), or index TIFF files, or a virtual raster that arranges \
                  TIFF files without scaling, masks or other types";
    Error::unsupported(path, found, advice)
}
