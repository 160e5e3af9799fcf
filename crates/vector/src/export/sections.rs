//! Sections of exact models by planes, as polygons.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::str::FromStr;

use super::{AttributeType, AttributeValue, GeometryKind, VectorFormat, VectorLayer, VectorWriter};
use spinney_base::io::Output;
use spinney_base::{DecimalSteps, Error, Progress, Result};
use spinney_brep::query::{CuttingPlane, SectionPolygon};
use spinney_brep::{Faces, ModelView};

/// Parallel section planes, in text form: `z=12.5`, a range `z=0..50/0.2`, or `plane=NX,NY,NZ,D`
/// with a normal and its dot product with the plane's points.
///
/// ```
/// use spinney::raw::export::vector::SectionPlanes;
///
/// let planes: SectionPlanes = "z=0..50/0.2".parse()?;
/// assert_eq!(planes.count(), 251);
/// assert!("z=0..50".parse::<SectionPlanes>().is_err());
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SectionPlanes {
    name: String,
    normal: [f64; 3],
    steps: DecimalSteps,
    count: u32,
}

impl SectionPlanes {
    /// Returns the number of planes.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Returns the plane of an axis at the lower side of a box, if it is one of these, and a plane
    /// just above it, as arguments: "z=0" and "z=0.001". (Sections contain what is below a plane.)
    pub fn at_foot(&self, [low, high]: [[f64; 3]; 2]) -> Option<[String; 2]> {
        /// Distance of the other plane, as a power of ten, relative to the size of the box.
        const DIGITS: i32 = -4;
        let axis = ["x", "y", "z"].iter().position(|axis| *axis == self.name)?;
        let foot = low[axis];
        let (mut first, mut end) = (0, self.count);
        while first < end {
            let middle = first + (end - first) / 2;
            if self.at(middle) < foot { first = middle + 1 } else { end = middle }
        }
        let size = high[axis] - foot;
        if first == self.count || self.at(first) != foot || size.partial_cmp(&0.0) != Some(Ordering::Greater)
        {
            return None;
        }
        let step: f64 = format!("1e{}", size.log10().floor() as i32 + DIGITS).parse().ok()?;
        let above = DecimalSteps::new(foot, step).value(1);
        Some([foot, above].map(|at| format!("{}={at}", self.name)))
    }

    /// Returns the dot product of a plane's points with the normal.
    fn at(&self, number: u32) -> f64 {
        self.steps.value(number.into())
    }
}

impl FromStr for SectionPlanes {
    type Err = Error;

    fn from_str(text: &str) -> Result<SectionPlanes> {
        let wrong = || {
            let expected = "x=, y= or z= with a number or FROM..TO/STEP, or plane=NX,NY,NZ,D";
            Error::invalid("planes", text, expected)
        };
        let (name, value) = text.split_once('=').ok_or_else(wrong)?;
        let number = |text: &str| text.trim().parse().ok().filter(|number: &f64| number.is_finite());
        let one = |name: &str, normal: [f64; 3], first: f64| SectionPlanes {
            name: name.into(),
            normal,
            steps: DecimalSteps::new(first, 0.0),
            count: 1,
        };
        if name == "plane" {
            let numbers: Option<Vec<f64>> = value.split(',').map(number).collect();
            let Some(&[x, y, z, at]) = numbers.as_deref() else { return Err(wrong()) };
            return Ok(one(&format!("{x},{y},{z}"), [x, y, z], at));
        }
        let axis = ["x", "y", "z"].iter().position(|axis| *axis == name).ok_or_else(wrong)?;
        let normal = CuttingPlane::across(axis, 0.0).normal;
        let Some((range, step)) = value.split_once('/') else {
            return Ok(one(name, normal, number(value).ok_or_else(wrong)?));
        };
        let (from, to) = range.split_once("..").ok_or_else(wrong)?;
        let numbers = (number(from), number(to), number(step));
        let (Some(from), Some(to), Some(step)) = numbers else { return Err(wrong()) };
        let steps = DecimalSteps::new(from, step);
        // The quotient of doubles may be off by one from the exact number of steps.
        let quotient = ((to - from) / step).floor();
        if !(step > 0.0 && from <= to && quotient < f64::from(u32::MAX - 1)) {
            let expected = "FROM..TO/STEP with a step above 0, and fewer than 2^32 steps";
            return Err(Error::invalid("planes", text, expected));
        }
        let near = quotient as i64 - 1..=quotient as i64 + 1;
        let count =
            near.filter(|number| steps.value(*number) <= to).max().map_or(1, |last| last.max(0) as u32 + 1);
        Ok(SectionPlanes { name: name.into(), normal, steps, count })
    }
}

