//! Several LAS files as one source of points.

use std::path::{Path, PathBuf};

use super::format::{SCAN_ANGLE, SCAN_ANGLE_RANK, angle_of_rank};
use super::read::LasReader;
use crate::attribute::{POSITION_BYTES, PointAttribute, RowLayout, ordered, position_of};
use crate::source::{PointSchema, PointSource, PointSubset, both_bounds};
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Points of LAS and LAZ files, file after file.
pub struct LasFiles {
    paths: Vec<PathBuf>,
    schema: PointSchema,
    /// Point count and bounds of each file, from its header.
    subsets: Vec<PointSubset>,
    remarks: Vec<(PathBuf, String)>,
    /// The file being read; `None` before the first and after the last.
    open: Option<LasReader>,
    /// Index of the next file.
    next: usize,
    rows: Vec<u8>,
}

impl LasFiles {
    /// Opens files and reads their headers. The points have the union of all attributes; a file
    /// that lacks an attribute gets its `no_data` value, or 0. The grid has the finest scale of all
    /// files. `crs` overrides the coordinate systems of the files.
    ///
    /// # Errors
    /// If there are no files, one cannot be read or is corrupt, their coordinate systems differ, or
    /// they are too far apart for one grid.
    pub fn open(paths: &[PathBuf], crs: Option<&Crs>) -> Result<LasFiles> {
        let schemas = paths
            .iter()
            .map(|path| Ok(LasReader::open(path)?.schema().clone()))
            .collect::<Result<Vec<_>>>()?;
        let (Some(path), Some(first)) = (paths.first(), schemas.first()) else {
            return Err(Error::invalid("LAS files", "none", "one or more"));
        };
        let mut schema = first.clone();
        let one_by_one = |found: String| Error::unsupported(path, found, "build one tree per file");
        for (other, other_path) in schemas.iter().zip(paths) {
            let name = |path: &Path| path.display().to_string();
            if crs.is_none() {
                Crs::check_same((&name(path), first.crs.as_ref()), (&name(other_path), other.crs.as_ref()))?;
            }
            schema.scale = std::array::from_fn(|axis| schema.scale[axis].min(other.scale[axis]));
        }
        let are_angles_joined = are_angles_joined(&schemas);
        if schemas.iter().any(|other| other.layout != first.layout) {
            let mut attributes = Vec::new();
            for attribute in schemas.iter().flat_map(|other| &other.layout.attributes) {
                let angle = PointAttribute::new(SCAN_ANGLE, SampleType::I16);
                let is_rank = are_angles_joined && attribute.name == SCAN_ANGLE_RANK;
                add_attribute(&mut attributes, if is_rank { &angle } else { attribute })
                    .map_err(one_by_one)?;
            }
            schema.layout = RowLayout::packed(attributes);
        }
        let (mut bounds, mut remarks, mut subsets) = (None, Vec::new(), Vec::new());
        for (other, other_path) in schemas.iter().zip(paths) {
            let corners = other.bounds.map(|position| moved(other, &schema, position));
            let [Some(least), Some(most)] = corners else {
                return Err(one_by_one("a distance between files that exceeds a 32-bit grid".into()));
            };
            bounds = both_bounds(bounds, Some([least, most]));
            subsets.push(PointSubset { count: other.count.unwrap_or(0), bounds: [least, most] });
            let mut remark = |text: &str| remarks.push((other_path.clone(), text.to_owned()));
            if !is_on_grid(other, &schema) {
                remark(
                    "its points are not on the finest grid of all files; they are moved by at most half a grid unit",
                );
            }
            if are_angles_joined && other.layout.position(SCAN_ANGLE_RANK).is_some() {
                remark(
                    "its scan angles (scan_angle_rank, in degrees) are stored as scan_angle (in units of 0.006 degrees), as in other files",
                );
            }
            if other.tags != first.tags {
                remark("its header fields differ from those of the first file, which are stored");
            }
            if other.layout.position("wavepacket_index").is_some() {
                remark("its points keep the offsets of their waveforms, but the waveforms are not stored");
            }
            other.losses.iter().for_each(|loss| remark(loss));
        }
        schema.bounds = bounds.unwrap_or(schema.bounds);
        schema.count = schemas.iter().map(|other| other.count).sum();
        let paths = paths.to_vec();
        Ok(LasFiles { paths, schema, subsets, remarks, open: None, next: 0, rows: Vec::new() })
    }

    /// Returns remarks on what was changed in or dropped from the files, each with its file.
    pub fn remarks(&self) -> Vec<(PathBuf, String)> {
        self.remarks.clone()
    }
}

/// Adds an attribute unless it is present; fails if its name is present with another type.
fn add_attribute(attributes: &mut Vec<PointAttribute>, attribute: &PointAttribute) -> Result<(), String> {
    match attributes.iter().find(|other| other.name == attribute.name) {
        None => attributes.push(attribute.clone()),
        Some(other) if other.sample == attribute.sample && other.no_data != attribute.no_data => {
            return Err(format!("attribute {} with different no_data values in the files", other.name));
        }
        Some(other) if other.sample == attribute.sample && other.scale_offset == attribute.scale_offset => {}
        Some(other) => {
            return Err(format!(
                "attribute {} with types {} and {} in the files",
                other.name,
                other.sample.name(),
                attribute.sample.name()
            ));
        }
    }
    Ok(())
}

