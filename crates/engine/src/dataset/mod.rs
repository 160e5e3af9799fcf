//! Datasets: tree files of either format, as they are or through views, behind one interface, for the command
//! line and for bindings.

mod contours;
mod labels;
mod outer_bounds;
mod polygons;
mod questions;
mod rebuild;
mod solids;
mod texts;
mod viewed;
mod zonal;

use std::fmt;
use std::path::Path;
use std::sync::Arc;

pub use self::rebuild::Rebuild;
use self::viewed::Viewed;
use crate::ops::{FileView, LayerInfo, Sampling, TreeFile, View, ViewSource, ViewStep, WarpGrid, data_box};
use crate::store::autumnal::{Autumnal, Commit};
use crate::store::goblin::Goblin;
use crate::tree::Source;
use spinney_base::io::{FileAccess, FileStat};
use spinney_base::space::Bounds;
use spinney_base::{Error, Progress, Result};
use spinney_container::{FileReference, Finding, Header, Metadata, OpenOptions, TreeFormat};

/// A tree file of any form and either format, or a view of one, open for questions; may be shared by any
/// number of threads.
///
/// Values come as f64 (which holds every sample type exactly) or as little-endian bytes; levels count from
/// the root (0) to the cells ([`Dataset::depth`]); coordinates are cells of the level that is asked for, x,
/// y, z, the last 0 in quadtrees.
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

/// Reader of a dataset, to which all questions go: one of the two formats, or a view.
enum Tree {
    Goblin(Arc<Goblin>),
    Autumnal(Arc<Autumnal>),
    View(Box<Viewed>),
}

/// Opens a tree file of either format and any form; `map.autumn@12` is commit 12 of `map.autumn`, `stack.goblin:B08` the layer `B08` of
/// `stack.goblin` (the first if none is named).
///
/// # Errors
/// If it cannot be read, is no tree file, is damaged, or of a newer version.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Dataset> {
    Dataset::of(TreeFile::open(path, options)?.into())
}

/// Opens a view of a file through a chain of steps: nothing is computed beforehand. For a file that is open
/// already, there is [`Dataset::view`].
///
/// # Errors
/// If the file cannot be read, or a step cannot be done.
pub fn open_view(chain: &FileView) -> Result<Dataset> {
    Ok(Dataset::of_view(Viewed::new(chain.open()?, chain.moves)))
}

