//! Regions of a class tree as features: polygons along cell borders.

use std::path::PathBuf;

use super::{AttributeType, AttributeValue, Geometry, GeometryKind, VectorFormat, VectorLayer, VectorWriter};
use spinney_base::io::Output;
use spinney_base::value::Number;
use spinney_base::{Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ClassRegion, PolygonRequest, PolygonSummary};

/// A region with the outer rings of its polygons.
struct Region<'a> {
    region: &'a ClassRegion<'a>,
    /// Indices of the outer rings, in order.
    outer: Vec<usize>,
}

impl<'a> Region<'a> {
    fn new(region: &'a ClassRegion<'a>) -> Region<'a> {
        let mut next = 0;
        let begin = |rings: &usize| {
            next += rings;
            next - rings
        };
        Region { region, outer: region.polygons().iter().map(begin).collect() }
    }
}

impl Geometry for Region<'_> {
    fn parts(&self) -> usize {
        self.region.parts()
    }

    fn count(&self, part: usize) -> u64 {
        self.region.count(part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        self.region.points(part, each)
    }

    fn is_outer(&self, part: usize) -> bool {
        self.outer.binary_search(&part).is_ok()
    }
}

/// Writes the regions of a class quadtree, one polygon each, or several for regions that are
/// connected only at corners.
///
/// Attributes are `class` (an integer; a string for 64-bit integers, a number for floating-point
/// samples), `cells` (an integer), `area_m2` where the coordinate system determines square metres,
/// and, if the tree has them, `name` and `color` (`#rrggbb`).
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::{VectorFormat, export_polygons};
/// use spinney::Output;
/// use spinney::query::PolygonRequest;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("regions.geojson");
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let output = Output::create(&path)?;
/// let made = export_polygons(&map, &PolygonRequest::new(), output, VectorFormat::GeoJson, &())?;
/// assert!(made.count > 0);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the tree is not categorical or is corrupt, the request is invalid, the output cannot be
/// written, or on cancellation.
pub fn export_polygons(
    tree: &Dataset,
    request: &PolygonRequest,
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<PolygonSummary> {
    let mut request = request.clone();
    let path = output.path().to_path_buf();
    if output.is_file() {
        // Temporary files of incomplete borders are in the output's directory.
        let directory = path.parent().filter(|directory| !directory.as_os_str().is_empty());
        request.directory = Some(directory.map_or_else(|| ".".into(), PathBuf::from));
    }
    let metadata = tree.metadata();
    let [low, high] = metadata.frame.world_box(&tree.header().extent_bounds());
    let (has_names, has_colours) = (!metadata.class_names.is_empty(), metadata.palette.is_some());
    // GeoJSON numbers are read in double precision, so 64-bit integers are written as strings,
    // which are exact.
    let sample = tree.header().form.value.sample;
    let above = tree.depth().saturating_sub(request.level.unwrap_or(tree.depth()));
    let cell_area = metadata.frame.coarser(above).cell_square_metres().ok();
    let is_wide = !sample.is_float() && sample.size() > 4;
    let attributes = [
        (!is_wide && !sample.is_float(), "class", AttributeType::Integer),
        (sample.is_float(), "class", AttributeType::Number),
        (is_wide, "class", AttributeType::Text),
        (true, "cells", AttributeType::Integer),
        (cell_area.is_some(), "area_m2", AttributeType::Number),
        (has_names, "name", AttributeType::Text),
        (has_colours, "color", AttributeType::Text),
    ];
    let attributes = attributes.into_iter().filter(|(is_there, ..)| *is_there);
    let layer = VectorLayer {
        name: "regions".into(),
        kind: Some(GeometryKind::Polygon),
        is_multi: request.across_corners,
        has_z: false,
        attributes: attributes.map(|(_, name, kind)| (name.to_owned(), kind)).collect(),
        crs: metadata.frame.crs.clone(),
        bounds: [[low[0], low[1]], [high[0], high[1]]],
    };
    let mut writer = VectorWriter::create(output, format, layer)?;
    let summary = tree.polygons(&request, progress, &mut |region| {
        let class = region.class();
        let name = metadata.class_names.get(&class);
        let colour = colour_of(tree, class);
        let digits = class.to_string();
        let number = match class.to_integer().and_then(|number| i64::try_from(number).ok()) {
            _ if is_wide => AttributeValue::Text(&digits),
            Some(number) if !sample.is_float() => AttributeValue::Integer(number),
            _ => AttributeValue::Number(class.to_f64()),
        };
        let cells = i64::try_from(region.cells()).unwrap_or(i64::MAX);
        let mut values = vec![number, AttributeValue::Integer(cells)];
        values.extend(cell_area.map(|area| AttributeValue::Number(area * region.cells() as f64)));
        if has_names {
            values.push(name.map_or(AttributeValue::None, |name| AttributeValue::Text(name)));
        }
        if has_colours {
            values.push(colour.as_deref().map_or(AttributeValue::None, AttributeValue::Text));
        }
        writer.write(&Region::new(region), &values)
    })?;
    writer.finish(progress).map(|()| summary)
}

/// Returns the tree's colour of a class.
fn colour_of(tree: &Dataset, class: Number) -> Option<String> {
    let palette = tree.metadata().palette.as_ref()?;
    let [red, green, blue, _] = *palette.colours.get(usize::try_from(class.to_integer()?).ok()?)?;
    Some(format!("#{red:02x}{green:02x}{blue:02x}"))
}
