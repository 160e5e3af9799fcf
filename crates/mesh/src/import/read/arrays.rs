//! In-memory meshes: arrays of vertices and faces.

use std::path::Path;

use super::corners::{Corners, MAX_CORNERS};
use super::vertices::VertexBounds;
use super::{MeshFace, Model, ModelInfo};
use spinney_base::{Error, Result};
use spinney_brep::Attributes;
use spinney_brep::attributes::{ObjectText, each_member};

/// Mesh in memory. Empty arrays are absent.
///
/// ```
/// use spinney::import::mesh::{ExactOptions, import_exact};
/// use spinney::raw::import::mesh::MeshArrays;
/// use spinney::Output;
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("wedge.goblin");
/// let mut mesh = MeshArrays::default();
/// mesh.name = "wedge".into();
/// mesh.vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// mesh.corners = vec![0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
/// let report = import_exact(vec![mesh.model()?], &ExactOptions::new(), Output::create(&path)?, &())?;
/// assert_eq!(report.faces, 4);
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct MeshArrays {
    /// Name of the mesh, used in errors and in the provenance. Without `parts`, it is also the name
    /// of the only part.
    pub name: String,
    /// Coordinates of the vertices.
    pub vertices: Vec<[f64; 3]>,
    /// Vertex indices of the corners of all rings, concatenated: counterclockwise seen from
    /// outside, holes clockwise.
    pub corners: Vec<u32>,
    /// End of each ring in `corners`; empty if all are triangles.
    pub ring_ends: Vec<usize>,
    /// End of each face in the list of rings. A face's first ring is its outer ring. Empty if each
    /// ring is a face.
    pub face_ends: Vec<usize>,
    /// Colours.
    pub colours: MeshColours,
    /// Part number of each face; empty if all faces belong to part 0.
    pub face_parts: Vec<u32>,
    /// Names of the parts, which are groups of faces of one object. Use several meshes for several
    /// objects.
    pub parts: Vec<String>,
    /// Attributes of the parts, or of the first parts: JSON objects, as in [`Attributes`].
    pub attributes: Vec<Option<String>>,
}

/// Colours of a mesh in memory: red, green, blue.
#[derive(Clone, Debug, Default)]
pub enum MeshColours {
    /// No colours.
    #[default]
    None,
    /// One colour per vertex.
    OfVertices(Vec<[u8; 3]>),
    /// One colour per face.
    OfFaces(Vec<[u8; 3]>),
    /// One colour per entry of `corners`.
    OfCorners(Vec<[u8; 3]>),
}

impl MeshColours {
    fn colours(&self) -> Option<&[[u8; 3]]> {
        match self {
            MeshColours::None => None,
            MeshColours::OfVertices(all) | MeshColours::OfFaces(all) | MeshColours::OfCorners(all) => {
                Some(all)
            }
        }
    }
}

impl MeshArrays {
    /// Returns the mesh as a model for import.
    ///
    /// # Errors
    /// If vertex indices, part numbers or ends are out of range; if coordinates are not finite; if
    /// the number of colours or parts does not match the vertices or faces; if a face has more than
    /// 2^20 corners; or if attributes are not JSON objects.
    pub fn model(mut self) -> Result<Box<dyn Model>> {
        let bounds = self.check_vertices()?;
        self.check_rings()?;
        self.check_colours()?;
        if self.parts.is_empty() {
            self.parts = vec![self.name.clone()];
        }
        self.check_parts()?;
        let path = Path::new(&self.name);
        let mut attributes = Attributes::within(u64::MAX);
        for (part, text) in (0..).zip(&self.attributes) {
            if let Some(text) = text {
                attributes.push_part(path, part, compact(part, text)?)?;
            }
        }
        let info = ModelInfo {
            path: path.to_path_buf(),
            format: "arrays".into(),
            faces: Some(self.faces() as u64),
            bounds,
            crs: None,
            unit: None,
            step: None,
            parts: self.parts.clone(),
            is_grouped: self.parts.len() > 1,
            is_z_up: false,
            attributes,
            is_coloured: self.colours.colours().is_some(),
            bytes: (self.vertices.len() * 24 + self.corners.len() * 4) as u64,
        };
        Ok(Box::new(Arrays { mesh: self, info, degenerate: 0 }))
    }

