//! Trees that are drawn, with what drawing needs and takes time to make.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use spinney_base::value::Value;
use spinney_base::{Error, Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::ops::WarpOptions;
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
    /// Pictures of tiles that are of one value all over.
    uniform: Mutex<HashMap<PictureKey, Vec<u8>>>,
}

/// All that the bytes of a picture of one value depend on: the look of its style, the ending of its format, and the value.
pub(crate) type PictureKey = (String, &'static str, Value);

/// Pictures of one value that are kept of a tree: some hundred bytes each.
const MAX_UNIFORM: usize = 1 << 12;

/// Styles that are kept ready for a tree.
const MAX_PAINTERS: usize = 16;

/// The tiles of a tree.
pub(crate) enum Tiles<'a> {
    Own(TreeTiles<'a>),
    Warped(Arc<WarpedTiles>),
}

impl Tiles<'_> {
    /// The value that a tile is of all over; `None` also where pixels depend on `margin` cells around them: what is around the tile matters then.
    ///
    /// # Errors
    /// If the tree cannot be read.
    pub(crate) fn uniform(&self, tile: TileId, margin: usize) -> Result<Option<Value>> {
        Ok(match self.source().content(tile)? {
            TileContent::Uniform(value) if margin == 0 => Some(value),
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
            uniform: Mutex::default(),
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
        let mut options = WarpOptions::default();
        options.level_cells = Some(WarpOptions::LOOK);
        let tiles = WarpedTiles::new(source, &tree.metadata().frame, SIDE, None, &options)?;
        Ok(Tiles::Warped(warped.insert(Arc::new(tiles)).clone()))
    }

    /// The picture of one value; `make` makes it if it was not asked for yet.
    ///
    /// # Errors
    /// Those of `make`.
    pub(crate) fn uniform_picture(
        &self,
        key: PictureKey,
        make: impl FnOnce() -> Result<Option<Vec<u8>>>,
    ) -> Result<Option<Vec<u8>>> {
        let kept = || self.uniform.lock().unwrap_or_else(PoisonError::into_inner);
        let known = kept().get(&key).cloned();
        if known.is_some() {
            return Ok(known);
        }
        let made = make()?;
        if let Some(picture) = &made {
            let mut kept = kept();
            if kept.len() >= MAX_UNIFORM {
                kept.clear();
            }
            kept.insert(key, picture.clone());
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
        if painters.len() >= MAX_PAINTERS {
            painters.clear();
        }
        painters.insert(style.json().to_owned(), painter.clone());
        Ok(painter)
    }
}
