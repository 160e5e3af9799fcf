//! Exact models of CSG solids: each primitive becomes a polyhedron, and exact set operations on
//! files combine them.

use std::path::PathBuf;

use crate::bounded_solid::BoundedSolid;
use crate::expression::Instruction;
use crate::lowered::{Bounds, Instance, hull, is_finite};
use crate::model::{Csg, Primitive};
use crate::shape::Shape;
use spinney_base::io::{Output, directory_of};
use spinney_base::{Error, Progress, Result, SetOperation, SilentProgress};
use spinney_brep::query::MassProperties;
use spinney_brep::{CombineReport, ExactModel, Grid, InsideRule, Origin, combine_as};
use spinney_container::{Codec, OpenOptions, Tag};
use spinney_crs::Crs;
use spinney_mesh::import::{DEFAULT_MEMORY, ExactOptions, MeshArrays, import_exact};
use tempfile::TempDir;

/// Maximum number of models that are combined at once: each is an open file.
const AT_ONCE: usize = 64;
/// Maximum number of facets of a primitive.
pub(crate) const MAX_FACETS: f64 = (1 << 20) as f64;
/// Default ratio of the longest side to the deviation of facets from curved surfaces.
const USUAL_SHARE: f64 = 1000.0;
/// Maximum length, in bytes, of a CSG text that a model's formula includes.
const MAX_FORMULA: usize = 1 << 12;

/// Options for the exact model of a CSG solid.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct CsgExactOptions {
    /// Maximum distance of facets from the curved surface that they approximate. Default: a
    /// thousandth of the longest side.
    pub deviation: Option<f64>,
    /// Width of a grid unit. Default: the smallest power of two with which the longest side has at
    /// most about 2^24 units.
    pub snap: Option<f64>,
    /// Unit of length, stored in the file. Default: the unit in the CSG text.
    pub unit: Option<String>,
    /// Coordinate reference system.
    pub crs: Option<Crs>,
    /// Compression of the file.
    pub codec: Codec,
    /// Memory limit, in bytes.
    pub memory: u64,
}

impl Default for CsgExactOptions {
    fn default() -> Self {
        let (deviation, snap, unit, crs) = (None, None, None, None);
        CsgExactOptions { deviation, snap, unit, crs, codec: Codec::default(), memory: DEFAULT_MEMORY }
    }
}

impl CsgExactOptions {
    /// Returns the default options: facets within a thousandth of the longest side, on the finest
    /// grid.
    pub fn new() -> CsgExactOptions {
        CsgExactOptions::default()
    }
}

/// Statistics of the exact model of a CSG solid.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct CsgExactReport {
    /// Number of primitives; primitives that are used several times count each time.
    pub primitives: usize,
    /// Number of primitives with curved surfaces, which facets approximate.
    pub curved: usize,
    /// Maximum distance of facets from the curved surfaces.
    pub deviation: f64,
    /// Number of faces of all primitives.
    pub facets: u64,
    /// Shells of Bezier patches, one for each primitive with patches.
    pub shells: Vec<ShellReport>,
    /// A remark on where an infinite solid was clipped.
    pub ends: Option<String>,
    /// Maximum displacement of a primitive's vertex by snapping to the grid.
    pub displacement: f64,
    /// Statistics of the model.
    pub model: CombineReport,
}

/// A shell of Bezier patches in the exact model of a CSG solid.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ShellReport {
    /// Name of its part of the model.
    pub name: String,
    /// Number of patches.
    pub patches: usize,
    /// The volume in the patches, by integrals of their polynomials. Exact except for rounding.
    pub volume: f64,
    /// The volume in the facets, with vertices on the grid.
    pub facet_volume: f64,
}

