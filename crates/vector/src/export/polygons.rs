//! Regions of a tree of classes, as features: polygons along the borders of its cells.

use std::path::PathBuf;

use super::{AttributeType, AttributeValue, Geometry, GeometryKind, VectorFormat, VectorLayer, VectorWriter};
use spinney_base::io::Output;
use spinney_base::value::Number;
use spinney_base::{Error, Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ClassRegion, PolygonRequest, PolygonSummary};

impl Geometry for ClassRegion<'_> {
    fn parts(&self) -> usize {
        ClassRegion::parts(self)
    }

    fn count(&self, part: usize) -> u64 {
        ClassRegion::count(self, part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        ClassRegion::points(self, part, each)
    }
}

/// Writes the regions of a quadtree of classes, one polygon each, with the attributes `class` (of integers of 64 bits as text), `cells`, and where the tree has them `name` and
/// `color` (`#rrggbb`).
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::vector::{VectorFormat, export_polygons};
/// use spinney::io::Output;
/// use spinney::query::PolygonRequest;
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("regions.geojson");
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let output = Output::create(&path)?;
/// let made = export_polygons(&map, &PolygonRequest::new(), output, VectorFormat::GeoJson, &())?;
/// assert!(made.count > 0);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the tree is not of classes or is damaged, the request makes no sense or has regions of several polygons (those that hang together by corners alone), the
/// output cannot be written, or on interruption.
pub fn export_polygons(
    tree: &Dataset,
    request: &PolygonRequest,
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<PolygonSummary> {
    if request.across_corners {
        let advice = "take regions by edges: those that touch in corners are features of their own";
        return Err(Error::unsupported(output.path(), "features of several polygons", advice));
    }
    let mut request = request.clone();
    let path = output.path().to_path_buf();
    if output.is_file() {
        // Borders that wait for their ends do so beside the output.
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        request.folder = Some(folder.map_or_else(|| ".".into(), PathBuf::from));
    }
    let metadata = tree.metadata();
    let [low, high] = metadata.frame.world_box(&tree.header().picture());
    let (has_names, has_colours) = (!metadata.class_names.is_empty(), metadata.palette.is_some());
    // (Numbers of files are double precision: integers of 64 bits are texts, which lose nothing.)
    let sample = tree.header().form.value.sample;
    let is_wide = !sample.is_float() && sample.size() > 4;
    let attributes = [
        (!is_wide, "class", AttributeType::Number),
        (is_wide, "class", AttributeType::Text),
        (true, "cells", AttributeType::Number),
        (has_names, "name", AttributeType::Text),
        (has_colours, "color", AttributeType::Text),
    ];
    let attributes = attributes.into_iter().filter(|(is_there, ..)| *is_there);
    let layer = VectorLayer {
        name: "regions".into(),
        kind: Some(GeometryKind::Polygon),
        is_multi: false,
        has_z: false,
        attributes: attributes.map(|(_, name, kind)| (name.to_owned(), kind)).collect(),
        crs: metadata.frame.crs.clone(),
        bounds: [[low[0], low[1]], [high[0], high[1]]],
    };
    let remark = layer.remark(format);
    let mut writer = VectorWriter::create(output, format, layer)?;
    remark.iter().for_each(|remark| progress.warn(&path, remark));
    let summary = tree.polygons(&request, progress, &mut |region| {
        let class = region.class();
        let name = metadata.class_names.get(&class);
        let colour = colour_of(tree, class);
        let digits = class.to_string();
        let number = match is_wide {
            true => AttributeValue::Text(&digits),
            false => AttributeValue::Number(class.to_f64()),
        };
        let mut values = vec![number, AttributeValue::Number(region.cells() as f64)];
        if has_names {
            values.push(name.map_or(AttributeValue::None, |name| AttributeValue::Text(name)));
        }
        if has_colours {
            values.push(colour.as_deref().map_or(AttributeValue::None, AttributeValue::Text));
        }
        writer.write(region, &values)
    })?;
    writer.finish().map(|()| summary)
}

/// The colour that the tree has for a class.
fn colour_of(tree: &Dataset, class: Number) -> Option<String> {
    let palette = tree.metadata().palette.as_ref()?;
    let [red, green, blue, _] = *palette.colours.get(usize::try_from(class.to_integer()?).ok()?)?;
    Some(format!("#{red:02x}{green:02x}{blue:02x}"))
}
