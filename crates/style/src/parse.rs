//! Parser of style documents and names.

use serde_json::{Value, json};

use super::blend::Blend;
use super::fields::{Fields, colour_of, list_of, shortened, wrong};
use super::layer::{
    Bound, Class, Contours, Draw, Encoding, Interpolation, Layer, Light, LightKind, Ramp, RampColours,
    SlopeUnit,
};
use super::mask::{Mask, Ranges};
use super::{LONGEST, Style, ramps};
use spinney_base::{Error, Result, sort};

/// Maximum number of layers in a style, stops in a ramp, classes in a palette, and ranges in a
/// mask.
const MAX_LAYERS: usize = 16;
const MAX_STOPS: usize = 1024;
const MAX_CLASSES: usize = 1 << 16;
const MAX_RANGES: usize = 256;

/// Names other than ramps, and their documents.
fn shortcuts() -> [(&'static str, Value); 12] {
    let draw = |name: &str| json!({ "draw": name });
    [
        ("default", draw("default")),
        ("palette", draw("palette")),
        ("rgb", draw("rgb")),
        ("hillshade", draw("hillshade")),
        ("multidirectional", json!({ "draw": "hillshade", "light": "multidirectional" })),
        (
            "relief",
            json!({ "layers": [
            { "draw": "ramp", "ramp": "terrain" },
            { "draw": "hillshade", "light": "multidirectional", "blend": "multiply" },
        ] }),
        ),
        ("slope", draw("slope")),
        ("aspect", draw("aspect")),
        ("contours", draw("contours")),
        ("terrain-rgb", draw("terrain-rgb")),
        ("mapbox", draw("terrain-rgb")),
        ("terrarium", json!({ "draw": "terrain-rgb", "encoding": "terrarium" })),
    ]
}

pub(super) fn names() -> Vec<&'static str> {
    shortcuts().into_iter().map(|(name, _)| name).chain(ramps::names()).collect()
}

/// Parses a style name.
pub(super) fn named(name: &str) -> Result<Style> {
    if ramps::named(name).is_some() {
        return of_value(&json!({ "draw": "ramp", "ramp": name }));
    }
    match shortcuts().into_iter().find(|(known, _)| *known == name) {
        Some((_, document)) => of_value(&document),
        None => {
            let expected = format!("a JSON document, or one of {}", names().join(", "));
            Err(Error::invalid("style", format!("`{}`", shortened(name.into())), expected))
        }
    }
}

/// Parses a style document.
pub(super) fn document(text: &str) -> Result<Style> {
    if text.len() as u64 > LONGEST {
        return Err(Error::invalid("style", format!("{} bytes", text.len()), "at most 1 MiB"));
    }
    let value: Value = serde_json::from_str(text)
        .map_err(|error| Error::invalid("style", error.to_string(), "a JSON document"))?;
    of_value(&value)
}

pub(super) fn of_value(value: &Value) -> Result<Style> {
    let mut fields = Fields::of(String::new(), value)?;
    let title = fields.text("title")?.map(String::from);
    let void = fields.colour("nodata")?.unwrap_or([0; 4]);
    let layers = match fields.value("layers") {
        None => {
            let layer = layer(&mut fields)?;
            vec![layer]
        }
        Some(layers) => {
            let place = fields.place("layers");
            let layers = list_of(&place, layers, MAX_LAYERS)?;
            if layers.is_empty() {
                return Err(Error::invalid(place, "none", "at least one layer"));
            }
            let layers = layers.iter().enumerate().map(|(index, value)| {
                let mut fields = Fields::of(format!("{place}[{index}]"), value)?;
                let layer = layer(&mut fields)?;
                fields.finish()?;
                Ok(layer)
            });
            layers.collect::<Result<Vec<Layer>>>()?
        }
    };
    fields.finish()?;
    Ok(Style { layers, void, title, json: value.to_string() })
}

#[derive(Clone, Copy)]
enum Kind {
    Auto,
    Palette,
    Ramp,
    Rgb,
    Hillshade,
    Slope,
    Aspect,
    Contours,
    TerrainRgb,
}

