//! Positions of a model in metres: geocentric if its coordinate system is known.

use glam::DVec3;

use super::super::gltf::globe::GlobePosition;
use spinney_base::{Error, Result};
use spinney_brep::{Faces, Grid};
use spinney_container::Unit;

/// Returns the length in metres of the unit of a model's coordinates, by default that of its
/// coordinate system: 1 if it is unknown or an angle.
pub(super) fn metres_of(faces: &dyn Faces) -> f64 {
    let unit = faces.unit().or_else(|| faces.crs()?.unit());
    unit.and_then(Unit::parse).and_then(Unit::metres).unwrap_or(1.0)
}

/// Maps grid points to metres.
pub(super) struct ModelPosition<'a> {
    grid: &'a Grid,
    globe: Option<GlobePosition>,
    metres: f64,
}

impl<'a> ModelPosition<'a> {
    /// Positions are on the globe if the coordinate system can be projected at the model's first
    /// point.
    pub(super) fn of(faces: &'a dyn Faces, first: [i32; 3]) -> ModelPosition<'a> {
        let grid = faces.grid();
        let globe = faces.crs().and_then(GlobePosition::of);
        let globe = globe.filter(|globe| globe.of_world(grid.to_world(first)).is_some());
        ModelPosition { grid, globe, metres: metres_of(faces) }
    }

    pub(super) fn is_on_globe(&self) -> bool {
        self.globe.is_some()
    }

    /// Returns an upper bound of the length in metres of a unit of the model's coordinates.
    pub(super) fn metres(&self) -> f64 {
        self.globe.as_ref().map_or(self.metres, GlobePosition::metres_per_unit)
    }

    /// Returns the position of a grid point.
    ///
    /// # Errors
    /// If the coordinate system does not extend there.
    pub(super) fn at(&self, point: [i32; 3]) -> Result<DVec3> {
        let world = self.grid.to_world(point);
        match &self.globe {
            Some(globe) => globe.of_world(world).ok_or_else(|| {
                let expected = "positions within the area of the coordinate system; set another one with \
                                `spinney transform FILE crs=...`";
                Error::invalid("vertex", format!("{world:?}"), expected)
            }),
            None => Ok(DVec3::from(world) * self.metres),
        }
    }
}
