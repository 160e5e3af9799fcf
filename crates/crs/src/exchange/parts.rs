//! Components of coordinate reference systems, independent of the form of their definitions, for
//! export to other forms.

use serde_json::Value;

use crate::Crs;
use crate::definition::geo_keys::{self, GeoKeys, key};
use crate::definition::{WktNode, number_of_json, parse_projjson, parse_wkt};
use crate::methods::{Values, axes_of_words};
use crate::projection::axis::Axis;
use crate::projection::datum_names;
use crate::projection::shift::Shift;
use crate::projection::system::{Base, Name, System, Unit, is_same_ellipsoid};
use crate::projection::{geo_keys as keys_reader, proj_string, projjson, wkt, words};
use crate::registry::{Axes, Ellipsoid, Geographic, VerticalSystem, base_of, definition_of};

/// A horizontal system, and its vertical system.
#[derive(Debug)]
pub(super) struct HorizontalAndVertical {
    /// Name of both together, if there is one.
    pub(super) name: Option<String>,
    pub(super) horizontal: Horizontal,
    pub(super) vertical: Option<Vertical>,
}

/// The horizontal system.
#[derive(Debug)]
pub(super) enum Horizontal {
    Earth(Box<Earth>),
    /// A local plane with an unknown position. The unit is its length in metres.
    Local {
        name: String,
        unit: f64,
    },
}

/// A system on the earth or on another body.
#[derive(Debug)]
pub(super) struct Earth {
    pub(super) name: Option<String>,
    /// EPSG code.
    pub(super) number: Option<u32>,
    pub(super) base: Base,
    /// PROJ's words for the method, and its parameters; `None` for geographic systems.
    pub(super) projection: Option<(String, Values)>,
    pub(super) axes: Vec<Axis>,
    /// Size of the horizontal unit: metres of a projected system, radians of a geographic one.
    pub(super) unit: f64,
    /// Size in metres of the unit of ellipsoidal heights, if these are the third axis.
    pub(super) height: Option<f64>,
    pub(super) shift: Option<Shift>,
}

/// A system of heights or depths.
#[derive(Debug)]
pub(super) struct Vertical {
    pub(super) name: String,
    pub(super) datum: String,
    pub(super) number: Option<u32>,
    /// Size of the unit in metres.
    pub(super) unit: f64,
    pub(super) is_up: bool,
}

/// Valid sizes of units of length, in metres.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-6..=1e7;
const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// Model type of geocentric systems.
const GEOCENTRIC: u16 = 3;

/// Reads the components of a definition. The error describes what was found.
pub(super) fn read(crs: &Crs) -> Result<HorizontalAndVertical, String> {
    let parts = match (crs.numbers(), crs) {
        (Some(epsg), _) => {
            let epsg = epsg.in_parts();
            let vertical = epsg.vertical.map(Vertical::of_epsg).transpose()?;
            let earth = Earth::of_epsg(epsg.horizontal)?;
            let name = crs.name().filter(|_| vertical.is_none()).or(earth.name.clone());
            let earth = Earth { name, ..earth };
            HorizontalAndVertical { name: None, horizontal: Horizontal::Earth(earth.into()), vertical }
        }
        (None, Crs::Epsg(_)) => return Err("no number".into()),
        (None, Crs::GeoKeys(keys)) => of_keys(keys)?,
        (None, Crs::Wkt(text)) => of_wkt(&parse_wkt(text)?)?,
        (None, Crs::ProjJson(text)) => of_json(&parse_projjson(text)?)?,
        (None, Crs::Proj(text)) => HorizontalAndVertical::of(Earth::of_proj_string(text)?),
    };
    parts.check()?;
    Ok(parts)
}

impl HorizontalAndVertical {
    fn of(earth: Earth) -> HorizontalAndVertical {
        HorizontalAndVertical { name: None, horizontal: Horizontal::Earth(earth.into()), vertical: None }
    }

