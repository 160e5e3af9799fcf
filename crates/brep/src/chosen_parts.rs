//! A view of some parts of a model.

use std::collections::{BTreeMap, BTreeSet};

use crate::{AttributedFaceVisitor, Face, Faces, Grid};
use spinney_base::{Error, Result};

/// The faces of some parts of a model; faces and parts are renumbered from 0. Has only faces on the
/// grid, not the off-grid vertices of exact faces. Every pass, including the one that counts the
/// faces, reads all faces of the model.
///
/// ```
/// use spinney::brep::{Face, Faces, Grid};
/// use spinney::raw::brep::{ChosenParts, FaceList};
///
/// let grid = Grid::over([[0.0; 3], [4.0; 3]], Some(1.0))?;
/// let mut faces = FaceList::new(grid, vec!["one".into(), "two".into()]);
/// for part in [0, 1, 1] {
///     let points = [[0, 0, 0], [4, 0, 0], [0, 4, 0]];
///     faces.push(&Face { number: 0, points: &points, ring_ends: &[3], colours: &[], part, source: 0 });
/// }
/// let two = ChosenParts::of(&faces, &[1].into())?;
/// assert_eq!((two.parts(), two.len()), (&["two".to_string()][..], 2));
/// # Ok::<(), spinney::Error>(())
/// ```
pub struct ChosenParts<'a> {
    faces: &'a dyn Faces,
    /// New number of each chosen part.
    numbers: BTreeMap<u32, u32>,
    /// Old number of each chosen part, and its name below.
    chosen: Vec<u32>,
    names: Vec<String>,
    len: u64,
}

impl<'a> ChosenParts<'a> {
    /// Chooses the parts with these numbers, and counts their faces.
    ///
    /// # Errors
    /// If a part does not exist or none is chosen, or the faces cannot be read.
    pub fn of(faces: &'a dyn Faces, chosen: &BTreeSet<u32>) -> Result<ChosenParts<'a>> {
        let all = faces.parts();
        if chosen.is_empty() || chosen.iter().any(|part| *part as usize >= all.len()) {
            let found = chosen.last().map_or("none".to_string(), u32::to_string);
            return Err(Error::invalid("parts", found, format!("numbers from 0 to {}", all.len() - 1)));
        }
        let numbers: BTreeMap<u32, u32> = chosen.iter().copied().zip(0..).collect();
        let names = chosen.iter().map(|part| all[*part as usize].clone()).collect();
        let mut found =
            ChosenParts { faces, numbers, chosen: chosen.iter().copied().collect(), names, len: 0 };
        let mut len = 0;
        found.each(&mut |_| {
            len += 1;
            Ok(())
        })?;
        found.len = len;
        Ok(found)
    }
}

impl Faces for ChosenParts<'_> {
    fn grid(&self) -> &Grid {
        self.faces.grid()
    }

    fn parts(&self) -> &[String] {
        &self.names
    }

    fn part_attributes(&self, part: u32) -> Result<Option<String>> {
        self.chosen.get(part as usize).map_or(Ok(None), |part| self.faces.part_attributes(*part))
    }

    fn parts_with_attributes(&self) -> Result<u64> {
        let mut count = 0;
        for part in &self.chosen {
            count += u64::from(self.faces.part_attributes(*part)?.is_some());
        }
        Ok(count)
    }

    fn origin(&self) -> Option<&dyn Faces> {
        Some(self.faces)
    }

    fn value_columns(&self) -> Result<Vec<String>> {
        self.faces.value_columns()
    }

    fn len(&self) -> u64 {
        self.len
    }

    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        self.each_with_values(&[], &mut |face, _| each(face))
    }

    fn each_with_values(&self, columns: &[&str], each: &mut AttributedFaceVisitor<'_>) -> Result<()> {
        let mut number = 0;
        self.faces.each_with_values(columns, &mut |face, values| {
            let Some(part) = self.numbers.get(&face.part) else { return Ok(()) };
            number += 1;
            each(&Face { number: number - 1, part: *part, ..*face }, values)
        })
    }
}