fn layer(fields: &mut Fields<'_>) -> Result<Layer> {
    let kinds = [
        ("default", Kind::Auto),
        ("palette", Kind::Palette),
        ("ramp", Kind::Ramp),
        ("rgb", Kind::Rgb),
        ("hillshade", Kind::Hillshade),
        ("slope", Kind::Slope),
        ("aspect", Kind::Aspect),
        ("contours", Kind::Contours),
        ("terrain-rgb", Kind::TerrainRgb),
    ];
    let kind = fields.choice("draw", &kinds)?;
    let kind = kind.ok_or_else(|| {
        Error::invalid(fields.place("draw"), "nothing", kinds.map(|kind| kind.0).join(", "))
    })?;
    let mut band = 0;
    if !matches!(kind, Kind::Auto | Kind::Rgb) {
        band = fields.integer("band", 1..=4)?.unwrap_or(1) as usize - 1;
    }
    let draw = match kind {
        Kind::Auto => Draw::Auto,
        Kind::Palette => Draw::Palette { classes: classes(fields)?, other: fields.colour("other")? },
        Kind::Ramp => Draw::Ramp(ramp(fields, &json!("viridis"), PERCENTILES, true)?),
        Kind::Rgb => {
            Draw::Rgb { bands: bands(fields)?, domain: domain(fields, true)?.unwrap_or(PERCENTILES) }
        }
        Kind::Hillshade => Draw::Hillshade(light(fields)?),
        Kind::Slope => {
            let units = [("degrees", SlopeUnit::Degrees), ("percent", SlopeUnit::Percent)];
            let unit = fields.choice("unit", &units)?.unwrap_or(SlopeUnit::Degrees);
            let most = if unit == SlopeUnit::Degrees { 60.0 } else { 100.0 };
            let colours = json!(["#ffffff", "#fee391", "#fe9929", "#cc4c02", "#662506"]);
            let ramp = ramp(fields, &colours, [Bound::Number(0.0), Bound::Number(most)], false)?;
            Draw::Slope { unit, z: height_factor(fields)?, ramp }
        }
        Kind::Aspect => {
            // North, east, south, west and north again.
            let colours = json!(["#3b6fb8", "#e8c24a", "#d7462f", "#3aa35b", "#3b6fb8"]);
            Draw::Aspect { ramp: ramp(fields, &colours, [Bound::Number(0.0), Bound::Number(360.0)], false)? }
        }
        Kind::Contours => contours(fields)?,
        Kind::TerrainRgb => {
            let encodings = [("mapbox", Encoding::Mapbox), ("terrarium", Encoding::Terrarium)];
            Draw::TerrainRgb(fields.choice("encoding", &encodings)?.unwrap_or(Encoding::Mapbox))
        }
    };
    let opacity = fields.number("opacity", 0.0..=1.0)?.unwrap_or(1.0);
    let blend = fields.choice("blend", &Blend::ALL)?.unwrap_or(Blend::Normal);
    let mask = Mask { show: ranges(fields, "show")?, hide: ranges(fields, "hide")?.unwrap_or_default() };
    Ok(Layer { draw, band, opacity, blend, mask })
}

/// Default domain, without outliers.
const PERCENTILES: [Bound; 2] = [Bound::Percent(2.0), Bound::Percent(98.0)];

fn light(fields: &mut Fields<'_>) -> Result<Light> {
    let kinds = [
        ("single", LightKind::Single),
        ("multidirectional", LightKind::Multidirectional),
        ("combined", LightKind::Combined),
    ];
    let kind = fields.choice("light", &kinds)?.unwrap_or(LightKind::Single);
    // Multidirectional light has fixed directions.
    let azimuth =
        if kind == LightKind::Multidirectional { None } else { fields.number("azimuth", -360.0..=360.0)? };
    Ok(Light {
        azimuth: azimuth.unwrap_or(315.0),
        altitude: fields.number("altitude", 0.0..=90.0)?.unwrap_or(45.0),
        z: height_factor(fields)?,
        kind,
    })
}

fn height_factor(fields: &mut Fields<'_>) -> Result<f64> {
    Ok(fields.number("z", 1e-6..=1e6)?.unwrap_or(1.0))
}

