//! Indexes: trees whose cells stay in TIFF files. While a tree is built, the files that are read
//! are recorded, and the checksums of their chunks; afterwards the sections of the index are made.

mod names;
mod plan;
mod recorder;
mod sections;
mod sources;
mod stac;
mod update;

pub(crate) use self::plan::{IndexPlan, not_indexable};
pub use self::recorder::SourceRecorder;
pub(crate) use self::recorder::{RecordedChunks, RecordedImage, RecordedSource, stat};
pub use self::sections::sections_of_shards;
pub(crate) use self::sections::write_sections;
pub use self::sources::{SourceFile, expand_sources};
pub use self::update::{IndexUpdate, UpdateReport, update_index};
use spinney_base::space::Region;
use spinney_references::PixelRule;

/// A window of a recorded file, and the pixels of a raster that are those of the window.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceWindow {
    /// Number of the file in the recorder.
    pub(crate) source: usize,
    /// The file's channels, from 0.
    pub(crate) channels: Vec<usize>,
    /// Pixels that are VOID.
    pub(crate) rule: PixelRule,
    /// The pixels of the raster.
    pub(crate) cells: Region,
    /// The pixel of the file that is the first of them.
    pub(crate) from: [u64; 2],
}
