//! Datasets: tree files of either format, directly or through views, with one interface for the
//! command line and for bindings.

mod contours;
mod dumps;
mod labels;
mod outer_bounds;
mod polygons;
mod queries;
mod rebuild;
mod solids;
mod viewed;
mod zonal;

use std::fmt;
use std::path::Path;
use std::sync::Arc;

pub use self::rebuild::Rebuild;
use self::viewed::Viewed;
use crate::ops::{
    FileView, LayerInfo, Sampling, TreeFile, View, ViewOperation, ViewSource, WarpGrid, data_box,
};
use crate::store::autumnal::{Autumnal, Commit};
use crate::store::goblin::Goblin;
use crate::tree::Source;
use spinney_base::io::{FileAccess, FileStat, url_of};
use spinney_base::space::Bounds;
use spinney_base::{Error, Progress, Result};
use spinney_container::{FileReference, Finding, Header, Metadata, OpenOptions, TreeFormat};

/// An open tree file of any tree type and either format, or a view of one. Can be shared by any
/// number of threads.
///
/// Values are returned as [`Number`](spinney_base::value::Number), which represents every sample
/// type exactly, or as little-endian bytes. Levels count from the root (0) to the cells
/// ([`Dataset::depth`]). Coordinates are in cells of the requested level, in the order x, y, z; z
/// is 0 in quadtrees.
///
/// ```no_run
/// use spinney::raw::dataset;
/// use spinney::{Bounds, OpenOptions};
///
/// let map = dataset::open("world.goblin".as_ref(), &OpenOptions::default())?;
/// let tile = Bounds { min: [0; 3], max: [256, 256, 1] };
/// let mut bytes = vec![0; 256 * 256 * map.header().form.width()];
/// map.window(8, &tile, 0.0, &mut bytes, None)?;
/// // A view of the file, without opening it again.
/// let turned = map.view(&["rotate=30".parse()?, "crop".parse()?])?;
/// println!("{:?}", turned.header().extent);
/// # Ok::<(), spinney::Error>(())
/// ```
pub struct Dataset {
    tree: Tree,
}

/// The reader that a dataset forwards all queries to: one of the two formats, or a view.
enum Tree {
    Goblin(Arc<Goblin>),
    Autumnal(Arc<Autumnal>),
    View(Box<Viewed>),
}

/// Opens a tree file of either format and any tree type. `map.autumn@12` is commit 12 of
/// `map.autumn`; `stack.goblin:B08` is the layer `B08` of `stack.goblin`. The default layer is the
/// first.
///
/// # Errors
/// If the file cannot be read, is not a tree file, is corrupt, or has a newer version.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Dataset> {
    Dataset::of(TreeFile::open(path, options)?.into())
}

/// Opens a view of a file through a chain of operations. Nothing is computed in advance. For a file
/// that is already open, use [`Dataset::view`].
///
/// # Errors
/// If the file cannot be read, or an operation is not possible.
pub fn open_view(chain: &FileView) -> Result<Dataset> {
    Ok(Dataset::of_view(Viewed::new(chain.open()?, chain.moves)))
}

impl Dataset {
    /// Returns a dataset of an open file, or of any other source that a view can have.
    ///
    /// # Errors
    /// If the source's header is invalid.
    pub fn of(source: ViewSource) -> Result<Dataset> {
        let tree = match source {
            ViewSource::File(TreeFile::Goblin(file)) => Tree::Goblin(file),
            ViewSource::File(TreeFile::Autumnal(file)) => Tree::Autumnal(file),
            source @ ViewSource::File(TreeFile::Mosaic(_)) => {
                // (A mosaic's levels are those of its files, which follow the rule.)
                let rule = source.header().rule;
                let view = View::whole(source)?.sampled(Sampling::Area(rule))?;
                return Ok(Dataset::of_view(Viewed::new(view, false)));
            }
            source => return Ok(Dataset::of_view(Viewed::new(View::whole(source)?, false))),
        };
        Ok(Dataset { tree })
    }

    fn of_view(viewed: Viewed) -> Dataset {
        Dataset { tree: Tree::View(Box::new(viewed)) }
    }

