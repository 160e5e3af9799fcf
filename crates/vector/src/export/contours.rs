//! Contour lines of a raster, and the areas between them, as features.

use std::path::PathBuf;

use super::{AttributeType, AttributeValue, GeometryKind, Smoothed, VectorFormat, VectorLayer, VectorWriter};
use spinney_base::io::Output;
use spinney_base::{Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{Contour, ContourRequest, ContourSummary};

/// Conversion of contours to features.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ContourFeatures {
    /// Writes areas between consecutive values, with the attributes min and max, instead of lines
    /// with the attribute value.
    pub filled: bool,
    /// Number of smoothing passes, each of which doubles the points: see [`Smoothed`].
    pub smooth: u8,
    /// Whether points have the value as a third coordinate; for areas, the lower value.
    pub has_z: bool,
}

impl ContourFeatures {
    /// Creates the default: unsmoothed lines in 2D.
    pub fn new() -> ContourFeatures {
        ContourFeatures::default()
    }
}

/// Writes the contours of a quadtree's first channel.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::{VectorFormat, export_contours};
/// use spinney::raw::export::vector::ContourFeatures;
/// use spinney::Output;
/// use spinney::query::{ContourLevels, ContourRequest};
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("lines.geojson");
/// let map = spinney::open("fixtures/v1/elevation.goblin")?;
/// let request = ContourRequest::new(ContourLevels::Every { step: 10.0, base: 0.0 });
/// let (features, output) = (ContourFeatures::new(), Output::create(&path)?);
/// let made = export_contours(&map, &request, &features, output, VectorFormat::GeoJson, &())?;
/// assert!(made.count > 0);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the request is invalid, the values are categorical, the tree is corrupt, the output cannot be
/// written, or on cancellation.
pub fn export_contours(
    tree: &Dataset,
    request: &ContourRequest,
    features: &ContourFeatures,
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<ContourSummary> {
    let mut request = request.clone();
    let path = output.path().to_path_buf();
    if output.is_file() {
        // Temporary files of incomplete lines are in the output's directory.
        let directory = path.parent().filter(|directory| !directory.as_os_str().is_empty());
        request.directory = Some(directory.map_or_else(|| ".".into(), PathBuf::from));
    }
    let (kind, name, attributes): (_, _, &[&str]) = match features.filled {
        false => (GeometryKind::Line, "contours", &["value"]),
        true => (GeometryKind::Polygon, "bands", &["min", "max"]),
    };
    let frame = &tree.metadata().frame;
    let [low, high] = frame.world_box(&tree.header().extent_bounds());
    let layer = VectorLayer {
        name: name.into(),
        kind: Some(kind),
        is_multi: false,
        has_z: features.has_z,
        attributes: attributes.iter().map(|name| ((*name).into(), AttributeType::Number)).collect(),
        crs: frame.crs.clone(),
        bounds: [[low[0], low[1]], [high[0], high[1]]],
    };
    let mut writer = VectorWriter::create(output, format, layer)?;
    let mut each = |contour: &Contour<'_>| match features.filled {
        false => {
            let line = Smoothed::new(contour, contour.is_closed(), features.smooth);
            writer.write(&line, &[AttributeValue::Number(contour.value())])
        }
        true => writer.write(contour, &contour.range().map(AttributeValue::Number)),
    };
    let summary = match features.filled {
        false => tree.contours(&request, progress, &mut each),
        true => tree.contour_bands(&request, progress, &mut each),
    }?;
    writer.finish(progress).map(|()| summary)
}