/// Summary of sections.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SectionSummary {
    /// Number of planes.
    pub planes: u64,
    /// Number of polygons in all planes.
    pub polygons: u64,
    /// Total area, excluding holes.
    pub area: f64,
    /// Objects that were cut one by one, in the model's order, with their total areas.
    pub objects: Vec<(String, f64)>,
}

/// Writes the sections of an exact model as polygons with the attributes `plane` (x, y, z, or the
/// normal), `at` (the coordinate, or the dot product of the normal with its points) and `area`.
/// Points are in 3D. If `flat`, and always in SVG, they are 2D coordinates in the plane: y and z
/// for x planes, z and x for y planes, x and y for z planes. If `by_object`, each object is cut by
/// itself, and its name is an attribute `object`. Memory is bounded by a single section.
///
/// ```
/// use spinney::{ExactModel, Output};
/// use spinney::export::VectorFormat;
/// use spinney::raw::export::vector::export_section;
/// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
/// # let directory = tempfile::tempdir().unwrap();
/// # let [mesh, path, out] = ["tetrahedron.off", "tetrahedron.goblin", "slices.csv"].map(|name| directory.path().join(name));
/// # let text = "OFF\n4 4 0\n0 0 0\n6 0 0\n0 6 0\n0 0 6\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
/// # std::fs::write(&mesh, text).unwrap();
/// # import_exact(open_all(&[mesh], 64 << 20)?, &ExactOptions::new(), Output::create(&path)?, &())?;
/// let model = ExactModel::open(&path, &Default::default())?;
/// let planes = ["z=1..5/2".parse()?];
/// let found = export_section(&model.into(), &planes, (false, false), Output::create(&out)?, VectorFormat::Csv, &())?;
/// assert_eq!((found.polygons, found.area), (3, (25.0 + 9.0 + 1.0) / 2.0));
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If a plane is degenerate, the body is unbounded, the file is corrupt or changed in the meantime,
/// the output cannot be written, or on cancellation.
pub fn export_section(
    view: &ModelView,
    planes: &[SectionPlanes],
    (flat, by_object): (bool, bool),
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<SectionSummary> {
    let is_flat = flat || format == VectorFormat::Svg;
    let mut attributes =
        vec![("plane", AttributeType::Text), ("at", AttributeType::Number), ("area", AttributeType::Number)];
    attributes.extend(by_object.then_some(("object", AttributeType::Text)));
    let layer = VectorLayer {
        name: "section".into(),
        kind: Some(GeometryKind::Polygon),
        is_multi: false,
        has_z: !is_flat,
        attributes: attributes.iter().map(|(name, kind)| ((*name).into(), *kind)).collect(),
        crs: if is_flat { None } else { view.file().crs().cloned() },
        bounds: bounds_of(view, planes, is_flat)?,
    };
    let mut writer = VectorWriter::create(output, format, layer)?;
    let mut made = SectionSummary::default();
    let (names, mut areas) = (view.file().parts(), BTreeMap::new());
    let name = |part: u32| names.get(part as usize).map_or("", String::as_str);
    for planes in planes {
        made.planes += u64::from(planes.count);
        let mut distances = (0..planes.count as usize).map(|number| planes.at(number as u32));
        view.plane_sections(planes.normal, &mut distances, by_object, progress, &mut |number, polygons| {
            let at = planes.at(number as u32);
            let plane = CuttingPlane { normal: planes.normal, distance: at };
            for polygon in polygons {
                (made.polygons, made.area) = (made.polygons + 1, made.area + polygon.area);
                let mut attributes = vec![
                    AttributeValue::Text(&planes.name),
                    AttributeValue::Number(at),
                    AttributeValue::Number(polygon.area),
                ];
                if let Some(part) = polygon.part {
                    attributes.push(AttributeValue::Text(name(part)));
                    *areas.entry(part).or_insert(0.0) += polygon.area;
                }
                match is_flat {
                    true => writer.write(&flattened(&plane, polygon), &attributes)?,
                    false => writer.write(polygon, &attributes)?,
                }
            }
            Ok(())
        })?;
    }
    view.file().check_unchanged()?;
    made.objects = areas.into_iter().map(|(part, area)| (name(part).to_owned(), area)).collect();
    writer.finish(progress).map(|()| made)
}

/// Returns bounds of the section coordinates.
fn bounds_of(view: &ModelView, planes: &[SectionPlanes], is_flat: bool) -> Result<[[f64; 2]; 2]> {
    let [low, high] = view.bounds()?;
    let corners = (0..8).map(|corner| [0, 1, 2].map(|axis| [low, high][corner >> axis & 1][axis]));
    let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for corner in corners {
        for planes in planes {
            let plane = CuttingPlane { normal: planes.normal, distance: 0.0 };
            let [x, y, _] = if is_flat { flat_point(&plane, corner) } else { corner };
            bounds = [[bounds[0][0].min(x), bounds[0][1].min(y)], [bounds[1][0].max(x), bounds[1][1].max(y)]];
        }
    }
    Ok(bounds)
}

/// Returns the coordinates of a point in a plane.
fn flat_point(plane: &CuttingPlane, point: [f64; 3]) -> [f64; 3] {
    let [u, v] = plane.axes();
    let along = |axis: [f64; 3]| (0..3).map(|i| axis[i] * point[i]).sum::<f64>();
    [along(u), along(v), 0.0]
}

fn flattened(plane: &CuttingPlane, polygon: &SectionPolygon) -> SectionPolygon {
    let ring = |ring: &Vec<[f64; 3]>| ring.iter().map(|point| flat_point(plane, *point)).collect();
    SectionPolygon { rings: polygon.rings.iter().map(ring).collect(), area: polygon.area, part: polygon.part }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_read_as_they_are_written() {
        let read = |text: &str| text.parse::<SectionPlanes>();
        assert_eq!(read("y= 2.5 ").unwrap().at(0), 2.5);
        assert_eq!(read("plane=1,1,0,7.5").unwrap().normal, [1.0, 1.0, 0.0]);
        let steps = read("z=0..0.3/0.1").unwrap();
        assert_eq!((steps.count(), steps.at(3)), (4, 0.3));
        for (text, count) in [("z=0..1/0.1", 11), ("z=0..0.2999999/0.1", 3), ("z=-0.3..0.7/0.2", 6)] {
            assert_eq!(read(text).unwrap().count(), count, "{text}");
        }
        for wrong in ["z", "z=", "w=1", "z=nan", "z=0..1", "plane=1,2,3", "plane=1,2,3,4,5", "z=1..inf/1"] {
            let error = read(wrong).unwrap_err().to_string();
            assert!(error.contains(wrong) && error.contains("FROM..TO/STEP, or plane="), "{error}");
        }
        for wrong in ["z=0..1/0", "z=1..0/1", "z=0..1/-1", "z=0..1/1e-12"] {
            let error = read(wrong).unwrap_err().to_string();
            assert!(error.contains(wrong) && error.contains("a step above 0"), "{error}");
        }
    }
}