    /// Returns the dataset through further operations, without opening the file again. New cells
    /// get their values by the file's rule, and cells keep their world coordinates.
    ///
    /// # Errors
    /// If an operation is not possible.
    pub fn view(self, steps: &[ViewOperation]) -> Result<Dataset> {
        let rule = self.header().rule;
        let file = match self.tree {
            Tree::Goblin(file) => TreeFile::Goblin(file),
            Tree::Autumnal(file) => TreeFile::Autumnal(file),
            Tree::View(viewed) => return Ok(Dataset::of_view(viewed.through(steps)?)),
        };
        let view = View::whole(file.into())?.through(steps)?.sampled(Sampling::Area(rule))?;
        Ok(Dataset::of_view(Viewed::new(view, false)))
    }

    /// Returns the dataset resampled to another grid, in any coordinate system: see
    /// [`Warped`](crate::ops::Warped).
    ///
    /// # Errors
    /// If the dataset is a view that does not show all of its file, or one of the two coordinate
    /// systems is not supported.
    pub fn warped(self, grid: &WarpGrid) -> Result<Dataset> {
        let whole = |file: TreeFile| Ok(Viewed::new(View::whole(file.into())?, false));
        let viewed = match self.tree {
            Tree::Goblin(file) => whole(TreeFile::Goblin(file))?,
            Tree::Autumnal(file) => whole(TreeFile::Autumnal(file))?,
            Tree::View(viewed) => *viewed,
        };
        Ok(Dataset::of_view(viewed.warped(grid)?))
    }

    /// Returns the smallest box of cells around all cells that are not VOID; `None` if all are
    /// VOID.
    ///
    /// # Errors
    /// If the file is corrupt.
    pub fn data_box(&self) -> Result<Option<Bounds>> {
        let whole = |file: TreeFile| data_box(&View::whole(file.into())?);
        match &self.tree {
            Tree::Goblin(file) => whole(TreeFile::Goblin(file.clone())),
            Tree::Autumnal(file) => whole(TreeFile::Autumnal(file.clone())),
            Tree::View(viewed) => data_box(viewed.view()),
        }
    }

    /// Returns the file, if this is not a view of one: for operations on whole files, such as
    /// [`Warped`](crate::ops::Warped).
    pub fn as_file(&self) -> Option<TreeFile> {
        match &self.tree {
            Tree::Goblin(file) => Some(TreeFile::Goblin(file.clone())),
            Tree::Autumnal(file) => Some(TreeFile::Autumnal(file.clone())),
            Tree::View(viewed) => match &**viewed.source_of_all()? {
                ViewSource::File(file @ TreeFile::Mosaic(_)) => Some(file.clone()),
                _ => None,
            },
        }
    }

    /// Returns the file, or the calculation on files, unless further operations are applied to it:
    /// for operations that read levels, such as [`Warped`](crate::ops::Warped).
    pub fn whole_source(&self) -> Option<Arc<ViewSource>> {
        match &self.tree {
            Tree::View(viewed) => {
                let source = viewed.view().source();
                (source.draws_levels() && viewed.view().is_whole()).then(|| source.clone())
            }
            _ => self.as_file().map(|file| Arc::new(file.into())),
        }
    }

    /// Returns the file, also that of a view: see [`ViewSource::file`].
    fn file(&self) -> Option<TreeFile> {
        match &self.tree {
            Tree::View(viewed) => viewed.source().file(),
            _ => self.as_file(),
        }
    }

    /// Returns a number that identifies the state of all files in a manifest: another state has
    /// another number. `None` if this is not a manifest.
    pub fn listed_state(&self) -> Option<u128> {
        match self.file()? {
            TreeFile::Mosaic(tree) => Some(tree.state()),
            TreeFile::Goblin(_) | TreeFile::Autumnal(_) => None,
        }
    }

    /// Returns the file's format; a dataset without a file counts as Goblin, the read-only format.
    pub fn format(&self) -> TreeFormat {
        self.file().map_or(TreeFormat::Goblin, |file| file.format())
    }

    /// Returns the commit that is read; only Autumnal files have commits.
    pub fn commit(&self) -> Option<&Commit> {
        match &self.tree {
            Tree::Goblin(_) => None,
            Tree::Autumnal(file) => Some(file.commit()),
            Tree::View(viewed) => viewed.source().commit(),
        }
    }

    /// Switches to the newest commit, if the file has a newer one; returns whether it has. Datasets
    /// opened at a specific commit and views do not change.
    ///
    /// # Errors
    /// If the file can no longer be read. The dataset is unchanged then.
    pub fn refresh(&mut self) -> Result<bool> {
        match &mut self.tree {
            // A reader that is shared with others must not change under them.
            Tree::Autumnal(file) => Arc::get_mut(file).map_or(Ok(false), Autumnal::refresh),
            Tree::Goblin(_) | Tree::View(_) => Ok(false),
        }
    }

