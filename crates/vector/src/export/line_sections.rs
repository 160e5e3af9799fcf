//! Vertical sections of exact models along lines, object by object.

use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

use super::{AttributeType, AttributeValue, GeometryKind, VectorFormat, VectorLayer, VectorWriter};
use crate::import::feature::{FeatureGeometry, FeatureOptions, open_features};
use spinney_base::io::{Output, shown};
use spinney_base::{Error, Progress, Result, SilentProgress};
use spinney_brep::query::SectionPolygon;
use spinney_brep::{Faces, ModelView};
use spinney_crs::Crs;
use spinney_overlay::{OverlayGrid, PolygonOverlay};
use spinney_tin::{SurfaceInput, triangulate};

/// Maximum area of a polygon that is a line but for rounding, relative to its squared extent.
/// Vertices are rounded to 2^-53 of the coordinates, which may be 2^20 times the extent.
const FLAT: f64 = 1e-9;
/// Maximum width of triangles that rounding of vertices makes, relative to a polygon's extent.
const SLIVER: f64 = 1e-11;

/// Line in the plane, along which a vertical section is made: in text form `X,Y,X,Y,...`.
#[derive(Clone, Debug, PartialEq)]
pub struct SectionLine {
    /// Two vertices or more; consecutive ones differ.
    points: Vec<[f64; 2]>,
}

impl SectionLine {
    /// Creates a line of vertices.
    ///
    /// # Errors
    /// If a coordinate is not finite, or there are no two different vertices.
    pub fn new(mut points: Vec<[f64; 2]>) -> Result<SectionLine> {
        if let Some(point) = points.iter().find(|point| point.iter().any(|at| !at.is_finite())) {
            return Err(Error::invalid("line of a section", format!("{point:?}"), "finite coordinates"));
        }
        points.dedup();
        if points.len() < 2 {
            let found = format!("{} different vertices", points.len());
            return Err(Error::invalid("line of a section", found, "at least two"));
        }
        Ok(SectionLine { points })
    }

    /// Reads the only line of a feature file, or a line through all of its points, in order. Also
    /// returns its coordinate system.
    ///
    /// # Errors
    /// Those of [`open_features`] and [`SectionLine::new`]; if there are several lines.
    pub fn read(path: &Path) -> Result<(SectionLine, Option<Crs>)> {
        let advice = "a section has one line, or points that are its vertices";
        let mut reader = open_features(path, &FeatureOptions::default())?;
        let (mut points, mut is_line): (Vec<[f64; 2]>, _) = (Vec::new(), false);
        while let Some(feature) = reader.next()? {
            match feature.geometry {
                None => {}
                Some(FeatureGeometry::Lines(lines)) => {
                    if is_line || !points.is_empty() || lines.len() > 1 {
                        return Err(Error::unsupported(path, "several lines", advice));
                    }
                    is_line = true;
                    points = lines.into_iter().next().unwrap_or_default();
                }
                Some(FeatureGeometry::Points(more)) if !is_line => points.extend(more),
                Some(_) => return Err(Error::unsupported(path, "geometries of other kinds", advice)),
            }
        }
        let line = SectionLine::new(points).map_err(|error| match error {
            Error::Invalid { what, found, expected } => {
                Error::invalid(format!("{}: {what}", shown(path)), found, expected)
            }
            error => error,
        })?;
        Ok((line, reader.schema().crs.clone()))
    }

    fn segments(&self) -> impl Iterator<Item = Segment> + '_ {
        let mut from = 0.0;
        self.points.windows(2).map(move |ends| {
            let along = [0, 1].map(|axis| ends[1][axis] - ends[0][axis]);
            let length = along[0].hypot(along[1]);
            let segment = Segment { start: ends[0], along, length, from };
            from += length;
            segment
        })
    }
}

impl FromStr for SectionLine {
    type Err = Error;

    fn from_str(text: &str) -> Result<SectionLine> {
        let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
        let numbers = numbers.filter(|numbers| numbers.len().is_multiple_of(2)).ok_or_else(|| {
            Error::invalid("line of a section", text, "an existing file, or coordinates as in X,Y,X,Y")
        })?;
        SectionLine::new(numbers.chunks_exact(2).map(|point| [point[0], point[1]]).collect())
    }
}

/// A segment of a line.
struct Segment {
    start: [f64; 2],
    along: [f64; 2],
    length: f64,
    /// Distance of its start along the line.
    from: f64,
}

impl Segment {
    /// Converts a point in the segment's plane to distance along the line and height.
    fn flat(&self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        let along = (x - self.start[0]) * self.along[0] + (y - self.start[1]) * self.along[1];
        [self.from + along / self.length, z]
    }

    fn world(&self, [distance, height]: [f64; 2]) -> [f64; 3] {
        let share = (distance - self.from) / self.length;
        let [x, y] = [0, 1].map(|axis| self.start[axis] + share * self.along[axis]);
        [x, y, height]
    }

