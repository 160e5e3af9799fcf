//! Trees that are drawn, with what drawing needs and takes time to make.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use spinney_base::value::Value;
use spinney_base::{Error, Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_style::Style;
use spinney_tiles::{TileContent, TileId, TilePainter, TileSource, TreeTiles, WarpedTiles};

/// Pixels along each side of a tile.
pub(crate) const SIDE: usize = 256;

/// A tree that is drawn.
pub(crate) struct Drawn {
    pub(crate) tree: Arc<Dataset>,
    /// Whether its channels are layers of the file.
    pub(crate) is_composite: bool,
    /// The tiles that it is warped to, once they were asked for.
    warped: Mutex<Option<Arc<WarpedTiles>>>,
    /// Styles made ready, by their documents.
    painters: Mutex<HashMap<String, Arc<TilePainter>>>,
    kept: Mutex<KeptPictures>,
}

/// Pictures of tiles that are asked for over and over, or take long to make.
#[derive(Default)]
struct KeptPictures {
    pictures: HashMap<PictureKey, Vec<u8>>,
    /// Bytes of all of them.
    bytes: usize,
}

/// The part of a tree that a picture shows which is kept.
#[derive(PartialEq, Eq, Hash)]
pub(crate) enum Seen {
    /// One value all over.
    Uniform(Value),
    /// A tile, all of which may be made of very many cells.
    Tile(TileId),
}

/// All that the bytes of a picture depend on: the look of its style, the ending of its format, and the part that is seen.
pub(crate) type PictureKey = (String, &'static str, Seen);

/// Bytes of pictures that are kept of a tree.
const MOST_BYTES: usize = 8 << 20;

/// The last zoom whose warped tiles are kept: all that there are to it are 85, and each is made of the cells that are fine enough for the highest latitudes.
const LAST_KEPT: u8 = 3;

/// Styles that are kept ready for a tree.
const MOST_PAINTERS: usize = 16;

/// The tiles of a tree.
pub(crate) enum Tiles<'a> {
    Own(TreeTiles<'a>),
    Warped(Arc<WarpedTiles>),
}

impl Tiles<'_> {
    /// The part that a tile shows, if a picture of it is worth being kept. Where pixels depend on `margin` cells around them, what is around a tile
    /// of one value matters, too.
    ///
    /// # Errors
    /// If the tree cannot be read.
    pub(crate) fn seen(&self, tile: TileId, margin: usize) -> Result<Option<Seen>> {
        Ok(match (self, self.source().content(tile)?) {
            (_, TileContent::Uniform(value)) if margin == 0 => Some(Seen::Uniform(value)),
            (Tiles::Warped(_), _) if tile.zoom <= LAST_KEPT => Some(Seen::Tile(tile)),
            _ => None,
        })
    }

    pub(crate) fn source(&self) -> &dyn TileSource {
        match self {
            Tiles::Own(tiles) => tiles,
            Tiles::Warped(tiles) => &**tiles,
        }
    }
}

impl Drawn {
    pub(crate) fn new(tree: Arc<Dataset>, is_composite: bool) -> Drawn {
        Drawn {
            tree,
            is_composite,
            warped: Mutex::default(),
            painters: Mutex::default(),
            kept: Mutex::default(),
        }
    }

    /// The tiles of the tree's own square, or of the world in web mercator.
    ///
    /// # Errors
    /// If it is an octree, or has no place in the world where that is needed.
    pub(crate) fn tiles(&self, is_native: bool) -> Result<Tiles<'_>> {
        let tree = &*self.tree;
        if tree.header().form.axes() != 2 {
            let advice = "tiles are of quadtrees: ask for windows, of one layer of cells each (z)";
            return Err(Error::unsupported(tree.name(), "an octree", advice));
        }
        if is_native {
            return Ok(Tiles::Own(TreeTiles::native(tree)));
        }
        if let Some(tiles) = TreeTiles::world(tree) {
            return Ok(Tiles::Own(tiles));
        }
        let mut warped = self.warped.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(tiles) = &*warped {
            return Ok(Tiles::Warped(tiles.clone()));
        }
        let Some(source) = tree.whole_source() else {
            let advice = "ask for tiles of its own grid (grid=native)";
            return Err(Error::unsupported(
                tree.name(),
                "a view on another grid than that of web maps",
                advice,
            ));
        };
        let tiles = WarpedTiles::new(source, &tree.metadata().frame, SIDE, None, &Default::default())?;
        Ok(Tiles::Warped(warped.insert(Arc::new(tiles)).clone()))
    }

    /// A picture that is kept; `make` makes it if it is not there yet.
    ///
    /// # Errors
    /// Those of `make`.
    pub(crate) fn picture(
        &self,
        key: PictureKey,
        make: impl FnOnce() -> Result<Option<Vec<u8>>>,
    ) -> Result<Option<Vec<u8>>> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let known = kept().pictures.get(&key).cloned();
        if known.is_some() {
            return Ok(known);
        }
        let made = make()?;
        if let Some(picture) = made.as_ref().filter(|picture| picture.len() < MOST_BYTES / 4) {
            let mut kept = kept();
            if kept.bytes + picture.len() > MOST_BYTES {
                *kept = KeptPictures::default();
            }
            if kept.pictures.insert(key, picture.clone()).is_none() {
                kept.bytes += picture.len();
            }
        }
        Ok(made)
    }

    /// A style made ready; the tree's own if none is given.
    ///
    /// # Errors
    /// Those of [`TilePainter::new`].
    pub(crate) fn painter(&self, style: Option<&Style>, progress: &dyn Progress) -> Result<Arc<TilePainter>> {
        let own;
        let style = match style {
            Some(style) => style,
            None => {
                own = Style::default_for(&self.tree);
                &own
            }
        };
        // (Who asks for the same style meanwhile waits for it.)
        let mut painters = self.painters.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(painter) = painters.get(style.json()) {
            return Ok(painter.clone());
        }
        let painter = Arc::new(TilePainter::new(style, &self.tree, progress)?);
        if painters.len() >= MOST_PAINTERS {
            painters.clear();
        }
        painters.insert(style.json().to_owned(), painter.clone());
        Ok(painter)
    }
}
