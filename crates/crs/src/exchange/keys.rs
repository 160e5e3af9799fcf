//! GeoTIFF keys for systems that were defined in other forms.

use super::parts::{Earth, Horizontal, HorizontalAndVertical};
use crate::definition::geo_keys::{GEOGRAPHIC, GeoKeys, GeoKeysBuilder, PROJECTED, USER_DEFINED, key};
use crate::methods::{self, Measure};
use crate::projection::shift::Shift;
use crate::projection::system::Name;

/// EPSG codes of units of length.
const LENGTHS: [(f64, u16); 4] = [(1.0, 9001), (0.3048, 9002), (1200.0 / 3937.0, 9003), (1000.0, 9036)];
const DEGREE: u16 = 9102;
const GREENWICH: u16 = 8901;

/// Writes the keys of a system. The error describes what keys cannot represent.
pub(super) fn write(parts: &HorizontalAndVertical) -> Result<GeoKeys, String> {
    let mut keys = GeoKeysBuilder::default();
    let earth = match &parts.horizontal {
        Horizontal::Earth(earth) => earth,
        Horizontal::Local { .. } => return Err("a local system, which GeoTIFF keys do not support".into()),
    };
    if earth.height.is_some() {
        return Err("ellipsoidal heights, which GeoTIFF keys support for few systems".into());
    }
    let is_north_first = earth.axes.first().is_some_and(|axis| axis.direction == "north");
    let is_polar = earth.axes.first().zip(earth.axes.get(1)).is_some_and(|(a, b)| a.direction == b.direction);
    match &earth.projection {
        None => {
            if (earth.unit / 1f64.to_radians() - 1.0).abs() > 1e-9 {
                return Err("longitude and latitude in a unit other than degrees".into());
            }
            keys.number(key::MODEL_TYPE, GEOGRAPHIC);
            base(&mut keys, earth)?;
        }
        Some(_) if is_north_first && !is_polar => {
            return Err(
                "northings before eastings, which GeoTIFF keys support only with an EPSG number".into()
            );
        }
        Some((words, values)) => {
            let written = methods::find_words(words, values)?;
            if written.key == 0 {
                return Err(format!("the method {}, which GeoTIFF keys do not support", written.name));
            }
            keys.number(key::MODEL_TYPE, PROJECTED);
            keys.text(key::CITATION, &earth.name());
            base(&mut keys, earth)?;
            keys.number(key::PROJECTED_CRS, USER_DEFINED);
            keys.number(key::PROJECTION, USER_DEFINED);
            keys.number(key::PROJECTION_METHOD, written.key);
            unit(&mut keys, key::LINEAR_UNITS, key::LINEAR_UNIT_SIZE, earth.unit);
            for parameter in written.keys(values) {
                let value = match parameter.measure {
                    Measure::Length => parameter.value / earth.unit,
                    Measure::Angle | Measure::Scale => parameter.value,
                };
                keys.double(parameter.name, &[value]);
            }
        }
    }
    if let Some(vertical) = &parts.vertical {
        let number = vertical.number.and_then(|number| u16::try_from(number).ok());
        match number {
            Some(number) => keys.number(key::VERTICAL, number),
            None if !vertical.is_up => return Err("depths in a system without an EPSG number".into()),
            None => {
                let known = LENGTHS.iter().find(|(own, _)| (vertical.unit / own - 1.0).abs() < 1e-10);
                let (_, unit) = known.ok_or_else(|| format!("heights in a unit of {:?} m", vertical.unit))?;
                keys.number(key::VERTICAL, USER_DEFINED);
                keys.text(key::VERTICAL_CITATION, &vertical.name);
                keys.number(key::VERTICAL_DATUM, USER_DEFINED);
                keys.number(key::VERTICAL_UNITS, *unit);
            }
        }
    }
    Ok(keys.finish())
}

fn unit(keys: &mut GeoKeysBuilder, place: u16, size_place: u16, metres: f64) {
    match LENGTHS.iter().find(|(own, _)| (metres / own - 1.0).abs() < 1e-10) {
        Some((_, number)) => keys.number(place, *number),
        None => {
            keys.number(place, USER_DEFINED);
            keys.double(size_place, &[metres]);
        }
    }
}

/// Writes the keys of the geographic system.
fn base(keys: &mut GeoKeysBuilder, earth: &Earth) -> Result<(), String> {
    match (&earth.base.datum, earth.registered()) {
        // (A datum known only by its name is written as the first system of the registry that has
        // it.)
        (Name::Epsg(number), _) => keys.number(key::GEODETIC_CRS, *number),
        (Name::Text(_), Some(known)) => keys.number(key::GEODETIC_CRS, known.number),
        (Name::Text(datum), None) => {
            let (ellipsoid, size, inverse, _) = earth.ellipsoid();
            let name = earth.base.name.as_deref().unwrap_or("unknown");
            keys.number(key::GEODETIC_CRS, USER_DEFINED);
            let part = |text: &str| text.replace(['|', '\0'], " ");
            let [name, datum, ellipsoid] = [name, datum.as_str(), ellipsoid.as_str()].map(part);
            keys.text(
                key::GEODETIC_CITATION,
                &format!("GCS Name = {name}|Datum = {datum}|Ellipsoid = {ellipsoid}"),
            );
            keys.number(key::GEODETIC_DATUM, USER_DEFINED);
            keys.number(key::ELLIPSOID, USER_DEFINED);
            keys.double(key::SEMI_MAJOR_AXIS, &[size]);
            match inverse == 0.0 {
                true => keys.double(key::SEMI_MINOR_AXIS, &[size]),
                false => keys.double(key::INVERSE_FLATTENING, &[inverse]),
            }
            match earth.base.prime_meridian == 0.0 {
                true => keys.number(key::PRIME_MERIDIAN, GREENWICH),
                false => {
                    keys.number(key::PRIME_MERIDIAN, USER_DEFINED);
                    keys.double(key::PRIME_MERIDIAN_LONGITUDE, &[earth.base.prime_meridian]);
                }
            }
        }
    }
    keys.number(key::ANGULAR_UNITS, DEGREE);
    match &earth.shift {
        None => {}
        Some(Shift::Helmert(numbers)) => keys.double(key::TO_WGS84, numbers),
        Some(Shift::Grid(name)) => {
            return Err(format!("a datum shift by the grid {name}, which GeoTIFF keys do not support"));
        }
    }
    Ok(())
}
