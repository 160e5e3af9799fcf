//! Export of coordinate reference systems as WKT 2, Esri's WKT 1 and GeoTIFF keys, from the
//! components that all forms have in common.

mod esri;
mod keys;
mod parts;
#[cfg(test)]
mod tests;
mod text;
mod wkt2;

use crate::definition::{WKT2, parse_wkt};
use crate::projection::geo_keys::cited;
use crate::{Crs, GeoKeys};
use spinney_base::{Error, Result};

impl Crs {
    /// Returns the system in well-known text version 2 (ISO 19162:2019). A definition in that form
    /// is returned unchanged.
    ///
    /// ```
    /// use spinney::Crs;
    /// let text = Crs::parse("+proj=laea +lat_0=52 +lon_0=10 +ellps=bessel")?.to_wkt2()?;
    /// assert!(text.starts_with("PROJCRS[\"unknown\",BASEGEOGCRS["));
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the definition contains an element that is not supported, so that the result might be
    /// different.
    pub fn to_wkt2(&self) -> Result<String> {
        if let Crs::Wkt(text) = self
            && parse_wkt(text).is_ok_and(|node| node.is(&WKT2))
        {
            return Ok(text.clone());
        }
        let text = parts::read(self).and_then(|parts| wkt2::write(&parts));
        text.map_err(|found| self.not_written("WKT 2", found))
    }

    /// Returns the system in the variant of well-known text version 1 that Esri's programs read.
    ///
    /// # Errors
    /// As for [`Crs::to_wkt2`], and if Esri's variant cannot represent it.
    pub fn to_esri_wkt(&self) -> Result<String> {
        let text = parts::read(self).and_then(|parts| esri::write(&parts));
        text.map_err(|found| self.not_written("Esri WKT", found))
    }

    /// Returns the system in GeoTIFF keys: the original keys, those of its EPSG codes, or those of
    /// its components.
    ///
    /// # Errors
    /// As for [`Crs::to_wkt2`], and if keys cannot represent it.
    pub fn to_geo_keys(&self) -> Result<GeoKeys> {
        if let Crs::GeoKeys(keys) = self {
            return Ok(keys.clone());
        }
        if let Some(keys) = self.numbers().and_then(GeoKeys::of_epsg) {
            return Ok(keys);
        }
        let keys = parts::read(self).and_then(|parts| keys::write(&parts));
        keys.map_err(|found| self.not_written("GeoTIFF keys", found))
    }

    /// Returns the system in a form that other programs read: `EPSG:4326` or `EPSG:4326+5773` if it
    /// has EPSG codes, otherwise WKT 2.
    ///
    /// # Errors
    /// If it has no EPSG codes and cannot be represented in WKT 2. Only [`Crs::definition`] is
    /// available then.
    pub fn to_text(&self) -> Result<String> {
        match self.numbers() {
            Some(epsg) => Ok(epsg.to_string()),
            None => self.to_wkt2(),
        }
    }

    /// Returns the original definition in a form that other programs may support although it is not
    /// supported here: WKT, PROJJSON or a PROJ string. `None` if the definition is in none of these
    /// forms.
    pub fn foreign_text(&self) -> Option<String> {
        match self {
            Crs::Epsg(_) => None,
            Crs::GeoKeys(keys) => cited(keys),
            Crs::Wkt(text) | Crs::ProjJson(text) | Crs::Proj(text) => Some(text.clone()),
        }
    }

    /// Returns a string that is equal for equal systems, whatever their forms and names; `None` if
    /// the definition is not supported.
    pub(crate) fn identity(&self) -> Option<String> {
        parts::read(self).ok()?.identity()
    }

    /// Whether another definition has the same horizontal coordinates, with or without EPSG codes,
    /// whatever the order of the axes and the heights.
    pub(crate) fn is_same_plane(&self, other: &Crs) -> bool {
        let identity = |crs: &Crs| parts::read(crs).ok()?.plane_identity();
        identity(self).is_some_and(|own| Some(own) == identity(other))
    }

    fn not_written(&self, form: &str, found: String) -> Error {
        let expected =
            format!("a definition that {form} can represent; the definition is `{}`", self.excerpt());
        Error::invalid(format!("coordinate system {self}"), found, expected)
    }

    /// Returns enough of the definition to recognize it.
    fn excerpt(&self) -> String {
        let definition = self.definition();
        let short: String =
            definition.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(200).collect();
        if short.len() < definition.len() { format!("{short}...") } else { short }
    }
}
