//! Builds the tree from the models of a plan.

use std::path::Path;
use std::sync::atomic::Ordering;

use glam::DVec3;

use super::closure::Closure;
use super::field::WindingField;
use super::grid::Triangle;
use super::inside::{Attribute, FillOptions, Inside};
use super::octants::is_in_run;
use super::plan::{SolidImport, flat_faces};
use super::source::{Solid, Surface, SurveyedShard};
use super::triangles::{Collector, Triangles};
use super::units::Units;
use crate::import::{MeshFace, ModelInfo};
use spinney_base::TreeType;
use spinney_base::io::{Output, directory_of};
use spinney_base::space::Dimension;
use spinney_base::value::{DataKind, Rule, SampleType, Sums, Value, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_brep::geometry::{Stages, Triangulator};
use spinney_container::{Metadata, Tag};
use spinney_engine::store::{BuildOptions, TreeWriter};

/// Counts and measures of a solid that was built.
#[derive(Clone, Debug, PartialEq)]
pub struct SolidReport {
    /// Faces that were read.
    pub faces: u64,
    /// Faces with fewer than three distinct vertices, not counted in `faces`.
    pub degenerate: u64,
    /// Faces that were read and are points or lines on the grid. Faces much smaller than a cell may
    /// become that.
    pub collapsed: u64,
    /// Polygons that were read and intersect themselves, or lost their area on the grid. They count
    /// as triangle fans.
    pub repaired: u64,
    /// Repetitions of duplicate triangles. They count once if the surface is not closed with them.
    pub duplicates: u64,
    /// Triangles of the faces, without those that have no area on the grid.
    pub triangles: u64,
    /// Triangles of open objects, included in `triangles`. Closed objects are built as without
    /// them.
    pub open_triangles: u64,
    /// Maximum distance that a vertex was moved to the grid, in the models' unit.
    pub displacement: f64,
    /// Unit of length of the models, if known: "mm".
    pub unit: Option<String>,
    /// Test that decided what is inside.
    pub inside: InsideTest,
    /// Cells away from the surface that are in its holes, where the result is a guess.
    pub undecided: u64,
    /// Volume that the faces enclose on the grid, in the models' unit: exact if the surface is
    /// closed, where parts that overlap count several times.
    pub volume: f64,
    /// Area of the faces on the grid.
    pub area: f64,
    /// Volume of the cells that were built.
    pub filled: f64,
    /// Width of a cell.
    pub cell: f64,
    /// Cells that were built: none if the surface encloses nothing, or nothing as wide as a cell.
    pub cells: u64,
    /// Counts of the tests that decided whether triangles cut octants above the blocks of cells.
    pub stages: Stages,
}

/// Test that decided what is inside a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InsideTest {
    /// None: only the surface was requested.
    Surface,
    /// The surface is closed: exact, by nonzero winding numbers.
    Closed,
    /// Every edge has a counterpart, but not all faces are consistently oriented: exact, by
    /// even-odd parity.
    Flipped,
    /// The surface is partly open: a winding field for each open object; the tests above for the
    /// others.
    Open,
}

impl InsideTest {
    /// Description of the test.
    pub fn text(self) -> &'static str {
        match self {
            InsideTest::Surface => "only its surface",
            InsideTest::Closed => "closed: inside is where the winding number is not zero",
            InsideTest::Flipped => {
                "closed, but with faces turned inside out: inside is where rays cross it an odd number of times"
            }
            InsideTest::Open => {
                "open or loose: inside is where the winding field of the open components is at least one half"
            }
        }
    }
}

/// Bytes of a triangle in memory, including its list entries.
const TRIANGLE: u64 = size_of::<Triangle>() as u64 + 12;

/// Surfaces of a solid, and the test that decides what is inside.
pub(super) struct Decided {
    pub(super) surfaces: Vec<Surface>,
    test: InsideTest,
    /// Whether one surface was divided into these. This requires all of it in memory.
    pub(super) is_divided: bool,
    /// Number of all triangles, and of open ones.
    triangles: [u64; 2],
}

impl Decided {
    fn new(surfaces: Vec<Surface>, test: InsideTest, is_divided: bool) -> Decided {
        let is_open = |surface: &&Surface| matches!(surface.inside, Inside::Field(_));
        let count = |surface: &Surface| surface.triangles.len() as u64;
        let triangles = [surfaces.iter().map(count).sum(), surfaces.iter().filter(is_open).map(count).sum()];
        Decided { surfaces, test, is_divided, triangles }
    }
}

