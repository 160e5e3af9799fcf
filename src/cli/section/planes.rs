//! `spinney section MODEL PLANE...`: where planes cut an exact model.

use anyhow::{Context as _, Result};
use spinney::Progress as _;
use spinney::brep::query::{CuttingPlane, SectionPolygon};
use spinney::brep::{ExactModel, Faces};
use spinney::export::vector::{
    AttributeType, AttributeValue, GeometryKind, VectorFormat, VectorLayer, VectorWriter,
};

use super::Args;
use crate::cli::Global;
use crate::cli::args::{number, numbers};
use crate::cli::report::Work;

/// Parallel planes: the normal, and the distances from the first on.
#[derive(Clone, Debug)]
pub(super) struct Planes {
    name: String,
    normal: [f64; 3],
    first: f64,
    step: f64,
    count: u32,
}

impl Planes {
    fn at(&self, number: u32) -> f64 {
        // (Steps of 0.2 as a decimal fraction has them: sums would drift away.)
        self.first + f64::from(number) * self.step
    }
}

/// Reads planes as they are written on the command line.
pub(super) fn parse_planes(text: &str) -> Result<Planes, String> {
    let wrong = || "expected x=, y= or z= with a number or FROM..TO/STEP, or plane=NX,NY,NZ,D".to_string();
    let (name, value) = text.split_once('=').ok_or_else(wrong)?;
    let one = |name: &str, normal: [f64; 3], first: f64| match first.is_finite() {
        true => Ok(Planes { name: name.into(), normal, first, step: 0.0, count: 1 }),
        false => Err(wrong()),
    };
    if name == "plane" {
        let [x, y, z, at] = numbers(value).ok_or_else(wrong)?;
        return one(&format!("{x},{y},{z}"), [x, y, z], at);
    }
    let axis = ["x", "y", "z"].iter().position(|axis| *axis == name).ok_or_else(wrong)?;
    let normal = CuttingPlane::across(axis, 0.0).normal;
    let Some((range, step)) = value.split_once('/') else {
        return one(name, normal, number(value)?);
    };
    let (from, to) = range.split_once("..").ok_or_else(wrong)?;
    let (from, to, step): (f64, f64, f64) = (number(from)?, number(to)?, number(step)?);
    // (The last one counts although steps are not quite what they are written as.)
    let steps = ((to - from) / step + 1e-9).floor();
    if !(from.is_finite() && step > 0.0 && (0.0..f64::from(u32::MAX)).contains(&steps)) {
        return Err("expected FROM..TO/STEP with a step above 0, and less than 2^32 steps".into());
    }
    Ok(Planes { name: name.into(), normal, first: from, step, count: steps as u32 + 1 })
}

/// Writes the sections; says what there is.
pub(super) fn write(
    args: &Args,
    model: &ExactModel,
    planes: &[Planes],
    format: VectorFormat,
    global: &Global,
) -> Result<String> {
    let is_flat = args.flat || format == VectorFormat::Svg;
    let attributes =
        [("plane", AttributeType::Text), ("at", AttributeType::Number), ("area", AttributeType::Number)];
    let [low, high] = model.bounds()?;
    let corners = (0..8).map(|corner| [0, 1, 2].map(|axis| [low, high][corner >> axis & 1][axis]));
    let cutting = || planes.iter().map(|planes| CuttingPlane { normal: planes.normal, distance: 0.0 });
    let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for corner in corners {
        for plane in cutting() {
            let [x, y, _] = if is_flat { flat(&plane, corner) } else { corner };
            bounds = [[bounds[0][0].min(x), bounds[0][1].min(y)], [bounds[1][0].max(x), bounds[1][1].max(y)]];
        }
    }
    let layer = VectorLayer {
        name: "section".into(),
        kind: Some(GeometryKind::Polygon),
        has_z: !is_flat,
        attributes: attributes.iter().map(|(name, kind)| ((*name).into(), *kind)).collect(),
        crs: if is_flat { None } else { model.crs().cloned() },
        bounds,
    };
    let work = Work::start(global, "planes")?;
    let write = || -> Result<[f64; 2]> {
        let remark = layer.remark(format);
        let mut writer = VectorWriter::create(args.limit.create(&args.output)?, format, layer)?;
        remark.iter().for_each(|remark| work.warn(&args.output, remark));
        let (mut count, mut area) = (0.0, 0.0);
        for planes in planes {
            let mut distances = (0..planes.count as usize).map(|number| planes.at(number as u32));
            model.plane_sections(planes.normal, &mut distances, &work, &mut |number, polygons| {
                let at = planes.at(number as u32);
                let plane = CuttingPlane { normal: planes.normal, distance: at };
                for polygon in polygons {
                    (count, area) = (count + 1.0, area + polygon.area);
                    let attributes = [
                        AttributeValue::Text(&planes.name),
                        AttributeValue::Number(at),
                        AttributeValue::Number(polygon.area),
                    ];
                    match is_flat {
                        true => writer.write(&flattened(&plane, polygon), &attributes)?,
                        false => writer.write(polygon, &attributes)?,
                    }
                }
                Ok(())
            })?;
        }
        model.check_unchanged()?;
        writer.finish()?;
        Ok([count, area])
    };
    let [count, area] = write().with_context(|| format!("cannot write {}", args.output.display()))?;
    work.finish();
    let planes: u64 = planes.iter().map(|planes| u64::from(planes.count)).sum();
    Ok(format!("{count} polygons in {planes} planes, with an area of {area}"))
}

/// A point by its place in a plane.
fn flat(plane: &CuttingPlane, point: [f64; 3]) -> [f64; 3] {
    let [u, v] = plane.axes();
    let along = |axis: [f64; 3]| (0..3).map(|i| axis[i] * point[i]).sum::<f64>();
    [along(u), along(v), 0.0]
}

fn flattened(plane: &CuttingPlane, polygon: &SectionPolygon) -> SectionPolygon {
    let ring = |ring: &Vec<[f64; 3]>| ring.iter().map(|point| flat(plane, *point)).collect();
    SectionPolygon { rings: polygon.rings.iter().map(ring).collect(), area: polygon.area }
}
