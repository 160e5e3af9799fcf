//! Model builder: faces are added one by one, stored in blocks of the file, and distributed to the
//! cells of an octree, in bounded memory.

mod arena;
mod base;
mod base_cell;
mod cells;
mod check;
mod copied;
mod defects;
mod division;
mod equal_faces;
mod items;
mod kept;
mod memory;
mod near;
mod pairs;
mod spread;
mod subtree_faces;
mod thin;
mod upper;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;

use self::arena::Arena;
use self::cells::Cell;
use self::items::LargePolygons;
use self::near::NearFaces;
use self::spread::Spread;
use self::subtree_faces::{FaceWords, SpoolTarget, SubtreeFacesBuilder};
use self::upper::Upper;
use super::store::objects::{ColumnNames, ObjectWriter};
use super::store::segment::CUT;
use super::store::summary::{NodeCounts, Summary};
use super::store::sums::StoredSums;
use super::store::table::{FIRST_NAMED, MAX_BYTES, MAX_NAMED, TableWriter};
use super::store::writer::{List, ModelWriter};
use super::{Face, Faces, Grid};
use crate::arrangement::{ExactFace, Rounded};
use crate::exact::normal::ring_normal;
use crate::face_check::{FaceCheck, FaceFlaw};
use crate::geometry::Stages;
use crate::part_sums::SumsOfParts;
use spinney_base::io::{Output, directory_of};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Codec, Metadata, Tag};

pub(crate) use self::base::BaseModel;
pub(crate) use self::base_cell::BaseRoot;
pub(crate) use self::check::{Checked, OctreeCheck};
pub use self::defects::format_position;
pub use self::defects::{Defect, DefectKind};
pub(crate) use self::memory::defects_of;

/// Default maximum number of faces of a leaf. With more, files are hardly smaller and queries take
/// longer; with less, cells are divided without benefit. (Bunny of 60,000 triangles: 277,000 nodes
/// without a limit, 68,000 with 12, 55,000 with 16.)
pub const LEAF_SIZE: usize = 12;

/// Statistics of a model that was built, and its defects. If a model without off-grid vertices has
/// defects, no file is written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BuildReport {
    /// Nodes of the octree.
    pub nodes: NodeCounts,
    /// Numbers of face-octant tests by their deciding stages.
    pub stages: Stages,
    /// Positions where the surface bounds no solid: at most 100.
    pub defects: Vec<Defect>,
    /// Number of all defects.
    pub defect_count: u64,
    /// Whether the defects are folds and thin intersections (see [`BuildReport::THIN`]), and what
    /// follows from them.
    pub is_thin: bool,
}

/// A file of an exact model that is being built.
pub struct ModelBuilder {
    writer: ModelWriter,
    grid: Grid,
    memory: u64,
    run: SubtreeFacesBuilder,
    /// Removed faces of the base.
    removed: SubtreeFacesBuilder,
    near_removed: NearFaces,
    words: Vec<u32>,
    faces: u64,
    /// Number of faces that have an area.
    wide: u64,
    proxies: u64,
    /// The largest part number of a face.
    last_part: u32,
    leaf_size: usize,
    is_unbounded: bool,
    near: NearFaces,
    objects: ObjectWriter,
    face_values: TableWriter,
    face_columns: ColumnNames,
    values_by_source: BTreeMap<u64, ColumnValues>,
    formula: String,
    check: FaceCheck,
    sums: SumsOfParts,
}

/// Values of a face: column names, and JSON strings.
pub type ColumnValues = Vec<(String, String)>;

impl ModelBuilder {
    /// Maximum number of columns of face values.
    pub(crate) const MAX_COLUMNS: usize = MAX_NAMED as usize;