fn contours(fields: &mut Fields<'_>) -> Result<Draw> {
    Ok(Draw::Contours(Contours {
        interval: fields.number("interval", 1e-9..=1e12)?,
        base: fields.number("base", -1e12..=1e12)?.unwrap_or(0.0),
        colour: fields.colour("color")?.unwrap_or([0x7a, 0x4a, 0x1e, 255]),
        width: fields.number("width", 0.1..=4.0)?.unwrap_or(1.0),
        bold: fields.integer("bold", 0..=1000)?.unwrap_or(5) as u32,
    }))
}

fn classes(fields: &mut Fields<'_>) -> Result<Vec<Class>> {
    let place = fields.place("classes");
    let Some(list) = fields.list("classes", MAX_CLASSES)? else { return Ok(Vec::new()) };
    if list.is_empty() {
        return Err(Error::invalid(place, "none", "at least one class"));
    }
    let classes = list.iter().enumerate().map(|(index, value)| {
        let mut fields = Fields::of(format!("{place}[{index}]"), value)?;
        let missing = |fields: &Fields<'_>, name, example: &str| {
            Error::invalid(fields.place(name), "nothing", format!("a {name}, as in {example}"))
        };
        let value = fields.number("value", f64::MIN..=f64::MAX)?;
        let value = value.ok_or_else(|| missing(&fields, "value", "11"))?;
        let colour = fields.colour("color")?;
        let colour = colour.ok_or_else(|| missing(&fields, "color", "\"#466b9f\""))?;
        let name = fields.text("name")?.unwrap_or_default().into();
        fields.finish()?;
        // No negative zero.
        Ok(Class { value: value + 0.0, colour, name })
    });
    let mut classes = classes.collect::<Result<Vec<Class>>>()?;
    sort::by_key(&mut classes, |class| sort::float_key(class.value));
    match classes.windows(2).find(|pair| pair[0].value == pair[1].value) {
        Some(pair) => Err(Error::invalid(place, format!("{} twice", pair[0].value), "each value once")),
        None => Ok(classes),
    }
}

/// Channels for red, green and blue; `None` selects them by the tree's colour roles.
fn bands(fields: &mut Fields<'_>) -> Result<Option<[usize; 3]>> {
    let place = fields.place("bands");
    let Some(value) = fields.value("bands") else { return Ok(None) };
    let band =
        |value: &Value| value.as_u64().filter(|band| (1..=4).contains(band)).map(|band| band as usize - 1);
    let bands: Option<Vec<usize>> =
        value.as_array().filter(|list| list.len() == 3).and_then(|list| list.iter().map(band).collect());
    bands
        .and_then(|bands| bands.try_into().ok())
        .map(Some)
        .ok_or_else(|| wrong(&place, value, "three channels for red, green and blue, as in [1, 2, 3]"))
}

/// Parses a number, or a percentile if `percentiles` allows it.
fn bound(place: &str, value: &Value, percentiles: bool) -> Result<Bound> {
    if let Some(number) = value.as_f64() {
        return Ok(Bound::Number(number));
    }
    let percent = match value.as_str() {
        Some("min") => Some(0.0),
        Some("max") => Some(100.0),
        text => text.and_then(|text| text.strip_suffix('%')).and_then(|text| text.trim().parse().ok()),
    };
    let percent = percent.filter(|percent| percentiles && (0.0..=100.0).contains(percent));
    let expected = if percentiles { "a number, or a percentile, as in \"2%\"" } else { "a number" };
    percent.map(Bound::Percent).ok_or_else(|| wrong(place, value, expected))
}

fn domain(fields: &mut Fields<'_>, percentiles: bool) -> Result<Option<[Bound; 2]>> {
    let place = fields.place("domain");
    let Some(value) = fields.value("domain") else { return Ok(None) };
    let [low, high] = pair(value).ok_or_else(|| wrong(&place, value, "two numbers, as in [0, 4000]"))?;
    Ok(Some([bound(&place, low, percentiles)?, bound(&place, high, percentiles)?]))
}

