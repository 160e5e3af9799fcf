//! Faces on a model's grid, and sources of faces.

use super::{ExactPlane, Grid};
use crate::exact::normal::{newell, ring_normal};
use crate::exact::vector::{cross, dot};
use crate::query::MassSums;
use spinney_base::{Progress, Result};
use spinney_crs::Crs;

/// A planar face with its holes, in grid coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face<'a> {
    /// Number of the face in its model, from 0.
    pub number: u64,
    /// Vertices of all rings, the outer ring first. The first vertex of a ring is not repeated at
    /// its end. Rings are counterclockwise seen from outside the solid, holes clockwise.
    /// Coordinates are 0 to 2^26 - 1.
    pub points: &'a [[i32; 3]],
    /// End of each ring in `points`; one entry for a face without holes.
    pub ring_ends: &'a [usize],
    /// A colour per vertex: red, green, blue. Empty if the model has no colours.
    pub colours: &'a [[u8; 3]],
    /// The face's part: an index into [`Faces::parts`].
    pub part: u32,
    /// Number that the fragments of a split face have in common. Of a model that was built from
    /// meshes, the number of the first fragment.
    pub source: u64,
}

impl<'a> Face<'a> {
    /// Returns the rings, the outer one first.
    pub fn rings(&self) -> impl Iterator<Item = &'a [[i32; 3]]> + use<'a> {
        let (points, ends) = (self.points, self.ring_ends);
        (0..ends.len()).map(move |ring| &points[if ring == 0 { 0 } else { ends[ring - 1] }..ends[ring]])
    }
}

impl Face<'_> {
    /// Returns the sum of the rings' area vectors: the normal, whose length is twice the area.
    pub fn area_vector(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for ring in self.rings() {
            let own = newell(ring);
            (0..3).for_each(|axis| sum[axis] += own[axis] as f64);
        }
        sum
    }

    /// Returns the area, in square grid units.
    pub fn area(&self) -> f64 {
        self.area_vector().map(|part| part * part).iter().sum::<f64>().sqrt() / 2.0
    }

    /// Returns whether the face has an area.
    pub fn has_area(&self) -> bool {
        self.plane().is_some()
    }

    /// Returns the plane of the face, whose front is outside; `None` if the face has no area.
    pub fn plane(&self) -> Option<ExactPlane> {
        let ring = self.rings().next()?;
        let normal = ring_normal(ring);
        (normal != [0; 3]).then(|| ExactPlane::through(ring[0], normal))
    }

    /// Returns six times the signed volume between the face and the grid's first point, in cubed
    /// grid units. Over a closed surface, these sum to six times its volume.
    // Invariant: no sum overflows. Coordinates are below 2^26, so a product of three is below 2^81.
    // A face has less than 2^32 vertices, a model has 2^32 faces, and the sum over all faces that
    // fit into a file is below 2^127.
    pub fn six_volumes(&self) -> i128 {
        let of_ring = |ring: &[[i32; 3]]| -> i128 {
            let wide = |point: [i32; 3]| point.map(i128::from);
            let Some((first, rest)) = ring.split_first() else { return 0 };
            rest.windows(2).map(|pair| dot(wide(*first), cross(wide(pair[0]), wide(pair[1])))).sum()
        };
        self.rings().map(of_ring).sum()
    }
}

/// Faces of a model, which can be read repeatedly.
pub trait Faces {
    /// Returns the grid of the coordinates.
    fn grid(&self) -> &Grid;

    /// Returns the names of the parts (objects, groups, materials); never empty.
    fn parts(&self) -> &[String];

    /// Returns the faces whose parts and metadata these faces have, if these are selected from
    /// others, or represent them.
    fn origin(&self) -> Option<&dyn Faces> {
        None
    }

    /// Returns the attributes of a part: a JSON object, as in [`Attributes`](crate::Attributes).
    ///
    /// # Errors
    /// If they cannot be read.
    fn part_attributes(&self, part: u32) -> Result<Option<String>> {
        self.origin().map_or(Ok(None), |origin| origin.part_attributes(part))
    }

    /// Returns the number of parts with attributes.
    ///
    /// # Errors
    /// If the attributes cannot be read.
    fn parts_with_attributes(&self) -> Result<u64> {
        self.origin().map_or(Ok(0), |origin| origin.parts_with_attributes())
    }

    /// Returns the metadata of the source files that have any: JSON objects.
    ///
    /// # Errors
    /// If it cannot be read.
    fn file_attributes(&self) -> Result<Vec<String>> {
        self.origin().map_or(Ok(Vec::new()), |origin| origin.file_attributes())
    }

    /// Returns the names of the columns of face values.
    ///
    /// # Errors
    /// If they cannot be read.
    fn value_columns(&self) -> Result<Vec<String>> {
        Ok(Vec::new())
    }

