//! Models whose vertices are snapped to multiples of another grid unit, as operands of operations
//! on that grid.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use super::map::Motion;
use super::snapped::{NewUnit, Snapping};
use super::{Rounding, Target, TransformOptions, TransformTask};
use crate::repair::{InsideRule, repair, repair_bytes};
use crate::{ColumnValues, ExactModel, FaceList, Faces, Grid, ModelBuilder};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result, SubProgress};

/// Writes a copy of a model with all vertices at multiples of a grid's unit; returns the maximum
/// distance that one was moved. The result is closed. Self-intersections of the moved surface are
/// resolved, and regions with a positive winding number are inside. `output` may be called twice.
///
/// # Errors
/// If the model is not a solid, or has no volume on that grid; if the memory is not enough, if
/// files cannot be read or written, or on cancellation.
pub(crate) fn regrid(
    model: &ExactModel,
    unit: &Grid,
    output: &dyn Fn() -> Result<Output>,
    memory: u64,
    progress: &dyn Progress,
) -> Result<f64> {
    model.check_surface(progress)?;
    let mut options = TransformOptions::new(memory);
    options.note = Some(format!("grid unit {}", unit.width()));
    let motion = Motion::identity();
    let task = TransformTask { model, motion: &motion, options: &options, progress, keeps_formula: true };
    let unit = NewUnit::Of(unit);
    match task.recompute(output()?, unit) {
        // (Errors without locations are not about intersections.)
        Err(Error::NotASolid { count, .. }) if count > 0 => task.repaired(output()?, unit),
        made => Ok(made?.displacement),
    }
}

impl TransformTask<'_> {
    /// Recomputes all vertices and resolves self-intersections of the surface; returns the maximum
    /// distance that a vertex was moved.
    fn repaired(&self, output: Output, unit: NewUnit<'_>) -> Result<f64> {
        let TransformTask { model, motion, options, progress, .. } = *self;
        let mut snapping = Snapping::of(model, motion, unit, progress)?;
        let mut faces = FaceList::new(snapping.grid.clone(), Vec::new());
        let mut values = SourceValues::of(model)?;
        model.each(&mut |face| {
            if face.number.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            values.add(face.source, face.number)?;
            snapping.face(face, &mut |face| {
                faces.push(face);
                Ok(())
            })?;
            let needed = repair_bytes(&faces) + values.bytes;
            match needed <= options.memory / 2 {
                true => Ok(()),
                false => Err(Error::TooLarge {
                    path: model.path().to_path_buf(),
                    what: "repairing a surface that intersects itself on the common grid of the models"
                        .into(),
                    needed: 2 * needed,
                    limit: options.memory,
                    advice: "allow more with --memory, or build all models with one --snap".into(),
                }),
            }
        })?;
        let is_unbounded = model.is_unbounded();
        let builder = ModelBuilder::new(output, snapping.grid.clone(), options.memory / 2)?
            .codec(options.codec)
            .unbounded(is_unbounded)
            .values_by_source(values.finish(progress));
        let (builder, done) = repair(
            (faces, is_unbounded),
            InsideRule::Positive,
            builder,
            model.path(),
            options.memory / 2,
            progress,
        )?;
        let displacement = snapping.displacement().max(done.displacement);
        let target = Target {
            task: self,
            grid: snapping.grid.clone(),
            after: builder.faces(),
            builder,
            columns: Vec::new(),
            moving: SubProgress::new(progress, 0, 1),
        };
        let counts = Some(snapping.planar.counts);
        target.finish(Rounding { displacement, counts, rounded: model.exact_faces().0 })?;
        Ok(displacement)
    }
}

/// Values of faces by their sources.
struct SourceValues<'a> {
    model: &'a ExactModel,
    columns: Vec<String>,
    /// `None` if faces of one source have different values.
    values: BTreeMap<u64, Option<ColumnValues>>,
    bytes: u64,
}

impl SourceValues<'_> {
    fn of(model: &ExactModel) -> Result<SourceValues<'_>> {
        Ok(SourceValues { model, columns: model.value_columns()?, values: BTreeMap::new(), bytes: 0 })
    }

    fn add(&mut self, source: u64, number: u64) -> Result<()> {
        /// Bytes of the containers per value.
        const CONTAINER: usize = 64;
        let mut own = ColumnValues::new();
        for (column, name) in (0..).zip(&self.columns) {
            // (Models have less than 2^32 faces.)
            if let Some(json) = self.model.face_value(column, number as u32)? {
                own.push((name.clone(), json));
            }
        }
        match self.values.entry(source) {
            Entry::Vacant(_) if own.is_empty() && self.columns.is_empty() => {}
            Entry::Vacant(entry) => {
                let bytes = own.iter().map(|(name, json)| (name.len() + json.len() + CONTAINER) as u64);
                self.bytes += CONTAINER as u64 + bytes.sum::<u64>();
                entry.insert(Some(own));
            }
            Entry::Occupied(mut entry) => {
                if entry.get().as_ref().is_some_and(|first| *first != own) {
                    entry.insert(None);
                }
            }
        }
        Ok(())
    }

    fn finish(self, progress: &dyn Progress) -> BTreeMap<u64, ColumnValues> {
        let lost = self.values.values().filter(|values| values.is_none()).count();
        if lost > 0 {
            let text =
                format!("the values of {lost} sources are not kept: their faces have different values");
            progress.warn(self.model.path(), &text);
        }
        self.values.into_iter().filter_map(|(source, values)| Some((source, values?))).collect()
    }
}