    /// Returns a string that is equal for equal systems, independent of names and of the order of
    /// axes, which does not affect coordinates here. `None` if the position of the plane is not
    /// defined.
    pub(super) fn identity(&self) -> Option<String> {
        let Horizontal::Earth(earth) = &self.horizontal else { return None };
        let vertical = self.vertical.as_ref().map(|vertical| match vertical.number {
            Some(number) => format!("EPSG:{number}"),
            None => {
                format!("{} {} {}", datum_names::key(&vertical.datum), number(vertical.unit), vertical.is_up)
            }
        });
        Some(format!("{} {:?} {vertical:?}", self.plane_identity()?, earth.height))
    }

    /// Returns a string that is equal for equal horizontal coordinates, independent of the order of
    /// axes and of heights.
    pub(super) fn plane_identity(&self) -> Option<String> {
        let Horizontal::Earth(earth) = &self.horizontal else { return None };
        let mut directions: Vec<_> = earth.axes.iter().map(|axis| axis.direction.as_str()).collect();
        directions.sort_unstable();
        let directions = if directions == ["east", "north"] { String::new() } else { directions.join(",") };
        Some(format!("{} {directions}", earth.identity()))
    }

    /// Fails if numbers are invalid.
    fn check(&self) -> Result<(), String> {
        let lengths = match &self.horizontal {
            Horizontal::Earth(earth) => {
                let turns = [earth.base.prime_meridian, earth.base.angle.to_degrees()];
                if turns.iter().any(|turn| turn.abs() > 360.0) || earth.base.angle <= 0.0 {
                    return Err(format!("a prime meridian at {:?} degrees", earth.base.prime_meridian));
                }
                if let Some(Shift::Helmert(numbers)) = &earth.shift
                    && (numbers.iter().any(|number| number.abs() > 1e6) || ![3, 7].contains(&numbers.len()))
                {
                    return Err(format!("a shift of the datum by {numbers:?}"));
                }
                [Some(earth.unit).filter(|_| earth.projection.is_some()), earth.height]
            }
            Horizontal::Local { unit, .. } => [Some(*unit), None],
        };
        let vertical = self.vertical.as_ref().map(|vertical| vertical.unit);
        match lengths.into_iter().flatten().chain(vertical).find(|unit| !LENGTHS.contains(unit)) {
            Some(unit) => Err(format!("a unit of {unit:?} m")),
            None => Ok(()),
        }
    }
}

/// Formats a number with few enough digits to tolerate a conversion to other units and back.
fn number(number: f64) -> String {
    format!("{:.10e}", number + 0.0)
}

fn axis(direction: &str) -> Axis {
    Axis { name: String::new(), direction: direction.into(), meridian: None }
}

impl Earth {
    /// Converts a system. `axes` are the directions of a geographic system's axes if it defines
    /// none.
    fn of_system(system: System, axes: [&str; 2]) -> Result<Earth, String> {
        let projection = match &system.conversion {
            None => None,
            Some(conversion) => {
                let (words, values) = system.projection(conversion)?;
                Some((words.to_string(), values))
            }
        };
        let System { name, base, axes: own_axes, unit, height, shift, .. } = system;
        let axes = match own_axes.is_empty() && projection.is_none() {
            true => axes.map(axis).into(),
            false => own_axes,
        };
        Ok(Earth { name, number: None, base, projection, axes, unit, height, shift })
    }