/// Returns whether some files have scan angles as in point formats up to 5, and others as in
/// formats 6 and above.
fn are_angles_joined(schemas: &[PointSchema]) -> bool {
    let has = |name: &str, sample: SampleType| {
        let mut attributes = schemas.iter().flat_map(|schema| &schema.layout.attributes);
        attributes.any(|own| own.name == name && own.sample == sample && own.scale_offset.is_none())
    };
    // An extra dimension named scan_angle in an old format is something else.
    let has_both = |schema: &PointSchema| {
        [SCAN_ANGLE, SCAN_ANGLE_RANK].iter().all(|name| schema.layout.position(name).is_some())
    };
    has(SCAN_ANGLE, SampleType::I16) && has(SCAN_ANGLE_RANK, SampleType::I8) && !schemas.iter().any(has_both)
}

/// Converts a position from one grid to another; `None` outside the range of `i32`.
fn moved(from: &PointSchema, to: &PointSchema, position: [i32; 3]) -> Option<[i32; 3]> {
    let mut moved = position;
    for axis in 0..3 {
        if (from.scale[axis], from.offset[axis]) != (to.scale[axis], to.offset[axis]) {
            // The difference of the offsets is small. Large absolute coordinates would lose digits.
            let ratio = from.scale[axis] / to.scale[axis];
            let step =
                f64::from(position[axis]) * ratio + (from.offset[axis] - to.offset[axis]) / to.scale[axis];
            let step = step.round();
            if !(f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&step) {
                return None;
            }
            moved[axis] = step as i32;
        }
    }
    Some(moved)
}

/// Returns whether all positions of one grid are on another.
fn is_on_grid(from: &PointSchema, to: &PointSchema) -> bool {
    let is_whole = |number: f64| (number - number.round()).abs() < 1e-6;
    (0..3).all(|axis| {
        is_whole(from.scale[axis] / to.scale[axis])
            && is_whole((from.offset[axis] - to.offset[axis]) / to.scale[axis])
    })
}

impl PointSource for LasFiles {
    fn schema(&self) -> &PointSchema {
        &self.schema
    }

    fn path(&self) -> &Path {
        &self.paths[self.next.saturating_sub(1).min(self.paths.len() - 1)]
    }

    fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize> {
        loop {
            let Some(reader) = &mut self.open else {
                let Some(path) = self.paths.get(self.next) else { return Ok(0) };
                self.open = Some(LasReader::open(path)?);
                self.next += 1;
                continue;
            };
            let (own, all) = (reader.schema().clone(), &self.schema);
            let is_alike = own.layout == all.layout && own.scale == all.scale && own.offset == all.offset;
            self.rows.clear();
            let count = match is_alike {
                true => reader.read(rows, most)?,
                false => reader.read(&mut self.rows, most)?,
            };
            if count == 0 {
                self.open = None;
                continue;
            }
            if !is_alike {
                convert(&self.rows, (&own, all), rows).ok_or_else(|| {
                    Error::corrupt(
                        self.path(),
                        "points",
                        "a point outside the bounds in its header",
                        "points inside them",
                    )
                })?;
            }
            return Ok(count);
        }
    }

    fn subsets(&self) -> &[PointSubset] {
        &self.subsets
    }

    fn subset(&self, number: usize) -> Result<Box<dyn PointSource>> {
        Ok(Box::new(LasFiles {
            paths: vec![self.paths[number].clone()],
            schema: PointSchema { count: Some(self.subsets[number].count), ..self.schema.clone() },
            subsets: vec![self.subsets[number]],
            remarks: Vec::new(),
            open: None,
            next: 0,
            rows: Vec::new(),
        }))
    }

    fn survey(&mut self) -> Result<bool> {
        let mut bounds = None;
        for path in &self.paths {
            let mut reader = LasReader::open(path)?;
            reader.survey()?;
            let [least, most] =
                reader.schema().bounds.map(|position| moved(reader.schema(), &self.schema, position));
            bounds = both_bounds(bounds, least.zip(most).map(|(least, most)| [least, most]));
        }
        self.schema.bounds = bounds.unwrap_or([[0; 3]; 2]);
        (self.open, self.next) = (None, 0);
        Ok(true)
    }
}

/// Appends rows of one schema, converted to another; `None` if a position is outside the other's
/// grid.
fn convert(rows: &[u8], (from, to): (&PointSchema, &PointSchema), made: &mut Vec<u8>) -> Option<()> {
    let all = || rows.chunks_exact(from.layout.size);
    let (before, size) = (made.len(), to.layout.size);
    made.resize(before + all().len() * size, 0);
    for (own, row) in made[before..].chunks_exact_mut(size).zip(all()) {
        let position = moved(from, to, position_of(row))?;
        for (bytes, step) in own[..POSITION_BYTES].chunks_exact_mut(4).zip(position) {
            bytes.copy_from_slice(&step.to_le_bytes());
        }
    }
    for (attribute, wanted) in to.layout.attributes.iter().enumerate() {
        let own = from.layout.position(&wanted.name);
        let rank = || from.layout.position(SCAN_ANGLE_RANK).filter(|_| wanted.name == SCAN_ANGLE);
        let numbers = match own.or_else(rank) {
            Some(index) if own.is_some() => from.layout.numbers(index, all()),
            Some(index) => from.layout.numbers(index, all()).into_iter().map(angle_of_rank).collect(),
            None => vec![wanted.no_data.unwrap_or(ordered(wanted.sample, &[0; 8])); all().len()],
        };
        for (own, number) in made[before..].chunks_exact_mut(size).zip(numbers) {
            to.layout.set_number(attribute, own, number);
        }
    }
    Some(())
}