/// The entries of a list with exactly two.
fn pair(value: &Value) -> Option<[&Value; 2]> {
    match value.as_array()?.as_slice() {
        [a, b] => Some([a, b]),
        _ => None,
    }
}

/// Parses a ramp. `colours` and `ends` are its default colours and domain.
fn ramp(fields: &mut Fields<'_>, colours: &Value, ends: [Bound; 2], percentiles: bool) -> Result<Ramp> {
    let place = fields.place("ramp");
    let value = fields.value("ramp").unwrap_or(colours);
    let kinds = [
        ("linear", Interpolation::Linear),
        ("discrete", Interpolation::Discrete),
        ("nearest", Interpolation::Nearest),
    ];
    let mut interpolation = fields.choice("interpolation", &kinds)?.unwrap_or(Interpolation::Linear);
    let domain = domain(fields, percentiles)?;
    let colours = match value {
        Value::String(name) => {
            let expected =
                || format!("one of {}, or a list of colours", ramps::names().collect::<Vec<_>>().join(", "));
            let mut colours = ramps::named(name).ok_or_else(|| wrong(&place, value, expected()))?;
            if colours.len() > 2 {
                interpolation = Interpolation::Discrete;
            }
            match ramps::land(name) {
                Some(first) => {
                    let land = colours.split_off(first);
                    RampColours::Heights { sea: colours, land }
                }
                None => RampColours::Even(colours),
            }
        }
        list => {
            let list = list_of(&place, list, MAX_STOPS)?;
            let at = |index: usize| format!("{place}[{index}]");
            if list.len() < 2 {
                let expected = "at least two colours, as in [\"#000000\", \"#ffffff\"] or [[0, \"#000000\"], [4000, \"#ffffff\"]]";
                return Err(wrong(&place, value, expected));
            }
            if list[0].is_string() {
                let colours = list.iter().enumerate().map(|(index, value)| colour_of(&at(index), value));
                RampColours::Even(colours.collect::<Result<_>>()?)
            } else {
                if domain.is_some() {
                    return Err(Error::invalid(
                        fields.place("domain"),
                        "a domain in addition to stops",
                        "colours without positions",
                    ));
                }
                let stops = list.iter().enumerate().map(|(index, value)| {
                    let [place, colour] = pair(value)
                        .ok_or_else(|| wrong(&at(index), value, "a stop, as in [4000, \"#ffffff\"]"))?;
                    Ok((bound(&at(index), place, percentiles)?, colour_of(&at(index), colour)?))
                });
                let stops = stops.collect::<Result<Vec<_>>>()?;
                let falls = |pair: &[(Bound, [u8; 4])]| match (pair[0].0, pair[1].0) {
                    (Bound::Number(a), Bound::Number(b)) | (Bound::Percent(a), Bound::Percent(b)) => a > b,
                    _ => false,
                };
                if stops.windows(2).any(falls) {
                    return Err(Error::invalid(place, "descending stops", "stops in ascending order"));
                }
                RampColours::Stops(stops)
            }
        }
    };
    Ok(Ramp { colours, domain: domain.unwrap_or(ends), interpolation })
}

/// Parses a list of numbers and ranges.
fn ranges(fields: &mut Fields<'_>, name: &'static str) -> Result<Option<Ranges>> {
    let place = fields.place(name);
    let Some(list) = fields.list(name, MAX_RANGES)? else { return Ok(None) };
    let expected = "a number, or a range, as in [0, 4000] or [0, null]";
    let ranges = list.iter().enumerate().map(|(index, value)| {
        let place = format!("{place}[{index}]");
        if let Some(number) = value.as_f64() {
            return Ok([number; 2]);
        }
        let ends = pair(value).ok_or_else(|| wrong(&place, value, expected))?;
        let end = |value: &Value, open: f64| if value.is_null() { Some(open) } else { value.as_f64() };
        match (end(ends[0], f64::NEG_INFINITY), end(ends[1], f64::INFINITY)) {
            (Some(low), Some(high)) if low <= high => Ok([low, high]),
            _ => Err(wrong(&place, value, expected)),
        }
    });
    ranges.collect::<Result<_>>().map(Some)
}