impl SolidImport {
    /// Builds the tree on the threads of the current rayon pool. Progress counts cells.
    ///
    /// Faces are read once. Triangles that exceed half of the memory go to a temporary file in the
    /// output's directory.
    ///
    /// # Errors
    /// If a model cannot be read, if the output cannot be written, or on cancellation. No file is
    /// left then.
    pub fn build(self, output: Output, progress: &dyn Progress) -> Result<SolidReport> {
        let directory = directory_of(output.path()).to_path_buf();
        let mut file = TreeWriter::create(output, (Dimension::Oct, self.grid.depth), 1)?;
        let report = self.write(&mut file, &directory, progress)?;
        file.finish()?;
        Ok(report)
    }

    /// Writes the tree as the next layer of a file. Temporary files are created in the directory
    /// `directory`.
    ///
    /// An import that was [planned for a shard](super::plan_part) writes the run of nodes that the
    /// file requests. Triangles that do not reach into the run are discarded as they are read,
    /// unless the surface has to be divided.
    ///
    /// # Errors
    /// Those of [`SolidImport::build`].
    pub fn write(
        mut self,
        file: &mut TreeWriter,
        directory: &Path,
        progress: &dyn Progress,
    ) -> Result<SolidReport> {
        let (run, survey) = (file.run(), self.survey.take());
        let (is_divided, is_part) =
            (survey.as_ref().is_some_and(|survey| survey.is_divided), survey.is_some());
        let part = run.zip(survey).map(|(run, survey)| SurveyedShard { run, survey });
        let grid = self.grid.clone();
        let is_in_part = |triangle: &Triangle| match run {
            Some(run) => !is_part || is_in_run(run, &grid, triangle),
            None => false,
        };
        let all = |_: &Triangle| true;
        let mut read = self.read(if is_divided { &all } else { &is_in_part }, directory, progress)?;
        let mut decided = self.inside(&mut read, is_part, progress)?;
        if decided.is_divided && is_part {
            if !is_divided {
                let found = "an open surface, planned as closed,";
                return Err(Error::unsupported(&self.models[0].info().path, found, "plan the build again"));
            }
            decided.surfaces.iter_mut().try_for_each(|surface| surface.triangles.retain(&is_in_part))?;
        }
        let mut report = self.report(&read, &decided);
        let (form, options) = self.tree(&report);
        let solid = self.solid(form, decided.surfaces, part, progress)?;
        let tally = file.source_with(&solid, self.extent, &options, progress, &mut |metadata| {
            report.undecided = solid.counters.undecided.load(Ordering::Relaxed);
            report.stages = *solid.counters.stages.lock().expect("no thread panics while it has this lock");
            set_tags(metadata, &self, &report);
        })?;
        report.cells = tally.cells;
        let each = self.grid.frame.linear().determinant().abs();
        report.filled = each
            * match (&tally.sum, self.options.attribute) {
                (Sums::Exact([sum, ..]), Attribute::Occupancy) => *sum as f64 / 255.0,
                _ => tally.cells as f64,
            };
        Ok(report)
    }

    /// Report of what is known before cells are built.
    pub(super) fn report(&self, read: &Read, decided: &Decided) -> SolidReport {
        let [triangles, open_triangles] = decided.triangles;
        SolidReport {
            faces: read.faces,
            degenerate: self.models.iter().map(|model| model.degenerate()).sum(),
            collapsed: read.collapsed,
            repaired: read.repaired,
            duplicates: read.duplicates,
            // (A divided surface is counted before its triangles are discarded.)
            triangles: if decided.is_divided { triangles } else { read.count },
            open_triangles,
            displacement: read.displacement,
            unit: self.options.unit.clone(),
            inside: decided.test,
            undecided: 0,
            volume: read.six_volumes as f64 / 6.0 * self.grid.step().powi(3),
            area: read.two_areas / 2.0 * self.grid.step().powi(2),
            filled: 0.0,
            cell: self.grid.step() * f64::from(self.grid.cell()),
            cells: 0,
            stages: Stages::default(),
        }
    }

