//! Faces of the base that a set operation keeps: their blocks are copied.

use super::bodies::Bodies;
use super::owners::PartNumbers;
use super::values::FaceValues;
use crate::arrangement::{ExactFace, Seams};
use crate::build::BaseModel;
use crate::{FaceBuffer, Faces, ModelBuilder};
use spinney_base::{Progress, Result};

impl Bodies<'_> {
    /// Adds the base's unchanged faces to the result, and counts their edges; returns their number.
    /// The faces of a block that stay are copied without decoding them.
    ///
    /// Invariant: the base's unchanged faces come first, in the order of their numbers, so that
    /// they get the numbers of [`Renumbering`](crate::face_set::Renumbering). Otherwise copied
    /// leaves would list other faces.
    pub(super) fn keep_faces(
        &self,
        base: &mut BaseModel<'_>,
        parts: &PartNumbers,
        (builder, seams): (&mut ModelBuilder, &mut Seams),
        values: &FaceValues<'_>,
        progress: &dyn Progress,
    ) -> Result<u64> {
        let Some((number, root)) = self.base else { return Ok(0) };
        let (model, (first_part, first_source)) = (base.model, self.first[number]);
        base.part_numbers = (0..model.parts().len() as u32).map(|part| parts.of(part + first_part)).collect();
        let base = &*base;
        let last_part = base.part_numbers.iter().copied().max().unwrap_or(0);
        let have_same_numbers =
            !root.is_moved() && base.keeps_part_numbers() && first_source == 0 && !values.has_columns(number);
        let ends = seams.ends();
        let (mut buffer, mut white) = (FaceBuffer::default(), Vec::new());
        model.each_block(&mut |first, block| {
            progress.check()?;
            let stays = |place: &usize| base.faces.number(first + *place as u64).is_some();
            let kept: Vec<usize> = (0..block.len()).filter(stays).collect();
            if kept.is_empty() {
                return Ok(());
            }
            let is_copied = have_same_numbers && block.is_coloured() == self.is_coloured;
            let may_be_watched = block.faces_between(&ends);
            if is_copied {
                let wrong = || model.wrong_face(first, "lists that do not fit".into());
                builder.push_kept_faces(block, &kept, last_part)?.ok_or_else(wrong)?;
            }
            for place in kept {
                if is_copied && !may_be_watched[place] {
                    continue;
                }
                block.read(place, &mut buffer);
                for point in &mut buffer.points {
                    *point = self.common_grid.point(number, *point);
                }
                seams.add_watched(&buffer.face());
                if is_copied {
                    continue;
                }
                let face = buffer.number;
                buffer.part = base.part_number(buffer.part);
                buffer.source = buffer.source.saturating_add(first_source);
                white.resize(if self.is_coloured { buffer.points.len() } else { 0 }, [255; 3]);
                if buffer.colours.is_empty() {
                    buffer.colours.extend_from_slice(&white);
                }
                builder.push_kept(&buffer.face(), buffer.is_proxy)?;
                values.copy(number, face, builder)?;
            }
            Ok(())
        })?;
        Ok(builder.faces())
    }

    /// Adds the base's unchanged exact faces, copied without decoding them.
    pub(super) fn keep_exact(
        &self,
        base: &BaseModel<'_>,
        builder: &mut ModelBuilder,
        progress: &dyn Progress,
    ) -> Result<()> {
        let Some((number, root)) = self.base else { return Ok(()) };
        let model = base.model;
        let last_part = base.part_numbers.iter().copied().max().unwrap_or(0);
        let have_same_numbers = !root.is_moved() && base.keeps_part_numbers() && self.first[number].1 == 0;
        model.each_exact_block(&mut |first, block| {
            progress.check()?;
            let stays = |place: &usize| base.exact.number(first + *place as u64).is_some();
            let kept: Vec<usize> = (0..block.len()).filter(stays).collect();
            if kept.is_empty() {
                return Ok(());
            }
            if have_same_numbers && block.is_coloured() == self.is_coloured {
                let pushed = builder.push_kept_block(block, &kept, last_part)?;
                return pushed.map_err(|found| model.wrong_exact_face(first, found));
            }
            kept.into_iter().try_for_each(|place| {
                let face = model.exact_face((first + place as u64) as u32)?;
                let part = base.part_number(face.part);
                builder.push_kept_exact(ExactFace { part, ..self.exact(number, face) })
            })
        })
    }
}
