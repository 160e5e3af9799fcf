//! Headers of opened files, for JavaScript.

use serde_json::{Value, json};
use spinney_base::Result;
use spinney_base::space::Bounds;
use spinney_base::value::Number;
use spinney_brep::{Faces, ModelView};
use spinney_container::{Metadata, Tag};
use spinney_crs::{Crs, Frame, Transformation};
use spinney_engine::dataset::Dataset;
use spinney_report::{JsonNumbers, commit_as_json};

use crate::files::{Content, Opened};
use crate::result::{count, sample};

/// Returns the header of an open file.
///
/// # Errors
/// If a layer is corrupt.
pub(crate) fn of(opened: &Opened) -> Result<Value> {
    match &opened.content {
        Content::Cells(tree) => of_cells(tree),
        Content::Model(model) => of_model(model),
    }
}

fn of_cells(tree: &Dataset) -> Result<Value> {
    let (header, metadata) = (tree.header(), tree.metadata());
    let (axes, value) = (header.form.axes(), header.form.value);
    let frame = &metadata.frame;
    let [low, high] = frame.world_box(&header.extent_bounds());
    let class = |value: &Number| {
        let name = metadata.class_names.get(value);
        json!({ "value": sample(*value, header.form.value.sample), "name": name, "colour": colour(metadata, value) })
    };
    let mut classes: Vec<Value> = metadata.class_names.keys().map(class).collect();
    if let (Some(palette), true) = (&metadata.palette, classes.is_empty()) {
        classes = (0..palette.colours.len()).map(|value| class(&Number::from(value as u64))).collect();
    }
    let layers = tree.layers()?;
    let layers: Vec<Value> = layers
        .iter()
        .map(|layer| {
            let header = &layer.header;
            let size: Vec<Value> = header.extent[..axes].iter().map(|cells| count(*cells)).collect();
            json!({
                "name": layer.name, "sampleType": header.form.value.sample.name(), "channels": header.form.value.channels,
                "meaning": header.kind.name(), "size": size, "levels": header.depth() + 1,
            })
        })
        .collect();
    let bounds: Vec<f64> = low[..axes].iter().chain(&high[..axes]).copied().collect();
    Ok(json!({
        "kind": if axes == 2 { "raster" } else { "volume" },
        "format": tree.format().name().to_lowercase(),
        "codec": header.codec.name(),
        "dimension": axes,
        "size": header.extent[..axes].iter().map(|cells| count(*cells)).collect::<Vec<_>>(),
        "depth": header.depth(),
        "levels": header.depth() + 1,
        "sampleType": value.sample.name(),
        "channels": value.channels,
        "meaning": header.kind.name(),
        "rule": header.rule.name(),
        "noData": metadata.nodata.map(|number| sample(number, value.sample)),
        "crs": frame.crs.as_ref().map(crs_json),
        "unit": unit(metadata),
        "bounds": bounds,
        "geographicBounds": geographic_bounds(frame, &header.extent_bounds()),
        "transform": if axes == 2 { json!(frame.affine()) } else { Value::Null },
        "matrix": frame.matrix,
        "channelNames": metadata.band_names,
        "scaleOffset": metadata.scale_offset,
        "units": metadata.units,
        "classes": classes,
        "tags": metadata.tags,
        "provenance": metadata.provenance,
        "layer": metadata.name,
        "layerNumber": tree.layer_number(),
        "time": metadata.time,
        "layers": layers,
        "commit": tree.commit().map(|commit| commit_as_json(commit, JsonNumbers::Marked)),
        "bytes": tree.file_size(),
        "remark": tree.remark(),
    }))
}

fn of_model(view: &ModelView) -> Result<Value> {
    let model = view.file();
    let metadata = model.metadata();
    // (An unbounded body has no bounds.)
    let bounds = if model.is_unbounded() { None } else { Some(view.bounds()?) };
    Ok(json!({
        "kind": "model",
        "format": "goblin",
        "codec": model.codec().name(),
        "dimension": 3,
        "faces": count(model.len()),
        "depth": model.depth(),
        "bounds": bounds.map(|[low, high]| [low, high].concat()),
        "crs": model.crs().map(crs_json),
        "unit": metadata.tag(Tag::Unit),
        "objects": model.parts(),
        "levels": crate::model::levels(model),
        "tags": metadata.tags,
        "provenance": metadata.provenance,
        "bytes": model.file_size(),
    }))
}

fn colour(metadata: &Metadata, value: &Number) -> Option<[u8; 4]> {
    let palette = metadata.palette.as_ref()?;
    palette.colours.get(usize::try_from(value.to_integer()?).ok()?).copied()
}

/// Returns the unit of a tree's world coordinates: that of the model, or of the coordinate system;
/// cells without georeferencing.
fn unit(metadata: &Metadata) -> Option<&str> {
    metadata.tag(Tag::Unit).or_else(|| match &metadata.frame.crs {
        Some(crs) => crs.unit(),
        None => metadata.frame.is_identity().then_some("cells"),
    })
}

fn crs_json(crs: &Crs) -> Value {
    json!({
        "name": crs.name(),
        "epsg": crs.numbers().map(|epsg| epsg.horizontal),
        "definition": crs.definition(),
    })
}

/// Returns west, south, east and north of a raster in degrees, if known.
fn geographic_bounds(frame: &Frame, extent: &Bounds) -> Option<[f64; 4]> {
    /// Subdivisions of each side: lines that are straight in one system are curves in the other.
    const STEPS: u32 = 32;
    let way = Transformation::new(frame.crs.as_ref()?, &Crs::epsg(4326), true).ok()?;
    let [width, height, _] = extent.max.map(|cells| cells as f64);
    let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for step in 0..=STEPS {
        let share = f64::from(step) / f64::from(STEPS);
        let (x, y) = (share * width, share * height);
        for [x, y] in [[x, 0.0], [x, height], [0.0, y], [width, y], [x, height / 2.0]] {
            let [x, y, _] = frame.to_world([x, y, 0.0]);
            let [lon, lat] = way.forward([x, y])?;
            bounds = [bounds[0].min(lon), bounds[1].min(lat), bounds[2].max(lon), bounds[3].max(lat)];
        }
    }
    bounds.iter().all(|number| number.is_finite()).then_some(bounds)
}