/// Builds an exact model of a solid. Planar primitives are exact except that their vertices are
/// snapped to the grid. Curved primitives become facets with vertices on their surfaces. Exact set
/// operations combine them, in temporary files next to the output that are removed at the end. Each
/// primitive is a part of the model. Progress counts primitives.
///
/// ```
/// use spinney::{ExactModel, Output};
/// use spinney::brep::MassProperties;
/// use spinney::raw::csg::{Csg, CsgExactOptions, import_exact_csg};
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("notched.goblin");
/// let csg = Csg::parse("notched".as_ref(), "difference(block(0,0,0, 2,2,2), block(1,1,1, 3,3,3))")?;
/// import_exact_csg(&csg, &CsgExactOptions::new(), Output::create(&path)?, &())?;
/// let model = ExactModel::open(&path, &Default::default())?;
/// assert_eq!(MassProperties::of(&model, &())?.volume, 7.0);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the solid is infinite and nothing bounds it; if a primitive needs too many facets or cannot
/// be built; if the file cannot be written; on cancellation. No output file is left then.
pub fn import_exact_csg(
    csg: &Csg,
    options: &CsgExactOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<CsgExactReport> {
    let bounded = csg.bounded()?;
    let [min, max] = bounded.bounds;
    let longest = (0..3).map(|axis| max[axis] - min[axis]).fold(0.0, f64::max);
    let within = options.deviation.unwrap_or(longest / USUAL_SHARE);
    if !(within.is_finite() && within > 0.0) {
        return Err(Error::invalid("deviation", within.to_string(), "a distance above zero"));
    }
    let parent = directory_of(output.path()).to_path_buf();
    let directory =
        tempfile::tempdir_in(&parent).map_err(Error::io(&parent, "make a temporary directory"))?;
    let unit = options.unit.clone().or_else(|| csg.unit().map(String::from));
    let mut body_builder = BodyBuilder {
        csg,
        bounded: &bounded,
        options,
        unit,
        within,
        snap: 0.0,
        directory,
        open: output.access().into(),
        files: 0,
        facets: 0,
        facet_volumes: Vec::new(),
        displacement: 0.0,
        progress,
    };
    body_builder.snap = Grid::over(body_builder.bounds(), options.snap)?.width();
    let root = body_builder.evaluate()?;
    let model = root.open(&body_builder.open)?;
    let formula = Some(csg.text()).filter(|text| text.len() <= MAX_FORMULA);
    let origin = Origin {
        formula: formula.map_or(String::new(), |text| format!("(csg {})", json_text(text))),
        provenance: vec![format!("primitives {}, facets within {within}", csg.path.display())],
        tags: vec![
            (Tag::Csg, csg.text().into()),
            (Tag::ModelDisplacement, body_builder.displacement.to_string()),
        ],
    };
    let operation = if root.is_negated { SetOperation::Complement } else { SetOperation::First };
    let report = combine_as(operation, &[&model], &origin, output, options.codec, options.memory, progress)?;
    // (Instances are evaluated in their order.)
    let shells = bounded.shells().zip(&body_builder.facet_volumes);
    let shells = shells
        .map(|((name, patches, volume), facet_volume)| ShellReport {
            name,
            patches,
            volume,
            facet_volume: *facet_volume,
        })
        .collect();
    let shapes = bounded.lowered.instances.iter().map(|instance| bounded.shape_of(instance));
    Ok(CsgExactReport {
        primitives: csg.primitives(),
        curved: shapes.filter(|primitive| primitive.shape.is_curved()).count(),
        deviation: within,
        facets: body_builder.facets,
        shells,
        displacement: body_builder.displacement,
        model: report,
        ends: bounded.ends.clone(),
    })
}

/// Encodes a string as a JSON string literal.
fn json_text(text: &str) -> String {
    let mut json = String::with_capacity(text.len() + 2);
    json.push('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => json.extend(['\\', c]),
            '\n' => json.push_str("\\n"),
            c if c < ' ' => json.push_str(&format!("\\u{:04x}", u32::from(c))),
            c => json.push(c),
        }
    }
    json.push('"');
    json
}

impl BoundedSolid {
    /// Returns the primitive of an instance.
    pub(crate) fn shape_of(&self, instance: &Instance) -> &Primitive {
        &self.primitives[instance.primitive as usize]
    }
}

/// A body in a file, or its complement.
struct Body {
    path: PathBuf,
    is_negated: bool,
}

impl Body {
    fn open(&self, options: &OpenOptions) -> Result<ExactModel> {
        ExactModel::open(&self.path, options)
    }
}

/// Progress that supports cancellation but drops all messages: notices about self-intersecting
/// outlines are not relevant here, because the even-odd rule defines them.
struct Quiet<'a>(&'a dyn Progress);

impl Progress for Quiet<'_> {
    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