    /// Returns the components of a system with an EPSG code.
    fn of_epsg(number: u32) -> Result<Earth, String> {
        let unknown = || format!("EPSG:{number}, whose definition is not built in");
        let small = u16::try_from(number).map_err(|_| unknown())?;
        let in_degrees = Crs::epsg(number).unit() == Some("degrees");
        if let Some(known) = Geographic::find(small).filter(|_| in_degrees) {
            let axes = if known.is_longitude_first() { ["east", "north"] } else { ["north", "east"] };
            return Ok(Earth {
                name: Some(known.name.into()),
                number: Some(number),
                base: Base::of_epsg(small)?,
                projection: None,
                axes: axes.map(axis).into(),
                unit: DEGREE,
                height: None,
                shift: None,
            });
        }
        let (base, axes) = base_of(small).ok_or_else(unknown)?;
        let axes = match axes {
            Axes::EastNorth => ["east", "north"],
            Axes::NorthEast => ["north", "east"],
            Axes::WestSouth => ["west", "south"],
            Axes::Other => ["", ""],
        };
        let definition = definition_of(small).ok_or_else(unknown)?;
        let shiftless = words::without_shift(&definition);
        let is_web_mercator = proj_string::is_web_mercator(&definition);
        let plane = Earth::of_proj_string(if is_web_mercator { &definition } else { &shiftless })?;
        Crs::epsg(number).unit().ok_or_else(unknown)?;
        let name = Geographic::find(base).and_then(|base| {
            let (zone, half) = proj_string::utm_zone(&definition)?;
            Some(format!("{} / UTM zone {zone}{half}", base.name))
        });
        Ok(Earth {
            name: Some(name.unwrap_or_else(|| format!("EPSG:{number}"))),
            number: Some(number),
            base: Base::of_epsg(base)?,
            axes: axes
                .iter()
                .filter(|direction| !direction.is_empty())
                .map(|direction| axis(direction))
                .collect(),
            shift: None,
            ..plane
        })
    }

    /// Returns the components of a PROJ string.
    fn of_proj_string(text: &str) -> Result<Earth, String> {
        let system = proj_string::parts(text)?;
        let [a, b] = system.ellipsoid;
        let known = Ellipsoid::of_size(a, inverse_flattening(system.ellipsoid));
        let datum = match system.datum.filter(|_| system.prime_meridian == 0.0) {
            Some(number) => Name::Epsg(number),
            None => Name::Text(match known {
                Some(known) => format!("Unknown based on {} ellipsoid", known.name),
                None => format!("Unknown based on an ellipsoid of {a} and {b} m"),
            }),
        };
        let base = Base {
            name: None,
            datum,
            ellipsoid: system.ellipsoid,
            ellipsoid_name: None,
            prime_meridian: system.prime_meridian,
            angle: DEGREE,
        };
        let (axes, unit) = match &system.projection {
            Some((words, values)) => {
                // (Polar stereographic systems are recognized by their method.)
                let is_at = |pole: f64| words == "+proj=laea" && values.contains(&("lat_0", pole));
                let of_pole =
                    [(90.0, ["south"; 2]), (-90.0, ["north"; 2])].into_iter().find(|(pole, _)| is_at(*pole));
                let directions = axes_of_words(words).or(of_pole.map(|(_, axes)| axes));
                (directions.into_iter().flatten().map(axis).collect(), system.unit)
            }
            None => (["east", "north"].map(axis).into(), DEGREE),
        };
        let projection = system.projection;
        let shift = system.shift;
        Ok(Earth { name: None, number: None, base, projection, axes, unit, height: None, shift })
    }

    /// Returns a string that is equal for systems with the same method, datum and units.
    fn identity(&self) -> String {
        let numbers = |numbers: &[f64]| numbers.iter().map(|one| number(*one)).collect::<Vec<_>>().join(",");
        let datum = match (self.registered(), &self.base.datum) {
            (Some(known), _) => known.datum_name.into(),
            (None, Name::Text(name)) => datum_names::key(name),
            (None, Name::Epsg(number)) => format!("EPSG:{number}"),
        };
        let ellipsoid = self.ellipsoid();
        let figure = numbers(&[ellipsoid.1, ellipsoid.2, self.base.prime_meridian, self.unit]);
        let mut values: Vec<_> = self.projection.iter().flat_map(|(_, values)| values.iter()).collect();
        values.retain(|(word, value)| *value != if *word == "k_0" { 1.0 } else { 0.0 });
        values.sort_by_key(|(word, _)| *word);
        let values: Vec<_> =
            values.into_iter().map(|(word, value)| format!("{word}={}", number(*value))).collect();
        let shift = match &self.shift {
            None => String::new(),
            // (A scale factor has fewer digits than its difference from one.)
            Some(Shift::Helmert(shift)) => shift.iter().map(|one| format!("{:.6e} ", one + 0.0)).collect(),
            Some(Shift::Grid(name)) => name.clone(),
        };
        let words = self.projection.as_ref().map_or("", |(words, _)| words);
        format!("{words} {} {datum} {figure} {shift}", values.join(" "))
    }

