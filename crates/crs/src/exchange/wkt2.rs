//! Well-known text version 2 (ISO 19162:2019).

use super::parts::{Earth, Horizontal, HorizontalAndVertical, Vertical, inverse_flattening};
use super::text::Text;
use crate::methods::{self, Measure};
use crate::projection::axis::Axis;
use crate::projection::shift::Shift;
use crate::projection::system::Name;
use crate::registry::{Ellipsoid, meridian_at};

/// Units of length: metres, name, EPSG code.
const LENGTHS: [(f64, &str, u16); 10] = [
    (1.0, "metre", 9001),
    (0.3048, "foot", 9002),
    (1200.0 / 3937.0, "US survey foot", 9003),
    (1000.0, "kilometre", 9036),
    (0.304_797_265_4, "Clarke's foot", 9005),
    (0.304_799_471_538_675_76, "British foot (Sears 1922)", 9041),
    (0.914_398_414_616_028_7, "British yard (Sears 1922)", 9040),
    (20.116_765_121_552_63, "British chain (Sears 1922)", 9042),
    (0.201_166_195_164, "Clarke's link", 9039),
    (1.000_013_596_5, "German legal metre", 9031),
];
/// Units of angle: radians, name, EPSG code.
const ANGLES: [(f64, &str, u16); 3] = [
    (std::f64::consts::PI / 180.0, "degree", 9122),
    (std::f64::consts::PI / 200.0, "grad", 9105),
    (1.0, "radian", 9101),
];
const DEGREE: f64 = ANGLES[0].0;

