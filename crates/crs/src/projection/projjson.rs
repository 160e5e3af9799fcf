//! Reads the components of a system from PROJJSON.

use serde_json::Value;

use super::axis::Axis;
use super::definition::Definition;
use super::shift::{self, Shift};
use super::system::{Base, Conversion, Name, Parameter, System, Unit, check_ellipsoid, degrees, half_axes};
use crate::definition::parse_projjson;

/// Members that are not supported, because they would change the system.
const OTHER: [&str; 2] = ["deriving_conversion", "deformation_models"];

/// Reads a definition. The error describes what was found.
pub(super) fn read(text: &str) -> Result<Definition, String> {
    system(&parse_projjson(text)?)?.definition()
}

/// Returns the components of a system.
pub(crate) fn system(value: &Value) -> Result<System, String> {
    if let Some(other) = OTHER.iter().find(|member| !value[**member].is_null()) {
        return Err(format!("a system with {other}"));
    }
    match value["type"].as_str() {
        Some("CompoundCRS") => system(&value["components"][0]),
        Some("BoundCRS") => bound(value),
        Some("GeographicCRS") => {
            let base = base(value)?;
            let (axes, unit) = axes(value, "ellipsoidal")?;
            let Unit::Angle(unit) = unit else {
                return Err("longitude and latitude in no unit of angles".into());
            };
            Ok(System { name: None, base, conversion: None, height: height(value)?, axes, unit, shift: None })
        }
        Some("ProjectedCRS") => {
            let base = base(&value["base_crs"])?;
            let (axes, unit) = axes(value, "Cartesian")?;
            let Unit::Length(unit) = unit else { return Err("a plane in no unit of length".into()) };
            let conversion = Some(conversion(&value["conversion"])?);
            let (name, height) = (text(&value["name"]), height(value)?);
            Ok(System { name, base, conversion, axes, unit, height, shift: None })
        }
        kind => Err(format!("a system of the kind {}", kind.unwrap_or("of none"))),
    }
}

/// Reads datum, ellipsoid and prime meridian.
fn base(value: &Value) -> Result<Base, String> {
    let datum = [&value["datum"], &value["datum_ensemble"]].into_iter().find(|datum| datum.is_object());
    let datum = datum.ok_or("a system without a datum")?;
    let name = datum["name"].as_str().ok_or("a datum without a name")?;
    let ellipsoid = &datum["ellipsoid"];
    let metres = |member: &str| match &ellipsoid[member] {
        Value::Null => Ok(None),
        value => match measure(value, Unit::Length(1.0))? {
            (number, Unit::Length(metres)) => Ok(Some(number * metres)),
            _ => Err(format!("the {member} of an ellipsoid in no unit of length")),
        },
    };
    let sizes = (metres("semi_major_axis")?, metres("semi_minor_axis")?, metres("radius")?);
    let ellipsoid = match (sizes, ellipsoid["inverse_flattening"].as_f64()) {
        ((Some(a), None, None), Some(inverse)) => half_axes(a, inverse)?,
        ((Some(a), Some(b), None), None) => check_ellipsoid([a, b])?,
        ((None, None, Some(radius)), None) => check_ellipsoid([radius, radius])?,
        _ => return Err(format!("the datum {name} without the size of its ellipsoid")),
    };
    let meridian = match &datum["prime_meridian"] {
        Value::Null => 0.0,
        meridian => angle(&meridian["longitude"])?,
    };
    Ok(Base {
        name: text(&value["name"]),
        datum: Name::Text(name.into()),
        ellipsoid,
        ellipsoid_name: text(&datum["ellipsoid"]["name"]),
        prime_meridian: meridian,
        angle: 1f64.to_radians(),
    })
}

fn text(value: &Value) -> Option<String> {
    value.as_str().map(String::from)
}

/// Returns the size in metres of the unit of the third axis, which must be ellipsoidal height.
fn height(value: &Value) -> Result<Option<f64>, String> {
    let axis = &value["coordinate_system"]["axis"][2];
    match (axis["direction"].as_str(), axis.is_null()) {
        (_, true) => Ok(None),
        (Some("up"), _) => match unit(&axis["unit"])? {
            Unit::Length(metres) => Ok(Some(metres)),
            _ => Err("heights in no unit of length".into()),
        },
        _ => Err("a third axis that does not point up".into()),
    }
}

