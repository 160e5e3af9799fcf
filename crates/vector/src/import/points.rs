//! Point features as input of point trees.

use std::path::{Path, PathBuf};

use super::feature::{
    AttributeType, Feature, FeatureAttribute, FeatureGeometry, FeatureOptions, FeatureReader,
    is_feature_file, open_features,
};
use spinney_base::space::Dimension;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};
use spinney_crs::Crs;
use spinney_points::{
    GriddedPoints, PointAttribute, PointImport, PointImportOptions, WorldPoints, ordered_number, plan_files,
    plan_points,
};

/// Name of the attribute with the third coordinate, in any case.
const HEIGHT: &str = "z";

/// Points of a feature file, on a grid, and counts for remarks.
struct FeaturePoints {
    /// The points.
    points: GriddedPoints,
    /// Names of attributes that are dropped because they are not numeric.
    left_out: Vec<String>,
    /// Number of features with measures, or with heights that not all features have; these are
    /// dropped.
    with_more: u64,
    /// Number of features without geometry, or with an empty one.
    without_geometry: u64,
}

impl FeaturePoints {
    /// Returns remarks on what was changed in or dropped from the file.
    fn remarks(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        if !self.left_out.is_empty() {
            remarks
                .push(format!("attributes that are not numbers are left out: {}", self.left_out.join(", ")));
        }
        if self.with_more > 0 {
            let what = "features have measures, or heights that other points lack; these are not stored";
            remarks.push(format!("{} {what}", self.with_more));
        }
        if self.without_geometry > 0 {
            remarks.push(format!("{} features without a point are skipped", self.without_geometry));
        }
        remarks.extend(self.points.remarks());
        remarks
    }
}

/// Plans a point tree of one or several LAS and LAZ files, or of one feature, PLY or NPY file; only
/// points that satisfy the filter are used.
///
/// # Errors
/// Those of [`plan_files`] and of reading features; if a feature is not a point, or there are
/// several feature files.
pub fn plan_point_files(
    paths: &[PathBuf],
    features: &FeatureOptions,
    options: &PointImportOptions,
) -> Result<PointImport> {
    let filter = &features.filter;
    let mut import = match paths {
        [path] if is_feature_file(path) => {
            let check_degrees = features.check_degrees && options.crs.is_none();
            let found = open_feature_points(path, &FeatureOptions { check_degrees, ..features.clone() })?;
            let remarks = found.remarks();
            let mut import = plan_points(Box::new(found.points), paths, Vec::new(), options)?;
            remarks.into_iter().for_each(|remark| import.add_remark(path, remark));
            import
        }
        [path, ..] if is_feature_file(path) => {
            return Err(Error::unsupported(
                path,
                "several feature files as one tree of points",
                "build one tree per file",
            ));
        }
        _ => plan_files(paths, &mut |attributes| filter.for_points(attributes), options)?,
    };
    if !filter.conditions.is_empty() {
        import.add_provenance(format!("points where {filter}"));
    }
    Ok(import)
}

/// Opens a file of point features. The third coordinate is the height of the geometry, or else the
/// attribute `z`. Numeric and Boolean attributes become attributes of the smallest type that holds
/// all values; doubles if some features have no value.
///
/// # Errors
/// Those of [`open_features`]; if a feature is not a point.
fn open_feature_points(path: &Path, options: &FeatureOptions) -> Result<FeaturePoints> {
    let survey = Survey::of(path, options)?;
    let Survey { attributes, columns, height, left_out, with_more, without_geometry } = survey;
    let reader = open_features(path, options)?;
    let crs = reader.schema().crs.clone();
    let points = Points {
        path: path.to_path_buf(),
        options: options.clone(),
        reader,
        attributes,
        columns,
        height,
        crs,
        rest: Vec::new(),
        numbers: Vec::new(),
    };
    let points = GriddedPoints::new(Box::new(points))?;
    Ok(FeaturePoints { points, left_out, with_more, without_geometry })
}

