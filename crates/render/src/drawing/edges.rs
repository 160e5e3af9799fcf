//! Triangles of an exact model's faces, and which of their sides are edges.

use std::collections::{BTreeSet, HashMap};

use spinney_base::{Error, Progress, Result};
use spinney_brep::exact::normal::triangle_normal;
use spinney_brep::{ChosenParts, ExactModel, Faces, each_triangle};

/// Maximum number of triangles of a drawing: fragments of one triangle in a BSP tree take about 2
/// KB.
const MAX_TRIANGLES: usize = 1 << 17;

/// Triangles between checks for cancellation.
const OFTEN: usize = 1 << 12;

/// Triangles of a model.
pub(super) struct Triangles {
    pub(super) corners: Vec<[[i32; 3]; 3]>,
    /// Zeros for triangles without area.
    normals: Vec<[i64; 3]>,
    sources: Vec<u64>,
    /// Triangle of each directed side; `None` if several triangles have the side.
    of_side: HashMap<[[i32; 3]; 2], Option<u32>>,
    /// Whether off-grid vertices are rounded to the grid.
    is_rounded: bool,
}

impl Triangles {
    /// Reads the triangles of a model, or of some of its parts.
    ///
    /// # Errors
    /// If there are more than [`MAX_TRIANGLES`], the file is corrupt, or on cancellation.
    pub(super) fn of(
        model: &ExactModel,
        parts: Option<&BTreeSet<u32>>,
        progress: &dyn Progress,
    ) -> Result<Triangles> {
        let too_many = |count: u64| {
            let found = format!("a drawing of {count} faces or more (at most {MAX_TRIANGLES} triangles)");
            let advice = "render a shaded image without --drawing, or draw blocks of the octree with --drawing octants";
            Error::unsupported(model.path(), found, advice)
        };
        let chosen = parts.map(|parts| ChosenParts::of(model, parts)).transpose()?;
        let faces: &dyn Faces = chosen.as_ref().map_or(model, |chosen| chosen);
        if faces.len() > MAX_TRIANGLES as u64 {
            return Err(too_many(faces.len()));
        }
        let mut found = Triangles {
            corners: Vec::new(),
            normals: Vec::new(),
            sources: Vec::new(),
            of_side: HashMap::new(),
            is_rounded: model.exact_faces().0 > 0,
        };
        each_triangle(faces, &mut |face| {
            let &[a, b, c] = face.points else { return Ok(()) };
            let number = found.corners.len();
            if number == MAX_TRIANGLES {
                return Err(too_many(number as u64));
            }
            if number.is_multiple_of(OFTEN) {
                progress.check()?;
            }
            let corners = [a, b, c];
            for side in [[a, b], [b, c], [c, a]] {
                found
                    .of_side
                    .entry(side)
                    .and_modify(|triangle| *triangle = None)
                    .or_insert(Some(number as u32));
            }
            found.corners.push(corners);
            found.normals.push(triangle_normal(&corners));
            found.sources.push(face.source);
            Ok(())
        })?;
        Ok(found)
    }

    /// Whether each side of a triangle is an edge: the surface bends or ends there, or meets
    /// another one.
    pub(super) fn edges(&self, triangle: usize) -> [bool; 3] {
        let has_area = self.normals[triangle] != [0; 3];
        [0, 1, 2].map(|side| has_area && !self.is_smooth(triangle, side))
    }

    /// Triangle across a side; `None` if there is none, or more than one.
    pub(super) fn triangle_across(&self, triangle: usize, side: usize) -> Option<usize> {
        let corners = &self.corners[triangle];
        let (from, to) = (corners[side], corners[(side + 1) % 3]);
        self.of_side.get(&[from, to]).copied().flatten()?;
        self.of_side.get(&[to, from]).copied().flatten().map(|other| other as usize)
    }

    /// Whether the surface continues in the same plane across a side.
    fn is_smooth(&self, triangle: usize, side: usize) -> bool {
        match self.triangle_across(triangle, side) {
            None => false,
            Some(other) if self.normals[other] != [0; 3] => self.are_in_plane(triangle, other),
            // A triangle without area joins sides that coincide.
            Some(joint) => (0..3).all(|side| match self.triangle_across(joint, side) {
                Some(other) => {
                    other == triangle || (self.normals[other] != [0; 3] && self.are_in_plane(triangle, other))
                }
                None => false,
            }),
        }
    }

    /// Whether two triangles lie in one plane and face the same way. (Triangles of one source may
    /// be proxies for faces with off-grid vertices. They differ from the plane by at most one grid
    /// unit.)
    fn are_in_plane(&self, one: usize, other: usize) -> bool {
        let [a, b] = [one, other].map(|triangle| self.normals[triangle].map(i128::from));
        let along: i128 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        let is_parallel = (0..3).all(|axis| {
            let [j, k] = [(axis + 1) % 3, (axis + 2) % 3];
            a[j] * b[k] == a[k] * b[j]
        });
        if along <= 0 || is_parallel {
            return along > 0;
        }
        if !self.is_rounded || self.sources[one] != self.sources[other] {
            return false;
        }
        let length = a.iter().map(|part| (*part as f64).powi(2)).sum::<f64>().sqrt();
        let origin = self.corners[one][0];
        self.corners[other].iter().all(|corner| {
            let height: i128 =
                (0..3).map(|axis| a[axis] * (i128::from(corner[axis]) - i128::from(origin[axis]))).sum();
            (height as f64).abs() <= length
        })
    }
}
