//! Colours of tiles: a style, painted tile by tile.

use serde::{Deserialize, Serialize};

use super::source::{TileContent, TileSamples, TileSource};
use super::tile_id::TileId;
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::{Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_style::{Ground, PercentileNumbers, SampleBlock, Style, StylePainter};

/// Description of how a tree's values become colours.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileColours {
    /// JSON document of the style.
    pub style: String,
    /// Values of the style's percentiles.
    pub percentiles: PercentileNumbers,
    /// Hash of these and the tree's palette and units. It changes whenever the tiles' appearance
    /// changes.
    pub look: String,
}

/// Pixels of a tile, row by row, without a margin.
#[derive(Clone, Debug, Default)]
pub struct TilePixels {
    /// Palette indices, if the painter has a palette.
    pub indices: Vec<u8>,
    /// Otherwise red, green, blue and opacity of each pixel.
    pub colours: Vec<[u8; 4]>,
}

impl TilePixels {
    /// Returns red, green, blue and opacity of each pixel, looking up indices in the palette.
    fn into_colours(self, palette: Option<&[[u8; 4]; 256]>) -> Vec<[u8; 4]> {
        match palette {
            Some(colours) => self.indices.iter().map(|index| colours[usize::from(*index)]).collect(),
            None => self.colours,
        }
    }
}

/// Style prepared for the tiles of a tree.
///
/// Tiles without any value are omitted, even if the style has a colour for VOID.
#[derive(Debug)]
pub struct TilePainter {
    painter: StylePainter,
    palette: Option<Box<[[u8; 4]; 256]>>,
    colours: TileColours,
}

impl TilePainter {
    /// Prepares a style.
    ///
    /// # Errors
    /// Those of [`StylePainter::new`].
    pub fn new(style: &Style, tree: &Dataset, progress: &dyn Progress) -> Result<TilePainter> {
        TilePainter::with_numbers(style, tree, None, progress)
    }

    /// Prepares a style, with given percentile values if there are any.
    ///
    /// # Errors
    /// Those of [`StylePainter::new`].
    pub fn with_numbers(
        style: &Style,
        tree: &Dataset,
        given: Option<&PercentileNumbers>,
        progress: &dyn Progress,
    ) -> Result<TilePainter> {
        let (painter, percentiles) = StylePainter::with_numbers(style, tree, given, progress)?;
        let palette = painter.palette().map(|colours| {
            let mut all = Box::new([[0; 4]; 256]);
            all.iter_mut().zip(colours).for_each(|(to, from)| *to = *from);
            all
        });
        let void = if painter.encodes_heights() { "nearest height" } else { "" };
        let look = format!("{:016x}", xxhash_rust::xxh3::xxh3_64(format!("{painter:?}{void}").as_bytes()));
        let colours = TileColours { style: style.json().to_owned(), percentiles, look };
        Ok(TilePainter { painter, palette, colours })
    }

    /// Returns the painter.
    pub fn painter(&self) -> &StylePainter {
        &self.painter
    }

    /// Returns the width in cells of the margin around a tile that its pixels depend on.
    pub fn margin(&self) -> usize {
        self.painter.margin() as usize
    }

    /// Returns the palette whose indices are painted, or `None` if colours are painted.
    pub fn palette(&self) -> Option<&[[u8; 4]; 256]> {
        self.palette.as_deref()
    }

    /// Returns the description of the colours, as archives store it.
    pub fn colours(&self) -> &TileColours {
        &self.colours
    }