    /// Returns the geographic system of the registry that has the datum.
    pub(super) fn registered(&self) -> Option<Geographic> {
        let base = &self.base;
        let fits = |known: &Geographic| {
            let is_same = known.ellipsoid().is_some_and(|known| {
                let inverse = known.inverse_flattening;
                let b = if inverse == 0.0 { known.size } else { known.size * (1.0 - 1.0 / inverse) };
                is_same_ellipsoid([known.size, b], base.ellipsoid)
            });
            is_same && known.meridian().is_some_and(|(_, turn)| (turn - base.prime_meridian).abs() < 1e-7)
        };
        match &base.datum {
            Name::Epsg(number) => Geographic::find(*number),
            Name::Text(name) => Geographic::of_datum_named(name, datum_names::key, fits),
        }
    }
}

/// Returns the inverse flattening of half axes; 0 for a sphere. If the ellipsoid is in the
/// registry, the result is exact.
pub(super) fn inverse_flattening([a, b]: [f64; 2]) -> f64 {
    let inverse = if a == b { 0.0 } else { a / (a - b) };
    Ellipsoid::of_size(a, inverse).map_or(inverse, |known| known.inverse_flattening)
}

impl Vertical {
    fn of_epsg(number: u32) -> Result<Vertical, String> {
        let known = u16::try_from(number).ok().and_then(VerticalSystem::find);
        known
            .map(Vertical::of_registry)
            .ok_or_else(|| format!("heights in EPSG:{number}, whose definition is not built in"))
    }

    fn of_registry(known: VerticalSystem) -> Vertical {
        let VerticalSystem { number, name, datum_name, unit, is_up, .. } = known;
        Vertical { name: name.into(), datum: datum_name.into(), number: Some(number.into()), unit, is_up }
    }
}

fn of_keys(keys: &GeoKeys) -> Result<HorizontalAndVertical, String> {
    if let Some(text) = keys_reader::cited(keys) {
        return of_wkt(&parse_wkt(&text)?);
    }
    let has_key = |place| keys.number(place).is_some();
    let model = keys.number(key::MODEL_TYPE).unwrap_or_default();
    // (A user-defined plane without a model type has no known position, whatever the geographic
    // system is.)
    let is_geographic = keys.registered(key::GEODETIC_CRS).is_some() && !has_key(key::PROJECTED_CRS);
    let is_local = ![geo_keys::PROJECTED, geo_keys::GEOGRAPHIC, GEOCENTRIC].contains(&model)
        && keys.registered(key::PROJECTED_CRS).is_none()
        && !is_geographic;
    let (vertical, height) = heights_of_keys(keys)?;
    if is_local {
        let name = keys.text(key::CITATION).unwrap_or_else(|| "unknown".into());
        let horizontal = Horizontal::Local { name, unit: keys_reader::linear_unit(keys)? };
        return Ok(HorizontalAndVertical { name: None, horizontal, vertical });
    }
    let earth = match keys.registered(key::PROJECTED_CRS) {
        Some(number) if model == geo_keys::PROJECTED => {
            let own = Earth::of_epsg(number.into())?;
            let unit = match keys.metres() {
                Some(by_name) => by_name,
                None if has_key(key::LINEAR_UNITS) => keys_reader::linear_unit(keys)?,
                None => own.unit,
            };
            let is_own = (unit / own.unit - 1.0).abs() < 1e-9;
            // (A different unit makes another system.)
            Earth { number: own.number.filter(|_| is_own && height.is_none()), unit, ..own }
        }
        _ => Earth::of_system(keys_reader::system(keys)?, ["north", "east"])?,
    };
    let earth = Earth { height, ..earth };
    Ok(HorizontalAndVertical {
        name: keys.text(key::CITATION).filter(|_| vertical.is_some()),
        horizontal: Horizontal::Earth(earth.into()),
        vertical,
    })
}