    /// Returns the coordinate reference system of the world, if known.
    fn crs(&self) -> Option<&Crs> {
        self.origin()?.crs()
    }

    /// Returns the unit of length of the world, if known: "mm".
    fn unit(&self) -> Option<&str> {
        self.origin()?.unit()
    }

    /// Returns whether the body extends to infinity; its faces then bound the cavities.
    fn is_unbounded(&self) -> bool {
        self.origin().is_some_and(|origin| origin.is_unbounded())
    }

    /// Returns the volume of the body minus that of the faces, in cubed grid units. It is nonzero
    /// if the model has off-grid vertices, whose faces are represented by proxies.
    ///
    /// # Errors
    /// If the exact faces cannot be read.
    fn volume_correction(&self) -> Result<f64> {
        Ok(0.0)
    }

    /// Returns the sums over all faces, from which measures are computed, if they include off-grid
    /// vertices or can be computed without visiting all faces; `None` otherwise.
    ///
    /// # Errors
    /// If the faces or sums cannot be read, or on cancellation.
    fn mass_sums(&self, _progress: &dyn Progress) -> Result<Option<MassSums>> {
        Ok(None)
    }

    /// Returns the number of faces.
    fn len(&self) -> u64;

    /// Returns whether there are no faces.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Visits all faces in the order of their numbers.
    ///
    /// # Errors
    /// If the faces cannot be read, or what `each` returns.
    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()>;

    /// Visits all faces as [`Faces::each`] does, each with its values of some columns as JSON.
    ///
    /// # Errors
    /// If the faces or values cannot be read, or what `each` returns.
    fn each_with_values(&self, columns: &[&str], each: &mut AttributedFaceVisitor<'_>) -> Result<()> {
        let none = vec![None; columns.len()];
        self.each(&mut |face| each(face, &none))
    }
}

/// Receives a face with its values of some columns.
pub type AttributedFaceVisitor<'a> = dyn FnMut(&Face<'_>, &[Option<String>]) -> Result<()> + 'a;

/// Faces in memory.
#[derive(Clone, Debug)]
pub struct FaceList {
    grid: Grid,
    parts: Vec<String>,
    points: Vec<[i32; 3]>,
    colours: Vec<[u8; 3]>,
    ring_ends: Vec<usize>,
    /// For each face: end of its rings and end of its vertices in the lists, part and source.
    faces: Vec<(usize, usize, u32, u64)>,
}

impl FaceList {
    /// Creates an empty list.
    pub fn new(grid: Grid, parts: Vec<String>) -> FaceList {
        FaceList {
            grid,
            parts,
            points: Vec::new(),
            colours: Vec::new(),
            ring_ends: Vec::new(),
            faces: Vec::new(),
        }
    }

    /// Reads all faces of a model into memory.
    ///
    /// # Errors
    /// If the faces cannot be read.
    pub fn of(faces: &dyn Faces) -> Result<FaceList> {
        let mut list = FaceList::new(faces.grid().clone(), faces.parts().to_vec());
        faces.each(&mut |face| {
            list.push(face);
            Ok(())
        })?;
        Ok(list)
    }

    /// Appends a face. Its number becomes its index in the list. Either all faces have colours, or
    /// none.
    pub fn push(&mut self, face: &Face<'_>) {
        self.points.extend_from_slice(face.points);
        self.colours.extend_from_slice(face.colours);
        self.ring_ends.extend_from_slice(face.ring_ends);
        self.faces.push((self.ring_ends.len(), self.points.len(), face.part, face.source));
    }

    /// Returns whether faces have colours.
    pub fn is_coloured(&self) -> bool {
        !self.colours.is_empty()
    }

    /// Returns the bytes of memory that the faces take.
    pub fn bytes(&self) -> u64 {
        let FaceList { points, colours, ring_ends, faces, .. } = self;
        (size_of_val(&points[..])
            + size_of_val(&colours[..])
            + size_of_val(&ring_ends[..])
            + size_of_val(&faces[..])) as u64
    }

    /// Returns the face at an index below the length.
    pub fn get(&self, number: usize) -> Face<'_> {
        let (rings, points, part, source) = self.faces[number];
        let (first_ring, first_point) = match number {
            0 => (0, 0),
            _ => (self.faces[number - 1].0, self.faces[number - 1].1),
        };
        let colours = if self.colours.is_empty() { &[] } else { &self.colours[first_point..points] };
        Face {
            number: number as u64,
            points: &self.points[first_point..points],
            ring_ends: &self.ring_ends[first_ring..rings],
            colours,
            part,
            source,
        }
    }
}

impl Faces for FaceList {
    fn grid(&self) -> &Grid {
        &self.grid
    }

    fn parts(&self) -> &[String] {
        &self.parts
    }

    fn len(&self) -> u64 {
        self.faces.len() as u64
    }

    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        (0..self.faces.len()).try_for_each(|number| each(&self.get(number)))
    }
}
