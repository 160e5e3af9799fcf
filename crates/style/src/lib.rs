//! Styles: how values become colours in images, tiles and legends.
//!
//! A [`Style`] is a small JSON document (see `docs/styles.md`), or a name such as `viridis` or
//! `hillshade`. A [`StylePainter`] is a style resolved for one tree: it has numbers instead of
//! percentiles, and look-up tables instead of palettes. It paints blocks of samples from any
//! source. Equal samples (and neighbours, if colours depend on them) give equal pixels, regardless
//! of how an image is cut into blocks. A [`Legend`] describes the meaning of the colours.
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

/// A style: layers that convert values to colours, drawn on top of each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Style {
    /// From bottom to top.
    layers: Vec<Layer>,
    /// Colour of VOID.
    void: [u8; 4],
    title: Option<String>,
    /// The JSON document.
    json: String,
}

/// Returns the colours of "viridis", from the minimum to the maximum.
pub fn viridis() -> Vec<[u8; 4]> {
    ramps::named("viridis").unwrap_or_default()
}

/// Maximum bytes of a document.
const LONGEST: u64 = 1 << 20;

impl Style {
    /// Parses a style: a JSON document or a name (see [`Style::names`]).
    ///
    /// # Errors
    /// If it is neither, or the document is not a valid style.
    pub fn parse(text: &str) -> Result<Style> {
        let text = text.trim();
        if text.starts_with('{') { parse::document(text) } else { parse::named(text) }
    }

    /// Parses a style from user input: a name, a document, or the path of a file with a document.
    ///
    /// # Errors
    /// Those of [`Style::parse`] and [`Style::read`].
    pub fn given(text: &str) -> Result<Style> {
        let is_text = text.trim_start().starts_with('{') || parse::names().contains(&text);
        // An unknown name may be the path of a file.
        if !is_text && (text.contains(['.', '/', '\\']) || Path::new(text).exists()) {
            return Style::read(Path::new(text));
        }
        Style::parse(text)
    }

    /// Reads a document from a file.
    ///
    /// # Errors
    /// If the file cannot be read, exceeds 1 MiB, or is not a style. The message names the file and
    /// the location in it.
    pub fn read(path: &Path) -> Result<Style> {
        let place = |error| match error {
            Error::Invalid { what, found, expected } => {
                Error::Invalid { what: format!("{}: {what}", path.display()), found, expected }
            }
            other => other,
        };
        let mut text = Vec::new();
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        // Reading one byte over the limit detects a longer file without reading it completely.
        file.take(LONGEST + 1).read_to_end(&mut text).map_err(Error::io(path, "read"))?;
        let text = String::from_utf8(text)
            .map_err(|_| place(Error::invalid("style", "bytes that are not UTF-8", "a JSON document")))?;
        parse::document(text.trim_start_matches('\u{feff}').trim()).map_err(place)
    }

    /// Returns the default style of a tree. Every tree has one:
    ///
    /// - palette colours, if the tree has a palette
    /// - RGB colours, if it has three channels or more, or two with the roles red and cyan. Samples
    ///   with more than eight bits are stretched between percentiles 2 and 98
    /// - distinct colours for classes
    /// - opacity for occupancy
    /// - grey for `u8` samples (unchanged) and `u16` samples (stretched)
    /// - "viridis" for all others, stretched
    pub fn default_for(tree: &Dataset) -> Style {
        default::style(tree)
    }

    /// Returns a style that maps values from `range` linearly: from black to white, or per colour
    /// channel if the tree has three channels or more, or two with the roles red and cyan.
    pub fn stretched(tree: &Dataset, range: [f64; 2]) -> Style {
        default::stretched(tree, range)
    }

    /// Returns the names that [`Style::parse`] accepts.
    pub fn names() -> Vec<&'static str> {
        parse::names()
    }

    /// Returns the JSON document of the style, which [`Style::parse`] accepts. Equal styles have
    /// equal documents.
    pub fn json(&self) -> &str {
        &self.json
    }
}
