//! Legends: the meaning of an image's colours.

mod draw;
mod svg;
mod text;
mod ticks;

use serde_json::json;

pub use self::draw::LegendImage;
use self::ticks::ticks;
use super::coat::{Classes, Coat, Ink};
use super::colour;
use super::layer::{Encoding, SlopeUnit};
use super::scale::Scale;
use spinney_base::Result;
use spinney_engine::dataset::Dataset;

/// Meaning of an image's colours, with a section for each layer.
#[derive(Clone, Debug, PartialEq)]
pub struct Legend {
    /// Title of the legend; may be empty.
    pub title: String,
    /// Sections, starting with that of the top layer.
    pub sections: Vec<LegendSection>,
}

/// The section of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct LegendSection {
    /// Subject and unit; may be empty.
    pub title: String,
    /// The colours.
    pub key: Key,
}

/// Colours and their meaning.
#[derive(Clone, Debug, PartialEq)]
pub enum Key {
    /// Single colours with names.
    Classes(Vec<LegendClass>),
    /// A colour ramp, evenly spaced.
    Ramp {
        /// The colours.
        colours: Vec<[u8; 4]>,
        /// Labelled positions, in ascending order.
        ticks: Vec<Tick>,
    },
}

/// A colour with a meaning of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct LegendClass {
    /// The colour.
    pub colour: [u8; 4],
    /// Its meaning.
    pub name: String,
    /// The value of the class; `None` if the colour does not represent a single value.
    pub value: Option<f64>,
}

impl LegendClass {
    fn of_value(value: f64, colour: [u8; 4], name: &str) -> LegendClass {
        let name = if name.is_empty() { value.to_string() } else { name.to_owned() };
        LegendClass { colour, name, value: Some(value) }
    }

    fn of_name((colour, name): ([u8; 4], String)) -> LegendClass {
        LegendClass { colour, name, value: None }
    }
}

/// A labelled position on a colour ramp.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// Position from 0 (start) to 1 (end).
    pub at: f64,
    /// The number at this position.
    pub label: String,
}

/// Maximum number of classes in a legend, and number of colours in a ramp.
const MAX_CLASSES: usize = 256;
const BAND: usize = 256;
/// Maximum number of discrete ramp colours that are listed as classes.
const MAX_STEPS: usize = 16;

impl Legend {
    /// Creates the legend of a painter's layers.
    ///
    /// # Errors
    /// If the tree is corrupt.
    pub(super) fn new(title: &str, coats: &[Coat], tree: &Dataset) -> Result<Legend> {
        let sections = coats.iter().rev().map(|coat| section(coat, tree));
        Ok(Legend { title: title.into(), sections: sections.collect::<Result<_>>()? })
    }

    /// Formats the legend as JSON, for the metadata of tile archives.
    pub fn json(&self) -> String {
        let sections = self.sections.iter().map(|section| match &section.key {
            Key::Classes(classes) => {
                let classes = classes
                    .iter()
                    .map(|class| json!({ "color": colour::text(class.colour), "name": class.name }));
                json!({ "title": section.title, "classes": classes.collect::<Vec<_>>() })
            }
            Key::Ramp { colours, ticks } => {
                let colours: Vec<String> = colours.iter().map(|code| colour::text(*code)).collect();
                let ticks = ticks.iter().map(|tick| json!({ "at": tick.at, "label": tick.label }));
                json!({ "title": section.title, "ramp": colours, "ticks": ticks.collect::<Vec<_>>() })
            }
        });
        json!({ "title": self.title, "sections": sections.collect::<Vec<_>>() }).to_string()
    }

    /// Formats the legend as an SVG document.
    pub fn svg(&self) -> String {
        svg::document(self)
    }

    /// Draws the legend, enlarged by a factor of 1 to 8. At 1, a line of text is 12 pixels high.
    pub fn draw(&self, scale: usize) -> LegendImage {
        draw::draw_image(self, scale.clamp(1, 8))
    }
}