    /// The solid of the surfaces, or a shard of it.
    pub(super) fn solid<'a>(
        &self,
        form: TreeType,
        surfaces: Vec<Surface>,
        part: Option<SurveyedShard>,
        progress: &'a dyn Progress,
    ) -> Result<Solid<'a>> {
        let options = &self.options;
        let fill = FillOptions {
            grid: self.grid.clone(),
            lattice: self.lattice,
            edge: options.edge,
            attribute: options.attribute,
            shell: options.shell,
            progress,
        };
        let held = (options.memory / 4 / TRIANGLE) as usize;
        let (_, value_of) = values(options.attribute, self.parts().len());
        Solid::new(form, fill, (surfaces, part), held, value_of)
    }

    /// Type of the tree and its build options, with the metadata known before cells are built.
    pub(super) fn tree(&self, report: &SolidReport) -> (TreeType, BuildOptions) {
        let (kind, rule) = match self.options.attribute {
            Attribute::Occupancy => (DataKind::Continuous, Rule::Occupancy),
            Attribute::Colour => (DataKind::Continuous, Rule::Mean),
            Attribute::PartNumber => (DataKind::Categorical, Rule::Majority),
        };
        let mut metadata = Metadata { frame: self.grid.frame.clone(), ..Metadata::default() };
        let parts = self.parts();
        let (value, _) = values(self.options.attribute, parts.len());
        if self.options.attribute == Attribute::PartNumber {
            let names = parts.into_iter().enumerate().filter(|(_, name)| !name.is_empty());
            metadata.class_names = names.map(|(i, name)| ((i as u64 + 1).into(), name)).collect();
        }
        metadata.provenance = self.models.iter().map(|model| provenance(model.info())).collect();
        set_tags(&mut metadata, self, report);
        let options = BuildOptions::new(kind, self.grid.depth)
            .rule(rule)
            .memory(self.options.memory / 4)
            .metadata(metadata)
            .share(self.options.share)
            .time(self.options.time)
            .packing(self.options.packing);
        (TreeType::new(Dimension::Oct, value), options)
    }

    /// Names of the parts of all models, which are numbered from 1.
    fn parts(&self) -> Vec<String> {
        self.models.iter().flat_map(|model| model.info().parts.iter().cloned()).collect()
    }

    /// Number of all parts, and a map from part numbers to object numbers.
    fn objects(&self) -> (usize, impl Fn(u32) -> u32 + use<>) {
        let mut objects: Vec<u32> = self.objects.iter().flatten().map(|object| object + 1).collect();
        let models = if objects.is_empty() { &self.models[..] } else { &[] };
        for info in models.iter().map(|model| model.info()) {
            let first = objects.len() as u32 + 1;
            let object = |part: u32| if info.is_grouped { first } else { first + part };
            objects.extend((0..info.parts.len() as u32).map(object));
        }
        (objects.len(), move |part: u32| objects[part as usize - 1])
    }

    /// Number of triangles that are kept in memory.
    fn held(&self) -> usize {
        (self.options.memory / 2 / TRIANGLE) as usize
    }

    /// Snaps and triangulates all faces, and keeps the triangles that `is_kept` selects.
    pub(super) fn read(
        &mut self,
        is_kept: &dyn Fn(&Triangle) -> bool,
        directory: &Path,
        progress: &dyn Progress,
    ) -> Result<Read> {
        let mut collectors =
            [Collector::new(self.held(), directory), Collector::new(self.held() / 8, directory)];
        let mut read = Reading::new(is_kept);
        let mut first_part = 1;
        let mut models = std::mem::take(&mut self.models);
        for model in &mut models {
            let info = model.info().clone();
            model.remarks().iter().for_each(|remark| progress.warn(&info.path, remark));
            model.faces(&mut |face| {
                if read.faces.is_multiple_of(1 << 12) {
                    progress.check()?;
                }
                read.face(self, &info, face, first_part, &mut collectors)
            })?;
            first_part += info.parts.len() as u32;
        }
        self.models = models;
        let [triangles, slivers] = collectors;
        let (triangles, slivers) = (triangles.finish()?, slivers.finish()?);
        if read.count == 0 {
            let step = self.grid.step();
            return Err(flat_faces(&self.models[0].info().path, self.bounds, step));
        }
        let Reading { faces, count, collapsed, displacement, closure, repaired, .. } = read;
        let (six_volumes, two_areas) = (read.six_volumes, read.two_areas);
        Ok(Read {
            six_volumes,
            two_areas,
            triangles,
            slivers,
            faces,
            count,
            collapsed,
            repaired,
            duplicates: 0,
            displacement,
            closure,
        })
    }

    /// Chooses the test for what is inside: one for the whole surface if possible, otherwise one
    /// for each of its units. Open surfaces are rejected if the solid is built in shards.
    pub(super) fn inside(
        &self,
        read: &mut Read,
        is_in_parts: bool,
        progress: &dyn Progress,
    ) -> Result<Decided> {
        let whole =
            |inside, test| Ok(Decided::new(vec![Surface::new(inside, read.triangles.clone())], test, false));
        if self.options.shell {
            return whole(Inside::Winding, InsideTest::Surface);
        }
        if read.closure.is_closed() {
            return whole(Inside::Winding, InsideTest::Closed);
        }
        let (parts, object) = self.objects();
        // (With several parts, correctly oriented ones must not be decided by parity.)
        if read.closure.is_even() && parts == 1 {
            return whole(Inside::Parity, InsideTest::Flipped);
        }
        let count = read.triangles.len() + read.slivers.len();
        let needed = WindingField::memory(count).max(Units::memory(count));
        if needed > self.options.memory {
            return Err(Error::TooLarge {
                path: self.models[0].info().path.clone(),
                what: "the winding field of an open surface".into(),
                needed,
                limit: self.options.memory,
                advice: "allow more with --memory, close the surface, or build it with --shell".into(),
            });
        }
        let mut all = read.triangles.all()?.to_vec();
        all.extend_from_slice(&read.slivers.all()?);
        read.triangles = Triangles::of(Vec::new());
        let units = Units::of(all, &object, progress)?;
        read.duplicates = units.duplicates;
        if is_in_parts && !units.open.is_empty() {
            let advice =
                "close the surface, build the cells that it cuts (--shell), or build all in a single process";
            let path = &self.models[0].info().path;
            return Err(Error::unsupported(path, "a shard of the solid of an open surface", advice));
        }
        let test = match (units.even.is_empty(), units.open.is_empty()) {
            (_, false) => InsideTest::Open,
            (false, true) => InsideTest::Flipped,
            (true, true) => InsideTest::Closed,
        };
        let even = units.even.into_iter().map(|triangles| (Inside::Parity, triangles));
        let exact = std::iter::once((Inside::Winding, units.closed)).chain(even);
        let exact = exact.filter(|(_, triangles)| !triangles.is_empty());
        let mut surfaces: Vec<Surface> =
            exact.map(|(inside, triangles)| Surface::new(inside, Triangles::of(triangles))).collect();
        for triangles in units.open {
            let field = WindingField::new(&triangles, progress)?;
            surfaces.push(Surface::new(Inside::Field(field.into()), Triangles::of(triangles)));
        }
        Ok(Decided::new(surfaces, test, true))
    }
}

