//! Faces on a model's grid, and whatever can hand them out.

use super::Grid;
use crate::exact::normal::{newell, ring_normal};
use crate::exact::vector::{cross, dot};
use spinney_base::Result;
use spinney_crs::Crs;

/// A planar face with its holes, in coordinates of the model's grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face<'a> {
    /// Number of the face in its model, from 0.
    pub number: u64,
    /// Corners of all rings, the outer ring's first; a ring does not repeat its first corner at its end.
    /// Counterclockwise seen from outside the solid, holes the other way round. Coordinates are 0 to 2^26 - 1.
    pub points: &'a [[i32; 3]],
    /// End of each ring in `points`; one entry for a face without holes.
    pub ring_ends: &'a [usize],
    /// A colour per corner, red, green, blue; nothing where the model has none.
    pub colours: &'a [[u8; 3]],
    /// Number of the part that it belongs to: an index into [`Faces::parts`].
    pub part: u32,
    /// Number of the face of the file that the model was built from; several faces have the same where one
    /// was cut, and numbers are left out where it had faces that cover nothing.
    pub source: u64,
}

impl<'a> Face<'a> {
    /// The rings, the outer one first.
    pub fn rings(&self) -> impl Iterator<Item = &'a [[i32; 3]]> + use<'a> {
        let (points, ends) = (self.points, self.ring_ends);
        (0..ends.len()).map(move |ring| &points[if ring == 0 { 0 } else { ends[ring - 1] }..ends[ring]])
    }
}

impl Face<'_> {
    /// The sum of its rings' area vectors: the normal, twice as long as the face is large.
    pub fn area_vector(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for ring in self.rings() {
            let own = newell(ring);
            (0..3).for_each(|axis| sum[axis] += own[axis] as f64);
        }
        sum
    }

    /// Whether it is more than a line.
    pub fn has_area(&self) -> bool {
        self.rings().next().is_some_and(|ring| ring_normal(ring) != [0; 3])
    }

    /// Six times the volume between the face and the grid's first point, in cubes of steps: of a closed surface these add up to its own.
    // Invariant: no sum overflows. Coordinates are below 2^26, so that a product of three is below 2^81 for each of less than 2^32 corners of
    // each of 2^32 faces, and those of all faces that fit into a file are below 2^127.
    pub fn six_volumes(&self) -> i128 {
        let of_ring = |ring: &[[i32; 3]]| -> i128 {
            let wide = |point: [i32; 3]| point.map(i128::from);
            let Some((first, rest)) = ring.split_first() else { return 0 };
            rest.windows(2).map(|pair| dot(wide(*first), cross(wide(pair[0]), wide(pair[1])))).sum()
        };
        self.rings().map(of_ring).sum()
    }
}

/// Faces of a model, which can be read any number of times.
pub trait Faces {
    /// The grid that their coordinates are on.
    fn grid(&self) -> &Grid;

    /// Names of the parts (objects, groups, materials); never empty.
    fn parts(&self) -> &[String];

    /// What is said of a part: a JSON object, as [`Attributes`](crate::Attributes) have them.
    ///
    /// # Errors
    /// If it cannot be read.
    fn part_attributes(&self, _part: u32) -> Result<Option<String>> {
        Ok(None)
    }

    /// Number of parts of which something is said.
    ///
    /// # Errors
    /// If it cannot be read.
    fn parts_with_attributes(&self) -> Result<u64> {
        Ok(0)
    }

    /// What is said of the files that the model is of, of those that say anything of themselves: JSON objects.
    ///
    /// # Errors
    /// If it cannot be read.
    fn file_attributes(&self) -> Result<Vec<String>> {
        Ok(Vec::new())
    }

    /// Names of the columns of values of faces.
    ///
    /// # Errors
    /// If they cannot be read.
    fn value_columns(&self) -> Result<Vec<String>> {
        Ok(Vec::new())
    }

    /// The coordinate system of the world, where known.
    fn crs(&self) -> Option<&Crs> {
        None
    }

    /// The unit of length of the world, where known: "mm".
    fn unit(&self) -> Option<&str> {
        None
    }

    /// Whether what is far away belongs to the body: its faces then bound what does not.
    fn is_unbounded(&self) -> bool {
        false
    }

    /// Volume of the body less that of the faces, in cubes of the grid's step: models may keep corners beside the
    /// grid, which faces stand in for.
    ///
    /// # Errors
    /// If they cannot be read.
    fn volume_beside(&self) -> Result<f64> {
        Ok(0.0)
    }

    /// Number of faces.
    fn len(&self) -> u64;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Reads all faces in the order of their numbers, and hands them out one by one.
    ///
    /// # Errors
    /// If they cannot be read, or what `each` returns.
    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()>;

    /// Reads all faces as [`Faces::each`] does, and hands out each with its values in some columns, JSON texts.
    ///
    /// # Errors
    /// If they cannot be read, or what `each` returns.
    fn each_with_values(&self, columns: &[&str], each: &mut AttributedFaceVisitor<'_>) -> Result<()> {
        let none = vec![None; columns.len()];
        self.each(&mut |face| each(face, &none))
    }
}

/// Takes a face with its values in some columns.
pub type AttributedFaceVisitor<'a> = dyn FnMut(&Face<'_>, &[Option<String>]) -> Result<()> + 'a;

/// Faces in memory.
#[derive(Clone, Debug)]
pub struct FaceList {
    grid: Grid,
    parts: Vec<String>,
    points: Vec<[i32; 3]>,
    colours: Vec<[u8; 3]>,
    ring_ends: Vec<usize>,
    /// Of each face: the ends of its rings and corners in the lists, its part and its source.
    faces: Vec<(usize, usize, u32, u64)>,
}

impl FaceList {
    /// An empty list.
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

    /// Takes all faces of a model to memory.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn of(faces: &dyn Faces) -> Result<FaceList> {
        let mut list = FaceList::new(faces.grid().clone(), faces.parts().to_vec());
        faces.each(&mut |face| {
            list.push(face);
            Ok(())
        })?;
        Ok(list)
    }

    /// Appends a face, whose number is that of its place in the list; all faces have colours or none.
    pub fn push(&mut self, face: &Face<'_>) {
        self.points.extend_from_slice(face.points);
        self.colours.extend_from_slice(face.colours);
        self.ring_ends.extend_from_slice(face.ring_ends);
        self.faces.push((self.ring_ends.len(), self.points.len(), face.part, face.source));
    }

    /// Whether faces have colours.
    pub fn is_coloured(&self) -> bool {
        !self.colours.is_empty()
    }

    /// Bytes of memory that the faces take.
    pub fn bytes(&self) -> u64 {
        let FaceList { points, colours, ring_ends, faces, .. } = self;
        (size_of_val(&points[..])
            + size_of_val(&colours[..])
            + size_of_val(&ring_ends[..])
            + size_of_val(&faces[..])) as u64
    }

    /// The face with a number below the length.
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