    /// Returns the parts of a polygon between the segment's ends, in distances and heights, each
    /// with its area.
    fn clipped(&self, polygon: &SectionPolygon, path: &Path) -> Result<Vec<FlatPolygon>> {
        /// Memory for a polygon's edges, in bytes.
        const MEMORY: u64 = 1 << 30;
        let rings: Vec<Vec<[f64; 2]>> =
            polygon.rings.iter().map(|ring| ring.iter().map(|point| self.flat(*point)).collect()).collect();
        let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for point in rings.iter().flatten() {
            for axis in 0..2 {
                bounds[0][axis] = bounds[0][axis].min(point[axis]);
                bounds[1][axis] = bounds[1][axis].max(point[axis]);
            }
        }
        let [low, high] = bounds;
        let end = self.from + self.length;
        if low[0] >= self.from && high[0] <= end {
            return Ok(vec![FlatPolygon { rings, area: polygon.area }]);
        }
        if low[0] >= end || high[0] <= self.from {
            return Ok(Vec::new());
        }
        // (Relative to the segment's start, so that the overlay's grid is fine.)
        let relative = |[distance, height]: [f64; 2]| [distance - self.from, height - low[1]];
        let back = |[distance, height]: [f64; 2]| [distance + self.from, height + low[1]];
        let moved = |ring: &Vec<[f64; 2]>| ring.iter().map(|point| relative(*point)).collect();
        let rings: Vec<Vec<[f64; 2]>> = rings.iter().map(moved).collect();
        let largest = rings.iter().flatten().flatten().fold(self.length, |most, at| most.max(at.abs()));
        let mut overlay = PolygonOverlay::new(OverlayGrid::for_coordinates(2.0 * largest), MEMORY);
        overlay.add(path, 0, &rings)?;
        let [bottom, top] = [-largest, largest.max(high[1] - low[1]) + largest];
        let ends = vec![[0.0, bottom], [self.length, bottom], [self.length, top], [0.0, top]];
        overlay.add(path, 1, &[ends])?;
        let mut found = Vec::new();
        overlay.regions(&mut |sources| (sources == [0, 1]).then(|| vec![0]), &(), &mut |region| {
            for rings in region.polygons {
                let area = rings.iter().map(|ring| signed_area(ring)).sum();
                let rings = rings.iter().map(|ring| ring.iter().map(|point| back(*point)).collect());
                found.push(FlatPolygon { rings: rings.collect(), area });
            }
            Ok(())
        })?;
        Ok(found)
    }
}

/// A polygon in distances along a line and heights: an outer ring, counterclockwise, and holes.
struct FlatPolygon {
    rings: Vec<Vec<[f64; 2]>>,
    area: f64,
}

impl FlatPolygon {
    /// Returns the triangles of a constrained Delaunay triangulation, counterclockwise, without
    /// slivers: between vertices that are on a line but for rounding errors, on both of its sides.
    fn triangles(self) -> Result<Vec<[[f64; 2]; 3]>> {
        let points: Vec<[f64; 3]> = self.rings.iter().flatten().map(|[x, y]| [*x, *y, 0.0]).collect();
        let extent = points.iter().flat_map(|point| [0, 1].map(|axis| (point[axis] - points[0][axis]).abs()));
        let extent = extent.fold(0.0, f64::max);
        let input = SurfaceInput { points, outlines: vec![self.rings], ..SurfaceInput::default() };
        let tin = match triangulate(&input) {
            Ok((tin, _)) => tin,
            // (A polygon that is a line, but for rounding errors.)
            Err(Error::Invalid { .. }) if self.area.abs() <= FLAT * extent * extent => return Ok(Vec::new()),
            Err(error) => return Err(error),
        };
        let positions: Vec<[f64; 2]> = tin.vertices().map(|[x, y, _]| [x, y]).collect();
        let is_wide = |[a, b, c]: &[[f64; 2]; 3]| {
            let sides = [(a, b), (b, c), (c, a)].map(|(a, b)| (b[0] - a[0]).hypot(b[1] - a[1]));
            let longest = sides.into_iter().fold(0.0, f64::max);
            2.0 * signed_area(&[*a, *b, *c, *a]) > SLIVER * extent * longest
        };
        let triangles =
            tin.triangles().iter().map(|corners| corners.map(|corner| positions[corner as usize]));
        Ok(triangles.filter(is_wide).collect())
    }
}

/// Returns the area of a closed ring, positive if counterclockwise.
fn signed_area(ring: &[[f64; 2]]) -> f64 {
    let Some(origin) = ring.first() else { return 0.0 };
    let to = |point: &[f64; 2]| [point[0] - origin[0], point[1] - origin[1]];
    let twice = ring.windows(2).map(|ends| {
        let (a, b) = (to(&ends[0]), to(&ends[1]));
        a[0] * b[1] - a[1] * b[0]
    });
    twice.sum::<f64>() / 2.0
}

/// Output of a vertical section.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LineSectionOptions {
    /// Coordinates are the distance along the line and the height, instead of those of the model.
    pub flat: bool,
    /// Polygons are divided into triangles, which have no new vertices.
    pub triangles: bool,
}