/// Reads a number, or an object with a number and its unit.
fn measure(value: &Value, usual: Unit) -> Result<(f64, Unit), String> {
    let (number, own) = match value {
        Value::Object(_) => (value["value"].as_f64(), unit(&value["unit"])?),
        _ => (value.as_f64(), usual),
    };
    Ok((number.ok_or("a measure that is no number")?, own))
}

/// Reads an angle and returns it in degrees.
fn angle(value: &Value) -> Result<f64, String> {
    match measure(value, Unit::Angle(1f64.to_radians()))? {
        (number, Unit::Angle(radians)) => Ok(degrees(number, radians)),
        _ => Err("an angle in no unit of angles".into()),
    }
}

pub(crate) fn unit(value: &Value) -> Result<Unit, String> {
    let factor = value["conversion_factor"].as_f64().filter(|factor| *factor > 0.0);
    match (value.as_str(), value["type"].as_str(), factor) {
        (Some("metre"), ..) => Ok(Unit::Length(1.0)),
        (Some("degree"), ..) => Ok(Unit::Angle(1f64.to_radians())),
        (Some("unity"), ..) => Ok(Unit::Scale(1.0)),
        (_, Some("LinearUnit"), Some(factor)) => Ok(Unit::Length(factor)),
        (_, Some("AngularUnit"), Some(factor)) => Ok(Unit::Angle(factor)),
        (_, Some("ScaleUnit"), Some(factor)) => Ok(Unit::Scale(factor)),
        _ => Err("a unit that is not known".into()),
    }
}

/// Reads the axes and their unit.
fn axes(value: &Value, kind: &str) -> Result<(Vec<Axis>, Unit), String> {
    let system = &value["coordinate_system"];
    if system["subtype"] != kind {
        return Err(format!("a system of axes that is not {kind}"));
    }
    let mut axes = Vec::new();
    let mut units = Vec::new();
    for axis in system["axis"].as_array().into_iter().flatten() {
        let direction = axis["direction"].as_str().ok_or("an axis without a direction")?.to_ascii_lowercase();
        let meridian = match &axis["meridian"] {
            Value::Null => None,
            meridian => Some(angle(&meridian["longitude"])?),
        };
        axes.push(Axis { name: axis["name"].as_str().unwrap_or_default().into(), direction, meridian });
        units.push(unit(&axis["unit"])?);
    }
    match units[..] {
        // (Heights have their own unit.)
        [a, b, ..] if a == b => Ok((axes, a)),
        _ => Err("axes that are not two with one unit".into()),
    }
}

/// Reads the method and the parameters of a conversion or transformation.
fn conversion(value: &Value) -> Result<Conversion, String> {
    let method = value["method"]["name"].as_str().ok_or("a conversion without a method")?.into();
    let mut parameters = Vec::new();
    for parameter in value["parameters"].as_array().into_iter().flatten() {
        let name = parameter["name"].as_str().ok_or("a parameter without a name")?;
        let number = parameter["value"].as_f64();
        let value = number.ok_or_else(|| format!("the parameter {name} without a number"))?;
        let own = &parameter["unit"];
        let unit = if own.is_null() { None } else { Some(unit(own)?) };
        parameters.push(Parameter { name: name.into(), value, unit });
    }
    Ok(Conversion { method, parameters })
}

/// Reads a bound system with its transformation to WGS 84.
fn bound(value: &Value) -> Result<System, String> {
    let source = &value["source_crs"];
    if source["type"] == "BoundCRS" {
        return Err("a BoundCRS in a BoundCRS".into());
    }
    let mut source = system(source)?;
    let (target, transformation) = (&value["target_crs"], &value["transformation"]);
    let names = [&target["datum"]["name"], &target["datum_ensemble"]["name"]];
    let name = names.into_iter().find_map(Value::as_str).unwrap_or_default();
    shift::check_target(target["type"] == "GeographicCRS", name)?;
    let file =
        transformation["parameters"].as_array().into_iter().flatten().find_map(|one| one["value"].as_str());
    source.shift = Some(match file {
        Some(grid) => Shift::Grid(grid.into()),
        None => shift::read(&conversion(transformation)?)?,
    });
    Ok(source)
}
