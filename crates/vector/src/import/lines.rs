//! Line features as input of line trees.

use std::path::{Path, PathBuf};

use super::feature::{
    AttributeType, FeatureAttribute, FeatureGeometry, FeatureOptions, FeatureReader, open_features,
};
use spinney_base::io::shown;
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_crs::Crs;
use spinney_lines::{LineAttribute, LineFeature, LineSchema, LineSource, LineValue, ValueKind};
use spinney_points::{GriddedPoints, PointAttribute, PointSource as _, WorldPoints};

/// Lines of a feature file, on a grid. The scale is that of the coordinates' decimal places if they
/// are few, else the finest that spans all lines.
pub struct FeatureLines {
    path: PathBuf,
    schema: LineSchema,
    reader: Box<dyn FeatureReader>,
    is_rounded: bool,
    with_heights: u64,
    /// Number of features read.
    count: u64,
}

/// Reads a file of line features once to find their grid, and opens it as input of a line tree.
///
/// # Errors
/// Those of [`open_features`]; if a feature is not a line, or a coordinate is not a number.
pub fn open_feature_lines(path: &Path, options: &FeatureOptions) -> Result<FeatureLines> {
    let reader = open_features(path, options)?;
    let crs = reader.schema().crs.clone();
    let vertices = Vertices {
        path: path.to_path_buf(),
        options: options.clone(),
        reader,
        crs,
        rest: Vec::new(),
        count: 0,
    };
    let gridded = GriddedPoints::new(Box::new(vertices))?;
    if gridded.skipped() > 0 {
        let found = format!("{} vertices with NaN or infinite coordinates", gridded.skipped());
        return Err(Error::corrupt(path, "features", found, "finite coordinates"));
    }
    let found = gridded.schema();
    // The world bounds determine one scale for both axes: the finer one, if it spans all lines.
    let ends: [[f64; 2]; 2] = std::array::from_fn(|axis| {
        found.bounds.map(|corner| f64::from(corner[axis]) * found.scale[axis] + found.offset[axis])
    });
    let [fine, coarse] = [found.scale[0].min(found.scale[1]), found.scale[0].max(found.scale[1])];
    let on = |scale: f64| -> Option<[f64; 2]> {
        let offsets = ends.map(|[least, most]| offset(scale, least, most));
        Some([offsets[0]?, offsets[1]?])
    };
    let (scale, offset) = match (on(fine), on(coarse)) {
        (Some(offset), _) => (fine, offset),
        (None, Some(offset)) => (coarse, offset),
        (None, None) => {
            let found =
                format!("coordinates from {:?} to {:?}", ends.map(|end| end[0]), ends.map(|end| end[1]));
            return Err(Error::invalid(shown(path), found, "coordinates that fit on a 32-bit grid"));
        }
    };
    // Scales are powers of ten (rounded) or of two, so their ratio is either an integer within
    // double precision or clearly not one.
    let ratio = coarse / scale;
    let is_part = (ratio - ratio.round()).abs() <= 4.0 * f64::EPSILON * ratio;
    let is_rounded = gridded.rounding().is_some() || !is_part || scale > fine;
    // Bounds are on the grid of their axis, vertices on the common one. If these differ, a rounded
    // vertex may lie outside the bounds.
    let slack =
        found.scale.map(|own| if is_rounded && own != scale { (own / scale / 2.0).ceil() as i32 } else { 0 });
    let step = |end: usize| [0, 1].map(|axis| step(scale, offset[axis], ends[axis][end]));
    let (least, most) = (step(0), step(1));
    let reader = open_features(path, options)?;
    let schema = reader.schema();
    let attribute =
        |(name, kind): &(String, AttributeType)| LineAttribute { name: name.clone(), kind: kind_of(*kind) };
    let schema = LineSchema {
        attributes: schema.attributes.iter().map(attribute).collect(),
        scale,
        offset,
        bounds: [
            [0, 1].map(|axis| least[axis].saturating_sub(slack[axis])),
            [0, 1].map(|axis| most[axis].saturating_add(slack[axis])),
        ],
        crs: schema.crs.clone(),
        count: schema.count,
    };
    Ok(FeatureLines { path: path.to_path_buf(), schema, reader, is_rounded, with_heights: 0, count: 0 })
}

/// Returns the offset of a 32-bit grid that spans these numbers; `None` if there is none.
fn offset(scale: f64, least: f64, most: f64) -> Option<f64> {
    let reach = least.abs().max(most.abs());
    let offset = if reach / scale <= f64::from(i32::MAX) { 0.0 } else { least.floor() };
    ((most - offset) / scale <= f64::from(i32::MAX)).then_some(offset)
}

fn step(scale: f64, offset: f64, number: f64) -> i32 {
    ((number - offset) / scale).round() as i32
}

