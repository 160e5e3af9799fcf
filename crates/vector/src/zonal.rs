//! Zonal statistics of features that are read in batches.

use std::path::{Path, PathBuf};

use crate::import::feature::{FeatureOptions, FeatureReader};
use crate::import::zones::{PolygonLayer, PolygonReader, invalid_polygons};
use spinney_base::{Error, Progress, Result};
use spinney_crs::{CellLocator, Coordinates, Frame};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ZonalRequest, ZoneStatistics};

/// Zonal query: the layers of a tree, and the features of a file.
pub struct FeatureZones<'a> {
    trees: &'a [&'a Dataset],
    request: &'a ZonalRequest,
    /// The features' file.
    path: PathBuf,
    /// For each layer, the index of the first one with the same grid.
    same: Vec<usize>,
    /// Ascending indices of these, and the locators of their cells. Polygons are transformed once
    /// per grid.
    grids: Vec<usize>,
    coordinates: Coordinates,
    locators: Vec<(CellLocator, [u64; 3])>,
    /// Whether some polygons meet a tree; if not, the error for the first batch.
    is_met: bool,
    outside: Option<Error>,
    /// Number of features whose rings cross or touch each other, or whose parts overlap.
    invalid: u64,
}

impl<'a> FeatureZones<'a> {
    /// Prepares the query for the features of a reader. Vertices are in `coordinates`, or else in
    /// the file's own. In trees without a coordinate system, they are assumed to be in the tree's
    /// own coordinates, with a warning.
    ///
    /// # Errors
    /// If there is no transformation from the coordinates to the cells of a tree.
    pub fn new(
        reader: &PolygonReader,
        coordinates: Option<&Coordinates>,
        trees: &'a [&'a Dataset],
        request: &'a ZonalRequest,
        progress: &dyn Progress,
    ) -> Result<FeatureZones<'a>> {
        let path = reader.path().to_path_buf();
        let own = reader.schema().crs.clone().map_or(Coordinates::World, Coordinates::System);
        let has_system = trees.iter().all(|tree| tree.metadata().frame.crs.is_some());
        let coordinates = match coordinates {
            Some(given) => given,
            None if !has_system && own != Coordinates::World => {
                let text =
                    "the tree has no coordinate system; vertices are assumed to be in its own coordinates";
                progress.warn(&path, text);
                &Coordinates::World
            }
            None => &own,
        };
        let same = Dataset::same_cells(trees);
        let grids: Vec<usize> = (0..trees.len()).filter(|number| same[*number] == *number).collect();
        let locators = grids.iter().map(|grid| {
            let (header, frame) = (trees[*grid].header(), &trees[*grid].metadata().frame);
            frame.check_columns()?;
            let locator = CellLocator::new(coordinates, frame, header.extent)?;
            // Remarks on a coordinate system are reported once.
            if *grid == 0 {
                locator.remarks().iter().for_each(|remark| progress.warn(&path, remark));
            }
            Ok((locator, header.extent))
        });
        let locators = locators.collect::<Result<Vec<_>>>()?;
        Ok(FeatureZones {
            trees,
            request,
            path,
            same,
            grids,
            coordinates: coordinates.clone(),
            locators,
            is_met: false,
            outside: None,
            invalid: 0,
        })
    }

    /// Yields, for each feature of a batch, its index and the statistics of all layers of the tree.
    ///
    /// # Errors
    /// If a ring has too few vertices, or one that is not finite, with the feature's number; if a
    /// tree is corrupt, on cancellation, or if `take` fails.
    pub fn each(
        &mut self,
        layer: &PolygonLayer,
        progress: &dyn Progress,
        take: &mut dyn FnMut(usize, &[ZoneStatistics]) -> Result<()>,
    ) -> Result<()> {
        let found = layer
            .in_cells_of(&self.coordinates, &self.locators)
            .map_err(|error| in_file(&self.path, error))?;
        match found.outside {
            None => self.is_met = true,
            Some(error) => self.outside = self.outside.take().or(Some(error)),
        }
        let first = found.trees.first().map_or(&[][..], Vec::as_slice);
        self.invalid += first.iter().flatten().filter(|polygon| polygon.was_invalid()).count() as u64;
        let of_grid =
            |first: &usize| &found.trees[self.grids.binary_search(first).expect("one of the list")][..];
        let queried: Vec<_> = self.trees.iter().copied().zip(self.same.iter().map(of_grid)).collect();
        let mut numbers = 0..;
        Dataset::zonal_layers(&queried, self.request, progress, &mut |zone| {
            numbers.next().map_or(Ok(()), |number| take(number, &zone))
        })
    }

    /// Completes the queries, and warns of invalid polygons.
    ///
    /// # Errors
    /// If there were polygons, and all of them are outside of the trees.
    pub fn finish(self, progress: &dyn Progress) -> Result<()> {
        let FeatureZones { path, is_met, outside, invalid, .. } = self;
        if invalid > 0 {
            progress.warn(&path, &invalid_polygons(invalid));
        }
        outside.filter(|_| !is_met).map_or(Ok(()), |error| Err(in_file(&path, error)))
    }
}

/// Adds the path to an error that does not contain it.
pub(crate) fn in_file(path: &Path, error: Error) -> Error {
    match error {
        Error::Invalid { what, found, expected } if !what.starts_with(&path.display().to_string()) => {
            Error::invalid(format!("{}: {what}", path.display()), found, expected)
        }
        other => other,
    }
}

/// Returns options for reading features whose coordinates are those of [`coordinates_in`].
pub(crate) fn options_over(frame: &Frame) -> FeatureOptions {
    FeatureOptions { check_degrees: frame.crs.is_some(), ..FeatureOptions::default() }
}

/// Returns the coordinates of a file's features, for transforming them to a frame. They are the
/// frame's own if one of the coordinate systems is unknown; an unknown system of the frame is
/// reported.
pub(crate) fn coordinates_in(
    frame: &Frame,
    path: &Path,
    reader: &dyn FeatureReader,
    progress: &dyn Progress,
) -> Coordinates {
    match &reader.schema().crs {
        None => Coordinates::World,
        Some(_) if frame.crs.is_none() => {
            let text = "the tree has no coordinate system; features are assumed to be in its own coordinates";
            progress.warn(path, text);
            Coordinates::World
        }
        Some(crs) => Coordinates::System(crs.clone()),
    }
}
