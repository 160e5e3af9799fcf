//! Reads the components of a system from well-known text of version 1 (OGC, GDAL and Esri) and 2
//! (2015 and 2019).

use super::axis::Axis;
use super::definition::Definition;
use super::proj_string;
use super::shift::{self, Shift};
use super::system::{Base, Conversion, Name, Parameter, System, Unit, degrees, half_axes};
use crate::definition::{BOUND, GEOGRAPHIC, WktNode, parse_wkt};
use crate::methods;

/// Keywords of supported projected systems.
const PROJECTED: [&str; 3] = ["PROJCS", "PROJCRS", "PROJECTEDCRS"];

const BASES: [&str; 3] = ["GEOGCS", "BASEGEOGCRS", "BASEGEODCRS"];
const DATUMS: [&str; 4] = ["DATUM", "TRF", "GEODETICDATUM", "ENSEMBLE"];
const ELLIPSOIDS: [&str; 2] = ["SPHEROID", "ELLIPSOID"];
const MERIDIANS: [&str; 2] = ["PRIMEM", "PRIMEMERIDIAN"];
const LENGTHS: [&str; 2] = ["LENGTHUNIT", "UNIT"];
const ANGLES: [&str; 2] = ["ANGLEUNIT", "UNIT"];
/// Nodes that do not affect coordinates.
const IGNORED_NODES: [&str; 14] = [
    "USAGE",
    "SCOPE",
    "AREA",
    "BBOX",
    "VERTICALEXTENT",
    "TIMEEXTENT",
    "REMARK",
    "ID",
    "AUTHORITY",
    "DYNAMIC",
    "FRAMEEPOCH",
    "ANCHOR",
    "ANCHOREPOCH",
    "ENSEMBLEACCURACY",
];

/// Reads a definition. The error describes what was found.
pub(super) fn read(text: &str) -> Result<Definition, String> {
    let node = parse_wkt(text)?;
    // (Some programs append a PROJ string as an EXTENSION where it differs from the WKT.)
    match node.horizontal().and_then(|node| node.child(&["EXTENSION"])) {
        Some(extension) => match extension.strings().collect::<Vec<_>>()[..] {
            ["PROJ4", words] if proj_string::is_web_mercator(words) => proj_string::read(words),
            _ => Err("an EXTENSION that is not known".into()),
        },
        None => system(&node)?.definition(),
    }
}

/// Returns the components of a system.
pub(crate) fn system(node: &WktNode) -> Result<System, String> {
    let node = node.horizontal().ok_or("a compound system of nothing")?;
    if node.is(&BOUND) {
        return bound(node);
    }
    let is_geographic = node.is(&GEOGRAPHIC);
    if !is_geographic && !node.is(&PROJECTED) {
        return Err(format!("a system of the kind {}", node.keyword()));
    }
    if is_geographic {
        let known = [&DATUMS[..], &MERIDIANS, &ANGLES, &["CS", "AXIS"]].concat();
        check_children(node, &known)?;
        let (base, shift) = base(node)?;
        let axes = axes(node)?;
        if node.child(&["CS"]).is_some_and(|cs| cs.words().next() != Some("ELLIPSOIDAL")) {
            return Err("longitude and latitude in a system of axes that is not ellipsoidal".into());
        }
        let unit = unit_of_axes(node, &ANGLES)?.unwrap_or(base.angle);
        return Ok(System {
            name: None,
            base,
            conversion: None,
            height: height(node, &axes)?,
            axes,
            unit,
            shift,
        });
    }
    let known = [&BASES[..], &LENGTHS, &["PROJECTION", "PARAMETER", "CONVERSION", "CS", "AXIS"]].concat();
    check_children(node, &known)?;
    if node.child(&["CS"]).is_some_and(|cs| cs.words().next() != Some("CARTESIAN")) {
        return Err("a plane in a system of axes that is not Cartesian".into());
    }
    let (base, shift) = base(node.child(&BASES).ok_or("a plane of no geographic system")?)?;
    let axes = axes(node)?;
    let unit = unit_of_axes(node, &LENGTHS)?.ok_or("a plane without a unit")?;
    let conversion = conversion(node.child(&["CONVERSION"]).unwrap_or(node))?;
    let (name, height) = (node.strings().next().map(String::from), height(node, &axes)?);
    Ok(System { name, base, conversion: Some(conversion), axes, unit, height, shift })
}

