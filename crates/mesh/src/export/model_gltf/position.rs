//! Positions of a model in metres: geocentric, around a point on the globe, or those of the model.

use std::path::Path;

use glam::DVec3;
use serde_json::{Value as Json, json};

use super::super::gltf::globe::GlobePosition;
use super::super::units::{length, metres_of_unit, units_of_crs};
use spinney_base::{Error, Result};
use spinney_brep::{Faces, Grid};
use spinney_crs::Crs;

/// Maps grid points to metres.
pub(super) struct ModelPosition<'a> {
    grid: &'a Grid,
    /// Units of the coordinate system, or else metres, per unit of the model along each axis.
    scale: DVec3,
    globe: Option<GlobePosition>,
    local: Option<LocalFrame>,
    /// Positions are multiples of this power of two. Relative to the origin of any node or tile,
    /// they are then exact in single precision, so that a vertex has the same position in all.
    unit: f64,
}

/// Maximum unit of positions in metres. Nodes and tiles of up to 8 km are then exact.
const MAX_UNIT: f64 = 1.0 / 2048.0;

/// Coordinates to the east, to the north and up from a point on the globe.
struct LocalFrame {
    /// The point in the coordinate system.
    world: [f64; 3],
    /// The point in geocentric coordinates.
    origin: DVec3,
    axes: [DVec3; 3],
}

impl<'a> ModelPosition<'a> {
    /// Positions of tiles: on the globe if the coordinate system can be projected at `point` of the
    /// model, otherwise those of the model.
    ///
    /// # Errors
    /// If coordinates are angles, and their system cannot be projected. `path` is for the error.
    pub(super) fn on_globe(faces: &'a dyn Faces, point: [f64; 3], path: &Path) -> Result<ModelPosition<'a>> {
        let Some(crs) = faces.crs() else { return Ok(ModelPosition::in_metres(faces)) };
        let scale = match crs.is_geographic() {
            // (The model's unit is that of heights.)
            true => DVec3::new(1.0, 1.0, length(faces.unit()).unwrap_or(1.0)),
            false => DVec3::splat(units_of_crs(faces.unit(), crs)),
        };
        let position = ModelPosition::new(faces, scale, GlobePosition::of(crs));
        match &position.globe {
            Some(globe) if globe.of_world(position.scaled(point)).is_some() => Ok(position),
            _ if crs.is_geographic() => {
                let found = format!("a model in degrees of {crs}, whose positions on the globe are unknown,");
                let advice = "treat its coordinates as WGS 84, which may be off by some hundred metres, with \
                              `spinney transform FILE crs=EPSG:4326 -o OUTPUT`, or build it in metres";
                Err(Error::unsupported(path, found, advice))
            }
            _ => Ok(ModelPosition::in_metres(faces)),
        }
    }

    /// Positions of a scene: those of the model. If they are angles, metres to the east, to the
    /// north and up from its centre instead.
    ///
    /// # Errors
    /// Those of [`ModelPosition::on_globe`], or if faces cannot be read.
    pub(super) fn in_scene(faces: &'a dyn Faces, path: &Path) -> Result<ModelPosition<'a>> {
        if !faces.crs().is_some_and(Crs::is_geographic) {
            return Ok(ModelPosition::in_metres(faces));
        }
        let centre = centre(faces)?;
        let mut position = ModelPosition::on_globe(faces, centre, path)?;
        let world = position.scaled(centre);
        position.local = position.globe.as_ref().and_then(|globe| {
            Some(LocalFrame { world, origin: globe.of_world(world)?, axes: globe.directions(world)? })
        });
        Ok(position)
    }

    fn in_metres(faces: &'a dyn Faces) -> ModelPosition<'a> {
        ModelPosition::new(faces, DVec3::splat(metres_of_unit(faces.unit(), faces.crs())), None)
    }

    fn new(faces: &'a dyn Faces, scale: DVec3, globe: Option<GlobePosition>) -> ModelPosition<'a> {
        let grid = faces.grid();
        let mut position = ModelPosition { grid, scale, globe, local: None, unit: MAX_UNIT };
        let extent = f64::from(grid.bits).exp2() * grid.width() * position.metres();
        // (Numbers in single precision have 24 bits.)
        position.unit = (extent.log2().ceil() - 24.0).exp2().min(MAX_UNIT);
        position
    }

    pub(super) fn is_on_globe(&self) -> bool {
        self.globe.is_some()
    }

    /// Returns what is known of the positions of a scene that are not those of the model.
    pub(super) fn about_scene(&self, faces: &dyn Faces) -> Option<Json> {
        let (local, crs) = (self.local.as_ref()?, faces.crs()?);
        let note = "positions are metres to the east, to the north and up from `origin`";
        Some(json!({ "crs": crs.definition(), "origin": local.world, "note": note }))
    }

    /// Returns an upper bound of the length in metres of a unit of the model's coordinates.
    pub(super) fn metres(&self) -> f64 {
        self.scale.max_element() * self.globe.as_ref().map_or(1.0, GlobePosition::metres_per_unit)
    }

    /// Returns the position of a grid point.
    ///
    /// # Errors
    /// If the coordinate system does not extend there.
    pub(super) fn at(&self, point: [i32; 3]) -> Result<DVec3> {
        let world = self.scaled(self.grid.to_world(point));
        let round = |position: DVec3| (position / self.unit).round() * self.unit;
        let Some(globe) = &self.globe else { return Ok(round(world.into())) };
        let found = globe.of_world(world).ok_or_else(|| {
            let expected = "positions within the area of the coordinate system; set another one with \
                            `spinney transform FILE crs=...`";
            Error::invalid("vertex", format!("{world:?}"), expected)
        })?;
        Ok(round(match &self.local {
            Some(LocalFrame { origin, axes, .. }) => axes.map(|axis| axis.dot(found - origin)).into(),
            None => found,
        }))
    }

    /// Returns a point of the model in the coordinate system, or else in metres.
    fn scaled(&self, point: [f64; 3]) -> [f64; 3] {
        (DVec3::from(point) * self.scale).into()
    }
}

/// Returns the centre of the bounding box.
fn centre(faces: &dyn Faces) -> Result<[f64; 3]> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    faces.each(&mut |face| {
        for point in face.points {
            let point = DVec3::from(faces.grid().to_world(*point));
            (low, high) = (low.min(point), high.max(point));
        }
        Ok(())
    })?;
    let centre = if faces.is_empty() { DVec3::ZERO } else { low.midpoint(high) };
    Ok(centre.into())
}
