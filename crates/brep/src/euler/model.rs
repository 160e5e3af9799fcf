//! Exact models that operators change.

use std::path::Path;

use super::body::{EulerBody, Start};
use super::local::LocalChange;
use super::names::{Kind, Names};
use super::text::{EulerText, TextLimits};
use crate::face_check::FaceCheck;
use crate::topology::{Topology, TopologyOptions};
use crate::{BuildReport, ExactModel, Face, FaceList, Faces, Grid, MAX_BITS, ModelBuilder, format_position};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_container::{Codec, Tag};

/// An exact model in memory, with the topology of its faces.
pub struct ModelBody<'a> {
    model: &'a ExactModel,
    faces: FaceList,
    topology: Topology,
    /// In grid coordinates.
    body: EulerBody,
    memory: u64,
}

impl<'a> ModelBody<'a> {
    /// Reads a model.
    ///
    /// # Errors
    /// If it has off-grid vertices, is open, or has a face whose rings divide it; if it needs more
    /// than `memory` bytes; if it cannot be read, or on cancellation.
    pub fn of(model: &'a ExactModel, memory: u64, progress: &dyn Progress) -> Result<ModelBody<'a>> {
        /// Minimum bytes of a face in memory: a triangle's points and its share of the topology.
        const MIN_FACE: u64 = 400;
        let path = model.path();
        model.check_surface(progress)?;
        let (exact, _) = model.exact_faces();
        if exact > 0 {
            let found = format!("a model with {exact} faces that have off-grid vertices");
            let advice = "round these to a grid first: `spinney transform MODEL --snap WIDTH -o OUTPUT`";
            return Err(Error::unsupported(path, found, advice));
        }
        let check = |needed: u64| match needed > memory {
            true => Err(Error::TooLarge {
                path: path.to_path_buf(),
                what: "holding the model's faces and their topology".into(),
                needed,
                limit: memory,
                advice: "allow more with --memory".into(),
            }),
            false => Ok(()),
        };
        check(model.len().saturating_mul(MIN_FACE))?;
        let faces = FaceList::of(model)?;
        let bytes = faces.bytes();
        check(bytes)?;
        let options = TopologyOptions { memory: memory - bytes, path: path.to_path_buf() };
        let topology = Topology::of(&faces, &options, progress)?;
        topology.check_closed(path)?;
        // (The edited body is a copy.)
        check(bytes + u64::from(topology.edges()) * 2 * EulerBody::EDGE_BYTES)?;
        let body = EulerBody::of(&topology, &|point| point.map(f64::from)).map_err(|error| match error {
            Error::Invalid { found, expected, .. } => Error::corrupt(path, "surface", found, expected),
            error => error,
        })?;
        Ok(ModelBody { model, faces, topology, body, memory })
    }

    pub(super) fn body(&self) -> &EulerBody {
        &self.body
    }

    pub(super) fn model(&self) -> &'a ExactModel {
        self.model
    }

    /// Warns of contents that operators do not have.
    pub(super) fn warn_losses(&self, progress: &dyn Progress) -> Result<()> {
        let model = self.model;
        let lost = [
            ("colours", self.faces.is_coloured()),
            ("attributes of objects", model.parts_with_attributes()? > 0),
            ("values of faces", !model.value_columns()?.is_empty()),
            ("the coordinate system", model.crs().is_some()),
        ];
        let lost: Vec<&str> =
            lost.into_iter().filter(|(_, is_lost)| *is_lost).map(|(what, _)| what).collect();
        if !lost.is_empty() {
            progress.warn(model.path(), &format!("the operators lack {}", lost.join(", ")));
        }
        Ok(())
    }

    /// Visits the number and the part of each face.
    pub(super) fn each_part(&self, each: &mut dyn FnMut(u32, u32)) {
        (0..self.topology.faces()).for_each(|face| each(face, self.faces.get(face as usize).part));
    }

