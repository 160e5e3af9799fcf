//! Coarse surfaces of exact models: triangles sorted into the image's tiles, so that a ray is
//! tested against those of its tile only.

use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec3};

use super::scene::{Surface, SurfacePoint};
use crate::camera::Camera;
use crate::paint::linear;
use spinney_base::{Progress, Result};
use spinney_brep::query::ModelSurface;
use spinney_brep::{Faces as _, each_triangle};

/// Pixels along a tile's sides.
const TILE: usize = 4;
/// Maximum number of triangles in memory; a triangle takes about 110 bytes.
pub(super) const MAX_TRIANGLES: u64 = 3 << 19;
/// Maximum number of entries of all tiles' lists: 64 MB.
const MAX_ENTRIES: usize = 1 << 24;
/// Cosine of the angle between faces up to which their common edge is drawn smooth.
const SMOOTH: f32 = 0.82;
/// Triangles between checks for cancellation.
const CHECKED: usize = 1 << 12;

/// Triangles that face the camera, by the image's tiles.
pub(super) struct CoarseSurface {
    /// For each vertex, its position in the image, in pixels, and the factor that interpolates
    /// linearly in the image: the inverse of its distance, or 1 if all rays are parallel.
    vertices: Vec<(DVec2, f64)>,
    /// For each vertex, its distance from the camera.
    depths: Vec<f64>,
    triangles: Vec<Triangle>,
    /// Columns and rows of tiles.
    tiles: [usize; 2],
    /// Triangles of the tiles.
    of_tiles: Lists,
    /// Linear colour of triangles without colours.
    clay: DVec3,
}

struct Triangle {
    vertices: [u32; 3],
    normals: [Vec3; 3],
    colours: Option<[[u8; 3]; 3]>,
}

impl CoarseSurface {
    /// Reads a surface. Returns `None` if its triangles overlap so often in the image that the
    /// tiles' lists do not fit into memory.
    ///
    /// # Errors
    /// If the surface cannot be read, or on cancellation.
    pub(super) fn of(
        surface: &ModelSurface<'_>,
        camera: &Camera,
        [width, height]: [u64; 2],
        clay: DVec3,
        progress: &dyn Progress,
    ) -> Result<Option<CoarseSurface>> {
        let grid = surface.grid();
        let mut numbers: HashMap<[i32; 3], u32> = HashMap::new();
        let (mut points, mut triangles) = (Vec::new(), Vec::new());
        each_triangle(surface, &mut |face| {
            if triangles.len().is_multiple_of(CHECKED) {
                progress.check()?;
            }
            let vertices = [0, 1, 2].map(|corner| {
                *numbers.entry(face.points[corner]).or_insert_with(|| {
                    points.push(DVec3::from(grid.to_world(face.points[corner])));
                    points.len() as u32 - 1
                })
            });
            let colours = face.colours.try_into().ok();
            triangles.push(Triangle { vertices, normals: [Vec3::ZERO; 3], colours });
            Ok(())
        })?;
        drop(numbers);
        smooth(&points, &mut triangles);
        let seen = |point: &DVec3| (DVec2::from(camera.project(*point)), camera.share(*point));
        let vertices: Vec<(DVec2, f64)> = points.iter().map(seen).collect();
        let depths = points.iter().map(|point| camera.depth(*point)).collect();
        // (The surface is closed: triangles that face away are hidden by others.)
        let corners = |triangle: &Triangle| triangle.vertices.map(|vertex| vertices[vertex as usize].0);
        triangles.retain(|triangle| {
            let [a, b, c] = corners(triangle);
            (b - a).perp_dot(c - a) < 0.0
        });
        let tiles = [width, height].map(|pixels| (pixels as usize).div_ceil(TILE));
        let in_tiles = |triangle: usize| tiles_of(corners(&triangles[triangle]), tiles);
        let Some(of_tiles) = Lists::of(tiles[0] * tiles[1], triangles.len(), &in_tiles) else {
            return Ok(None);
        };
        Ok(Some(CoarseSurface { vertices, depths, triangles, tiles, of_tiles, clay }))
    }

    /// Returns the first triangle at an image position, in pixels, with the weights of its corners.
    fn first_at(&self, at: DVec2) -> Option<(&Triangle, DVec3)> {
        let [column, row] = at.to_array().map(|pixels| (pixels.max(0.0) as usize) / TILE);
        let tile = row.min(self.tiles[1] - 1) * self.tiles[0] + column.min(self.tiles[0] - 1);
        let mut found: Option<(f64, &Triangle, DVec3)> = None;
        for number in self.of_tiles.list(tile) {
            let triangle = &self.triangles[*number as usize];
            let corners = triangle.vertices.map(|vertex| self.vertices[vertex as usize]);
            let Some(weights) = weights(corners.map(|corner| corner.0), at) else { continue };
            let weights = weights * DVec3::from(corners.map(|corner| corner.1));
            let weights = weights / weights.element_sum();
            let depth = weights.dot(triangle.vertices.map(|vertex| self.depths[vertex as usize]).into());
            if found.is_none_or(|(nearest, ..)| depth < nearest) {
                found = Some((depth, triangle, weights));
            }
        }
        found.map(|(_, triangle, weights)| (triangle, weights))
    }
}

