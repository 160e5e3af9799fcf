//! Line features as input of line trees.

use std::path::{Path, PathBuf};

use super::feature::{
    AttributeType, Feature, FeatureAttribute, FeatureOptions, FeatureReader, Heights, open_features,
};
use spinney_base::space::Dimension;
use spinney_base::{Error, Progress, Result};
use spinney_crs::Crs;
use spinney_lines::{
    LineAttribute, LineFeature, LineSchema, LineSource, LineValue, ROUNDED, ValueKind, VertexGrid,
    VertexSurvey,
};

/// Lines of a feature file, on a grid of two or three axes. The scale is that of the coordinates'
/// decimal places if they are few, else the finest that spans all lines.
pub struct FeatureLines {
    path: PathBuf,
    schema: LineSchema,
    grid: VertexGrid,
    reader: Box<dyn FeatureReader>,
    losses: u64,
    /// Number of features read.
    count: u64,
}

/// Reads a file of line features once to find their grid, and opens it as input of a line tree. The
/// tree has three axes if all vertices have heights. `crs` replaces the coordinate system of the
/// file.
///
/// # Errors
/// Those of [`open_features`]; if a feature is not a line, or the lines do not fit on a grid.
pub fn open_feature_lines(
    path: &Path,
    options: &FeatureOptions,
    crs: Option<&Crs>,
    progress: &dyn Progress,
) -> Result<FeatureLines> {
    let check_degrees = options.check_degrees && crs.is_none();
    let options = &FeatureOptions { check_degrees, ..options.clone() };
    let mut reader = open_features(path, options)?;
    let crs = crs.or(reader.schema().crs.as_ref()).cloned();
    let mut survey = VertexSurvey::default();
    let mut count = 0u64;
    while let Some(mut feature) = reader.next()? {
        count += 1;
        if count.is_multiple_of(1 << 12) {
            progress.check()?;
        }
        for line in lines_of(path, count, &mut feature)? {
            line.into_iter().for_each(|vertex| survey.include(vertex));
        }
    }
    let grid = survey.grid(path, crs.as_ref())?;
    let reader = open_features(path, options)?;
    let attribute =
        |(name, kind): &(String, AttributeType)| LineAttribute { name: name.clone(), kind: kind_of(*kind) };
    let attributes = reader.schema().attributes.iter().map(attribute).collect();
    let mut schema = LineSchema::new(&grid, attributes, crs);
    schema.count = reader.schema().count;
    Ok(FeatureLines { path: path.to_path_buf(), schema, grid, reader, losses: 0, count: 0 })
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

/// Takes the lines out of a feature; z is NaN unless all vertices have heights.
fn lines_of(path: &Path, number: u64, feature: &mut Feature) -> Result<Vec<Vec<[f64; 3]>>> {
    feature.take_lines().map_err(|found| {
        let advice = "line trees contain lines only; index points with `--index points`, and rasterize polygons with --cell";
        Error::unsupported(path, format!("feature {number}, which is {found},"), advice)
    })
}

impl LineSource for FeatureLines {
    fn schema(&self) -> &LineSchema {
        &self.schema
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn remarks(&self) -> Vec<String> {
        let rounded = self.grid.is_rounded().then(|| ROUNDED.to_owned());
        let what = "features have measures, or heights that other features lack; these are not stored";
        let lost = (self.losses > 0).then(|| format!("{} {what}", self.losses));
        rounded.into_iter().chain(lost).collect()
    }

    fn next(&mut self) -> Result<Option<LineFeature>> {
        let Some(mut feature) = self.reader.next()? else { return Ok(None) };
        self.count += 1;
        let Heights { are_there, have_measures, .. } = feature.heights;
        let has_heights = self.grid.dimension() == Dimension::Oct;
        self.losses += u64::from(have_measures || are_there && !has_heights);
        let lines = lines_of(&self.path, self.count, &mut feature)?.into_iter();
        let lines = lines.map(|line| line.into_iter().map(|at| self.grid.vertex(at)).collect()).collect();
        Ok(Some(LineFeature { lines, values: feature.attributes.into_iter().map(value_of).collect() }))
    }
}