/// Returns the name and code of a unit of a size in metres or radians; the code is 0 if it has
/// none.
fn unit_name(table: &[(f64, &'static str, u16)], size: f64) -> (&'static str, u16) {
    let known = table.iter().find(|(own, ..)| (size / own - 1.0).abs() < 1e-10);
    known.map_or(("unknown", 0), |(_, name, number)| (name, *number))
}

/// Writes a system. The error describes what cannot be written.
pub(super) fn write(parts: &HorizontalAndVertical) -> Result<String, String> {
    let mut text = Text::new();
    let Some(vertical) = &parts.vertical else {
        horizontal(&mut text, &parts.horizontal)?;
        return Ok(text.finish());
    };
    let plane = match &parts.horizontal {
        Horizontal::Earth(earth) => earth.name(),
        Horizontal::Local { name, .. } => name.clone(),
    };
    let name = parts.name.clone().unwrap_or_else(|| format!("{plane} + {}", vertical.name));
    let mut result = Ok(());
    text.node("COMPOUNDCRS", &mut |text| {
        text.quoted(&name);
        result = horizontal(text, &parts.horizontal);
        heights(text, vertical);
    });
    result.map(|()| text.finish())
}

fn horizontal(text: &mut Text, horizontal: &Horizontal) -> Result<(), String> {
    match horizontal {
        Horizontal::Earth(earth) => bound(text, earth),
        Horizontal::Local { name, unit } => {
            text.node("ENGCRS", &mut |text| {
                text.quoted(name);
                text.node("EDATUM", &mut |text| {
                    text.quoted("Unknown engineering datum");
                });
                let axes = [axis("east"), axis("north")];
                cartesian(text, &axes, *unit, None);
            });
            Ok(())
        }
    }
}

fn axis(direction: &str) -> Axis {
    Axis { name: String::new(), direction: direction.into(), meridian: None }
}

/// Writes a system, bound to WGS 84 if it defines a datum shift.
fn bound(text: &mut Text, earth: &Earth) -> Result<(), String> {
    let Some(shift) = &earth.shift else { return system(text, earth) };
    let mut result = Ok(());
    text.node("BOUNDCRS", &mut |text| {
        text.node("SOURCECRS", &mut |text| result = system(text, earth));
        text.node("TARGETCRS", &mut world);
        text.node("ABRIDGEDTRANSFORMATION", &mut |text| transformation(text, &earth.base_name(), shift));
    });
    result
}

/// Writes WGS 84.
fn world(text: &mut Text) {
    text.node("GEOGCRS", &mut |text| {
        text.quoted("WGS 84");
        text.node("DATUM", &mut |text| {
            text.quoted("World Geodetic System 1984");
            ellipsoid(text, "WGS 84", 6_378_137.0, 298.257_223_563);
        });
        meridian(text, "Greenwich", 0.0);
        ellipsoidal(text, &[axis("north"), axis("east")], DEGREE, None);
        id(text, 4326);
    });
}

fn transformation(text: &mut Text, from: &str, shift: &Shift) {
    text.quoted(&format!("Transformation from {from} to WGS 84"));
    let numbers = match shift {
        Shift::Grid(file) => {
            method(text, "NTv2", 9615);
            text.node("PARAMETERFILE", &mut |text| {
                text.quoted("Latitude and longitude difference file").quoted(file);
                id(text, 8656);
            });
            return;
        }
        Shift::Helmert(numbers) => numbers,
    };
    let names = ["X-axis translation", "Y-axis translation", "Z-axis translation", "X-axis rotation"];
    let names = names.into_iter().chain(["Y-axis rotation", "Z-axis rotation", "Scale difference"]);
    match numbers.len() {
        3 => method(text, "Geocentric translations (geog2D domain)", 9603),
        _ => method(text, "Position Vector transformation (geog2D domain)", 9606),
    }
    for (place, (name, number)) in names.zip(numbers).enumerate() {
        text.node("PARAMETER", &mut |text| {
            // (An abridged scale is a factor; rotations are in arc seconds.)
            text.quoted(name).plain(if place == 6 { 1.0 + number * 1e-6 } else { *number });
            id(text, 8605 + place as u32);
        });
    }
}

fn system(text: &mut Text, earth: &Earth) -> Result<(), String> {
    let Some((words, values)) = &earth.projection else {
        text.node("GEOGCRS", &mut |text| {
            text.quoted(&earth.name());
            datum(text, earth);
            ellipsoidal(text, &earth.axes, earth.unit, earth.height);
            // (The code is that of the whole system.)
            if let Some(number) = earth.number {
                id(text, number);
            }
        });
        return Ok(());
    };
    let written = methods::find_words(words, values)?;
    let pole = methods::pole(words, values);
    let axes = match (&earth.axes[..], pole) {
        ([], Some(latitude)) => {
            let direction = if latitude > 0.0 { "south" } else { "north" };
            vec![axis(direction), axis(direction)]
        }
        ([], None) => methods::axes_of_words(words).unwrap_or(["east", "north"]).map(axis).into(),
        (axes_of_system, _) => axes_of_system.to_vec(),
    };
    text.node("PROJCRS", &mut |text| {
        text.quoted(&earth.name());
        text.node("BASEGEOGCRS", &mut |text| {
            text.quoted(&earth.base_name());
            datum(text, earth);
            if let Name::Epsg(number) = earth.base.datum {
                id(text, number.into());
            }
        });
        text.node("CONVERSION", &mut |text| {
            text.quoted("unnamed");
            method(text, written.name, written.number);
            for parameter in written.parameters(values) {
                text.node("PARAMETER", &mut |text| {
                    let (name, number) = parameter.name;
                    text.quoted(name).plain(parameter.value);
                    match parameter.measure {
                        Measure::Angle => unit(text, "ANGLEUNIT", &ANGLES, DEGREE),
                        Measure::Length => unit(text, "LENGTHUNIT", &LENGTHS, 1.0),
                        Measure::Scale => text.node("SCALEUNIT", &mut |text| {
                            text.quoted("unity").plain(1);
                        }),
                    }
                    if number > 0 {
                        id(text, number.into());
                    }
                });
            }
        });
        cartesian(text, &axes, earth.unit, earth.height);
        if let Some(number) = earth.number {
            id(text, number);
        }
    });
    Ok(())
}

impl Earth {
    pub(super) fn name(&self) -> String {
        match (&self.name, &self.projection) {
            (Some(name), _) => name.clone(),
            (None, Some(_)) => "unknown".into(),
            (None, None) => self.base_name(),
        }
    }

    /// Returns the name of the geographic system.
    pub(super) fn base_name(&self) -> String {
        let registered = match self.base.datum {
            Name::Epsg(_) => self.registered().map(|known| known.name.into()),
            Name::Text(_) => None,
        };
        registered.or(self.base.name.clone()).unwrap_or_else(|| "unknown".into())
    }

    /// Returns the ellipsoid: name, half axis in metres, inverse flattening, and its entry in the
    /// registry.
    pub(super) fn ellipsoid(&self) -> (String, f64, f64, Option<&'static Ellipsoid>) {
        let inverse = inverse_flattening(self.base.ellipsoid);
        let size = self.base.ellipsoid[0];
        let known = self.registered().and_then(|known| known.ellipsoid());
        if let Some(known) = known {
            return (known.name.into(), known.size, known.inverse_flattening, Some(known));
        }
        let known = Ellipsoid::of_size(size, inverse);
        let name = self.base.ellipsoid_name.clone().or(known.map(|known| known.name.into()));
        (name.unwrap_or_else(|| "unknown".into()), size, inverse, known)
    }
}

/// Writes datum, ellipsoid and prime meridian.
fn datum(text: &mut Text, earth: &Earth) {
    let registered = earth.registered();
    let (name, size, inverse, _) = earth.ellipsoid();
    text.node("DATUM", &mut |text| {
        match (&registered, &earth.base.datum) {
            (Some(known), _) => text.quoted(known.datum_name),
            (None, Name::Text(name)) => text.quoted(name),
            (None, Name::Epsg(number)) => text.quoted(&format!("of EPSG:{number}")),
        };
        ellipsoid(text, &name, size, inverse);
    });
    let turn = earth.base.prime_meridian;
    let (name, turn) = match registered.and_then(|known| known.meridian()) {
        Some((name, turn)) => (name, turn),
        None => (meridian_at(turn).unwrap_or("unknown"), turn),
    };
    meridian(text, name, turn);
}

fn ellipsoid(text: &mut Text, name: &str, size: f64, inverse: f64) {
    text.node("ELLIPSOID", &mut |text| {
        text.quoted(name).plain(size).plain(inverse);
        unit(text, "LENGTHUNIT", &LENGTHS, 1.0);
    });
}

fn meridian(text: &mut Text, name: &str, degrees: f64) {
    text.node("PRIMEM", &mut |text| {
        text.quoted(name).plain(degrees);
        unit(text, "ANGLEUNIT", &ANGLES, DEGREE);
    });
}

fn method(text: &mut Text, name: &str, number: u16) {
    text.node("METHOD", &mut |text| {
        text.quoted(name);
        if number > 0 {
            id(text, number.into());
        }
    });
}

fn unit(text: &mut Text, keyword: &str, table: &[(f64, &'static str, u16)], size: f64) {
    let (name, number) = unit_name(table, size);
    text.node(keyword, &mut |text| {
        text.quoted(name).plain(size);
        if number > 0 {
            id(text, number.into());
        }
    });
}

fn id(text: &mut Text, number: u32) {
    text.node("ID", &mut |text| {
        text.quoted("EPSG").plain(number);
    });
}

fn ellipsoidal(text: &mut Text, axes: &[Axis], angle: f64, height: Option<f64>) {
    coordinates(
        text,
        "ellipsoidal",
        axes,
        height,
        |direction| match direction {
            "north" => "geodetic latitude (Lat)",
            _ => "geodetic longitude (Lon)",
        },
        |text| unit(text, "ANGLEUNIT", &ANGLES, angle),
    );
}

fn cartesian(text: &mut Text, axes: &[Axis], metres: f64, height: Option<f64>) {
    // At a pole both axes have the same direction, and the first one is the easting.
    let is_polar = axes.len() > 1 && axes[0].direction == axes[1].direction;
    let mut place = 0;
    coordinates(
        text,
        "Cartesian",
        axes,
        height,
        |direction| {
            place += 1;
            match (direction, is_polar, place) {
                (_, true, 1) => "easting (E)",
                (_, true, _) => "northing (N)",
                ("east", ..) => "easting (E)",
                ("west", ..) => "westing (W)",
                ("south", ..) => "southing (S)",
                _ => "northing (N)",
            }
        },
        |text| unit(text, "LENGTHUNIT", &LENGTHS, metres),
    );
}

/// Writes a coordinate system with its axes.
fn coordinates(
    text: &mut Text,
    kind: &str,
    axes: &[Axis],
    height: Option<f64>,
    mut name: impl FnMut(&str) -> &'static str,
    unit_of_plane: impl Fn(&mut Text),
) {
    text.node("CS", &mut |text| {
        text.plain(kind).plain(2 + usize::from(height.is_some()));
    });
    for (place, axis) in axes.iter().take(2).enumerate() {
        let usual = name(&axis.direction);
        text.node("AXIS", &mut |text| {
            text.quoted(usual).plain(&axis.direction);
            if let Some(degrees) = axis.meridian {
                text.node("MERIDIAN", &mut |text| {
                    text.plain(degrees);
                    unit(text, "ANGLEUNIT", &ANGLES, DEGREE);
                });
            }
            text.node("ORDER", &mut |text| {
                text.plain(place + 1);
            });
            unit_of_plane(text);
        });
    }
    if let Some(metres) = height {
        text.node("AXIS", &mut |text| {
            text.quoted("ellipsoidal height (h)").plain("up");
            text.node("ORDER", &mut |text| {
                text.plain(3);
            });
            unit(text, "LENGTHUNIT", &LENGTHS, metres);
        });
    }
}

fn heights(text: &mut Text, vertical: &Vertical) {
    text.node("VERTCRS", &mut |text| {
        text.quoted(&vertical.name);
        text.node("VDATUM", &mut |text| {
            text.quoted(&vertical.datum);
        });
        text.node("CS", &mut |text| {
            text.plain("vertical").plain(1);
        });
        text.node("AXIS", &mut |text| {
            match vertical.is_up {
                true => text.quoted("gravity-related height (H)").plain("up"),
                false => text.quoted("depth (D)").plain("down"),
            };
            unit(text, "LENGTHUNIT", &LENGTHS, vertical.unit);
        });
        if let Some(number) = vertical.number {
            id(text, number);
        }
    });
}