    /// Starts a file; about `memory` bytes are used.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn new(output: Output, grid: Grid, memory: u64) -> Result<ModelBuilder> {
        let directory: PathBuf = directory_of(output.path()).to_path_buf();
        let writer = ModelWriter::new(output, &grid, memory / 16)?;
        let sums_directory = directory.clone();
        let run =
            SubtreeFacesBuilder::new((memory / 4 / 4) as usize, SpoolTarget::Directory(directory.clone()));
        let removed = SubtreeFacesBuilder::new((memory / 8 / 4) as usize, SpoolTarget::Directory(directory));
        let check = FaceCheck::new(grid.bits);
        let sums = SumsOfParts::new(&sums_directory, grid.bits, memory / 16);
        Ok(ModelBuilder {
            writer,
            grid,
            memory,
            run,
            removed,
            near_removed: NearFaces::new(1),
            words: Vec::new(),
            faces: 0,
            wide: 0,
            proxies: 0,
            last_part: 0,
            leaf_size: LEAF_SIZE,
            is_unbounded: false,
            near: NearFaces::new(1),
            objects: ObjectWriter::default(),
            face_values: TableWriter::default(),
            face_columns: ColumnNames::default(),
            values_by_source: BTreeMap::new(),
            formula: String::new(),
            check,
            sums,
        })
    }

    /// Sets the maximum number of faces of a leaf whose planes do not share a point. With 0,
    /// BOOLEAN cells occur only at the deepest level, as in the extended octrees of the literature:
    /// several times as many cells.
    #[must_use]
    pub fn leaf_size(self, leaf_size: usize) -> ModelBuilder {
        ModelBuilder { leaf_size, ..self }
    }

    /// Sets the codec of blocks, segments and tables. With [`Codec::Packed`], they take fewer
    /// bytes, and are decoded on use.
    ///
    /// # Panics
    /// If faces were already added.
    #[must_use]
    pub fn codec(mut self, codec: Codec) -> ModelBuilder {
        assert!(self.writer.is_empty(), "set the codec before adding faces");
        self.writer.set_codec(codec);
        self
    }

    /// Sets whether the body extends to infinity, so that the faces bound its cavities.
    #[must_use]
    pub fn unbounded(self, is_unbounded: bool) -> ModelBuilder {
        ModelBuilder { is_unbounded, ..self }
    }

    /// Sets the maximum distance between faces and their proxies in grid units, before any are
    /// added.
    pub(super) fn reach(self, reach: u8) -> ModelBuilder {
        ModelBuilder { near: NearFaces::new(reach), near_removed: NearFaces::new(reach), ..self }
    }

    /// Adds a face with off-grid vertices, which other faces are proxies of. A file is then written
    /// even if the proxies have defects.
    ///
    /// # Errors
    /// If the file cannot be written, or the memory is not enough.
    pub(super) fn push_exact(&mut self, face: ExactFace) -> Result<()> {
        self.check_exact_memory(1)?;
        self.last_part = self.last_part.max(face.part);
        self.sums.add_exact(&face)?;
        self.near.push(&face);
        self.writer.exact_face(face)
    }

    /// Fails if `more` additional faces with off-grid vertices exceed the memory.
    fn check_exact_memory(&self, more: u64) -> Result<()> {
        let (needed, limit) = ((self.writer.exact_faces() + more) * NearFaces::BYTES, self.memory / 4);
        if needed <= limit {
            return Ok(());
        }
        Err(Error::TooLarge {
            path: self.writer.path().to_path_buf(),
            what: "storing boxes and planes of the faces with off-grid vertices".into(),
            needed,
            limit,
            advice: "allow more with --memory".into(),
        })
    }

    /// Sets the values of faces that are pushed from now on, by their sources ([`Face::source`]).
    #[must_use]
    pub(crate) fn values_by_source(self, values_by_source: BTreeMap<u64, ColumnValues>) -> ModelBuilder {
        ModelBuilder { values_by_source, ..self }
    }

    /// Adds a face; faces are numbered in this order. All its vertices must be in one plane, and
    /// its rings must not cross. A face without area is stored, but bounds nothing.
    ///
    /// # Errors
    /// If the face is invalid, if the file cannot be written, or if there are 2^32 faces.
    pub fn push(&mut self, face: &Face<'_>) -> Result<()> {
        self.push_face(face, false)
    }

    /// Adds a face as [`ModelBuilder::push`] does, which may be a proxy for faces with off-grid
    /// vertices.
    pub(super) fn push_face(&mut self, face: &Face<'_>, is_proxy: bool) -> Result<()> {
        let number = self.write_face(face, is_proxy)?;
        self.sums.add(face, is_proxy)?;
        let Some(number) = number else { return Ok(()) };
        self.wide += 1;
        self.words.clear();
        FaceWords::write(number, face.points, face.ring_ends, &mut self.words);
        self.run.push(FaceWords(&self.words))
    }

    /// Records a removed face of the base; a face without area is in no cell and is ignored.
    pub(super) fn remove(&mut self, face: &Face<'_>) -> Result<()> {
        if ring_normal(face.rings().next().unwrap_or_default()) == [0; 3] {
            return Ok(());
        }
        self.words.clear();
        FaceWords::write(face.number as u32, face.points, face.ring_ends, &mut self.words);
        self.removed.push(FaceWords(&self.words))
    }

    /// Records a removed face of the base with off-grid vertices.
    pub(super) fn remove_exact(&mut self, face: &ExactFace) {
        self.near_removed.push(face);
    }

    /// Writes a face; returns its number if it has an area.
    fn write_face(&mut self, face: &Face<'_>, is_proxy: bool) -> Result<Option<u32>> {
        let Ok(number) = u32::try_from(self.faces) else {
            let path = self.writer.path();
            return Err(Error::unsupported(path, "a model of 2^32 or more faces", "divide the model"));
        };
        let has_area = self.check.has_area(face).map_err(|FaceFlaw { found, expected }| {
            Error::invalid(format!("face {}", face.number), found, expected)
        })?;
        self.faces += 1;
        self.proxies += u64::from(is_proxy);
        self.last_part = self.last_part.max(face.part);
        self.writer.face(&Face { number: number.into(), ..*face }, is_proxy)?;
        // (Several faces may have the same source.)
        let values = self.values_by_source.get(&face.source).cloned().unwrap_or_default();
        values.iter().try_for_each(|(column, json)| self.face_value(column, json))?;
        Ok(has_area.then_some(number))
    }

    /// Adds all faces of a surface with snapped vertices, and its exact faces. Progress counts
    /// faces.
    pub(super) fn push_rounded(mut self, rounded: Rounded, progress: &dyn Progress) -> Result<ModelBuilder> {
        /// Number of faces between cancellation checks.
        const OFTEN: u64 = 1 << 12;
        self = self.reach(rounded.reach);
        let Rounded { faces, is_proxy, exact, .. } = rounded;
        faces.each(&mut |face| {
            if face.number.is_multiple_of(OFTEN) {
                progress.check()?;
                progress.advance(OFTEN.min(faces.len() - face.number), faces.len());
            }
            self.push_face(face, is_proxy[face.number as usize])
        })?;
        for (number, face) in (0..).zip(exact) {
            if u64::is_multiple_of(number, OFTEN) {
                progress.check()?;
            }
            self.push_exact(face)?;
        }
        Ok(self)
    }

    /// Returns the number of added faces, without those with off-grid vertices.
    pub fn faces(&self) -> u64 {
        self.faces
    }

    /// Records to which parts faces are added from now on: see [`ModelBuilder::has_faces_of`].
    pub fn record_parts(&mut self) {
        self.sums.record_touched();
    }

    /// Returns whether faces were added to a part since parts are recorded.
    pub fn has_faces_of(&self, part: u32) -> bool {
        self.sums.is_touched(part)
    }

    /// Returns whether faces with off-grid vertices were added.
    pub fn has_exact_faces(&self) -> bool {
        self.writer.exact_faces() > 0
    }

    /// Adds a part with its attributes, a JSON object as in [`Attributes`](crate::Attributes).
    /// Parts are numbered in this order. A model without parts gets one named `mesh`.
    ///
    /// # Errors
    /// If the file cannot be written, or the name or the attributes have more than 16 MiB.
    pub fn part(&mut self, name: &str, attributes: Option<&str>) -> Result<()> {
        for text in [Some(name), attributes].into_iter().flatten() {
            self.check_length(text, "a name, or attributes of a part,")?;
        }
        let ModelBuilder { writer, objects, .. } = self;
        objects.part(name, attributes, &mut |key, bytes| writer.chunk(List::Objects, key, bytes))
    }

    /// Adds the metadata of a source file, a JSON object.
    ///
    /// # Errors
    /// If the file cannot be written, or the object has more than 16 MiB.
    pub fn about_file(&mut self, text: &str) -> Result<()> {
        self.check_length(text, "metadata of a source file")?;
        let ModelBuilder { writer, objects, .. } = self;
        objects.file(text, &mut |key, bytes| writer.chunk(List::Objects, key, bytes))
    }

    /// Sets a value, in JSON, of the last pushed face in a named column. A face has at most one
    /// value per column.
    ///
    /// # Errors
    /// If there is no face yet, if there are more than 4096 columns, if the file cannot be written,
    /// or the value has more than 16 MiB.
    pub fn face_value(&mut self, column: &str, json: &str) -> Result<()> {
        self.check_length(json, "a value of a face")?;
        let name = serde_json::Value::from(vec![column]).to_string();
        let number = if self.faces > 0 { self.face_columns.number(&name) } else { None };
        let Some(number) = number else {
            return Err(Error::invalid(
                "column",
                column,
                "at most 4096 columns, and a face before its values",
            ));
        };
        // (Larger face numbers were rejected by `write_face`.)
        let face = (self.faces - 1) as u32;
        let ModelBuilder { writer, face_values, .. } = self;
        let take = &mut |key, bytes: &[u8]| writer.chunk(List::FaceValues, key, bytes);
        face_values.push(FIRST_NAMED + number, face, json.as_bytes(), take)
    }

    fn check_length(&self, text: &str, what: &str) -> Result<()> {
        if text.len() <= MAX_BYTES {
            return Ok(());
        }
        let found = format!("{what} of {} bytes", text.len());
        Err(Error::unsupported(self.writer.path(), found, format!("shorten it to {MAX_BYTES} bytes")))
    }

    /// Sets the formula that the model is computed by.
    pub(super) fn formula(self, formula: String) -> ModelBuilder {
        ModelBuilder { formula, ..self }
    }

    /// Builds the octree and completes the file, on the threads of the current rayon pool. If the
    /// faces have defects and none are off-grid, no file is written. Adds the number of defects to
    /// the metadata.
    ///
    /// # Errors
    /// If a face's part was not added, if the file cannot be written, or on cancellation.
    pub fn finish(self, metadata: &mut Metadata, progress: &dyn Progress) -> Result<BuildReport> {
        self.finish_with(None, metadata, progress)
    }

    /// Does the same as [`ModelBuilder::finish`], if some faces are those of a base whose
    /// grid is a cell of the model's grid.
    pub(super) fn finish_with(
        self,
        base: Option<&BaseModel<'_>>,
        metadata: &mut Metadata,
        progress: &dyn Progress,
    ) -> Result<BuildReport> {
        let ModelBuilder {
            mut writer,
            grid,
            memory,
            run,
            removed,
            near_removed,
            faces,
            wide,
            proxies,
            last_part,
            leaf_size,
            is_unbounded,
            near: mut all_near,
            mut objects,
            mut face_values,
            face_columns,
            formula,
            mut sums,
            ..
        } = self;
        let (run, target) = run.finish()?;
        let (removed, _) = removed.finish()?;
        let stages = Mutex::new(Stages::default());
        let total = (run.len() + if base.is_some() { removed.len() } else { 0 }) as u64;
        let mut upper = Upper {
            bits: grid.bits,
            depth: grid.depth(),
            leaf_size,
            finds_folds: base.is_none() && wide == faces,
            near: &mut all_near,
            near_removed: &near_removed,
            memory,
            target,
            stages: &stages,
            progress,
            writer: &mut writer,
            done: 0,
            total,
            large: LargePolygons::new(memory / 32),
            visited: 0,
        };
        let mut arena = Arena::default();
        let mark = arena.mark();
        let root = Cell { level: 0, position: [0; 3], winding: is_unbounded.into() };
        let word = match base {
            None => {
                let near = upper.near.of(&upper.near.all(), &root, grid.bits);
                upper.cell(&root, run, (&near, Spread::new(wide, leaf_size)), &mut arena)?
            }
            Some(base) => {
                let winding = root.winding - base.model.far_winding();
                let node = base.root_cell()?;
                let near = [upper.near.from(base.exact.len()), near_removed.all()];
                let (root, runs) = (Cell { winding, ..root }, [run, removed]);
                upper.change_faces(base, (&root, &node), runs, [&near[0], &near[1]], &mut arena)?
            }
        };
        // The root always has its own segment.
        if word != CUT {
            arena.cut(Code::root(Dimension::Oct), mark, word);
        }
        upper.store(&mut arena)?;
        let mut report = BuildReport {
            nodes: arena.counts,
            stages: *stages.lock().expect("no thread panics while it holds this lock"),
            defects: Vec::new(),
            defect_count: arena.defects.count,
            is_thin: arena.defects.are_thin(),
        };
        let defects = std::mem::take(&mut arena.defects);
        report.defects = defects.list.into_iter().map(|found| found.in_world(&grid)).collect();
        if report.defect_count > 0 && writer.exact_faces() == 0 {
            return Ok(report);
        }
        metadata.tags.remove(Tag::ModelIntersections.key());
        if report.defect_count > 0 {
            metadata.set_tag(Tag::ModelIntersections, report.defect_count.to_string());
        }
        if let Some(base) = base {
            base.add_sums(&mut sums, progress)?;
        }
        let sums = sums.finish(&mut |part, sums| {
            objects.sums(part, &sums.to_bytes(), &mut |key, bytes| writer.chunk(List::Objects, key, bytes))
        })?;
        // (Base and result are closed: the caller has checked both.)
        let sums = StoredSums { is_closed: sums.is_closed || base.is_some(), ..sums };
        let parts = objects.finish(&mut |key, bytes| writer.chunk(List::Objects, key, bytes))?;
        if u64::from(last_part) >= parts {
            let expected = format!("a number below {parts}, the number of added parts");
            return Err(Error::invalid("part number of a face", last_part.to_string(), expected));
        }
        let take = &mut |key, bytes: &[u8]| writer.chunk(List::FaceValues, key, bytes);
        face_columns.write(&mut face_values, take)?;
        face_values.finish(take)?;
        let (nodes, exact_faces, reach) = (
            report.nodes,
            writer.exact_faces(),
            if writer.exact_faces() == 0 { 1 } else { all_near.reach() },
        );
        let codec = writer.codec();
        let summary = Summary { grid, codec, faces, is_unbounded, nodes, exact_faces, proxies, reach, parts };
        writer.finish(&summary, &sums.to_bytes(), &[], &formula, metadata)?;
        Ok(report)
    }
}