/// Attributes of all features.
struct Survey {
    attributes: Vec<PointAttribute>,
    /// Their indices among the attributes of the features.
    columns: Vec<usize>,
    height: Height,
    left_out: Vec<String>,
    with_more: u64,
    without_geometry: u64,
}

/// Source of the third coordinate.
#[derive(Clone, Copy, PartialEq)]
enum Height {
    /// None.
    None,
    /// The geometries.
    Geometry,
    /// An attribute, by its index.
    Attribute(usize),
}

/// Range of an attribute's values.
#[derive(Clone, Copy)]
struct Column {
    least: i64,
    most: i64,
    /// Whether all values are integers or Booleans.
    are_whole: bool,
    /// Whether all values equal the x, y or height of their points: columns of a table that make up
    /// its geometry.
    are_coordinates: [bool; 3],
}

impl Survey {
    fn of(path: &Path, options: &FeatureOptions) -> Result<Survey> {
        let mut reader = open_features(path, options)?;
        let schema = reader.schema().clone();
        let column = Column { least: i64::MAX, most: i64::MIN, are_whole: true, are_coordinates: [true; 3] };
        let mut found = vec![column; schema.attributes.len()];
        let [mut points, mut with_heights, mut features_with_heights, mut with_measures] = [0u64; 4];
        let mut without_geometry = 0u64;
        while let Some(feature) = reader.next()? {
            let heights = &feature.heights;
            features_with_heights += u64::from(heights.are_there);
            with_measures += u64::from(heights.have_measures);
            without_geometry += u64::from(match &feature.geometry {
                None => true,
                Some(FeatureGeometry::Points(own)) => own.is_empty(),
                Some(_) => false,
            });
            let place = match &feature.geometry {
                Some(FeatureGeometry::Points(own)) => {
                    points += own.len() as u64;
                    with_heights += heights.of_points.len() as u64;
                    match (&own[..], &heights.of_points[..]) {
                        ([[x, y]], [z]) => [*x, *y, *z],
                        ([[x, y]], _) => [*x, *y, f64::NAN],
                        _ => [f64::NAN; 3],
                    }
                }
                _ => [f64::NAN; 3],
            };
            for (column, value) in found.iter_mut().zip(&feature.attributes) {
                for (are, coordinate) in column.are_coordinates.iter_mut().zip(place) {
                    *are &= number(Some(value)) == coordinate;
                }
                match value {
                    FeatureAttribute::Integer(number) => {
                        column.least = column.least.min(*number);
                        column.most = column.most.max(*number);
                    }
                    FeatureAttribute::Boolean(_) => {
                        column.least = column.least.min(0);
                        column.most = column.most.max(1);
                    }
                    _ => column.are_whole = false,
                }
            }
        }
        let named =
            |(name, kind): &(String, AttributeType)| is_number(*kind) && name.eq_ignore_ascii_case(HEIGHT);
        let height = match schema.attributes.iter().position(named) {
            _ if points > 0 && with_heights == points => Height::Geometry,
            Some(place) => Height::Attribute(place),
            None => Height::None,
        };
        let lost = if height == Height::Geometry { 0 } else { features_with_heights };
        let with_more = with_measures.max(lost);
        let (mut attributes, mut columns, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
        let is_other =
            |place: usize| Height::Attribute(place) != height && found[place].are_coordinates == [false; 3];
        for (place, (name, kind)) in
            schema.attributes.iter().enumerate().filter(|(place, _)| is_other(*place))
        {
            match is_number(*kind) || *kind == AttributeType::Boolean {
                true => {
                    attributes.push(PointAttribute::new(name.clone(), found[place].sample()));
                    columns.push(place);
                }
                false => left_out.push(name.clone()),
            }
        }
        Ok(Survey { attributes, columns, height, left_out, with_more, without_geometry })
    }
}

fn is_number(kind: AttributeType) -> bool {
    matches!(kind, AttributeType::Integer | AttributeType::Number)
}

impl Column {
    /// Returns the smallest type that holds all values.
    fn sample(&self) -> SampleType {
        use SampleType::{F64, I8, I16, I32, I64, U8, U16, U32};
        let fits = |(_, least, most): &(SampleType, i64, i64)| *least <= self.least && self.most <= *most;
        let types = [
            (U8, 0, u8::MAX.into()),
            (I8, i8::MIN.into(), i8::MAX.into()),
            (U16, 0, u16::MAX.into()),
            (I16, i16::MIN.into(), i16::MAX.into()),
            (U32, 0, u32::MAX.into()),
            (I32, i32::MIN.into(), i32::MAX.into()),
        ];
        match self.are_whole {
            true => types.iter().find(|kind| fits(kind)).map_or(I64, |(sample, ..)| *sample),
            false => F64,
        }
    }
}

/// Points of all features.
struct Points {
    path: PathBuf,
    options: FeatureOptions,
    reader: Box<dyn FeatureReader>,
    attributes: Vec<PointAttribute>,
    columns: Vec<usize>,
    height: Height,
    crs: Option<Crs>,
    /// Remaining points of the last feature, in reverse order, and the numbers of their attributes.
    rest: Vec<[f64; 3]>,
    numbers: Vec<i64>,
}

/// Converts a value to a number; NaN if it is not numeric.
fn number(value: Option<&FeatureAttribute>) -> f64 {
    match value {
        Some(FeatureAttribute::Integer(number)) => *number as f64,
        Some(FeatureAttribute::Number(number)) => *number,
        Some(FeatureAttribute::Boolean(is)) => f64::from(u8::from(*is)),
        _ => f64::NAN,
    }
}

impl Points {
    fn take(&mut self, feature: Feature) -> Result<()> {
        let points = match feature.geometry {
            None => Vec::new(),
            Some(FeatureGeometry::Points(points)) => points,
            Some(_) => {
                let advice = "index lines with `--index lines`, or rasterize features with --cell";
                return Err(Error::unsupported(&self.path, "a feature that is not a point", advice));
            }
        };
        let above = |point: usize| match self.height {
            Height::None => 0.0,
            Height::Geometry => feature.heights.of_points.get(point).copied().unwrap_or(f64::NAN),
            Height::Attribute(place) => number(feature.attributes.get(place)),
        };
        let place = |(point, [x, y]): (usize, &[f64; 2])| [*x, *y, above(point)];
        self.rest = points.iter().enumerate().map(place).rev().collect();
        self.numbers.clear();
        for (attribute, place) in self.attributes.iter().zip(&self.columns) {
            let value = feature.attributes.get(*place);
            self.numbers.push(match (attribute.sample, value) {
                (SampleType::F64, value) => ordered_number(SampleType::F64, &number(value).to_le_bytes()),
                (_, Some(FeatureAttribute::Integer(number))) => *number,
                (_, value) => number(value) as i64,
            });
        }
        Ok(())
    }
}

impl WorldPoints for Points {
    fn attributes(&self) -> &[PointAttribute] {
        &self.attributes
    }

    fn dimension(&self) -> Dimension {
        if self.height == Height::None { Dimension::Quad } else { Dimension::Oct }
    }

    fn crs(&self) -> Option<&Crs> {
        self.crs.as_ref()
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn next(&mut self, numbers: &mut [i64]) -> Result<Option<[f64; 3]>> {
        loop {
            if let Some(place) = self.rest.pop() {
                numbers.copy_from_slice(&self.numbers);
                return Ok(Some(place));
            }
            let Some(feature) = self.reader.next()? else { return Ok(None) };
            self.take(feature)?;
        }
    }

    fn rewind(&mut self) -> Result<()> {
        self.reader = open_features(&self.path, &self.options)?;
        self.rest.clear();
        Ok(())
    }
}
