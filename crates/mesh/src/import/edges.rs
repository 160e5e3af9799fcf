//! Edges of meshes as input of line trees.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::{Model, ModelInfo};
use spinney_base::io::{Sorter, directory_of};
use spinney_base::space::{Dimension, Up, morton_encode};
use spinney_base::{Error, Progress, Result};
use spinney_crs::Crs;
use spinney_lines::{
    LineAttribute, LineFeature, LineSchema, LineSource, LineValue, ROUNDED, ValueKind, VertexGrid,
    VertexSurvey,
};
use xxhash_rust::xxh3::xxh3_64;

/// Options of [`open_mesh_edges`].
#[derive(Clone, Debug)]
pub struct EdgeOptions {
    /// Axis that points up in the file.
    pub up: Up,
    /// Coordinate system, instead of the file's.
    pub crs: Option<Crs>,
    /// Approximate memory limit in bytes.
    pub memory: u64,
    /// Path of the tree: temporary files are in its directory.
    pub output: PathBuf,
}

/// Edges of a mesh, each once: a line feature with its object and its number of faces.
pub struct MeshEdges {
    path: PathBuf,
    schema: LineSchema,
    parts: Vec<String>,
    is_rounded: bool,
    remarks: Vec<String>,
    /// Distinct edges in order.
    edges: BufReader<File>,
}

/// Bytes of an edge: its ends, the number of its object and of its faces.
const EDGE: usize = 32;

/// An edge between two vertices, the lower one first.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Edge {
    ends: [[i32; 3]; 2],
    part: u32,
    faces: u32,
}

impl Edge {
    fn to_bytes(self) -> [u8; EDGE] {
        let [[a, b, c], [d, e, f]] = self.ends;
        let words = [a, b, c, d, e, f].map(i32::cast_unsigned).into_iter().chain([self.part, self.faces]);
        let mut bytes = [0; EDGE];
        bytes
            .as_chunks_mut::<4>()
            .0
            .iter_mut()
            .zip(words)
            .for_each(|(four, word)| *four = word.to_le_bytes());
        bytes
    }

    fn from_bytes(bytes: &[u8; EDGE]) -> Edge {
        let word = |index: usize| u32::from_le_bytes(bytes.as_chunks::<4>().0[index]);
        let end = |first: usize| [0, 1, 2].map(|axis| word(first + axis).cast_signed());
        Edge { ends: [end(0), end(3)], part: word(6), faces: word(7) }
    }

    /// Key by which equal edges are next to each other, and others near those around: the position
    /// of the middle, in 2^13 steps along each axis of the bounds, and a hash.
    fn key(&self, [low, high]: [[i32; 3]; 2]) -> u64 {
        let step = |axis: usize| {
            let side = (i64::from(high[axis]) - i64::from(low[axis])).max(1);
            let middle = (i64::from(self.ends[0][axis]) + i64::from(self.ends[1][axis])) / 2;
            (((middle - i64::from(low[axis])) << 13) / (side + 1)) as u32
        };
        let position = (0..3).fold(0, |code, axis| code | morton_encode(Dimension::Oct, step(axis)) << axis);
        position << 25 | xxh3_64(&self.to_bytes()[..24]) >> 39
    }
}

