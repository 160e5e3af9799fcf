//! Imports point files into point trees.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::attribute::PointAttribute;
use crate::build::{BuildSummary, PointBuildOptions, build};
use crate::las::LasFiles;
use crate::query::PointCondition;
use crate::source::{ChosenPoints, GriddedPoints, PointSource};
use crate::tables::{self, Table, is_point_table};
use serde::{Deserialize, Serialize};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_container::Metadata;
use spinney_crs::Crs;

/// Options of an import from files.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointImportOptions {
    /// Build options.
    pub build: PointBuildOptions,
    /// Names of the attributes to keep; `None` keeps all.
    pub attributes: Option<Vec<String>>,
    /// Coordinate system, which overrides that of the files.
    pub crs: Option<Crs>,
}

/// Opened and checked files, ready to be built.
pub struct PointImport {
    pub(crate) source: Box<dyn PointSource>,
    pub(crate) metadata: Metadata,
    pub(crate) options: PointBuildOptions,
    description: Vec<(&'static str, String)>,
    /// Files, and remarks on what was changed in or dropped from them.
    remarks: Vec<(PathBuf, String)>,
}

/// Returns whether a file is a LAS or LAZ file, judging by its name or its first bytes.
pub fn is_las_file(path: &Path) -> bool {
    let named = |ending: &str| path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending));
    let mut start = [0; 4];
    // Only regular files are read: bytes read from a pipe would be lost.
    let mut begins =
        || path.is_file() && File::open(path).is_ok_and(|mut file| file.read_exact(&mut start).is_ok());
    named("las") || named("laz") || begins() && start == *b"LASF"
}

/// Returns whether this crate reads points from the file: LAS, LAZ, PLY and NPY.
pub fn has_points(path: &Path) -> bool {
    is_las_file(path) || is_point_table(path)
}

/// Opens LAS and LAZ files, or one PLY or NPY file, and plans a tree of all points that satisfy the
/// conditions. `conditions` is called with the attributes of the files.
///
/// # Errors
/// If a file cannot be read, has another format or is corrupt; if the files have different
/// coordinate systems; if an attribute name is unknown.
pub fn plan_files(
    paths: &[PathBuf],
    conditions: &mut dyn FnMut(&[PointAttribute]) -> Result<Vec<PointCondition>>,
    options: &PointImportOptions,
) -> Result<PointImport> {
    let (source, remarks): (Box<dyn PointSource>, _) = match paths {
        [path] if is_point_table(path) => {
            let Table { points, mut remarks } = tables::open(path)?;
            let points = GriddedPoints::new(points)?;
            remarks.extend(points.remarks());
            let remarks = remarks.into_iter().map(|remark| (path.clone(), remark)).collect();
            (Box::new(points), remarks)
        }
        _ => {
            if let Some(table) = paths.iter().find(|path| is_point_table(path)) {
                return Err(Error::unsupported(
                    table,
                    "a PLY or NPY file among several inputs",
                    "build one tree per file",
                ));
            }
            let files = LasFiles::open(paths, options.crs.as_ref())?;
            let remarks = files.remarks();
            (Box::new(files), remarks)
        }
    };
    let conditions = conditions(&source.schema().layout.attributes)?;
    let mut import = plan_points(source, paths, conditions, options)?;
    import.remarks = remarks;
    Ok(import)
}

/// Plans a tree of those points of a source that satisfy the conditions.
///
/// # Errors
/// If an attribute name is unknown.
pub fn plan_points(
    source: Box<dyn PointSource>,
    paths: &[PathBuf],
    conditions: Vec<PointCondition>,
    options: &PointImportOptions,
) -> Result<PointImport> {
    let attributes = &source.schema().layout.attributes;
    let indices = |names: &Vec<String>| {
        names.iter().map(|name| attribute_index(attributes, name)).collect::<Result<Vec<_>>>()
    };
    let kept = options.attributes.as_ref().map(indices).transpose()?;
    let source: Box<dyn PointSource> = match conditions.is_empty() && kept.is_none() {
        true => source,
        false => Box::new(ChosenPoints::new(source, conditions, kept)),
    };
    let schema = source.schema();
    let mut metadata = Metadata { tags: schema.tags.clone(), ..Metadata::default() };
    metadata.frame.crs = options.crs.clone().or(schema.crs.clone());
    metadata.provenance = paths.iter().map(|path| path.display().to_string()).collect();
    let mut description = Vec::new();
    if let Some(count) = schema.count {
        let files = if paths.len() == 1 { "1 file".into() } else { format!("{} files", paths.len()) };
        description.push(("input", format!("{count} points in {files}")));
    }
    let names: Vec<&str> = schema.layout.attributes.iter().map(|attribute| attribute.name.as_str()).collect();
    if !names.is_empty() {
        description.push(("attributes", names.join(", ")));
    }
    Ok(PointImport { source, metadata, options: options.build.clone(), description, remarks: Vec::new() })
}

/// Returns the index of the attribute with this name.
///
/// # Errors
/// If there is none with that name.
pub fn attribute_index(attributes: &[PointAttribute], name: &str) -> Result<usize> {
    attributes.iter().position(|attribute| attribute.name == name).ok_or_else(|| {
        let names: Vec<&str> = attributes.iter().map(|attribute| attribute.name.as_str()).collect();
        Error::invalid(
            "attribute",
            format!("`{name}`"),
            format!("one of the points' attributes: {}", names.join(", ")),
        )
    })
}

impl PointImport {
    /// Returns a description of the input as lines with headings.
    pub fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Adds a line about the origin of the points, such as a query or a source that is no file.
    pub fn add_provenance(&mut self, text: impl Into<String>) {
        self.metadata.provenance.push(text.into());
    }

    /// Adds a remark on a file, which is reported as a warning when the tree is built.
    pub fn add_remark(&mut self, path: &Path, text: impl Into<String>) {
        self.remarks.push((path.into(), text.into()));
    }

    /// Warns of what was changed in or dropped from the files.
    pub fn warn_of_remarks(&self, progress: &dyn Progress) {
        self.remarks.iter().for_each(|(path, text)| progress.warn(path, text));
    }

    /// Builds the tree, and warns of what was changed in or dropped from the files.
    ///
    /// # Errors
    /// Those of [`build`].
    pub fn build(mut self, output: Output, progress: &dyn Progress) -> Result<BuildSummary> {
        self.warn_of_remarks(progress);
        build(&mut *self.source, &self.options, &self.metadata, output, progress)
    }
}
