//! Esri's variant of well-known text version 1, as in `.prj` files of shapefiles.

use super::parts::{Earth, Horizontal, HorizontalAndVertical};
use super::text::Text;
use crate::methods::{self, Measure};
use crate::projection::shift::Shift;
use crate::projection::system::Name;
use crate::registry::{esri_name, meridian_at};

/// Esri's names of units of length.
const LENGTHS: [(f64, &str); 4] =
    [(1.0, "Meter"), (0.3048, "Foot"), (1200.0 / 3937.0, "Foot_US"), (1000.0, "Kilometer")];

fn unit(text: &mut Text, metres: f64) {
    let known = LENGTHS.iter().find(|(own, _)| (metres / own - 1.0).abs() < 1e-10);
    text.node("UNIT", &mut |text| {
        text.quoted(known.map_or("User_Defined_Unit", |(_, name)| name)).plain(metres);
    });
}

/// Writes a system. The error describes what cannot be written.
pub(super) fn write(parts: &HorizontalAndVertical) -> Result<String, String> {
    let earth = match &parts.horizontal {
        Horizontal::Earth(earth) => earth,
        Horizontal::Local { .. } => return Err("a local system, which Esri WKT does not support".into()),
    };
    if let Some(Shift::Grid(name)) = &earth.shift {
        return Err(format!("a datum shift by the grid {name}, which Esri WKT does not support"));
    }
    let mut text = Text::new();
    let Some((words, values)) = &earth.projection else {
        geographic(&mut text, earth);
        return Ok(with_heights(text, parts));
    };
    let (method, parameters) = methods::find_words(words, values)?.esri_parameters(values)?;
    text.node("PROJCS", &mut |text| {
        text.quoted(&esri_name("", &earth.name()));
        geographic(text, earth);
        text.node("PROJECTION", &mut |text| {
            text.quoted(method);
        });
        for parameter in &parameters {
            let value = match parameter.measure {
                Measure::Length => parameter.value / earth.unit,
                Measure::Angle | Measure::Scale => parameter.value,
            };
            text.node("PARAMETER", &mut |text| {
                text.quoted(parameter.name).plain(value);
            });
        }
        unit(text, earth.unit);
    });
    Ok(with_heights(text, parts))
}

fn geographic(text: &mut Text, earth: &Earth) {
    let registered = earth.registered();
    let (ellipsoid, size, inverse, known) = earth.ellipsoid();
    text.node("GEOGCS", &mut |text| {
        let name = match (&registered, &earth.base.name) {
            (Some(known), _) => known.esri_name(),
            (None, name) => esri_name("", name.as_deref().unwrap_or("Unknown")),
        };
        text.quoted(&format!("GCS_{}", name.trim_start_matches("GCS_")));
        text.node("DATUM", &mut |text| {
            let name = match (&registered, &earth.base.datum) {
                (Some(known), _) => known.esri_datum(),
                (None, Name::Text(name)) => esri_name("", name),
                (None, Name::Epsg(_)) => "Unknown".into(),
            };
            text.quoted(&format!("D_{}", name.trim_start_matches("D_")));
            text.node("SPHEROID", &mut |text| {
                let name = known.map_or_else(|| esri_name("", &ellipsoid), |known| known.esri_name());
                text.quoted(&name).plain(size).plain(inverse);
            });
        });
        let turn = earth.base.prime_meridian;
        text.node("PRIMEM", &mut |text| {
            text.quoted(meridian_at(turn).unwrap_or("Unknown")).plain(turn);
        });
        let radians = if earth.projection.is_some() { 1f64.to_radians() } else { earth.unit };
        let name = if (radians / 1f64.to_radians() - 1.0).abs() < 1e-10 { "Degree" } else { "Grad" };
        text.node("UNIT", &mut |text| {
            text.quoted(name).plain(radians);
        });
    });
}

/// Appends the vertical system to the text.
fn with_heights(plane: Text, parts: &HorizontalAndVertical) -> String {
    let mut text = plane;
    if let Some(vertical) = &parts.vertical {
        text.node("VERTCS", &mut |text| {
            text.quoted(&esri_name("", &vertical.name));
            text.node("VDATUM", &mut |text| {
                text.quoted(&esri_name("", &vertical.datum));
            });
            for (name, value) in
                [("Vertical_Shift", 0.0), ("Direction", if vertical.is_up { 1.0 } else { -1.0 })]
            {
                text.node("PARAMETER", &mut |text| {
                    text.quoted(name).plain(value);
                });
            }
            unit(text, vertical.unit);
        });
    }
    text.finish()
}