/// Creates bodies in files of a temporary directory.
struct BodyBuilder<'a> {
    csg: &'a Csg,
    bounded: &'a BoundedSolid,
    options: &'a CsgExactOptions,
    unit: Option<String>,
    within: f64,
    /// Width of a unit of all grids.
    snap: f64,
    directory: TempDir,
    /// Options for opening these files.
    open: OpenOptions,
    files: u64,
    facets: u64,
    /// Volumes of the polyhedra of patches, in the order of the instances.
    facet_volumes: Vec<f64>,
    displacement: f64,
    progress: &'a dyn Progress,
}

impl BodyBuilder<'_> {
    /// Returns a box around all polyhedra.
    fn bounds(&self) -> Bounds {
        let BoundedSolid { primitives, lowered, around, .. } = self.bounded;
        let boxes = lowered.boxes(primitives);
        lowered.instances.iter().zip(&boxes).fold(*around, |all, (instance, bounds)| {
            if is_finite(bounds) {
                return hull(&all, bounds);
            }
            let made = self.bounded.shape_of(instance).shape.polyhedron(
                self.within,
                &instance.to_world,
                self.ball(instance),
            );
            made.vertices.iter().fold(all, |all, vertex| hull(&all, &[*vertex, *vertex]))
        })
    }

    /// Returns a ball, in a primitive's local coordinates, around everything finite.
    fn ball(&self, instance: &Instance) -> ([f64; 3], f64) {
        let [min, max] = self.bounded.around;
        let centre = [0, 1, 2].map(|axis| (min[axis] + max[axis]) / 2.0);
        let half = (0..3).map(|axis| (max[axis] - min[axis]).powi(2)).sum::<f64>().sqrt() / 2.0;
        // (Slightly larger, so that faces of the box do not coincide with faces around the ball.)
        (instance.to_local.apply(centre), 1.01 * half * instance.to_local.stretch())
    }

    /// Returns the path of a new file.
    fn file(&mut self) -> PathBuf {
        self.files += 1;
        self.directory.path().join(format!("{}.goblin", self.files))
    }

    /// Returns the body of the whole expression.
    fn evaluate(&mut self) -> Result<Body> {
        let bounded = self.bounded;
        let total = bounded.lowered.instances.len() as u64;
        let mut stack: Vec<Body> = Vec::new();
        for instruction in &bounded.lowered.instructions {
            let body = match *instruction {
                Instruction::Primitive(number, is_negated) => {
                    let path = self.primitive(&bounded.lowered.instances[number as usize])?;
                    self.progress.advance(1, total);
                    Body { path, is_negated }
                }
                Instruction::Any(count) => {
                    // A union is the complement of the intersection of complements.
                    let parts = stack.split_off(stack.len() - count as usize);
                    let parts = parts.into_iter().map(|part| Body { is_negated: !part.is_negated, ..part });
                    let all = self.all(parts.collect())?;
                    Body { is_negated: !all.is_negated, ..all }
                }
                Instruction::All(count) => {
                    let parts = stack.split_off(stack.len() - count as usize);
                    self.all(parts)?
                }
                Instruction::Odd(count, is_even) => {
                    let parts = stack.split_off(stack.len() - count as usize);
                    let is_negated = parts.iter().fold(is_even, |even, part| even != part.is_negated);
                    Body {
                        path: self.joined(
                            SetOperation::SymmetricDifference,
                            parts.into_iter().map(|part| part.path).collect(),
                        )?,
                        is_negated,
                    }
                }
            };
            stack.push(body);
        }
        stack.pop().ok_or_else(|| Error::invalid("solid", "nothing", "a primitive"))
    }

    /// Returns the intersection of bodies.
    fn all(&mut self, parts: Vec<Body>) -> Result<Body> {
        let (out, within): (Vec<Body>, Vec<Body>) = parts.into_iter().partition(|part| part.is_negated);
        let [out, within] =
            [out, within].map(|parts| parts.into_iter().map(|part| part.path).collect::<Vec<_>>());
        if within.is_empty() {
            return Ok(Body { path: self.joined(SetOperation::Union, out)?, is_negated: true });
        }
        let mut all = self.joined(SetOperation::Intersection, within)?;
        if !out.is_empty() {
            // (De Morgan: an intersection of complements is the complement of the union.)
            let mut less = vec![all];
            less.extend(self.fewer(SetOperation::Union, out, AT_ONCE - 1)?);
            all = self.combined(SetOperation::Difference, &less)?;
        }
        Ok(Body { path: all, is_negated: false })
    }

    /// Applies an associative and commutative operation to any number of operands.
    fn joined(&mut self, operation: SetOperation, parts: Vec<PathBuf>) -> Result<PathBuf> {
        let mut left = self.fewer(operation, parts, 1)?;
        left.pop().ok_or_else(|| Error::invalid("operands", "none", "at least one"))
    }

    /// Applies an operation in batches until at most `most` bodies with the same result are left.
    fn fewer(
        &mut self,
        operation: SetOperation,
        mut parts: Vec<PathBuf>,
        most: usize,
    ) -> Result<Vec<PathBuf>> {
        while parts.len() > most {
            let mut fewer = Vec::new();
            for some in parts.chunks(AT_ONCE) {
                fewer.push(if let [one] = some { one.clone() } else { self.combined(operation, some)? });
            }
            parts = fewer;
        }
        Ok(parts)
    }

    /// Applies an operation and deletes its operands.
    fn combined(&mut self, operation: SetOperation, parts: &[PathBuf]) -> Result<PathBuf> {
        let path = self.file();
        let open = |path: &PathBuf| ExactModel::open(path, &self.open);
        let models = parts.iter().map(open).collect::<Result<Vec<_>>>()?;
        let models: Vec<&ExactModel> = models.iter().collect();
        let output = Output::create(&path)?;
        // (Objects of one text that overlap become one without a warning.)
        combine_as(
            operation,
            &models,
            &Origin::default(),
            output,
            Codec::Plain,
            self.options.memory,
            &SilentProgress(self.progress),
        )
        .map_err(|error| self.with_csg_path(error))?;
        for part in parts {
            std::fs::remove_file(part).map_err(Error::io(part, "remove"))?;
        }
        Ok(path)
    }

    /// Writes the file of a primitive.
    fn primitive(&mut self, instance: &Instance) -> Result<PathBuf> {
        let primitive = self.bounded.shape_of(instance);
        let shape = &primitive.shape;
        let within = self.within / instance.to_world.stretch();
        let facets = shape.facets(within);
        let name = primitive.name();
        if facets > MAX_FACETS {
            let found = format!("{} for {facets} facets of the {name}", self.within);
            return Err(Error::invalid("deviation", found, "a larger distance, for at most 1048576 facets"));
        }
        let made = shape.polyhedron(within, &instance.to_world, self.ball(instance));
        self.facets += made.face_ends.len() as u64;
        let mut mesh = MeshArrays::default();
        mesh.name = name;
        mesh.vertices = made.vertices;
        mesh.corners = made.corners;
        mesh.ring_ends = made.ring_ends;
        mesh.face_ends = made.face_ends;
        let mut options = ExactOptions::new();
        options.snap = Some(self.snap);
        options.inside = InsideRule::Odd;
        options.unit = self.unit.clone();
        options.crs = self.options.crs.clone();
        options.memory = self.options.memory;
        let path = self.file();
        let quiet = Quiet(self.progress);
        let import = |options: &ExactOptions| {
            import_exact(vec![mesh.clone().model()?], options, Output::create(&path)?, &quiet)
        };
        // (A self-intersecting outline is repaired; the even-odd rule defines its interior.)
        let report = match import(&options) {
            Err(Error::NotASolid { .. }) => {
                options.repair = true;
                import(&options)
            }
            other => other,
        };
        let report = report.map_err(|error| self.with_csg_path(error))?;
        self.displacement = self.displacement.max(report.displacement);
        if matches!(shape, Shape::Patches { .. }) {
            let model = ExactModel::open(&path, &self.open)?;
            self.facet_volumes.push(MassProperties::of(&model, self.progress)?.volume);
        }
        Ok(path)
    }

    /// Rewrites an error about a temporary file to name the CSG file.
    fn with_csg_path(&self, error: Error) -> Error {
        match error {
            Error::NotASolid { what, locations, count, .. } => {
                let advice = "choose a finer grid with --snap, or build cells of it (without --brep)".into();
                Error::NotASolid { path: self.csg.path.clone(), what, locations, count, advice }
            }
            other => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strings_are_json() {
        assert_eq!(json_text("a \"b\"\\\n\u{1}é"), "\"a \\\"b\\\"\\\\\\n\\u0001é\"");
    }
}