    /// Returns whether a face of an edited body has the rings of the model's face of that number.
    fn is_unchanged(&self, body: &EulerBody, face: u32) -> bool {
        let rings = body.faces.get(face).map_or(&[][..], |face| &face.rings);
        if face >= self.topology.faces() || body.source_of(face) != Some(face) {
            return false;
        }
        let known = self.topology.rings_of_face(face);
        let is_equal = |(ring, known): (&u32, u32)| {
            let half_edges = self.topology.half_edges_of_ring(known);
            let mut known: Vec<[f64; 3]> = half_edges
                .map(|half| self.topology.point(self.topology.origin(half)).map(f64::from))
                .collect();
            let mut found = body.points_of(*ring);
            // (Where a ring passes a point twice, this may overlook that it is the same.)
            least_first(&mut known);
            least_first(&mut found);
            known == found
        };
        rings.len() == known.len() && rings.iter().zip(known).all(is_equal)
    }
}

/// Rotates a ring of points so that it begins with the least.
fn least_first(ring: &mut [[f64; 3]]) {
    let compare = |a: &usize, b: &usize| ring[*a].partial_cmp(&ring[*b]).unwrap_or(std::cmp::Ordering::Equal);
    if let Some(least) = (0..ring.len()).min_by(compare) {
        ring.rotate_left(least);
    }
}

/// A model, and the body that operators made of it.
pub struct EditedModel<'a> {
    source: &'a ModelBody<'a>,
    body: EulerBody,
    displacement: f64,
}

/// Statistics of a changed model.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct EditReport {
    /// Faces of the model.
    pub before: u64,
    /// Faces of the result.
    pub after: u64,
    /// Faces of the result that differ from the model's.
    pub changed: u64,
    /// Faces of the model that were removed, with their values.
    pub removed: u64,
    /// Maximum distance of a point from its position in the operators, by rounding to the grid.
    pub displacement: f64,
    /// Statistics of the octree.
    pub built: BuildReport,
}

/// Applies the operators of a text to a model, whose coordinates are those of the world. Vertices,
/// edges, faces and rings have the names of [`euler_text`](super::euler_text). After each operator,
/// `each` receives the line's number, the line and the body.
///
/// # Errors
/// Those of [`EulerText::apply`].
pub fn edit_model<'a>(
    source: &'a ModelBody<'a>,
    text: &[u8],
    path: &Path,
    each: &mut dyn FnMut(u32, &str, &EulerBody),
) -> Result<EditedModel<'a>> {
    let mut names = Names::default();
    let body = source.body.clone();
    for (kind, count) in [
        (Kind::Vertex, body.vertices.slots()),
        (Kind::Edge, body.half_edges.slots()),
        (Kind::Face, body.faces.slots()),
        (Kind::Ring, body.rings.slots()),
    ] {
        (0..count as u32).for_each(|entity| names.add(kind, entity, entity));
    }
    let grid = source.model.grid().clone();
    let mut edited = EulerText::of(body, names, grid);
    let limits = TextLimits { memory: source.memory, path: path.to_path_buf() };
    edited.apply(text, &limits, each)?;
    Ok(EditedModel { source, body: edited.body, displacement: edited.displacement })
}

/// Applies local changes to a model.
///
/// # Errors
/// If there is no vertex, edge or face at the position of a change, or several, or the change is
/// not possible.
pub fn apply_local<'a>(source: &'a ModelBody<'a>, changes: &[LocalChange]) -> Result<EditedModel<'a>> {
    let mut body = source.body.clone();
    body.forgets = true;
    let mut displacement = 0.0f64;
    for change in changes {
        displacement = displacement.max(change.apply(&mut body, source.model.grid())?);
    }
    Ok(EditedModel { source, body, displacement })
}