impl Dataset {
    /// An open file, or anything else that a view can stand on.
    ///
    /// # Errors
    /// If the file's header says what no file can have.
    pub fn of(source: ViewSource) -> Result<Dataset> {
        let tree = match source {
            ViewSource::File(TreeFile::Goblin(file)) => Tree::Goblin(file),
            ViewSource::File(TreeFile::Autumnal(file)) => Tree::Autumnal(file),
            source @ ViewSource::File(TreeFile::Mosaic(_)) => {
                // (Its levels are those of its files, which are made by the rule.)
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

    /// The dataset through more steps, without opening the file again. New cells get their values by the
    /// file's rule, and cells keep their world coordinates.
    ///
    /// # Errors
    /// If a step cannot be done.
    pub fn view(self, steps: &[ViewStep]) -> Result<Dataset> {
        let rule = self.header().rule;
        let file = match self.tree {
            Tree::Goblin(file) => TreeFile::Goblin(file),
            Tree::Autumnal(file) => TreeFile::Autumnal(file),
            Tree::View(viewed) => return Ok(Dataset::of_view(viewed.through(steps)?)),
        };
        let view = View::whole(file.into())?.through(steps)?.sampled(Sampling::Area(rule))?;
        Ok(Dataset::of_view(Viewed::new(view, false)))
    }

    /// The dataset on a grid of other cells, in any coordinate system: see [`Warped`](crate::ops::Warped).
    ///
    /// # Errors
    /// If it is a view of another part of its file, or one of the two systems cannot be computed.
    pub fn warped(self, grid: &WarpGrid) -> Result<Dataset> {
        let whole = |file: TreeFile| Ok(Viewed::new(View::whole(file.into())?, false));
        let viewed = match self.tree {
            Tree::Goblin(file) => whole(TreeFile::Goblin(file))?,
            Tree::Autumnal(file) => whole(TreeFile::Autumnal(file))?,
            Tree::View(viewed) => *viewed,
        };
        Ok(Dataset::of_view(viewed.warped(grid)?))
    }

    /// The smallest box of cells around all that is not VOID; `None` if all is.
    ///
    /// # Errors
    /// If the file is damaged.
    pub fn data_box(&self) -> Result<Option<Bounds>> {
        let whole = |file: TreeFile| data_box(&View::whole(file.into())?);
        match &self.tree {
            Tree::Goblin(file) => whole(TreeFile::Goblin(file.clone())),
            Tree::Autumnal(file) => whole(TreeFile::Autumnal(file.clone())),
            Tree::View(viewed) => data_box(viewed.view()),
        }
    }

    /// The file, if this is no view of one: for what stands on files, such as [`Warped`](crate::ops::Warped).
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

    /// The file, or what is calculated with files, if nothing is seen through further steps: for what reads levels, such as
    /// [`Warped`](crate::ops::Warped).
    pub fn whole_source(&self) -> Option<Arc<ViewSource>> {
        match &self.tree {
            Tree::View(viewed) => {
                let source = viewed.view().source();
                (source.draws_levels() && viewed.view().is_whole()).then(|| source.clone())
            }
            _ => self.as_file().map(|file| Arc::new(file.into())),
        }
    }

    /// The file, also that behind a view: see [`ViewSource::file`].
    fn file(&self) -> Option<TreeFile> {
        match &self.tree {
            Tree::View(viewed) => viewed.source().file(),
            _ => self.as_file(),
        }
    }

    /// A number that tells the state of all files that a manifest lists: another state has another one. `None` if this is no manifest.
    pub fn listed_state(&self) -> Option<u128> {
        match self.file()? {
            TreeFile::Mosaic(tree) => Some(tree.state()),
            TreeFile::Goblin(_) | TreeFile::Autumnal(_) => None,
        }
    }

    /// The file's format; what comes from no file counts as published.
    pub fn format(&self) -> TreeFormat {
        self.file().map_or(TreeFormat::Goblin, |file| file.format())
    }

    /// The commit that is read; only Autumnal files have commits.
    pub fn commit(&self) -> Option<&Commit> {
        match &self.tree {
            Tree::Goblin(_) => None,
            Tree::Autumnal(file) => Some(file.commit()),
            Tree::View(viewed) => viewed.source().commit(),
        }
    }

    /// Moves on to the newest commit, if the file has got a newer one; returns whether it has. Datasets
    /// opened at a certain commit, and views, stay as they are.
    ///
    /// # Errors
    /// If the file cannot be read any more; the dataset stays as it was then.
    pub fn refresh(&mut self) -> Result<bool> {
        match &mut self.tree {
            // A reader that others have, too, is not pulled away from under them.
            Tree::Autumnal(file) => Arc::get_mut(file).map_or(Ok(false), Autumnal::refresh),
            Tree::Goblin(_) | Tree::View(_) => Ok(false),
        }
    }

    /// The layers of the file: names and headers. A view has one, and no name.
    ///
    /// # Errors
    /// If one is damaged.
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

    /// The number of the layer that is asked, among those of the file.
    pub fn layer_number(&self) -> usize {
        self.as_file().map_or(0, |file| file.layer_number())
    }

    /// Another layer of the same file, by its name or its number from 0, without opening the file again.
    ///
    /// # Errors
    /// If there is none of that name or number, it is damaged, or this is a view.
    pub fn layer(&self, name: &str) -> Result<Dataset> {
        let Some(file) = self.as_file() else {
            let advice = "name the layer where the view is opened, as in FILE:LAYER";
            return Err(Error::unsupported(self.name(), "a view, which has no layers,", advice));
        };
        let layers = file.layers()?;
        let place = FileReference { file: self.name().into(), commit: None, layer: Some(name.into()) };
        let number = place.layer_number(layers.iter().map(|layer| &*layer.name))?;
        Dataset::of(file.open_layer(number)?.into())
    }

    /// Another layer of the same file on the cells of this one: as it is if its cells are as large, else a view of it.
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

    /// The header: form, rule, depth, extent. Depth and extent of views are their own.
    pub fn header(&self) -> &Header {
        match &self.tree {
            Tree::Goblin(file) => file.header(),
            Tree::Autumnal(file) => file.header(),
            Tree::View(viewed) => viewed.header(),
        }
    }

    /// The metadata: frame, nodata, palette, names, provenance. The frame of views is their own.
    pub fn metadata(&self) -> &Metadata {
        match &self.tree {
            Tree::Goblin(file) => file.metadata(),
            Tree::Autumnal(file) => file.metadata(),
            Tree::View(viewed) => viewed.metadata(),
        }
    }

    /// The file's path; a view of a tree in memory has none.
    pub fn path(&self) -> Option<&Path> {
        match &self.tree {
            Tree::Goblin(file) => Some(file.path()),
            Tree::Autumnal(file) => Some(file.path()),
            Tree::View(viewed) => viewed.source().path(),
        }
    }

    /// How the file was opened.
    pub fn access(&self) -> FileAccess {
        match &self.tree {
            Tree::Goblin(file) => file.access().clone(),
            Tree::Autumnal(file) => file.access().clone(),
            Tree::View(viewed) => viewed.source().access(),
        }
    }

    /// The name for messages: the path, if there is one.
    pub fn name(&self) -> &Path {
        match &self.tree {
            Tree::Goblin(file) => file.path(),
            Tree::Autumnal(file) => file.path(),
            Tree::View(viewed) => viewed.source().name(),
        }
    }

    /// Bytes of the whole file.
    pub fn file_size(&self) -> u64 {
        self.file().map_or(0, |file| file.file_size())
    }

    /// Number of segments; 0 in Autumnal files, which have none.
    pub fn segments(&self) -> usize {
        self.file().map_or(0, |file| file.segments())
    }

    /// Places of records in all segments, of which dense blocks need fewer, and records that are stored more than once more; in
    /// Autumnal files the records of the commit's tree, the shared ones as often as they occur.
    pub fn stored_records(&self) -> u64 {
        self.file().map_or(0, |file| file.stored_records())
    }

    /// Name and bytes of each part of the file.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        self.file().map_or_else(Vec::new, |file| file.sections())
    }

    /// Levels below the root.
    pub fn depth(&self) -> u8 {
        self.header().depth()
    }

    /// The picture's size at a level, in that level's cells (rounded up); all cells outside are VOID. Below
    /// the cells there is nothing finer: such a level counts as [`Dataset::depth`].
    pub fn extent_at(&self, level: u8) -> Bounds {
        let shift = self.depth().saturating_sub(level);
        Bounds::picture(self.header().extent.map(|cells| cells.div_ceil(1 << shift)))
    }

    /// Whether numbers of a level are approximate: those of a [calculation](ViewStep::Calculation) above its cells, made of what
    /// its operands have at that level. Windows and single cells are so; statistics, zones, histograms, searches, and sizes that are asked for
    /// exactly go down to the cells.
    pub fn is_approximate(&self, level: u8) -> bool {
        match &self.tree {
            Tree::Goblin(_) | Tree::Autumnal(_) => false,
            Tree::View(viewed) => level < self.depth() && viewed.source().is_approximate(),
        }
    }

    /// A remark on the file that whoever reads it should know: see [`Autumnal::remark`].
    pub fn remark(&self) -> Option<&'static str> {
        match &self.tree {
            Tree::Goblin(_) => None,
            Tree::Autumnal(file) => file.remark(),
            Tree::View(viewed) => viewed.source().remark(),
        }
    }

    /// Makes sure that the file still is what it was when it was opened (an Autumnal file may have got more
    /// commits), so that all answers since are of one state. One look at the file's length and time: to be
    /// asked once after a batch of questions, not for each.
    ///
    /// # Errors
    /// If somebody has overwritten the file or cut it short; files that were renamed or removed stay as they
    /// are for those who have them open. Each read of a remote file checks its version already, so that no request
    /// is made: see [`Dataset::check_remote`].
    pub fn check_unchanged(&self) -> Result<()> {
        match &self.tree {
            Tree::Goblin(file) => file.check_unchanged(),
            Tree::Autumnal(file) => file.check_unchanged(),
            Tree::View(viewed) => viewed.source().check_unchanged(),
        }
    }

    /// Queries the host of a remote file, with one request, whether it still is the version that was opened. (Not of a view: the
    /// dataset that it was made of has the file.)
    ///
    /// # Errors
    /// [`Error::Changed`] if it is not; also if the host does not respond, or has no such file any more.
    pub fn check_remote(&self) -> Result<()> {
        match &self.tree {
            Tree::Goblin(file) => file.check_remote(),
            Tree::Autumnal(file) => file.check_remote(),
            Tree::View(_) => Ok(()),
        }
    }

    /// Version of the file when it was opened; `None` of a view, and of bytes in memory.
    pub fn version(&self) -> Option<&FileStat> {
        match &self.tree {
            Tree::Goblin(file) => file.version(),
            Tree::Autumnal(file) => file.version(),
            Tree::View(_) => None,
        }
    }

    /// Checks all of the file: see [`Goblin::verify`] and [`Autumnal::verify`].
    ///
    /// # Errors
    /// If the file cannot be read, or on interruption.
    pub fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        self.file().map_or_else(|| Ok(Vec::new()), |file| file.verify(memory, progress))
    }

    /// Checks all of the file but the trees of older commits.
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