/// Reads the faces of a mesh twice, and opens its edges as input of a line tree. Each edge is one
/// feature, with the attributes `object` (the part of its first face) and `faces` (how many faces
/// have it: 1 on an open border, 2 on a closed surface). Vertices are those of a grid; edges
/// between equal vertices are left out. Sorts edges within the memory limit.
///
/// # Errors
/// If the mesh has no faces, cannot be read or does not fit on a grid, or the temporary file cannot
/// be written.
pub fn open_mesh_edges(
    model: &mut dyn Model,
    options: &EdgeOptions,
    progress: &dyn Progress,
) -> Result<MeshEdges> {
    let ModelInfo { path, crs, parts, .. } = model.info().clone();
    let (up, crs) = (model.info().up(options.up), options.crs.clone().or(crs));
    let mut survey = VertexSurvey::default();
    let mut is_empty = true;
    each_face(model, progress, &mut |face| {
        is_empty = false;
        face.points.iter().for_each(|point| survey.include(up.to_z_up(*point)));
        Ok(())
    })?;
    if is_empty {
        return Err(Error::corrupt(path, "faces", "none with vertices", "a model with faces"));
    }
    let grid = survey.grid(&path, crs.as_ref())?;
    let mut sorter = Sorter::new(directory_of(&options.output), options.memory);
    each_face(model, progress, &mut |face| {
        let mut first = 0;
        for end in face.ring_ends {
            let ring = &face.points[first..*end];
            first = *end;
            for (index, point) in ring.iter().enumerate() {
                let [a, b] = [*point, ring[(index + 1) % ring.len()]].map(|at| grid.vertex(up.to_z_up(at)));
                if a != b {
                    let edge = Edge { ends: [a.min(b), a.max(b)], part: face.part, faces: 1 };
                    sorter.push(edge.key(grid.bounds()), &edge.to_bytes())?;
                }
            }
        }
        Ok(())
    })?;
    let edges = distinct(sorter, &grid, directory_of(&options.output), progress)?;
    let attribute = |name: &str, kind| LineAttribute { name: name.into(), kind };
    let attributes = vec![attribute("object", ValueKind::Text), attribute("faces", ValueKind::Integer)];
    let schema = LineSchema::new(&grid, attributes, crs);
    let (is_rounded, mut remarks) = (grid.is_rounded(), model.remarks());
    let info = model.info();
    let has_attributes = info.attributes.parts() > 0;
    let losses = [
        (info.unit.is_some(), "the unit of length"),
        (info.is_coloured, "colours"),
        (has_attributes, "attributes of objects"),
    ];
    let lost = losses.into_iter().filter(|(is_lost, _)| *is_lost);
    remarks.extend(lost.map(|(_, what)| format!("a tree of edges does not have {what}: not stored")));
    Ok(MeshEdges { path, schema, parts, is_rounded, remarks, edges })
}

/// Passes all faces to a function; checks for cancellation.
fn each_face(
    model: &mut dyn Model,
    progress: &dyn Progress,
    each: &mut dyn FnMut(&super::MeshFace<'_>) -> Result<()>,
) -> Result<()> {
    let mut count = 0u64;
    model.faces(&mut |face| {
        count += 1;
        if count.is_multiple_of(1 << 12) {
            progress.check()?;
        }
        each(face)
    })
}

/// Writes the sorted edges to a temporary file, equal ones once.
fn distinct(
    sorter: Sorter,
    grid: &VertexGrid,
    directory: &Path,
    progress: &dyn Progress,
) -> Result<BufReader<File>> {
    let failed = || Error::io(directory, "use a temporary file");
    let mut out = BufWriter::new(tempfile::tempfile_in(directory).map_err(failed())?);
    // Invariant: equal edges have equal keys, so they are in one group. The group has different
    // edges of one key, in the order of their first faces; a hash in the key keeps it small.
    let mut group: Vec<Edge> = Vec::new();
    let mut key = 0;
    let mut write = |group: &mut Vec<Edge>| {
        group.drain(..).try_for_each(|edge| out.write_all(&edge.to_bytes()).map_err(failed()))
    };
    let mut count = 0u64;
    sorter.finish(&mut |row| {
        count += 1;
        if count.is_multiple_of(1 << 12) {
            progress.check()?;
        }
        let Some(edge) = row.first_chunk().map(Edge::from_bytes) else { return Ok(()) };
        let next = edge.key(grid.bounds());
        if next != key {
            write(&mut group)?;
            key = next;
        }
        match group.iter_mut().find(|own| own.ends == edge.ends) {
            Some(own) => own.faces = own.faces.saturating_add(1),
            None => group.push(edge),
        }
        Ok(())
    })?;
    write(&mut group)?;
    let mut file = out.into_inner().map_err(|error| failed()(error.into_error()))?;
    file.seek(SeekFrom::Start(0)).map_err(failed())?;
    Ok(BufReader::new(file))
}

impl LineSource for MeshEdges {
    fn schema(&self) -> &LineSchema {
        &self.schema
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn remarks(&self) -> Vec<String> {
        let rounded = self.is_rounded.then(|| ROUNDED.to_owned());
        rounded.into_iter().chain(self.remarks.iter().cloned()).collect()
    }

    fn next(&mut self) -> Result<Option<LineFeature>> {
        let mut bytes = [0; EDGE];
        match self.edges.read_exact(&mut bytes) {
            Ok(()) => {}
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(None),
            Err(error) => return Err(Error::io(&self.path, "read the edges of")(error)),
        }
        let Edge { ends, part, faces } = Edge::from_bytes(&bytes);
        let object = self.parts.get(part as usize).cloned().unwrap_or_default();
        let values = vec![LineValue::Text(object), LineValue::Integer(faces.into())];
        Ok(Some(LineFeature { lines: vec![ends.to_vec()], values }))
    }
}