impl EditedModel<'_> {
    /// Writes the changed model. Faces keep their parts, colours and values; faces that were made
    /// of a face have its part and values.
    ///
    /// # Errors
    /// If a face is not planar or has no area, or if the faces bound no solid; if files cannot be
    /// written; or on cancellation. No file is written then.
    pub fn write(
        &self,
        (output, codec): (Output, Codec),
        note: &str,
        progress: &dyn Progress,
    ) -> Result<EditReport> {
        let EditedModel { source, body, .. } = self;
        let model = source.model;
        let (grid, shift) = self.grid()?;
        let mut builder = ModelBuilder::new(output, grid.clone(), source.memory)?
            .codec(codec)
            .unbounded(model.is_unbounded());
        let columns = model.value_columns()?;
        let is_coloured = source.faces.is_coloured();
        let mut check = FaceCheck::new(grid.bits);
        let (mut changed, mut after, mut volume) = (0, 0, 0i128);
        let (mut points, mut ends, mut colours) = (Vec::new(), Vec::new(), Vec::new());
        for number in body.faces.numbers() {
            let from = body.source_of(number);
            let original = from.map(|from| source.faces.get(from as usize));
            points.clear();
            ends.clear();
            colours.clear();
            let is_unchanged = source.is_unchanged(body, number);
            match original.filter(|_| is_unchanged) {
                Some(face) => {
                    points.extend(face.points.iter().map(|point| shifted(*point, shift)));
                    ends.extend_from_slice(face.ring_ends);
                    colours.extend_from_slice(face.colours);
                }
                None => {
                    self.rings(number, shift, (&mut points, &mut ends))?;
                    if is_coloured {
                        let colour = |point: &[i32; 3]| colour_at(original.as_ref(), *point, shift);
                        colours.extend(points.iter().map(colour));
                    }
                }
            }
            let face = Face {
                number: after,
                points: &points,
                ring_ends: &ends,
                colours: &colours,
                part: original.map_or(0, |face| face.part),
                source: original.map_or(source.faces.len() + u64::from(number), |face| face.source),
            };
            if !is_unchanged {
                changed += 1;
                self.check_face(&mut check, &face, number, &grid)?;
            }
            volume += face.six_volumes();
            after += 1;
            if after.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            builder.push(&face)?;
            for (column, name) in (0..).zip(&columns) {
                let Some(from) = from else { continue };
                if let Some(value) = model.face_value(column, from)? {
                    builder.face_value(name, &value)?;
                }
            }
        }
        for (part, name) in (0..).zip(model.parts()) {
            builder.part(name, model.part_attributes(part)?.as_deref())?;
        }
        model.file_attributes()?.iter().try_for_each(|text| builder.about_file(text))?;
        if (volume <= 0) != model.is_unbounded() && after > 0 {
            return Err(self.no_solid("the surface is turned inside out, or encloses nothing"));
        }
        let mut metadata = model.metadata().clone();
        metadata.frame = grid.frame(model.crs().cloned());
        metadata.provenance.push(format!("edit of {}: {note}", model.path().display()));
        metadata.tags.remove(Tag::Csg.key());
        let built = builder.finish(&mut metadata, progress)?;
        if built.defect_count > 0 {
            let advice = "check the coordinates: faces must meet at common edges only, and enclose the solid";
            return Err(built.error(model.path(), "after the change, it is not a solid", advice));
        }
        if model.formula()?.is_some() {
            progress
                .warn(model.path(), "the result has no formula: the one of the model does not describe it");
        }
        model.warn_levels(progress);
        let known = 0..source.topology.faces();
        let removed = known.filter(|face| body.source_of(*face) != Some(*face)).count() as u64;
        let displacement = self.displacement;
        Ok(EditReport { before: model.len(), after, changed, removed, displacement, built })
    }

    fn no_solid(&self, what: &str) -> Error {
        Error::NotASolid {
            path: self.source.model.path().to_path_buf(),
            what: format!("after the change, it is not a solid: {what}"),
            locations: Vec::new(),
            count: 0,
            advice: "check the coordinates of the change".into(),
        }
    }

    /// Returns the points of a face's rings, and their ends.
    fn rings(
        &self,
        face: u32,
        shift: [i64; 3],
        (points, ends): (&mut Vec<[i32; 3]>, &mut Vec<usize>),
    ) -> Result<()> {
        for ring in self.body.faces.get(face).into_iter().flat_map(|face| &face.rings) {
            let found = self.body.points_of(*ring);
            if found.len() < 3 {
                let found = format!("a ring of {} vertices in the result", found.len());
                let expected = "rings of at least 3 vertices; complete the operators";
                return Err(Error::invalid(self.source.model.path().display().to_string(), found, expected));
            }
            // (Coordinates are integers within the grid.)
            points.extend(
                found
                    .into_iter()
                    .map(|point| [0, 1, 2].map(|axis| (point[axis] as i64 - shift[axis]) as i32)),
            );
            ends.push(points.len());
        }
        Ok(())
    }

    /// Checks that a face is planar, that its rings do not cross, and that it has an area.
    fn check_face(&self, check: &mut FaceCheck, face: &Face<'_>, number: u32, grid: &Grid) -> Result<()> {
        const MAX_SHOWN: usize = 4;
        let (found, expected) = match check.has_area(face) {
            Ok(true) => return Ok(()),
            Ok(false) => ("no area".into(), "an area"),
            Err(flaw) => match flaw.found.starts_with("a vertex at") {
                true => {
                    ("vertices that are not in one plane".into(), "a planar face; divide it first, as by mef")
                }
                false => (flaw.found, flaw.expected),
            },
        };
        let shown = face.points.iter().take(MAX_SHOWN).map(|point| format_position(grid.to_world(*point)));
        let more = if face.points.len() > MAX_SHOWN { " ..." } else { "" };
        let shown = shown.collect::<Vec<_>>().join("; ");
        let what = format!(
            "{}: face f{number} of the result, with vertices at {shown}{more}",
            self.source.model.path().display()
        );
        Err(Error::invalid(what, found, expected))
    }

    /// Returns the grid of the result, and the position of its first point in the model's grid.
    fn grid(&self) -> Result<(Grid, [i64; 3])> {
        let grid = self.source.model.grid();
        let (mut low, mut high) = ([0.0f64; 3], [((1u64 << grid.bits) - 1) as f64; 3]);
        let inside = (low, high);
        for vertex in self.body.vertices.numbers().filter_map(|vertex| self.body.vertices.get(vertex)) {
            for axis in 0..3 {
                low[axis] = low[axis].min(vertex.point[axis]);
                high[axis] = high[axis].max(vertex.point[axis]);
            }
        }
        if (low, high) == inside {
            return Ok((grid.clone(), [0; 3]));
        }
        let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        if longest >= (1u64 << MAX_BITS) as f64 {
            let found = format!("a result of {longest:e} grid units along an axis");
            return Err(Error::invalid(
                "grid",
                found,
                "at most 2^26; snap the model to a coarser grid first",
            ));
        }
        let shift = low.map(|at| at as i64);
        let bits = (64 - (longest as u64).leading_zeros() as u8).max(1);
        let origin = [0, 1, 2].map(|axis| grid.origin[axis] + shift[axis]);
        Ok((Grid { bits, origin, ..grid.clone() }, shift))
    }
}

fn shifted(point: [i32; 3], by: [i64; 3]) -> [i32; 3] {
    [0, 1, 2].map(|axis| (i64::from(point[axis]) - by[axis]) as i32)
}

/// Returns the colour that a face has at a vertex, or else at its first one; white without a face.
fn colour_at(face: Option<&Face<'_>>, point: [i32; 3], shift: [i64; 3]) -> [u8; 3] {
    let Some(face) = face else { return [255; 3] };
    let at = face.points.iter().position(|known| shifted(*known, shift) == point).unwrap_or(0);
    face.colours.get(at).copied().unwrap_or([255; 3])
}

impl EulerBody {
    /// Returns the half-edges of all rings of a face.
    pub(super) fn half_edges_of_face(&self, face: u32) -> Vec<u32> {
        let rings = self.faces.get(face).into_iter().flat_map(|face| &face.rings);
        let first = |ring: &u32| match self.rings.get(*ring)?.start {
            Start::HalfEdge(half) => Some(half),
            Start::Vertex(_) => None,
        };
        rings.filter_map(first).flat_map(|half| self.around(half)).collect()
    }
}
