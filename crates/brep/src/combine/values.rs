//! Values of the operands' faces, copied to the faces of the result.

use std::collections::{BTreeMap, HashSet};

use crate::{ExactModel, Face, ModelBuilder};
use spinney_base::Result;

/// Values of the faces of models. Only their locations are in memory; the values are read when a
/// face of the result is written.
pub(super) struct FaceValues<'a> {
    models: &'a [&'a ExactModel],
    /// Per model: numbers and names of the columns that the result keeps.
    columns: Vec<Vec<(u32, String)>>,
    /// By source in the result, and own part: a model's face, by model and number; `None` if faces
    /// of this source have different values.
    origins: BTreeMap<(u64, u32), Option<(usize, u32)>>,
    /// Columns that the result drops, since there are too many.
    pub(super) lost_columns: u64,
    /// Faces of the result without values, since those of their source differ.
    pub(super) lost_values: u64,
}

impl<'a> FaceValues<'a> {
    /// Bytes per face whose values are found by its source.
    pub(super) const BYTES: u64 = 80;

    /// Collects the columns of some models. Columns with the same name are joined. If there are
    /// more than [`ModelBuilder::MAX_COLUMNS`] names, the first ones are kept.
    pub(super) fn of(models: &'a [&'a ExactModel]) -> Result<FaceValues<'a>> {
        let mut names: HashSet<String> = HashSet::new();
        let (mut columns, mut lost_columns) = (Vec::new(), 0);
        for model in models {
            let (mut own, mut taken) = (Vec::new(), HashSet::new());
            for (number, name) in (0..).zip(model.face_columns()?) {
                // (Each column has one name, and names are unique, except in corrupt files.)
                let Some(name) = name.into_iter().next().filter(|name| taken.insert(name.clone())) else {
                    continue;
                };
                if !names.contains(&name) && names.len() == ModelBuilder::MAX_COLUMNS {
                    lost_columns += 1;
                    continue;
                }
                names.insert(name.clone());
                own.push((number, name));
            }
            columns.push(own);
        }
        Ok(FaceValues { models, columns, origins: BTreeMap::new(), lost_columns, lost_values: 0 })
    }

    /// Returns whether faces of a model may have values that the result keeps.
    pub(super) fn has_columns(&self, model: usize) -> bool {
        !self.columns[model].is_empty()
    }

    /// Returns the memory use in bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.origins.len() as u64 * Self::BYTES
    }

    /// Records a model's face from which faces of the result may come. Part and source are those of
    /// the result.
    pub(super) fn note(&mut self, model: usize, face: &Face<'_>) -> Result<()> {
        if self.columns[model].is_empty() {
            return Ok(());
        }
        // (Models have fewer than 2^32 faces.)
        let own = (model, face.number as u32);
        let key = (face.source, face.part);
        match self.origins.get(&key).copied() {
            None => drop(self.origins.insert(key, Some(own))),
            Some(Some(first)) if self.values(first)? != self.values(own)? => {
                self.origins.insert(key, None);
            }
            Some(_) => {}
        }
        Ok(())
    }

    /// Sets the values of the builder's last face to those of a model's face.
    pub(super) fn copy(&self, model: usize, number: u64, builder: &mut ModelBuilder) -> Result<()> {
        let values = self.values((model, number as u32))?;
        values.iter().try_for_each(|(name, json)| builder.face_value(name, json))
    }

    /// Sets the values of the builder's last face to those of its part and source.
    pub(super) fn give(&mut self, face: &Face<'_>, builder: &mut ModelBuilder) -> Result<()> {
        // (Faces that belong to another object now have the part of that object. Their sources are
        // those of one operand.)
        let own = self.origins.get(&(face.source, face.part)).copied();
        match own.or_else(|| self.of_source(face.source)) {
            Some(Some((model, number))) => self.copy(model, number.into(), builder),
            Some(None) => {
                self.lost_values += 1;
                Ok(())
            }
            None => Ok(()),
        }
    }

    /// Returns the face of a source of any part, as [`FaceValues::origins`] do.
    fn of_source(&self, source: u64) -> Option<Option<(usize, u32)>> {
        let mut found = self.origins.range((source, 0)..=(source, u32::MAX)).map(|(_, face)| *face);
        let first = found.next()?;
        Some(first.filter(|_| found.next().is_none()))
    }

    /// Returns the column names and values of a model's face.
    fn values(&self, (model, number): (usize, u32)) -> Result<Vec<(&str, String)>> {
        let mut values = Vec::new();
        for (column, name) in &self.columns[model] {
            values.extend(self.models[model].face_value(*column, number)?.map(|json| (name.as_str(), json)));
        }
        Ok(values)
    }
}