fn kind_of(kind: AttributeType) -> ValueKind {
    match kind {
        AttributeType::Integer => ValueKind::Integer,
        AttributeType::Number => ValueKind::Number,
        AttributeType::Boolean => ValueKind::Boolean,
        AttributeType::Json => ValueKind::Json,
        AttributeType::Mixed => ValueKind::Mixed,
        AttributeType::Text | AttributeType::PerSegment => ValueKind::Text,
    }
}

fn value_of(attribute: FeatureAttribute) -> LineValue {
    match attribute {
        FeatureAttribute::None => LineValue::None,
        FeatureAttribute::Integer(number) => LineValue::Integer(number),
        FeatureAttribute::Number(number) => LineValue::Number(number),
        FeatureAttribute::Text(text) => LineValue::Text(text),
        FeatureAttribute::Boolean(is) => LineValue::Boolean(is),
        FeatureAttribute::Json(text) => LineValue::Json(text),
    }
}

/// Returns the lines of a feature's geometry.
fn lines_of(path: &Path, number: u64, geometry: Option<FeatureGeometry>) -> Result<Vec<Vec<[f64; 2]>>> {
    let found = match geometry {
        None => return Ok(Vec::new()),
        Some(FeatureGeometry::Lines(lines)) => return Ok(lines),
        Some(FeatureGeometry::Points(_)) => "points",
        Some(FeatureGeometry::Polygons(_)) => "a polygon",
        Some(FeatureGeometry::Collection(_)) => "a collection of geometries",
    };
    let advice = "line trees contain lines only; index points with `--index points`, and rasterize polygons with --cell";
    Err(Error::unsupported(path, format!("feature {number}, which is {found},"), advice))
}

impl FeatureLines {
    /// Returns whether vertices are rounded to the grid, by at most half a grid unit.
    pub fn is_rounded(&self) -> bool {
        self.is_rounded
    }

    /// Returns the number of features read so far that have heights or measures, which are skipped.
    pub fn with_heights(&self) -> u64 {
        self.with_heights
    }
}

impl LineSource for FeatureLines {
    fn schema(&self) -> &LineSchema {
        &self.schema
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn next(&mut self) -> Result<Option<LineFeature>> {
        let Some(feature) = self.reader.next()? else { return Ok(None) };
        self.count += 1;
        self.with_heights += u64::from(feature.heights.any());
        let LineSchema { scale, offset, .. } = self.schema;
        let vertex = |[x, y]: [f64; 2]| [step(scale, offset[0], x), step(scale, offset[1], y)];
        let lines = lines_of(&self.path, self.count, feature.geometry)?;
        let lines = lines.into_iter().map(|line| line.into_iter().map(vertex).collect()).collect();
        Ok(Some(LineFeature { lines, values: feature.attributes.into_iter().map(value_of).collect() }))
    }
}

/// Vertices of all features.
struct Vertices {
    path: PathBuf,
    options: FeatureOptions,
    reader: Box<dyn FeatureReader>,
    crs: Option<Crs>,
    /// Remaining vertices of the last feature.
    rest: Vec<[f64; 2]>,
    count: u64,
}

impl WorldPoints for Vertices {
    fn attributes(&self) -> &[PointAttribute] {
        &[]
    }

    fn dimension(&self) -> Dimension {
        Dimension::Quad
    }

    fn crs(&self) -> Option<&Crs> {
        self.crs.as_ref()
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn next(&mut self, _numbers: &mut [i64]) -> Result<Option<[f64; 3]>> {
        loop {
            if let Some([x, y]) = self.rest.pop() {
                return Ok(Some([x, y, 0.0]));
            }
            let Some(feature) = self.reader.next()? else { return Ok(None) };
            self.count += 1;
            self.rest = lines_of(&self.path, self.count, feature.geometry)?.concat();
        }
    }

    fn rewind(&mut self) -> Result<()> {
        self.reader = open_features(&self.path, &self.options)?;
        self.rest.clear();
        self.count = 0;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_contain_all_vertices_if_the_grids_of_the_axes_differ() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("lines.geojson");
        for seed in 0..60u32 {
            // More digits than fit into a 32-bit grid; the finest grid of the first axis is
            // coarser.
            let share = |number: u32| f64::from(17 * seed + number + 1).sqrt().fract();
            let line: Vec<[f64; 2]> =
                (0..8).map(|n| [3e5 + 10_261.0 * share(n), 3.19e6 + 7_438.0 * share(n + 50)]).collect();
            let geometry = serde_json::json!({ "type": "LineString", "crs": null, "coordinates": line });
            std::fs::write(&path, geometry.to_string()).unwrap();
            let mut source = open_feature_lines(&path, &FeatureOptions::default()).unwrap();
            assert!(source.is_rounded());
            let [least, most] = source.schema().bounds;
            for vertex in source.next().unwrap().unwrap().lines.concat() {
                assert!((0..2).all(|axis| (least[axis]..=most[axis]).contains(&vertex[axis])), "seed {seed}");
            }
        }
    }
}