/// Fails if a node has children that might change its meaning.
fn check_children(node: &WktNode, known: &[&str]) -> Result<(), String> {
    match node.nodes().find(|child| !child.is(known) && !child.is(&IGNORED_NODES)) {
        Some(other) => Err(format!("{} in {}", other.keyword(), node.keyword())),
        None => Ok(()),
    }
}

/// Reads datum, ellipsoid and prime meridian, and the datum's shift.
fn base(node: &WktNode) -> Result<(Base, Option<Shift>), String> {
    let known = [&DATUMS[..], &MERIDIANS, &ANGLES, &["CS", "AXIS"]].concat();
    check_children(node, &known)?;
    let datum = node.child(&DATUMS).ok_or_else(|| format!("{} without a datum", node.keyword()))?;
    check_children(datum, &[&ELLIPSOIDS[..], &["MEMBER", "TOWGS84", "EXTENSION"]].concat())?;
    let name = datum.strings().next().ok_or("a datum without a name")?;
    let ellipsoid =
        datum.child(&ELLIPSOIDS).ok_or_else(|| format!("the datum {name} without an ellipsoid"))?;
    let ellipsoid_name = ellipsoid.strings().next().map(String::from);
    let [size, inverse_flattening] = ellipsoid.numbers().collect::<Vec<_>>()[..] else {
        return Err(format!("the datum {name} without the size of its ellipsoid"));
    };
    let ellipsoid = half_axes(size * unit(ellipsoid, &LENGTHS)?.unwrap_or(1.0), inverse_flattening)?;
    let angle = unit_of_axes(node, &ANGLES)?.unwrap_or(1f64.to_radians());
    let meridian = node.child(&MERIDIANS).map(|node| prime_meridian(node, angle)).transpose()?.unwrap_or(0.0);
    let grid =
        datum.child(&["EXTENSION"]).map(|extension| match extension.strings().collect::<Vec<_>>()[..] {
            ["PROJ4_GRIDS", grid] => Ok(Shift::Grid(grid.into())),
            _ => Err(format!("the datum {name} with an EXTENSION that is not known")),
        });
    let shift = datum.child(&["TOWGS84"]).map(|node| Ok(Shift::Helmert(node.numbers().collect())));
    let base = Base {
        name: node.strings().next().map(String::from),
        datum: Name::Text(name.into()),
        ellipsoid,
        ellipsoid_name,
        prime_meridian: meridian,
        angle,
    };
    Ok((base, grid.or(shift).transpose()?))
}

/// Returns a prime meridian in degrees.
fn prime_meridian(node: &WktNode, angle: f64) -> Result<f64, String> {
    let longitude = node.numbers().next().ok_or("a prime meridian without a longitude")?;
    let unit = unit(node, &ANGLES)?.unwrap_or(angle);
    // GDAL writes the longitude of Paris in degrees even if the unit is grads.
    let in_degrees = (longitude - 2.337_229_17).abs() < 1e-8 && node.strings().next() == Some("Paris");
    Ok(if in_degrees { longitude } else { degrees(longitude, unit) })
}

/// Returns the size of a node's unit in metres or radians.
pub(crate) fn unit(node: &WktNode, keywords: &[&str]) -> Result<Option<f64>, String> {
    let Some(unit) = node.child(keywords) else { return Ok(None) };
    match unit.numbers().next() {
        Some(factor) if factor > 0.0 => Ok(Some(factor)),
        _ => Err(format!("a {} without its size", unit.keyword())),
    }
}

/// Returns the common unit of the horizontal axes, defined once or for each axis.
fn unit_of_axes(node: &WktNode, keywords: &[&str]) -> Result<Option<f64>, String> {
    let of_all = unit(node, keywords)?;
    // (Heights have their own unit.)
    let axes = node.nodes().filter(|node| node.is(&["AXIS"])).take(2);
    let each = axes.map(|axis| unit(axis, keywords)).collect::<Result<Vec<_>, _>>()?;
    match each[..] {
        [a, b] if a != b => Err("axes with different units".into()),
        [Some(a), ..] if of_all.is_some_and(|all| all != a) => Err("axes with different units".into()),
        [a, ..] => Ok(a.or(of_all)),
        [] => Ok(of_all),
    }
}