    /// Returns the layers of the file: names and headers. A view has one layer, which has the name
    /// of the view's metadata.
    ///
    /// # Errors
    /// If a layer is corrupt.
    pub fn layers(&self) -> Result<Vec<LayerInfo>> {
        match self.as_file() {
            Some(file) => file.layers(),
            None => Ok(vec![LayerInfo {
                name: self.metadata().name.clone(),
                header: self.header().clone(),
                bytes: None,
            }]),
        }
    }

    /// Returns the index of this dataset's layer in the file.
    pub fn layer_number(&self) -> usize {
        self.as_file().map_or(0, |file| file.layer_number())
    }

    /// Returns another layer of the same file, by its name or its index from 0, without opening the
    /// file again.
    ///
    /// # Errors
    /// If there is no layer of that name or index, it is corrupt, or this is a view.
    pub fn layer(&self, name: &str) -> Result<Dataset> {
        let Some(file) = self.as_file() else {
            let advice = "name the layer when you open the view, as in FILE:LAYER";
            return Err(Error::unsupported(self.name(), "choosing a layer of a view", advice));
        };
        let layers = file.layers()?;
        let place = FileReference { file: self.name().into(), commit: None, layer: Some(name.into()) };
        let number = place.layer_number(layers.iter().map(|layer| &*layer.name))?;
        Dataset::of(file.open_layer(number)?.into())
    }

    /// Returns another layer of the same file on the cells of this one: the layer itself if its
    /// cells have the same size, else a view of it.
    ///
    /// # Errors
    /// Those of [`Dataset::layer`].
    pub fn aligned_layer(&self, name: &str) -> Result<Dataset> {
        let layer = self.layer(name)?;
        if layer.depth() == self.depth() && layer.header().extent == self.header().extent {
            return Ok(layer);
        }
        match (self.as_file(), layer.as_file()) {
            (Some(own), Some(layer)) => {
                let view = View::whole(own.into())?.of_layer(layer.into())?;
                Ok(Dataset::of_view(Viewed::new(view, false)))
            }
            _ => Ok(layer),
        }
    }

    /// Returns the header: tree type, rule, depth, extent. A view has a depth and an extent of its
    /// own.
    pub fn header(&self) -> &Header {
        match &self.tree {
            Tree::Goblin(file) => file.header(),
            Tree::Autumnal(file) => file.header(),
            Tree::View(viewed) => viewed.header(),
        }
    }

    /// Returns the metadata: frame, nodata, palette, names, provenance. A view has a frame of its
    /// own.
    pub fn metadata(&self) -> &Metadata {
        match &self.tree {
            Tree::Goblin(file) => file.metadata(),
            Tree::Autumnal(file) => file.metadata(),
            Tree::View(viewed) => viewed.metadata(),
        }
    }

    /// Returns the file's path; a view of a tree in memory has none.
    pub fn path(&self) -> Option<&Path> {
        match &self.tree {
            Tree::Goblin(file) => Some(file.path()),
            Tree::Autumnal(file) => Some(file.path()),
            Tree::View(viewed) => viewed.source().path(),
        }
    }

    /// Returns how the file was opened.
    pub fn access(&self) -> FileAccess {
        match &self.tree {
            Tree::Goblin(file) => file.access().clone(),
            Tree::Autumnal(file) => file.access().clone(),
            Tree::View(viewed) => viewed.source().access(),
        }
    }

    /// Returns the name for messages: the path, if there is one.
    pub fn name(&self) -> &Path {
        match &self.tree {
            Tree::Goblin(file) => file.path(),
            Tree::Autumnal(file) => file.path(),
            Tree::View(viewed) => viewed.source().name(),
        }
    }

    /// Returns the size of the whole file in bytes.
    pub fn file_size(&self) -> u64 {
        self.file().map_or(0, |file| file.file_size())
    }

    /// Returns the number of segments; 0 for Autumnal files, which have none.
    pub fn segments(&self) -> usize {
        self.file().map_or(0, |file| file.segments())
    }

    /// Returns the number of record slots. For Goblin files, this counts the slots in all segments;
    /// dense blocks use fewer slots than the records that they replace, and records stored twice
    /// count twice. For Autumnal files, it counts the INNER nodes of the commit's tree; nodes of
    /// shared subtrees count once per occurrence.
    pub fn stored_records(&self) -> u64 {
        self.file().map_or(0, |file| file.stored_records())
    }