/// Returns the vertical system of keys, or the unit of ellipsoidal heights.
fn heights_of_keys(keys: &GeoKeys) -> Result<(Option<Vertical>, Option<f64>), String> {
    let unit = match keys.number(key::VERTICAL_UNITS) {
        None | Some(0) => None,
        Some(number) => Some(
            keys_reader::metres_numbered(number).ok_or_else(|| format!("heights in the unit {number}"))?,
        ),
    };
    let Some(number) = keys.number(key::VERTICAL).filter(|number| *number != 0) else {
        let unknown = |unit| Vertical {
            name: "unknown".into(),
            datum: "unknown".into(),
            number: None,
            unit,
            is_up: true,
        };
        return Ok((unit.map(unknown), None));
    };
    let is_ellipsoid =
        (5001..=5035).contains(&number) || Geographic::find(number).is_some() || number == 4979;
    if is_ellipsoid {
        return Ok((None, Some(unit.unwrap_or(1.0))));
    }
    // Numbers of datums, from before GeoTIFF 1.1.
    let of_datum = |number| VerticalSystem::of_datum(number);
    let datum = keys.registered(key::VERTICAL_DATUM);
    let known = match (5101..=5106).contains(&number) {
        true => of_datum(number),
        false => VerticalSystem::find(number).or_else(|| datum.and_then(of_datum)),
    };
    let citation = keys.text(key::VERTICAL_CITATION);
    let mut vertical = match known {
        Some(known) => Vertical::of_registry(known),
        None => {
            let datum = datum.map_or("unknown".into(), |number| format!("unknown, of the number {number}"));
            Vertical {
                name: citation.clone().unwrap_or_else(|| "unknown".into()),
                datum,
                number: None,
                unit: 1.0,
                is_up: true,
            }
        }
    };
    if let Some(citation) = citation.filter(|_| vertical.number != Some(number.into())) {
        vertical.name = citation;
    }
    if let Some(unit) = unit.filter(|unit| (unit / vertical.unit - 1.0).abs() > 1e-9) {
        (vertical.unit, vertical.number) = (unit, None);
    }
    Ok((Some(vertical), None))
}

fn of_wkt(node: &WktNode) -> Result<HorizontalAndVertical, String> {
    if node.is(&["LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"]) {
        let unit = wkt::unit(node, &["LENGTHUNIT", "UNIT"])?;
        let unit = match (unit, node.child(&["AXIS"])) {
            (None, Some(axis)) => wkt::unit(axis, &["LENGTHUNIT"])?,
            (unit, _) => unit,
        };
        let name = node.strings().next().unwrap_or("unknown").into();
        let unit = unit.ok_or("a local system without a unit")?;
        return Ok(HorizontalAndVertical {
            name: None,
            horizontal: Horizontal::Local { name, unit },
            vertical: None,
        });
    }
    if !node.is(&["COMPD_CS", "COMPOUNDCRS"]) {
        return Ok(HorizontalAndVertical::of(earth_of_wkt(node)?));
    }
    let parts: Vec<_> = node.nodes().filter(|node| node.is_crs()).collect();
    let [horizontal, vertical] = parts[..] else {
        return Err(format!("a compound system of {} components", parts.len()));
    };
    let vertical = Some(vertical_of_wkt(vertical)?);
    let name = node.strings().next().map(String::from);
    Ok(HorizontalAndVertical {
        name,
        horizontal: Horizontal::Earth(earth_of_wkt(horizontal)?.into()),
        vertical,
    })
}