/// Returns the size in metres of the unit of the third axis, which must be ellipsoidal height.
fn height(node: &WktNode, axes: &[Axis]) -> Result<Option<f64>, String> {
    let Some(axis) = node.nodes().filter(|node| node.is(&["AXIS"])).nth(2) else { return Ok(None) };
    match axes[2].direction.as_str() {
        "up" => Ok(unit(axis, &LENGTHS)?.or(unit(node, &["LENGTHUNIT"])?)),
        other => Err(format!("a third axis that goes {other}")),
    }
}

fn axes(node: &WktNode) -> Result<Vec<Axis>, String> {
    let mut axes = Vec::new();
    for (place, axis) in node.nodes().filter(|node| node.is(&["AXIS"])).enumerate() {
        let (Some(name), Some(direction)) = (axis.strings().next(), axis.words().next()) else {
            return Err("an axis without a direction".into());
        };
        let order = axis.child(&["ORDER"]).and_then(|order| order.numbers().next());
        if order.is_some_and(|order| order != (place + 1) as f64) {
            return Err("axes out of their order".into());
        }
        let meridian = axis.child(&["MERIDIAN"]).map(|node| {
            let longitude = node.numbers().next().ok_or("an axis along no meridian")?;
            Ok::<_, String>(degrees(longitude, unit(node, &ANGLES)?.unwrap_or(1f64.to_radians())))
        });
        let direction = direction.to_ascii_lowercase();
        axes.push(Axis { name: name.into(), direction, meridian: meridian.transpose()? });
    }
    if axes.is_empty() && node.child(&["CS"]).is_some() {
        return Err("a system of axes without axes".into());
    }
    Ok(axes)
}

/// Reads the method and the parameters from a node's children.
fn conversion(node: &WktNode) -> Result<Conversion, String> {
    let method = node.child(&["METHOD", "PROJECTION"]).and_then(|method| method.strings().next());
    let parameters = node.nodes().filter(|node| node.is(&["PARAMETER"])).map(parameter);
    Ok(Conversion {
        method: method.ok_or("a plane without a method")?.into(),
        parameters: parameters.collect::<Result<_, _>>()?,
    })
}

fn parameter(node: &WktNode) -> Result<Parameter, String> {
    let (Some(name), Some(value)) = (node.strings().next(), node.numbers().next()) else {
        return Err("a parameter without a value".into());
    };
    let unit = match unit(node, &["ANGLEUNIT"])?.map(Unit::Angle) {
        Some(unit) => Some(unit),
        None => match unit(node, &["LENGTHUNIT"])?.map(Unit::Length) {
            Some(unit) => Some(unit),
            None => unit(node, &["SCALEUNIT"])?.map(Unit::Scale),
        },
    };
    Ok(Parameter { name: name.into(), value, unit })
}

/// Reads a bound system with its transformation to WGS 84.
fn bound(node: &WktNode) -> Result<System, String> {
    check_children(node, &["SOURCECRS", "TARGETCRS", "ABRIDGEDTRANSFORMATION"])?;
    let inner = |keyword: &str| {
        let found = node.child(&[keyword]).and_then(|node| node.nodes().next());
        found.ok_or_else(|| format!("a BOUNDCRS without {keyword}"))
    };
    let source = inner("SOURCECRS")?;
    if source.is(&BOUND) {
        return Err("a BOUNDCRS in a BOUNDCRS".into());
    }
    let mut source = system(source)?;
    let target = inner("TARGETCRS")?;
    let target_name = target.child(&DATUMS).and_then(|datum| datum.strings().next()).unwrap_or_default();
    shift::check_target(target.is(&GEOGRAPHIC), target_name)?;
    let transformation =
        node.child(&["ABRIDGEDTRANSFORMATION"]).ok_or("a BOUNDCRS without a transformation")?;
    if let Some(grid) = transformation.child(&["PARAMETERFILE"]) {
        source.shift = Some(Shift::Grid(grid.strings().nth(1).unwrap_or("without a name").into()));
        return Ok(source);
    }
    let mut conversion = conversion(transformation)?;
    for parameter in &mut conversion.parameters {
        // (An abridged scale is a factor, not its difference from one.)
        if methods::key(&parameter.name) == "scaledifference" && parameter.unit.is_none() {
            (parameter.value, parameter.unit) = (parameter.value - 1.0, Some(Unit::Scale(1.0)));
        }
    }
    source.shift = Some(shift::read(&conversion)?);
    Ok(source)
}