    /// Returns name and size in bytes of each section of the file.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        self.file().map_or_else(Vec::new, |file| file.sections())
    }

    /// Returns the number of levels below the root.
    pub fn depth(&self) -> u8 {
        self.header().depth()
    }

    /// Returns the extent at a level, in that level's cells (rounded up). All cells outside of it
    /// are VOID. Levels deeper than [`Dataset::depth`] count as that level.
    pub fn extent_at(&self, level: u8) -> Bounds {
        let shift = self.depth().saturating_sub(level);
        Bounds::of_extent(self.header().extent.map(|cells| cells.div_ceil(1 << shift)))
    }

    /// Returns whether the values of a level are approximate. This holds for the levels of a
    /// [calculation](ViewOperation::Calculation) above its cells, which are calculated from the
    /// operands' values at that level. It concerns windows and single cells. Statistics, zones,
    /// histograms, searches and exact sizes are computed from the cells.
    pub fn is_approximate(&self, level: u8) -> bool {
        match &self.tree {
            Tree::Goblin(_) | Tree::Autumnal(_) => false,
            Tree::View(viewed) => level < self.depth() && viewed.source().is_approximate(),
        }
    }

    /// Returns a remark on the file for its readers: see [`Autumnal::remark`].
    pub fn remark(&self) -> Option<&'static str> {
        match &self.tree {
            Tree::Goblin(_) => None,
            Tree::Autumnal(file) => file.remark(),
            Tree::View(viewed) => viewed.source().remark(),
        }
    }

    /// Checks that the file has not changed since it was opened, apart from new commits in an
    /// Autumnal file, so that all results since then are of one state. Costs one stat of the file
    /// (length and modification time): to be called once after a batch of queries, not for each.
    ///
    /// # Errors
    /// If the file was overwritten or truncated. Files that were renamed or removed keep their
    /// contents for the processes that have them open. Each read of a remote file checks its
    /// version anyway, so no request is made for it here: see [`Dataset::check_remote`].
    pub fn check_unchanged(&self) -> Result<()> {
        match &self.tree {
            Tree::Goblin(file) => file.check_unchanged(),
            Tree::Autumnal(file) => file.check_unchanged(),
            Tree::View(viewed) => viewed.source().check_unchanged(),
        }
    }

    /// Checks with one request to the host that a remote file still has the version that was
    /// opened. (Does nothing for a view: call it on the dataset that the view was made of.)
    ///
    /// # Errors
    /// [`Error::Changed`] if the version is another one; also if the host does not respond, or no
    /// longer has the file.
    pub fn check_remote(&self) -> Result<()> {
        match &self.tree {
            Tree::Goblin(file) => file.check_remote(),
            Tree::Autumnal(file) => file.check_remote(),
            Tree::View(_) => Ok(()),
        }
    }

    /// Returns the file's version at the time it was opened; `None` for a view and for bytes in
    /// memory.
    pub fn version(&self) -> Option<&FileStat> {
        match &self.tree {
            Tree::Goblin(file) => file.version(),
            Tree::Autumnal(file) => file.version(),
            Tree::View(_) => None,
        }
    }

    /// Verifies the whole file: see [`Goblin::verify`] and [`Autumnal::verify`].
    ///
    /// # Errors
    /// If the file cannot be read, or on cancellation.
    pub fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        self.file().map_or_else(|| Ok(Vec::new()), |file| file.verify(memory, progress))
    }

    /// Checks that copies of the file can be read wherever they are: an index must name its sources
    /// by URLs.
    ///
    /// # Errors
    /// If it names a file by its path.
    pub fn check_movable(&self) -> Result<()> {
        let Some(TreeFile::Goblin(file)) = self.as_file() else { return Ok(()) };
        let is_local = |name: &str| url_of(Path::new(name)).is_none();
        let Some(name) = file.find_source(&is_local)? else { return Ok(()) };
        let found = format!("a copy of an index whose cells are in local files ({name})");
        let advice =
            "index the files by their URLs, or write a file with all cells first (`spinney transform`)";
        Err(Error::unsupported(file.path(), found, advice))
    }

    /// Verifies the whole file except for the trees of older commits.
    ///
    /// # Errors
    /// Those of [`Dataset::verify`].
    pub fn verify_quickly(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        self.file().map_or_else(|| Ok(Vec::new()), |file| file.verify_quickly(memory, progress))
    }
}

impl fmt::Debug for Dataset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Dataset").field("path", &self.path()).field("header", self.header()).finish()
    }
}