/// A polygon or triangle of a vertical section.
#[derive(Clone, Debug, PartialEq)]
pub struct LineSectionFigure<'a> {
    /// Name of the object that is cut.
    pub object: &'a str,
    /// Number of the line's segment, from 1.
    pub segment: u32,
    /// Closed rings, the outer one first.
    pub rings: Vec<Vec<[f64; 3]>>,
    /// Area, without holes.
    pub area: f64,
}

/// Summary of a vertical section.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LineSectionSummary {
    /// Number of segments of the line.
    pub segments: u64,
    /// Number of polygons or triangles.
    pub figures: u64,
    /// Objects that are cut, in the model's order, with the area of their section.
    pub objects: Vec<(String, f64)>,
}

/// Cuts each object of a model by the vertical planes through the segments of a line, between the
/// segments' ends. Polygons are counterclockwise as seen from the right of the line. A plane along
/// a wall of the model cuts bodies at its left only. Memory is bounded by the section of a segment.
///
/// # Errors
/// If an object is not closed, the file is corrupt, or on cancellation; those of `each`.
pub fn line_section(
    view: &ModelView,
    line: &SectionLine,
    options: &LineSectionOptions,
    progress: &dyn Progress,
    each: &mut dyn FnMut(&LineSectionFigure<'_>) -> Result<()>,
) -> Result<LineSectionSummary> {
    let names = view.file().parts();
    let mut summary = LineSectionSummary::default();
    let mut areas: BTreeMap<u32, f64> = BTreeMap::new();
    let total = line.points.len() as u64 - 1;
    for (number, segment) in (1..).zip(line.segments()) {
        progress.check()?;
        summary.segments += 1;
        // From the right of the line, distances grow to the right.
        let normal = [segment.along[1], -segment.along[0], 0.0];
        let distance = normal[0] * segment.start[0] + normal[1] * segment.start[1];
        let place = |ring: &[[f64; 2]]| -> Vec<[f64; 3]> {
            let point = |at: &[f64; 2]| if options.flat { [at[0], at[1], 0.0] } else { segment.world(*at) };
            ring.iter().map(point).collect()
        };
        let work = SilentProgress(progress);
        view.plane_sections(normal, &mut [distance].into_iter(), true, &work, &mut |_, polygons| {
            for polygon in polygons {
                let part = polygon.part.unwrap_or_default();
                let object = names.get(part as usize).map_or("", String::as_str);
                for flat in segment.clipped(polygon, view.file().path())? {
                    *areas.entry(part).or_default() += flat.area;
                    let figures: Vec<(Vec<Vec<[f64; 3]>>, f64)> = match options.triangles {
                        false => vec![(flat.rings.iter().map(|ring| place(ring)).collect(), flat.area)],
                        true => {
                            let closed = |[a, b, c]: [[f64; 2]; 3]| [a, b, c, a];
                            let triangles = flat.triangles()?.into_iter().map(closed);
                            triangles.map(|ring| (vec![place(&ring)], signed_area(&ring))).collect()
                        }
                    };
                    for (rings, area) in figures {
                        summary.figures += 1;
                        each(&LineSectionFigure { object, segment: number, rings, area })?;
                    }
                }
            }
            Ok(())
        })?;
        progress.advance(1, total);
    }
    view.file().check_unchanged()?;
    let name = |part: u32| names.get(part as usize).cloned().unwrap_or_default();
    summary.objects = areas.into_iter().map(|(part, area)| (name(part), area)).collect();
    Ok(summary)
}

/// Writes a vertical section as polygons with the attributes `object`, `segment` and `area`.
///
/// # Errors
/// Those of [`line_section`]; if the output cannot be written.
pub fn export_line_section(
    view: &ModelView,
    line: &SectionLine,
    options: &LineSectionOptions,
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<LineSectionSummary> {
    let flat = options.flat || format == VectorFormat::Svg;
    let options = LineSectionOptions { flat, ..*options };
    let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    let mut reach = |point: [f64; 2]| {
        for axis in 0..2 {
            bounds[0][axis] = bounds[0][axis].min(point[axis]);
            bounds[1][axis] = bounds[1][axis].max(point[axis]);
        }
    };
    if flat {
        let [low, high] = view.bounds()?;
        reach([0.0, low[2]]);
        reach([line.segments().map(|segment| segment.length).sum(), high[2]]);
    } else {
        line.points.iter().for_each(|point| reach(*point));
    }
    let attributes = [
        ("object", AttributeType::Text),
        ("segment", AttributeType::Integer),
        ("area", AttributeType::Number),
    ];
    let layer = VectorLayer {
        name: "section".into(),
        kind: Some(GeometryKind::Polygon),
        is_multi: false,
        has_z: !flat,
        attributes: attributes.iter().map(|(name, kind)| ((*name).into(), *kind)).collect(),
        crs: if flat { None } else { view.file().crs().cloned() },
        bounds,
    };
    let mut writer = VectorWriter::create(output, format, layer)?;
    let summary = line_section(view, line, &options, progress, &mut |figure| {
        let attributes = [
            AttributeValue::Text(figure.object),
            AttributeValue::Integer(figure.segment.into()),
            AttributeValue::Number(figure.area),
        ];
        writer.write(&figure.rings, &attributes)
    })?;
    writer.finish(progress)?;
    Ok(summary)
}
