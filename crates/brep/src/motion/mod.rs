//! Motions of exact models: translation, rotation, mirroring, scaling, and any other affine map.
//!
//! If a motion maps grid points to those of another grid, nothing is rounded: axes are permuted or
//! mirrored, and the rest is stored in the grid's origin and step. Off-grid vertices, and the
//! planes that define them, are moved by the same integers. For all other motions, vertices are
//! recomputed. Octrees are rebuilt in any case: tie-breaks of cell corners on faces change if axes
//! are permuted.

mod lattice;
mod map;
mod regrid;
mod snapped;
mod view;

use self::lattice::Lattice;
use self::snapped::{NewUnit, Snapping};
use super::arrangement::{ExactFace, Turner};
use super::attributes::{map_locations, with_member};
use super::closure::{Closure, Seed};
use super::planar::PlanarCounts;
use super::query::MassSums;
use super::store::formula::moved_formula;
use super::{BuildReport, ExactModel, Face, Faces, Grid, ModelBuilder};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result, SubProgress};
use spinney_container::{Codec, Metadata, Tag};
use spinney_crs::Crs;

pub use self::map::Motion;
pub(crate) use self::regrid::regrid;
pub use self::view::{ModelView, ViewRays};

/// Options for moving a model.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TransformOptions {
    /// Width of the unit of a new grid, to which all vertices are snapped. By default, the model's
    /// own grid, with as little rounding as possible.
    pub snap: Option<f64>,
    /// The coordinate reference system of the result; by default, the model's.
    pub crs: Option<Crs>,
    /// Unit of length of the result's coordinates; by default, the model's.
    pub unit: Option<String>,
    /// Whether the caller adds levels of detail to the result. Otherwise, a warning reports that
    /// those of the model are lost.
    pub levels: bool,
    /// A line for the result's provenance; by default, the map's coefficients.
    pub note: Option<String>,
    /// Codec of the file.
    pub codec: Codec,
    /// Maximum bytes of memory in total.
    pub memory: u64,
}

impl TransformOptions {
    /// Creates options that use the model's grid if possible, with a memory limit in bytes.
    pub fn new(memory: u64) -> TransformOptions {
        let (snap, crs, unit, note) = (None, None, None, None);
        TransformOptions { snap, crs, unit, levels: false, note, codec: Codec::default(), memory }
    }
}

/// Statistics of a model that was moved.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct TransformReport {
    /// Faces of the model.
    pub before: u64,
    /// Faces of the result.
    pub after: u64,
    /// Whether the body's shape is unchanged: no vertex was moved relative to others.
    pub is_exact: bool,
    /// Maximum distance of a vertex from its exact image, in the model's unit.
    pub displacement: f64,
    /// Faces that were triangulated, as their vertices are not in one plane on the grid, or their
    /// rings cross.
    pub cut: u64,
    /// Faces that were dropped: on the grid, they are points or lines.
    pub collapsed: u64,
    /// Faces with off-grid vertices that were dropped; their proxies on the grid replace them.
    pub rounded: u64,
    /// The grid.
    pub grid: Grid,
    /// Statistics of the octree.
    pub built: BuildReport,
}