fn earth_of_wkt(node: &WktNode) -> Result<Earth, String> {
    let earth = match node.child(&["EXTENSION"]) {
        None => Earth::of_system(wkt::system(node)?, ["east", "north"])?,
        Some(extension) => match extension.strings().collect::<Vec<_>>()[..] {
            ["PROJ4", words] if proj_string::is_web_mercator(words) => Earth::of_proj_string(words)?,
            _ => return Err("an EXTENSION that is not known".into()),
        },
    };
    Ok(Earth { number: node.number(), ..earth })
}

fn vertical_of_wkt(node: &WktNode) -> Result<Vertical, String> {
    if !node.is(&["VERT_CS", "VERTCRS", "VERTICALCRS"]) {
        return Err(format!("heights in a system of the kind {}", node.keyword()));
    }
    let number = node.number();
    if let Some(known) = number.and_then(|number| Vertical::of_epsg(number).ok()) {
        return Ok(known);
    }
    let datum = node.child(&["VERT_DATUM", "VDATUM", "VRF", "VERTICALDATUM", "ENSEMBLE"]);
    let name = |node: &WktNode| node.strings().next().map(String::from);
    let axis = node.child(&["AXIS"]);
    let units = ["LENGTHUNIT", "UNIT"];
    let unit = match (wkt::unit(node, &units)?, axis) {
        (None, Some(axis)) => wkt::unit(axis, &units)?,
        (unit, _) => unit,
    };
    Ok(Vertical {
        name: name(node).ok_or("heights without a name")?,
        datum: datum.and_then(name).ok_or("heights above nothing")?,
        number,
        unit: unit.ok_or("heights without a unit")?,
        is_up: match axis.and_then(|axis| axis.words().next()) {
            None | Some("UP") => true,
            Some("DOWN") => false,
            Some(other) => return Err(format!("heights with the axis direction {other}")),
        },
    })
}

fn of_json(value: &Value) -> Result<HorizontalAndVertical, String> {
    let text = |value: &Value| value.as_str().map(String::from);
    let earth = |value: &Value| {
        let earth = Earth::of_system(projjson::system(value)?, ["north", "east"])?;
        Ok::<_, String>(Earth { number: number_of_json(value), ..earth })
    };
    match value["components"].as_array().map(Vec::as_slice) {
        None => Ok(HorizontalAndVertical::of(earth(value)?)),
        Some([horizontal, vertical]) => {
            let (horizontal, vertical) = (earth(horizontal)?, vertical_of_json(vertical)?);
            Ok(HorizontalAndVertical {
                name: text(&value["name"]),
                horizontal: Horizontal::Earth(horizontal.into()),
                vertical: Some(vertical),
            })
        }
        Some(parts) => Err(format!("a compound system of {} components", parts.len())),
    }
}

fn vertical_of_json(value: &Value) -> Result<Vertical, String> {
    let number = number_of_json(value);
    if let Some(known) = number.and_then(|number| Vertical::of_epsg(number).ok()) {
        return Ok(known);
    }
    let datum =
        [&value["datum"], &value["datum_ensemble"]].into_iter().find_map(|datum| datum["name"].as_str());
    let axis = &value["coordinate_system"]["axis"][0];
    let (Some("VerticalCRS"), Some(name), Some(datum), Unit::Length(unit)) =
        (value["type"].as_str(), value["name"].as_str(), datum, projjson::unit(&axis["unit"])?)
    else {
        return Err("heights of a kind that is not known".into());
    };
    let is_up = match axis["direction"].as_str() {
        Some("up") => true,
        Some("down") => false,
        _ => return Err("heights whose axis points neither up nor down".into()),
    };
    Ok(Vertical { name: name.into(), datum: datum.into(), number, unit, is_up })
}