fn section(coat: &Coat, tree: &Dataset) -> Result<LegendSection> {
    let metadata = tree.metadata();
    let text = |list: &[String]| list.get(coat.band).cloned().unwrap_or_default();
    let (name, unit) = (text(&metadata.band_names), text(&metadata.units));
    let with_unit = |name: &str, unit: &str| match (name.is_empty(), unit.is_empty()) {
        (_, true) => name.to_string(),
        (true, false) => unit.to_string(),
        (false, false) => format!("{name} ({unit})"),
    };
    // Convert labels to physical units by scale and offset.
    let (factor, summand) = metadata.scale_offset.get(coat.band).copied().unwrap_or((1.0, 0.0));
    let to_physical = |number: f64| number * factor + summand;
    let (title, key) = match &coat.ink {
        Ink::Classes(classes) => (name, Key::Classes(named(classes, tree)?)),
        Ink::Scale(scale) => (with_unit(&name, &unit), scale_key(scale, &to_physical)),
        Ink::Slope { unit, scale, .. } => {
            let unit = if *unit == SlopeUnit::Degrees { "degrees" } else { "%" };
            (with_unit("Slope", unit), scale_key(scale, &|slope| slope))
        }
        Ink::Aspect(scale) => {
            let mut key = scale_key(scale, &|aspect| aspect);
            if let Key::Ramp { ticks, .. } = &mut key {
                *ticks = ["N", "E", "S", "W", "N"]
                    .iter()
                    .enumerate()
                    .map(|(i, name)| Tick { at: i as f64 / 4.0, label: (*name).into() })
                    .collect();
            }
            ("Aspect".into(), key)
        }
        Ink::Light { .. } => {
            let greys = (0..BAND).map(|grey| [grey as u8, grey as u8, grey as u8, 255]).collect();
            let tick = |at: f64, label: &str| Tick { at, label: label.into() };
            let ticks = vec![tick(0.0, "shade"), tick(1.0, "light")];
            ("Hillshade".into(), Key::Ramp { colours: greys, ticks })
        }
        Ink::Contours(lines) => {
            let every = ticks::number(lines.interval * factor.abs());
            let label =
                if unit.is_empty() { format!("every {every}") } else { format!("every {every} {unit}") };
            ("Contours".into(), Key::Classes(vec![LegendClass::of_name((lines.colour, label))]))
        }
        Ink::Channels { bands, .. } => {
            let colours = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]];
            let label = |band: usize| match metadata.band_names.get(band).filter(|name| !name.is_empty()) {
                Some(name) => name.clone(),
                None => format!("Channel {}", band + 1),
            };
            let classes = colours.into_iter().zip(bands.map(label)).map(LegendClass::of_name);
            (String::new(), Key::Classes(classes.collect()))
        }
        Ink::Heights { encoding, .. } => {
            let name = if *encoding == Encoding::Mapbox { "Mapbox" } else { "Terrarium" };
            (format!("Heights in Terrain-RGB ({name})"), Key::Classes(Vec::new()))
        }
    };
    Ok(LegendSection { title, key })
}

/// The key of a scale. `to_physical` converts its numbers to labels.
fn scale_key(scale: &Scale, to_physical: &dyn Fn(f64) -> f64) -> Key {
    let stops: Vec<(f64, [u8; 4])> = scale.stops().collect();
    let (low, high) = (stops[0].0, stops[stops.len() - 1].0);
    if scale.steps().is_some() && stops.len() <= MAX_STEPS {
        let number = |number: f64| ticks::number(to_physical(number));
        let label = |i: usize| match (i, stops.get(i + 1)) {
            (0, Some(next)) => format!("below {}", number(next.0)),
            (_, Some(next)) => format!("{} to {}", number(stops[i].0), number(next.0)),
            (_, None) => format!("{} and more", number(stops[i].0)),
        };
        let classes = stops.iter().enumerate().map(|(i, stop)| LegendClass::of_name((stop.1, label(i))));
        return Key::Classes(classes.collect());
    }
    let at = |i: usize| {
        let share = i as f64 / (BAND - 1) as f64;
        scale.colour(low * (1.0 - share) + high * share)
    };
    Key::Ramp { colours: (0..BAND).map(at).collect(), ticks: ticks(to_physical(low), to_physical(high)) }
}

/// The key of classes: those of the style, or those with names, or else those that occur.
fn named(classes: &Classes, tree: &Dataset) -> Result<Vec<LegendClass>> {
    let names = &tree.metadata().class_names;
    if !classes.names.is_empty() {
        let listed = classes.sparse.iter().zip(&classes.names).take(MAX_CLASSES);
        return Ok(listed.map(|(class, name)| LegendClass::of_value(class.0, class.1, name)).collect());
    }
    let of_tree = |value: f64, name: &str| LegendClass::of_value(value, classes.colour(value), name);
    if !names.is_empty() {
        let listed = names.iter().filter(|(_, name)| !name.is_empty()).take(MAX_CLASSES);
        return Ok(listed.map(|(value, name)| of_tree(value.to_f64(), name)).collect());
    }
    let header = tree.header();
    if header.counts_classes() && header.form.value.channels == 1 {
        let occurring = tree.statistics(None, &())?.classes;
        let listed = occurring.iter().take(MAX_CLASSES);
        return Ok(listed.map(|(value, _)| of_tree(value.to_f64(), &value.to_string())).collect());
    }
    let listed = classes.dense.iter().enumerate().take(MAX_CLASSES);
    Ok(listed.map(|(value, code)| LegendClass::of_value(value as f64, *code, "")).collect())
}
