//! Trees for drawing, with cached objects that are expensive to create.

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

/// Tree for drawing.
pub(crate) struct DrawableTree {
    pub(crate) tree: Arc<Dataset>,
    /// Whether its channels are layers of the file.
    pub(crate) is_composite: bool,
    /// Warped tiles, once they are first requested.
    warped: Mutex<Option<Arc<WarpedTiles>>>,
    /// Prepared styles, by their JSON documents.
    painters: Mutex<HashMap<String, Arc<TilePainter>>>,
    /// Images of tiles with one value throughout.
    uniform: Mutex<HashMap<TileImageKey, Vec<u8>>>,
}

/// All inputs of the image of a uniform tile: the style's `look`, the format's extension, and the
/// value.
pub(crate) type TileImageKey = (String, &'static str, Value);

/// Maximum number of cached images of uniform tiles per tree; each takes a few hundred bytes.
const MAX_UNIFORM: usize = 1 << 12;

/// Maximum number of cached styles per tree.
const MAX_PAINTERS: usize = 16;

/// Tiles of a tree.
pub(crate) enum Tiles<'a> {
    Own(TreeTiles<'a>),
    Warped(Arc<WarpedTiles>),
}

impl Tiles<'_> {
    /// Value of a uniform tile; `None` if it has several values, or if pixels depend on `margin`
    /// cells around the tile.
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

impl DrawableTree {
    pub(crate) fn new(tree: Arc<Dataset>, is_composite: bool) -> DrawableTree {
        DrawableTree {
            tree,
            is_composite,
            warped: Mutex::default(),
            painters: Mutex::default(),
            uniform: Mutex::default(),
        }
    }

    /// Tiles of the tree's own grid, or of the world in web mercator.
    ///
    /// # Errors
    /// If the tree is an octree; or, for web mercator, if it is not georeferenced, or is a view on
    /// another grid.
    pub(crate) fn tiles(&self, is_native: bool) -> Result<Tiles<'_>> {
        let tree = &*self.tree;
        if tree.header().form.axes() != 2 {
            let advice = "tiles need a quadtree; request a window, whose z selects a layer of cells";
            return Err(Error::unsupported(tree.name(), "a map of an octree", advice));
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
            let advice = "request tiles of its own grid (grid=native)";
            return Err(Error::unsupported(tree.name(), "a web map of a view on another grid", advice));
        };
        let mut options = WarpOptions::default();
        options.level_cells = Some(WarpOptions::PREVIEW);
        let tiles = WarpedTiles::new(source, &tree.metadata().frame, SIDE, None, &options)?;
        Ok(Tiles::Warped(warped.insert(Arc::new(tiles)).clone()))
    }

    /// Image of a uniform tile; `make` creates it if it is not cached.
    ///
    /// # Errors
    /// Those of `make`.
    pub(crate) fn uniform_image(
        &self,
        key: TileImageKey,
        make: impl FnOnce() -> Result<Option<Vec<u8>>>,
    ) -> Result<Option<Vec<u8>>> {
        let kept = || self.uniform.lock().unwrap_or_else(PoisonError::into_inner);
        let known = kept().get(&key).cloned();
        if known.is_some() {
            return Ok(known);
        }
        let made = make()?;
        if let Some(image) = &made {
            let mut kept = kept();
            if kept.len() >= MAX_UNIFORM {
                kept.clear();
            }
            kept.insert(key, image.clone());
        }
        Ok(made)
    }

    /// Prepared style; the tree's default style if `style` is `None`.
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
        // The lock makes concurrent requests for the same style wait instead of preparing it twice.
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