/// Moves a model, and writes it to a file.
///
/// Shifts by an integer number of grid units, quarter turns, mirrors, permuted axes and a uniform
/// scaling are exact, also for off-grid vertices. Any other shift is rounded to grid units, unless
/// a finer grid represents it. For all other maps, vertices are recomputed and snapped to the
/// nearest grid points, and faces that are not planar then are triangulated. Names and attributes
/// of parts, face values, colours and metadata are kept. Time is proportional to the face count, as
/// for a build. Memory is limited, but faces with off-grid vertices are held. Progress counts
/// faces, each in several passes.
///
/// ```
/// use spinney::{ExactModel, Output};
/// use spinney::brep::{Faces, Motion, TransformOptions, transform};
/// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = |name: &str| directory.path().join(name);
/// # let text = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
/// # std::fs::write(path("a.off"), text).unwrap();
/// # import_exact(open_all(&[path("a.off")], 64 << 20)?, &ExactOptions::new(), Output::create(&path("a.goblin"))?, &())?;
/// let model = ExactModel::open(&path("a.goblin"), &Default::default())?;
/// let mirror = Motion::from_rows([[-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 2.0]])?;
/// let output = Output::create(&path("b.goblin"))?;
/// let report = transform(&model, &mirror, &TransformOptions::new(64 << 20), output, &())?;
/// assert!(report.is_exact && report.after == model.len());
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the model is not a solid, if the result is none ([`Error::NotASolid`], with the positions: it
/// intersects itself on the grid) or does not fit on a grid, if the memory is not enough, if files
/// cannot be read or written, or on cancellation. No file is written then.
pub fn transform(
    model: &ExactModel,
    motion: &Motion,
    options: &TransformOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<TransformReport> {
    model.check_surface(progress)?;
    let lattice = if options.snap.is_none() { Lattice::of(model, motion)? } else { None };
    let task = TransformTask { model, motion, options, progress, keeps_formula: false };
    let report = match lattice {
        Some(lattice) => task.exactly(&lattice, output),
        None => task.recompute(output, options.snap.map_or(NewUnit::Finest, NewUnit::Width)),
    }?;
    if !options.levels {
        model.warn_levels(progress);
    }
    Ok(report)
}

/// Moves the locations in a part's attributes: its addresses and its extent.
fn moved_about(mut about: String, motion: &Motion) -> String {
    let json = |numbers: &[f64]| {
        let is_finite = numbers.iter().all(|number| number.is_finite());
        is_finite.then(|| serde_json::to_string(numbers).ok()).flatten()
    };
    if about.contains("\"address\"") {
        let moved = map_locations(&about, &mut |points| {
            let points: Vec<[f64; 3]> = serde_json::from_str(points).ok()?;
            let moved: Option<Vec<String>> = points.iter().map(|point| json(&motion.apply(*point))).collect();
            Some(format!("[{}]", moved?.join(",")))
        });
        about = moved.unwrap_or(about);
    }
    if about.contains("\"geographicalExtent\"") {
        let moved = with_member(&about, "geographicalExtent", &mut |extent| {
            let Ok(extent) = serde_json::from_str::<[f64; 6]>(extent) else { return Ok(Some(extent.into())) };
            let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
            for corner in 0..8 {
                let point = motion.apply([0, 1, 2].map(|axis| extent[axis + 3 * (corner >> axis & 1)]));
                low = [0, 1, 2].map(|axis| low[axis].min(point[axis]));
                high = [0, 1, 2].map(|axis| high[axis].max(point[axis]));
            }
            Ok(json([low, high].as_flattened()))
        });
        about = moved.unwrap_or(about);
    }
    about
}

/// A motion in progress.
struct TransformTask<'a> {
    model: &'a ExactModel,
    motion: &'a Motion,
    options: &'a TransformOptions,
    progress: &'a dyn Progress,
    /// Whether the result keeps the model's formula, without the motion.
    keeps_formula: bool,
}

impl TransformTask<'_> {
    /// Moves everything to another grid, point by point.
    fn exactly(&self, lattice: &Lattice, output: Output) -> Result<TransformReport> {
        let is_mirrored = self.motion.is_mirrored();
        let mut target = Target::new(self, output, &lattice.grid)?;
        let mut count = 0u64;
        self.model.each_exact(&mut |face| {
            let moved = lattice.exact(face);
            count += 1;
            if count.is_multiple_of(1 << 8) {
                self.progress.check()?;
            }
            target.builder.push_exact(match is_mirrored {
                true => ExactFace { plane: moved.plane, ..moved.turned() },
                false => moved,
            })
        })?;
        let (mut points, mut turner) = (Vec::new(), Turner::default());
        self.model.each_face(&mut |face, is_proxy| {
            points.clear();
            points.extend(face.points.iter().map(|point| lattice.point(*point)));
            let moved = Face { points: &points, ..*face };
            let moved = if is_mirrored { turner.turn(&moved) } else { moved };
            target.push(&moved, is_proxy, face.number)
        })?;
        target.finish(Rounding { displacement: lattice.displacement, ..Rounding::default() })
    }

    /// Recomputes all vertices.
    fn recompute(&self, output: Output, unit: NewUnit<'_>) -> Result<TransformReport> {
        let mut snapping = Snapping::of(self.model, self.motion, unit, self.progress)?;
        let mut target = Target::new(self, output, &snapping.grid.clone())?;
        let (mut closure, mut sums) = (Closure::new(Seed::new()), MassSums::new());
        self.model.each(&mut |face| {
            let number = face.number;
            snapping.face(face, &mut |face| {
                closure.add(face);
                sums.add_face(face);
                target.push(face, false, number)
            })
        })?;
        let flaw = if sums.measures(&snapping.grid).volume == 0.0 && !self.model.is_empty() {
            Some(format!("on a grid with units of {} it has no volume", snapping.grid.width()))
        } else {
            (!closure.is_closed()).then(|| "some edges have a face on one side only".into())
        };
        if let Some(what) = flaw {
            return Err(Error::NotASolid {
                path: self.model.path().to_path_buf(),
                what: format!("the result would not be a solid: {what}"),
                locations: Vec::new(),
                count: 0,
                advice: "choose a finer grid with --snap, or check the model with `spinney verify`".into(),
            });
        }
        let rounded = self.model.exact_faces().0;
        let counts = Some(snapping.planar.counts);
        target.finish(Rounding { displacement: snapping.displacement(), counts, rounded })
    }

    /// Returns the metadata of the result: unit, frame and provenance.
    fn metadata(&self, grid: &Grid, rounding: &Rounding) -> Metadata {
        let TransformOptions { crs, unit, note, .. } = self.options;
        let mut metadata = self.model.metadata().clone();
        metadata.frame = grid.frame(crs.as_ref().or(self.model.crs()).cloned());
        let rows = self.motion.to_rows();
        let path = self.model.path().display();
        let note = note.clone().unwrap_or_else(|| format!("affine={}", numbers(rows.as_flattened(), ",")));
        metadata.provenance.push(format!("view of {path}: {note}"));
        if let Some(unit) = unit {
            metadata.set_tag(Tag::Unit, unit);
        }
        let number = |tag: Tag| metadata.tag(tag).and_then(|text| text.parse::<f64>().ok()).unwrap_or(0.0);
        let displacement = number(Tag::ModelDisplacement) * self.motion.growth() + rounding.displacement;
        let cut = number(Tag::ModelCutFaces);
        metadata.set_tag(Tag::ModelDisplacement, displacement.to_string());
        if let Some(counts) = &rounding.counts {
            metadata.set_tag(Tag::ModelCutFaces, (cut + counts.cut as f64).to_string());
            metadata.set_tag(Tag::ModelSlivers, counts.slivers.to_string());
        }
        metadata
    }
}

