//! `spinney contours`: lines of equal values, and the areas between them; of octrees, surfaces.

mod args;
mod isosurfaces;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, Result};
use spinney::Progress as _;
use spinney::export::vector::{
    AttributeType, AttributeValue, GeometryKind, Smoothed, VectorLayer, VectorWriter,
};
use spinney::io::Output;
use spinney::query::{Contour, ContourLevels, ContourNodata, ContourRequest};

pub(crate) use self::args::Args;
use self::args::Nodata;
use super::args::{check_output, level_of, vector_format};
use super::report::{Work, report_output};
use super::{Global, exact};

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    if exact::open(&args.tree.file)?.is_some() {
        exact::refuse(&args.tree.file, &[("contours", true)])?;
    }
    let tree = args.tree.open()?;
    check_output([args.tree.file.as_path()], &args.output)?;
    let levels = match (args.levels.every, &args.levels.levels) {
        (Some(step), _) => ContourLevels::Every { step, base: args.base },
        (None, levels) => ContourLevels::At(levels.clone().unwrap_or_default()),
    };
    let mut request = ContourRequest::new(levels);
    request.level = Some(level_of(&tree, args.level)?);
    request.memory = args.memory.bytes;
    request.nodata = match args.nodata {
        Nodata::Open => ContourNodata::Open,
        Nodata::Extend => ContourNodata::Extend,
        Nodata::Close => ContourNodata::Close,
    };
    if tree.header().form.axes() == 3 {
        return isosurfaces::run(args, &tree, &request, global, start);
    }
    let format = vector_format(args.format.as_deref(), &args.output)?;
    let (kind, name, attributes): (_, _, &[&str]) = match args.bands {
        false => (GeometryKind::Line, "contours", &["value"]),
        true => (GeometryKind::Polygon, "bands", &["min", "max"]),
    };
    let frame = &tree.metadata().frame;
    let [low, high] = frame.world_box(&tree.header().picture());
    let layer = VectorLayer {
        name: name.into(),
        kind: Some(kind),
        has_z: args.has_z,
        attributes: attributes.iter().map(|name| ((*name).into(), AttributeType::Number)).collect(),
        crs: frame.crs.clone(),
        bounds: [[low[0], low[1]], [high[0], high[1]]],
    };
    let work = Work::start(global, "cells")?;
    let output = args.limit.create(&args.output)?;
    if output.is_file() {
        let folder = args.output.parent().filter(|folder| !folder.as_os_str().is_empty());
        request.folder = Some(folder.map_or_else(|| ".".into(), PathBuf::from));
    }
    let write = |output: Output| {
        let remark = layer.remark(format);
        let mut writer = VectorWriter::create(output, format, layer)?;
        remark.iter().for_each(|remark| work.warn(&args.output, remark));
        let mut each = |contour: &Contour<'_>| match args.bands {
            false => {
                let line = Smoothed::new(contour, contour.is_closed(), args.smooth);
                writer.write(&line, &[AttributeValue::Number(contour.value())])
            }
            true => writer.write(contour, &contour.range().map(AttributeValue::Number)),
        };
        let summary = match args.bands {
            false => tree.contours(&request, &work, &mut each),
            true => tree.contour_bands(&request, &work, &mut each),
        }?;
        writer.finish().map(|()| summary)
    };
    let summary = write(output).with_context(|| format!("cannot write {}", args.output.display()))?;
    work.finish();
    let what = if args.bands { "polygons" } else { "lines" };
    global.report(
        "contours",
        format_args!(
            "{} {what} of {} points, {} of {} tiles read",
            summary.count, summary.points, summary.tiles_read, summary.tiles
        ),
    );
    report_output(global, &args.output, start);
    Ok(())
}