    /// Paints a tile of a source from its samples, which include the margin.
    ///
    /// # Errors
    /// If the samples are not of the type that the style was prepared for.
    pub fn paint(
        &self,
        source: &dyn TileSource,
        tile: TileId,
        samples: &TileSamples,
        pixels: &mut TilePixels,
    ) -> Result<()> {
        let margin = self.margin();
        let side = samples.side - 2 * margin;
        let ground = if margin == 0 {
            vec![Ground::PIXEL]
        } else {
            let depth = tile.zoom + side.trailing_zeros() as u8;
            let first = f64::from(tile.row) * side as f64;
            Ground::new(&source.frame(depth), 1 << depth).rows(first, side)
        };
        let block = SampleBlock {
            width: side,
            height: side,
            margin,
            bytes: &samples.values,
            valid: &samples.valid,
            ground: &ground,
        };
        if self.palette.is_some() {
            pixels.indices.resize(side * side, 0);
            self.painter.paint_indices(&block, &mut pixels.indices)
        } else {
            pixels.colours.resize(side * side, [0; 4]);
            self.painter.paint(&block, pixels.colours.as_flattened_mut())?;
            if self.painter.encodes_heights() {
                spread_colours(&mut pixels.colours, side);
            }
            Ok(())
        }
    }
}

/// Gives transparent pixels the colour of the nearest opaque pixel, by steps between direct
/// neighbours. They stay transparent.
fn spread_colours(pixels: &mut [[u8; 4]], side: usize) {
    let mut is_reached: Vec<bool> = pixels.iter().map(|pixel| pixel[3] > 0).collect();
    if !is_reached.contains(&false) {
        return;
    }
    let mut reached: Vec<usize> = (0..pixels.len()).filter(|at| is_reached[*at]).collect();
    let mut next = 0;
    while let Some(at) = reached.get(next).copied() {
        next += 1;
        let [red, green, blue, _] = pixels[at];
        let (column, row) = (at % side, at / side);
        let neighbours = [
            (row > 0).then(|| at - side),
            (column > 0).then(|| at - 1),
            (column + 1 < side).then_some(at + 1),
            (at + side < pixels.len()).then_some(at + side),
        ];
        for neighbour in neighbours.into_iter().flatten() {
            if !is_reached[neighbour] {
                is_reached[neighbour] = true;
                pixels[neighbour] = [red, green, blue, 0];
                reached.push(neighbour);
            }
        }
    }
}

/// Draws the pixels of a tile of `side` cells a side: red, green, blue and opacity, row by row.
/// Returns `None` if no cell has a value.
///
/// # Errors
/// If the source cannot be read.
pub fn draw_tile(
    source: &dyn TileSource,
    painter: &TilePainter,
    tile: TileId,
    side: usize,
) -> Result<Option<Vec<[u8; 4]>>> {
    // (For remote files, the reads of `content` and those of `tile` go into one batch.)
    let mut is_unread = false;
    let content = defer_missing(source.content(tile), &mut is_unread)?;
    if content == Some(TileContent::Empty) {
        return Ok(None);
    }
    let (mut samples, mut pixels) = (TileSamples::default(), TilePixels::default());
    defer_missing(source.tile(tile, side, painter.margin(), &mut samples), &mut is_unread)?;
    finish_deferred(is_unread)?;
    if !samples.valid.contains(&true) {
        return Ok(None);
    }
    painter.paint(source, tile, &samples, &mut pixels)?;
    Ok(Some(pixels.into_colours(painter.palette())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transparent_pixels_have_the_nearest_colour() {
        let (none, one, other) = ([0; 4], [1, 2, 3, 255], [9, 8, 7, 255]);
        let mut pixels = [none; 16];
        (pixels[0], pixels[15]) = (one, other);
        spread_colours(&mut pixels, 4);
        let hidden = |[red, green, blue, _]: [u8; 4]| [red, green, blue, 0];
        assert_eq!((pixels[0], pixels[15]), (one, other));
        assert_eq!(
            (pixels[1], pixels[5], pixels[14], pixels[10]),
            (hidden(one), hidden(one), hidden(other), hidden(other))
        );
        let mut nothing = [none; 4];
        spread_colours(&mut nothing, 2);
        assert_eq!(nothing, [none; 4]);
    }
}