    /// Number of faces.
    fn faces(&self) -> usize {
        match (&self.ring_ends[..], &self.face_ends[..]) {
            ([], _) => self.corners.len() / 3,
            (rings, []) => rings.len(),
            (_, faces) => faces.len(),
        }
    }

    /// Start and end of a ring in `corners`.
    fn ring(&self, ring: usize) -> (usize, usize) {
        match ring.checked_sub(1) {
            _ if self.ring_ends.is_empty() => (3 * ring, 3 * ring + 3),
            None => (0, self.ring_ends[0]),
            Some(before) => (self.ring_ends[before], self.ring_ends[ring]),
        }
    }

    /// First and end ring of a face.
    fn rings(&self, face: usize) -> (usize, usize) {
        match face.checked_sub(1) {
            _ if self.face_ends.is_empty() => (face, face + 1),
            None => (0, self.face_ends[0]),
            Some(before) => (self.face_ends[before], self.face_ends[face]),
        }
    }

    fn check_vertices(&self) -> Result<[[f64; 3]; 2]> {
        let mut bounds = VertexBounds::new();
        for (number, point) in self.vertices.iter().enumerate() {
            if !point.iter().all(|coordinate| coordinate.is_finite()) {
                let found = format!("vertex {number} at {point:?}");
                return Err(Error::invalid("vertices", found, "finite coordinates"));
            }
            bounds.add(*point);
        }
        bounds.get().ok_or_else(|| Error::invalid("vertices", "none", "one or more"))
    }

    fn check_rings(&self) -> Result<()> {
        let count = self.vertices.len();
        if let Some(corner) = self.corners.iter().find(|corner| **corner as usize >= count) {
            let expected = format!("vertex indices, 0 to {}", count - 1);
            return Err(Error::invalid("corners", corner.to_string(), expected));
        }
        if self.ring_ends.is_empty() {
            if !self.face_ends.is_empty() {
                return Err(Error::invalid(
                    "face_ends",
                    "ends of faces without ends of rings",
                    "both or none",
                ));
            }
            if !self.corners.len().is_multiple_of(3) {
                return Err(Error::invalid(
                    "corners",
                    self.corners.len().to_string(),
                    "a multiple of three: triangles",
                ));
            }
            return Ok(());
        }
        check_ends("ring_ends", &self.ring_ends, self.corners.len())?;
        if !self.face_ends.is_empty() {
            check_ends("face_ends", &self.face_ends, self.ring_ends.len())?;
        }
        for face in 0..self.faces() {
            let (first, end) = self.rings(face);
            let corners = self.ring(end - 1).1 - self.ring(first).0;
            if corners > MAX_CORNERS {
                let found = format!("face {face} of {corners} corners");
                return Err(Error::invalid("faces", found, format!("at most {MAX_CORNERS}")));
            }
        }
        Ok(())
    }

    fn check_colours(&self) -> Result<()> {
        let (expected, of) = match &self.colours {
            MeshColours::None => return Ok(()),
            MeshColours::OfVertices(_) => (self.vertices.len(), "vertices"),
            MeshColours::OfFaces(_) => (self.faces(), "faces"),
            MeshColours::OfCorners(_) => (self.corners.len(), "corners"),
        };
        check_count("colours", self.colours.colours().map_or(0, <[_]>::len), expected, of)
    }

    fn check_parts(&self) -> Result<()> {
        if self.attributes.len() > self.parts.len() {
            let expected = format!("at most one per part, {}", self.parts.len());
            return Err(Error::invalid("attributes", self.attributes.len().to_string(), expected));
        }
        if self.face_parts.is_empty() {
            return Ok(());
        }
        check_count("parts", self.face_parts.len(), self.faces(), "faces")?;
        match self.face_parts.iter().find(|part| **part as usize >= self.parts.len()) {
            None => Ok(()),
            Some(part) => {
                let expected = format!("indices of named parts, 0 to {}", self.parts.len() - 1);
                Err(Error::invalid("parts", part.to_string(), expected))
            }
        }
    }
}