/// Triangles of all models that were kept, and counts of all faces.
pub(super) struct Read {
    pub(super) triangles: Triangles,
    /// Triangles without area on the grid whose edges are edges of other triangles.
    slivers: Triangles,
    faces: u64,
    /// Triangles with area, kept or not.
    count: u64,
    collapsed: u64,
    repaired: u64,
    duplicates: u64,
    displacement: f64,
    /// Six times the volume that all faces enclose, and twice their area, in grid units.
    six_volumes: i128,
    two_areas: f64,
    pub(super) closure: Closure,
}

/// State of reading faces, with buffers that are reused for each face.
struct Reading<'k> {
    /// Whether to keep a triangle.
    is_kept: &'k dyn Fn(&Triangle) -> bool,
    faces: u64,
    count: u64,
    collapsed: u64,
    displacement: f64,
    /// Six times the volume that all faces enclose, and twice their area, in grid units.
    six_volumes: i128,
    two_areas: f64,
    closure: Closure,
    snapped: Vec<[i32; 3]>,
    triangulator: Triangulator,
    repaired: u64,
}

impl<'k> Reading<'k> {
    fn new(is_kept: &'k dyn Fn(&Triangle) -> bool) -> Reading<'k> {
        Reading {
            is_kept,
            faces: 0,
            count: 0,
            collapsed: 0,
            displacement: 0.0,
            six_volumes: 0,
            two_areas: 0.0,
            closure: Closure::default(),
            snapped: Vec::new(),
            triangulator: Triangulator::default(),
            repaired: 0,
        }
    }

    fn face(
        &mut self,
        import: &SolidImport,
        info: &ModelInfo,
        face: &MeshFace<'_>,
        first_part: u32,
        [triangles, slivers]: &mut [Collector; 2],
    ) -> Result<()> {
        let part = first_part + face.part;
        if import.only.as_ref().is_some_and(|only| !only.contains(&(part - 1))) {
            return Ok(());
        }
        self.faces += 1;
        self.snapped.clear();
        for point in face.points {
            let point = info.up(import.options.up).to_z_up(*point);
            let snapped = import.grid.snap(&info.path, point)?;
            self.displacement = self.displacement.max(import.grid.displacement(point, snapped));
            self.snapped.push(snapped);
        }
        let attribute = match import.options.attribute {
            Attribute::Occupancy => 0,
            Attribute::Colour => mean_colour(face.colours),
            Attribute::PartNumber => part,
        };
        // Decremented at the face's first triangle with area.
        self.collapsed += 1;
        let mut is_collapsed = true;
        let mut push = |corners: [[i32; 3]; 3]| {
            self.closure.add(corners);
            let mut triangle = Triangle { corners, attribute, part };
            let normal = triangle.normal();
            // (Products of a normal and a coordinate take up to 98 bits.)
            self.six_volumes +=
                (0..3).map(|axis| i128::from(normal[axis]) * i128::from(corners[0][axis])).sum::<i128>();
            self.two_areas += DVec3::from(normal.map(|number| number as f64)).length();
            if import.options.shell {
                triangle.leave_wall(&import.grid, import.extent);
            }
            if triangle.normal() != [0; 3] {
                self.collapsed -= u64::from(std::mem::take(&mut is_collapsed));
                self.count += 1;
                return if (self.is_kept)(&triangle) { triangles.push(triangle) } else { Ok(()) };
            }
            // If two corners coincide, the triangle's edges are one edge and its opposite, which
            // cancel.
            let [a, b, c] = corners;
            if a == b || b == c || c == a { Ok(()) } else { slivers.push(triangle) }
        };
        if let [a, b, c] = self.snapped[..] {
            return push([a, b, c]);
        }
        let wide: Vec<[i64; 3]> = self.snapped.iter().map(|point| point.map(i64::from)).collect();
        let mut cut = Vec::new();
        if !self.triangulator.triangulate(&wide, face.ring_ends, &mut cut) {
            // A face that intersects itself or has no area. Fans have its boundary, too, so closed
            // surfaces stay closed.
            self.repaired += 1;
            let mut first = 0;
            for end in face.ring_ends.iter().map(|end| *end as u32) {
                cut.extend((first + 2..end).map(|corner| [first, corner - 1, corner]));
                first = end;
            }
        }
        cut.into_iter().try_for_each(|corners| push(corners.map(|corner| self.snapped[corner as usize])))
    }
}

/// Mean of a face's colours, as 0x00RRGGBB.
fn mean_colour(colours: &[[u8; 3]]) -> u32 {
    let count = colours.len().max(1) as u32;
    let mean = |channel: usize| {
        let sum: u32 = colours.iter().map(|colour| u32::from(colour[channel])).sum();
        (sum + count / 2) / count
    };
    mean(0) << 16 | mean(1) << 8 | mean(2)
}

/// Value type of a solid with this number of parts, and the function from attributes to values.
fn values(attribute: Attribute, parts: usize) -> (ValueType, fn(u32) -> Value) {
    match attribute {
        Attribute::Occupancy => (ValueType::new(SampleType::U8, 1), |value| Value::from([value as u8])),
        Attribute::Colour => (ValueType::new(SampleType::U8, 3), |value| {
            let [blue, green, red, _] = value.to_le_bytes();
            Value::from([red, green, blue])
        }),
        Attribute::PartNumber => match parts {
            0..=255 => (ValueType::new(SampleType::U8, 1), |value| Value::from([value as u8])),
            256..=65535 => (ValueType::new(SampleType::U16, 1), |value| Value::from([value as u16])),
            _ => (ValueType::new(SampleType::U32, 1), |value| Value::from([value])),
        },
    }
}

pub(in crate::import) fn provenance(info: &ModelInfo) -> String {
    format!("mesh {} ({})", info.path.display(), info.format)
}

/// Records a report in the tree's metadata.
fn set_tags(metadata: &mut Metadata, import: &SolidImport, report: &SolidReport) {
    let edge = if import.options.shell { "shell" } else { import.options.edge.name() };
    metadata.set_tag(Tag::SolidBoundary, edge);
    metadata.set_tag(Tag::SolidSurface, report.inside.text());
    metadata.set_tag(Tag::SolidTriangles, report.triangles.to_string());
    metadata.set_tag(Tag::SolidDisplacement, report.displacement.to_string());
    metadata.set_tag(Tag::SolidDoubledTriangles, report.duplicates.to_string());
    metadata.set_tag(Tag::SolidRepairedFaces, report.repaired.to_string());
    metadata.set_tag(Tag::SolidUndecidedCells, report.undecided.to_string());
    if let Some(unit) = &import.options.unit {
        metadata.set_tag(Tag::Unit, unit);
    }
}