impl Surface for &CoarseSurface {
    fn first(&mut self, at: [f64; 2], _: DVec3, direction: DVec3) -> Result<Option<SurfacePoint>> {
        let Some((triangle, weights)) = self.first_at(at.into()) else { return Ok(None) };
        let weighted =
            |corners: [DVec3; 3]| (0..3).map(|corner| weights[corner] * corners[corner]).sum::<DVec3>();
        let outwards = weighted(triangle.normals.map(|normal| normal.as_dvec3()));
        let albedo = triangle
            .colours
            .map_or(self.clay, |colours| weighted(colours.map(|colour| DVec3::from(linear(colour)))));
        Ok(Some(SurfacePoint { outwards: outwards.try_normalize().unwrap_or(-direction), albedo, open: 1.0 }))
    }
}

/// Lists of triangles by tile or by vertex.
struct Lists {
    /// End of each list in `entries`.
    ends: Vec<u32>,
    entries: Vec<u32>,
}

impl Lists {
    /// Makes `count` lists. `lists_of` returns the lists that have a triangle. Returns `None` if
    /// there are too many entries.
    fn of<I: Iterator<Item = usize>>(
        count: usize,
        triangles: usize,
        lists_of: &dyn Fn(usize) -> I,
    ) -> Option<Lists> {
        let (mut ends, mut total) = (vec![0u32; count], 0);
        for triangle in 0..triangles {
            for list in lists_of(triangle) {
                ends[list] += 1;
                total += 1;
            }
            if total > MAX_ENTRIES {
                return None;
            }
        }
        // Starts of the lists; they become the ends while the lists are filled.
        let mut start = 0;
        for end in &mut ends {
            (*end, start) = (start, start + *end);
        }
        let mut entries = vec![0; total];
        for triangle in 0..triangles {
            for list in lists_of(triangle) {
                entries[ends[list] as usize] = triangle as u32;
                ends[list] += 1;
            }
        }
        Some(Lists { ends, entries })
    }

    fn list(&self, number: usize) -> &[u32] {
        let start = number.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.entries[start as usize..self.ends[number] as usize]
    }
}

/// Sets the normals of all corners. Around a vertex, faces whose normals differ by a small angle
/// form a smooth surface, so that the facets of a coarse surface are not seen.
fn smooth(points: &[DVec3], triangles: &mut [Triangle]) {
    let area = |triangle: &Triangle| {
        let [a, b, c] = triangle.vertices.map(|vertex| points[vertex as usize]);
        (b - a).cross(c - a)
    };
    let scale = triangles.iter().map(|triangle| area(triangle).length()).fold(f64::MIN_POSITIVE, f64::max);
    let areas: Vec<Vec3> = triangles.iter().map(|triangle| (area(triangle) / scale).as_vec3()).collect();
    let vertices = |triangle: usize| triangles[triangle].vertices.map(|vertex| vertex as usize).into_iter();
    let Some(around) = Lists::of(points.len(), triangles.len(), &vertices) else { return };
    for (number, triangle) in triangles.iter_mut().enumerate() {
        let own = areas[number].normalize_or_zero();
        triangle.normals = triangle.vertices.map(|vertex| {
            let others = around.list(vertex as usize).iter().map(|other| areas[*other as usize]);
            let sum: Vec3 = others.filter(|other| own.dot(*other) >= SMOOTH * other.length()).sum();
            sum.normalize_or(own)
        });
    }
}

/// Returns the numbers of the tiles that a triangle's box meets.
fn tiles_of(corners: [DVec2; 3], tiles: [usize; 2]) -> impl Iterator<Item = usize> {
    let [a, b, c] = corners;
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    // (Casts of floating-point numbers saturate; the end of an empty range is 0.)
    let range = move |axis: usize| {
        let end = (high[axis] / TILE as f64).floor() + 1.0;
        (low[axis] / TILE as f64).max(0.0) as usize..(end.max(0.0) as usize).min(tiles[axis])
    };
    range(1).flat_map(move |row| range(0).map(move |column| row * tiles[0] + column))
}

/// Returns the weights of a triangle's corners at a position, or `None` outside. Triangles with a
/// common edge leave no gap: both decide by the same number.
fn weights(corners: [DVec2; 3], at: DVec2) -> Option<DVec3> {
    let mut found = [0.0; 3];
    for (index, weight) in found.iter_mut().enumerate() {
        let (from, to) = (corners[(index + 1) % 3], corners[(index + 2) % 3]);
        let is_turned = (to.x, to.y) < (from.x, from.y);
        let (low, high) = if is_turned { (to, from) } else { (from, to) };
        let side = (high - low).perp_dot(at - low);
        *weight = if is_turned { side } else { -side };
        if *weight < 0.0 {
            return None;
        }
    }
    Some(found.into()).filter(|weights: &DVec3| weights.element_sum() > 0.0)
}