/// Fails unless `ends` ascends strictly up to `total`.
fn check_ends(name: &str, ends: &[usize], total: usize) -> Result<()> {
    let is_ascending = ends[0] > 0 && ends.windows(2).all(|pair| pair[0] < pair[1]);
    if is_ascending && ends.last() == Some(&total) {
        return Ok(());
    }
    let found = match is_ascending {
        true => format!("{} as the last one", ends[ends.len() - 1]),
        false => "ends that do not ascend strictly from at least 1".into(),
    };
    Err(Error::invalid(name, found, format!("ascending ends, the last of them {total}")))
}

/// Fails if an array does not have one entry per element.
fn check_count(name: &str, found: usize, expected: usize, of: &str) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    Err(Error::invalid(name, found.to_string(), format!("one for each of {expected} {of}")))
}

/// Attributes of a part without whitespace between tokens.
fn compact(part: u32, json: &str) -> Result<String> {
    let mut text = ObjectText::default();
    each_member(json, |key, value| text.push(key, value))
        .map_err(|error| Error::invalid("attributes", format!("{error} in part {part}"), "a JSON object"))?;
    Ok(text.to_string())
}

struct Arrays {
    mesh: MeshArrays,
    info: ModelInfo,
    degenerate: u64,
}

impl Model for Arrays {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let mesh = &self.mesh;
        let mut corners = Corners::default();
        for face in 0..mesh.faces() {
            corners.clear();
            let (first, end) = mesh.rings(face);
            for ring in first..end {
                let (start, end) = mesh.ring(ring);
                for (index, vertex) in (start..end).zip(&mesh.corners[start..end]) {
                    corners.push(mesh.vertices[*vertex as usize]);
                    match &mesh.colours {
                        MeshColours::None => {}
                        MeshColours::OfVertices(colours) => corners.push_colour(colours[*vertex as usize]),
                        MeshColours::OfFaces(colours) => corners.push_colour(colours[face]),
                        MeshColours::OfCorners(colours) => corners.push_colour(colours[index]),
                    }
                }
                corners.end_ring();
            }
            corners.hand_out(mesh.face_parts.get(face).copied().unwrap_or(0), each)?;
        }
        self.degenerate = corners.degenerate;
        Ok(())
    }

    fn degenerate(&self) -> u64 {
        self.degenerate
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on the number line, ring ends, colours and part of each visited face.
    type Found = Vec<(Vec<f64>, Vec<usize>, Vec<u8>, u32)>;

    fn handed_out(mesh: MeshArrays) -> Result<Found> {
        let mut model = mesh.model()?;
        let mut found = Vec::new();
        model.faces(&mut |face| {
            let points = face.points.iter().map(|point| point[0]).collect();
            let colours = face.colours.iter().map(|colour| colour[0]).collect();
            found.push((points, face.ring_ends.to_vec(), colours, face.part));
            Ok(())
        })?;
        Ok(found)
    }

    fn line(count: u8) -> MeshArrays {
        let vertices = (0..count).map(|at| [f64::from(at), 0.0, 0.0]).collect();
        MeshArrays { name: "line".into(), vertices, ..MeshArrays::default() }
    }

    #[test]
    fn triangles_and_polygons_with_holes_are_handed_out() {
        let mut mesh = line(7);
        mesh.corners = vec![0, 1, 2, 3, 4, 5, 6, 6, 1];
        let colours = (10..17).map(|red| [red; 3]).collect();
        mesh.colours = MeshColours::OfVertices(colours);
        let found = handed_out(mesh.clone()).unwrap();
        assert_eq!(found.len(), 2, "the last one covers nothing");
        assert_eq!(found[1], (vec![3.0, 4.0, 5.0], vec![3], vec![13, 14, 15], 0));
        mesh.ring_ends = vec![3, 6, 9];
        assert_eq!(handed_out(mesh.clone()).unwrap(), found);
        mesh.corners = vec![0, 1, 2, 3, 4, 5, 6, 1, 3, 5];
        (mesh.ring_ends, mesh.face_ends) = (vec![4, 7, 10], vec![2, 3]);
        (mesh.parts, mesh.face_parts) = (vec!["a".into(), "b".into()], vec![1, 0]);
        mesh.colours = MeshColours::OfFaces(vec![[7; 3], [8; 3]]);
        let expected = [
            (vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], vec![4, 7], vec![7; 7], 1),
            (vec![1.0, 3.0, 5.0], vec![3], vec![8; 3], 0),
        ];
        assert_eq!(handed_out(mesh.clone()).unwrap(), expected);
        mesh.colours = MeshColours::OfCorners((0..10).map(|red| [red; 3]).collect());
        assert_eq!(handed_out(mesh).unwrap()[1].2, vec![7, 8, 9]);
    }

    #[test]
    fn names_and_attributes_are_reported() {
        let mut mesh = line(3);
        mesh.corners = vec![0, 1, 2];
        let model = mesh.clone().model().unwrap();
        assert_eq!((&model.info().parts[..], model.info().is_grouped), (&["line".to_owned()][..], false));
        assert_eq!(model.info().bounds, [[0.0; 3], [2.0, 0.0, 0.0]]);
        mesh.parts = vec!["a".into(), "b".into()];
        mesh.attributes = vec![None, Some("{ \"attributes\": {\"height\": 5} }".into())];
        let model = mesh.model().unwrap();
        assert!(model.info().is_grouped);
        assert_eq!(model.info().attributes.part(1), Some("{\"attributes\":{\"height\":5}}"));
    }

    #[test]
    fn invalid_meshes_are_refused() {
        let triangle = || MeshArrays { corners: vec![0, 1, 2], ..line(3) };
        assert!(handed_out(triangle()).is_ok());
        let refused = |change: fn(&mut MeshArrays), expected: &str| {
            let mut mesh = triangle();
            change(&mut mesh);
            let message = handed_out(mesh).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        refused(|mesh| mesh.vertices.clear(), "vertices: got none");
        refused(|mesh| mesh.vertices[1][2] = f64::NAN, "vertex 1 at [1.0, 0.0, NaN], expected finite");
        refused(|mesh| mesh.corners[2] = 3, "corners: got 3, expected vertex indices, 0 to 2");
        refused(|mesh| mesh.corners.push(0), "corners: got 4, expected a multiple of three: triangles");
        refused(
            |mesh| mesh.ring_ends = vec![2],
            "2 as the last one, expected ascending ends, the last of them 3",
        );
        refused(|mesh| mesh.ring_ends = vec![3, 3], "ring_ends: got ends that do not ascend");
        refused(|mesh| mesh.ring_ends = vec![0, 3], "ring_ends: got ends that do not ascend");
        refused(|mesh| mesh.ring_ends = vec![usize::MAX], "ascending ends");
        refused(|mesh| mesh.face_ends = vec![1], "face_ends: got ends of faces without ends of rings");
        refused(
            |mesh| (mesh.ring_ends, mesh.face_ends) = (vec![3], vec![2]),
            "face_ends: got 2 as the last one, expected ascending ends, the last of them 1",
        );
        refused(
            |mesh| mesh.colours = MeshColours::OfFaces(vec![]),
            "got 0, expected one for each of 1 faces",
        );
        refused(|mesh| mesh.colours = MeshColours::OfVertices(vec![[0; 3]; 4]), "each of 3 vertices");
        refused(|mesh| mesh.colours = MeshColours::OfCorners(vec![[0; 3]; 4]), "each of 3 corners");
        refused(|mesh| mesh.face_parts = vec![0, 0], "parts: got 2, expected one for each of 1 faces");
        refused(|mesh| mesh.face_parts = vec![1], "parts: got 1, expected indices of named parts, 0 to 0");
        refused(
            |mesh| mesh.attributes = vec![None, None],
            "attributes: got 2, expected at most one per part, 1",
        );
        refused(|mesh| mesh.attributes = vec![Some("[]".into())], "in part 0, expected a JSON object");
        let mut large = line(3);
        large.corners = [0, 1, 2].into_iter().cycle().take(MAX_CORNERS + 1).collect();
        large.ring_ends = vec![large.corners.len()];
        assert!(handed_out(large).unwrap_err().to_string().contains("at most 1048576"));
    }
}