/// Rounding statistics of a motion.
#[derive(Default)]
struct Rounding {
    displacement: f64,
    /// Statistics of faces whose vertices were recomputed.
    counts: Option<PlanarCounts>,
    /// Faces with off-grid vertices that were dropped.
    rounded: u64,
}

/// The output file.
struct Target<'a> {
    task: &'a TransformTask<'a>,
    grid: Grid,
    builder: ModelBuilder,
    /// Names of the columns of face values.
    columns: Vec<String>,
    after: u64,
    /// The first third of the work.
    moving: SubProgress<'a>,
}

impl<'a> Target<'a> {
    fn new(task: &'a TransformTask<'a>, output: Output, grid: &Grid) -> Result<Target<'a>> {
        let TransformOptions { memory, codec, .. } = *task.options;
        let builder = ModelBuilder::new(output, grid.clone(), memory)?
            .codec(codec)
            .unbounded(task.model.is_unbounded())
            .reach(task.model.reach());
        let columns = task.model.value_columns()?;
        let count = task.model.len();
        let moving = SubProgress::new(task.progress, count, 3 * count);
        Ok(Target { task, grid: grid.clone(), builder, columns, after: 0, moving })
    }

    /// Adds a face that replaces the model's face `number`, with that face's values.
    fn push(&mut self, face: &Face<'_>, is_proxy: bool, number: u64) -> Result<()> {
        /// Number of faces between cancellation checks.
        const OFTEN: u64 = 1 << 12;
        if number.is_multiple_of(OFTEN) {
            self.moving.check()?;
            self.moving.advance(OFTEN, self.task.model.len());
        }
        self.after += 1;
        self.builder.push_face(face, is_proxy)?;
        for (column, name) in (0..).zip(&self.columns) {
            // (Models have less than 2^32 faces.)
            if let Some(value) = self.task.model.face_value(column, number as u32)? {
                self.builder.face_value(name, &value)?;
            }
        }
        Ok(())
    }

    fn finish(self, rounding: Rounding) -> Result<TransformReport> {
        let Target { task, grid, mut builder, after, .. } = self;
        let TransformTask { model, motion, progress, .. } = *task;
        for (part, name) in (0..).zip(model.parts()) {
            let about = model.part_attributes(part)?.map(|about| moved_about(about, motion));
            builder.part(name, about.as_deref())?;
        }
        model.file_attributes()?.iter().try_for_each(|text| builder.about_file(text))?;
        let rows = motion.to_rows();
        let builder = builder.formula(match task.keeps_formula {
            true => model.formula()?.unwrap_or_default(),
            false => moved_formula(&numbers(rows.as_flattened(), " "), model)?,
        });
        let is_exact = rounding.counts.is_none();
        // (Proxies of exact faces may intersect where these are thinner than a unit.)
        let is_rounded = builder.has_exact_faces();
        let mut metadata = task.metadata(&grid, &rounding);
        let building = SubProgress::new(progress, 2 * model.len(), 3 * model.len());
        let built = builder.finish(&mut metadata, &building)?;
        if built.defect_count > 0 && !is_rounded {
            let (what, advice) = match is_exact {
                true => (
                    "the model intersects itself",
                    "check it with `spinney verify`, and build it again with --repair",
                ),
                false => (
                    "on its new grid the result intersects itself, so it is not a solid",
                    "choose a finer grid with --snap, build the model with --repair, or use only shifts by integer grid units, quarter turns and uniform factors, which are exact",
                ),
            };
            return Err(built.error(model.path(), what, advice));
        }
        let counts = rounding.counts.unwrap_or_default();
        Ok(TransformReport {
            before: model.len(),
            after,
            is_exact,
            displacement: rounding.displacement,
            cut: counts.cut + counts.fanned,
            collapsed: counts.collapsed,
            rounded: rounding.rounded,
            grid,
            built,
        })
    }
}

/// Formats numbers with the minimum number of digits that identify them.
fn numbers(numbers: &[f64], between: &str) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(between)
}
