//! Values of faces, read face by face.

use super::reader::ExactModel;
use crate::Faces as _;
use spinney_base::Result;

/// Values of faces in some columns.
pub(crate) struct FaceValues<'a> {
    model: &'a ExactModel,
    /// Number of each column, if the model has it.
    columns: Vec<Option<usize>>,
    values: Vec<Option<String>>,
}

impl ExactModel {
    /// Finds columns of face values by their names.
    pub(crate) fn values_of(&self, columns: &[&str]) -> Result<FaceValues<'_>> {
        let names = if columns.is_empty() { Vec::new() } else { self.value_columns()? };
        let place = |column: &&str| names.iter().position(|name| name == column);
        let values = vec![None; columns.len()];
        Ok(FaceValues { model: self, columns: columns.iter().map(place).collect(), values })
    }
}

impl FaceValues<'_> {
    /// Reads the values of a face, as JSON.
    pub(crate) fn of(&mut self, face: u64) -> Result<&[Option<String>]> {
        for (value, column) in self.values.iter_mut().zip(&self.columns) {
            // (Models have less than 2^32 faces and columns.)
            *value = match column {
                Some(column) => self.model.face_value(*column as u32, face as u32)?,
                None => None,
            };
        }
        Ok(&self.values)
    }
}
