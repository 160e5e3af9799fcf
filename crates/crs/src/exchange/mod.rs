//! Coordinate systems as others read them: WKT 2, Esri's WKT 1 and GeoTIFF's keys, written from the parts that each form has.

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
    /// The system in well-known text of version 2 (ISO 19162:2019). A text that came so stays as it is.
    ///
    /// ```
    /// use spinney::Crs;
    /// let text = Crs::parse("+proj=laea +lat_0=52 +lon_0=10 +ellps=bessel")?.to_wkt2()?;
    /// assert!(text.starts_with("PROJCRS[\"unknown\",BASEGEOGCRS["));
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the definition says something that is not understood here, so that the text could say something else.
    pub fn to_wkt2(&self) -> Result<String> {
        if let Crs::Wkt(text) = self
            && parse_wkt(text).is_ok_and(|node| node.is(&WKT2))
        {
            return Ok(text.clone());
        }
        let text = parts::read(self).and_then(|parts| wkt2::write(&parts));
        text.map_err(|found| self.not_written("WKT 2", found))
    }

    /// The system in the well-known text of version 1 that Esri's programs read.
    ///
    /// # Errors
    /// As of [`Crs::to_wkt2`], and if Esri's text has no words for it.
    pub fn to_esri_wkt(&self) -> Result<String> {
        let text = parts::read(self).and_then(|parts| esri::write(&parts));
        text.map_err(|found| self.not_written("Esri's WKT", found))
    }

    /// The system in keys of GeoTIFF files: as they came, by its numbers, or by its parts.
    ///
    /// # Errors
    /// As of [`Crs::to_wkt2`], and if there are no keys for it.
    pub fn to_geo_keys(&self) -> Result<GeoKeys> {
        if let Crs::GeoKeys(keys) = self {
            return Ok(keys.clone());
        }
        if let Some(keys) = self.numbers().and_then(GeoKeys::of_epsg) {
            return Ok(keys);
        }
        let keys = parts::read(self).and_then(|parts| keys::write(&parts));
        keys.map_err(|found| self.not_written("GeoTIFF's keys", found))
    }

    /// The system as other programs read it: `EPSG:4326` or `EPSG:4326+5773` where it has numbers, else WKT 2.
    ///
    /// # Errors
    /// If it has no numbers and cannot be said in WKT 2; then [`Crs::definition`] is all that there is.
    pub fn to_text(&self) -> Result<String> {
        match self.numbers() {
            Some(epsg) => Ok(epsg.to_string()),
            None => self.to_wkt2(),
        }
    }

    /// A definition that other programs may know though it is not understood here: WKT 1, PROJJSON or PROJ's words, as it came. `None`
    /// if it came in none of these.
    pub fn foreign_text(&self) -> Option<String> {
        match self {
            Crs::Epsg(_) => None,
            Crs::GeoKeys(keys) => cited(keys),
            Crs::Wkt(text) | Crs::ProjJson(text) | Crs::Proj(text) => Some(text.clone()),
        }
    }

    /// Text that is the same for the same systems, in whatever form they came and whatever their names are; `None` where they are not
    /// understood.
    pub(crate) fn identity(&self) -> Option<String> {
        parts::read(self).ok()?.identity()
    }

    /// Whether another definition says the same of the plane, by number or not, whatever the order of its axes is, and whatever they say of heights.
    pub(crate) fn is_same_plane(&self, other: &Crs) -> bool {
        let identity = |crs: &Crs| parts::read(crs).ok()?.plane_identity();
        identity(self).is_some_and(|own| Some(own) == identity(other))
    }

    fn not_written(&self, form: &str, found: String) -> Error {
        let expected =
            format!("a definition that can be said in {form}; as it came it says `{}`", self.excerpt());
        Error::invalid(format!("coordinate system {self}"), found, expected)
    }

    /// Enough of the definition to know it.
    fn excerpt(&self) -> String {
        let definition = self.definition();
        let short: String =
            definition.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(200).collect();
        if short.len() < definition.len() { format!("{short}...") } else { short }
    }
}
