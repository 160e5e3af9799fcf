//! Faces of the exact surface in a box.

use crate::face_set::FaceSet;
use crate::store::node::world_box;
use crate::{ExactModel, Faces};
use spinney_base::io::batch::run_batched;
use spinney_base::{Error, Progress, Result};

/// Finds the faces whose own boxes touch a box of the world, among those in the leaves that meet
/// it; also returns their number.
pub(super) fn faces_in_box(
    model: &ExactModel,
    corners: [[f64; 3]; 2],
    progress: &dyn Progress,
) -> Result<(FaceSet, u64)> {
    check_box(corners)?;
    let grid = model.grid();
    let is_wanted = |level, cell| touch(&world_box(level, cell, grid), &corners);
    // (A face may be in several leaves.)
    let mut listed = FaceSet::new(Faces::len(model));
    run_batched(|| {
        model.each_leaf(&model.root()?, &is_wanted, &mut |node| {
            progress.check()?;
            node.faces().for_each(|number| listed.set(number, true));
            Ok(())
        })
    })?;
    let (mut found, mut count) = (FaceSet::new(Faces::len(model)), 0);
    model.each_numbered(listed.numbers(), &mut |face| {
        progress.check()?;
        let points = || face.points.iter().map(|point| grid.to_world(*point));
        let end = |of: fn(f64, f64) -> f64, start: f64| {
            points().fold([start; 3], |all, at| [0, 1, 2].map(|axis| of(all[axis], at[axis])))
        };
        if touch(&[end(f64::min, f64::INFINITY), end(f64::max, f64::NEG_INFINITY)], &corners) {
            found.set(face.number, true);
            count += 1;
        }
        Ok(())
    })?;
    Ok((found, count))
}

fn touch(a: &[[f64; 3]; 2], b: &[[f64; 3]; 2]) -> bool {
    (0..3).all(|axis| a[0][axis] <= b[1][axis] && b[0][axis] <= a[1][axis])
}

/// Fails for a box whose minimum is above its maximum, or without numbers.
pub(super) fn check_box([min, max]: [[f64; 3]; 2]) -> Result<()> {
    if (0..3).all(|axis| min[axis] <= max[axis]) {
        return Ok(());
    }
    let expected = "minimum coordinates, and maximum coordinates that are not smaller";
    Err(Error::invalid("box", format!("{min:?} to {max:?}"), expected))
}
