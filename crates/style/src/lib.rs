//! Styles: how values become colours, whatever is drawn: pictures, tiles, legends.
//!
//! A [`Style`] is a small JSON document (`docs/styles.md` says what is in it), or a name such as `viridis` or
//! `hillshade`. A [`StylePainter`] is a style made ready for one tree: percentiles have become numbers, palettes tables. It paints
//! blocks of samples, wherever they come from; equal samples (and neighbours, where these matter) give equal pixels, however
//! a picture is cut into blocks. A [`Legend`] tells what the colours mean.
//!
//! ```
//! # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
//! use spinney::raw::style::{Ground, SampleBlock, StylePainter};
//! use spinney::style::Style;
//!
//! let map = spinney::open("fixtures/v1/classes.goblin")?;
//! let style = Style::parse(r##"{"draw": "palette", "classes": [{"value": 4, "color": "#228b22", "name": "Forest"}]}"##)?;
//! let painter = StylePainter::new(&style, &map, &())?;
//! let block = SampleBlock { width: 2, height: 1, margin: 0, bytes: &[4, 9], valid: &[true; 2], ground: &[Ground::PIXEL] };
//! let mut rgba = [0; 8];
//! painter.paint(&block, &mut rgba)?;
//! assert_eq!(rgba, [0x22, 0x8b, 0x22, 255, 0, 0, 0, 0]);
//! # Ok::<(), spinney::Error>(())
//! ```

mod blend;
mod coat;
mod colour;
mod default;
mod domain;
mod fields;
mod ground;
mod indices;
mod layer;
mod legend;
mod mask;
mod painter;
mod parse;
mod ramps;
mod relief;
mod resolve;
mod scale;

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

pub use self::colour::{CLAY, distinct, to_linear, to_srgb};
pub use self::domain::PercentileNumbers;
pub use self::ground::Ground;
use self::layer::Layer;
pub use self::legend::{Key, Legend, LegendClass, LegendImage, LegendSection, Tick};
pub use self::painter::{SampleBlock, StylePainter};
use spinney_base::{Error, Result};
use spinney_engine::dataset::Dataset;

/// The way in which values become colours: layers over each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Style {
    /// From the lowest to the highest.
    layers: Vec<Layer>,
    /// Colour of VOID.
    void: [u8; 4],
    title: Option<String>,
    /// The document.
    json: String,
}

/// The colours of "viridis", from the least to the greatest number.
pub fn viridis() -> Vec<[u8; 4]> {
    ramps::named("viridis").unwrap_or_default()
}

/// Bytes of the longest document.
const LONGEST: u64 = 1 << 20;

impl Style {
    /// Reads a style: a JSON document, or a name ([`Style::names`]).
    ///
    /// # Errors
    /// If it is neither, or says what no style can.
    pub fn parse(text: &str) -> Result<Style> {
        let text = text.trim();
        if text.starts_with('{') { parse::document(text) } else { parse::named(text) }
    }

    /// Reads what people write for a style: its name, its document, or the path of a file with one.
    ///
    /// # Errors
    /// Those of [`Style::parse`] and [`Style::read`].
    pub fn given(text: &str) -> Result<Style> {
        let is_text = text.trim_start().starts_with('{') || parse::names().contains(&text);
        // (A name that is no style's may be a file's.)
        if !is_text && (text.contains(['.', '/', '\\']) || Path::new(text).exists()) {
            return Style::read(Path::new(text));
        }
        Style::parse(text)
    }

    /// Reads the document in a file.
    ///
    /// # Errors
    /// If it cannot be read, has more than 1 MiB, or is no style; the message names the file and the place in it.
    pub fn read(path: &Path) -> Result<Style> {
        let place = |error| match error {
            Error::Invalid { what, found, expected } => {
                Error::Invalid { what: format!("{}: {what}", path.display()), found, expected }
            }
            other => other,
        };
        let mut text = Vec::new();
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        // (One byte more than there may be tells that there are more, without reading them.)
        file.take(LONGEST + 1).read_to_end(&mut text).map_err(Error::io(path, "read"))?;
        let text = String::from_utf8(text)
            .map_err(|_| place(Error::invalid("style", "bytes that are no UTF-8 text", "a JSON document")))?;
        parse::document(text.trim_start_matches('\u{feff}').trim()).map_err(place)
    }

    /// The style of a tree for which nobody gave one; there is one for every tree.
    ///
    /// The tree's palette if it has one; colours as they are if it has three channels or more (those of more than eight bits
    /// stretched between their percentiles 2 and 98); classes in colours that differ; occupancy by opacity; grey for samples of
    /// `u8` (as they are) and `u16` (stretched); all else in "viridis", stretched.
    pub fn default_for(tree: &Dataset) -> Style {
        default::style(tree)
    }

    /// The style that makes greys of a tree's values, or colours of three channels or more: one number becomes black, another
    /// white, and what lies between them what is between.
    pub fn stretched(tree: &Dataset, range: [f64; 2]) -> Style {
        default::stretched(tree, range)
    }

    /// The names that [`Style::parse`] takes.
    pub fn names() -> Vec<&'static str> {
        parse::names()
    }

    /// The style as its document, which [`Style::parse`] reads again; the same for the same style.
    pub fn json(&self) -> &str {
        &self.json
    }
}
