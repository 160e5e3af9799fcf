//! Properties of a model that are needed before its first vertex is written.

use super::Job;
use spinney_base::Result;
use spinney_brep::Face;

/// Summary of all faces.
#[derive(Default)]
pub(super) struct Survey {
    pub(super) has_colours: bool,
    /// Whether a face has corners of different colours.
    pub(super) has_shades: bool,
    /// Bounds of the faces, by part.
    bounds: Vec<Option<[[i32; 3]; 2]>>,
    /// Edge sum by part: 0 if every edge occurs equally often in both directions. Any other sum of
    /// 0 is a collision of a 128-bit hash.
    open: Vec<u128>,
}

impl Survey {
    pub(super) fn of(job: &Job<'_>) -> Result<Survey> {
        let parts = job.faces.parts().len();
        let mut survey = Survey { open: vec![0; parts], bounds: vec![None; parts], ..Survey::default() };
        job.each(&mut |face| {
            survey.has_colours |= !face.colours.is_empty();
            survey.has_shades |= face.colours.windows(2).any(|pair| pair[0] != pair[1]);
            if let Some(sum) = survey.open.get_mut(face.part as usize) {
                *sum = sum.wrapping_add(edges(face));
            }
            if let Some(bounds) = survey.bounds.get_mut(face.part as usize) {
                *bounds = join_bounds(*bounds, bounds_of(face.points));
            }
            Ok(())
        })?;
        Ok(survey)
    }

    /// Bounds of a part's faces, if it has any.
    pub(super) fn bounds(&self, part: u32) -> Option<[[i32; 3]; 2]> {
        self.bounds.get(part as usize).copied().flatten()
    }

    /// Whether the faces of a part are closed.
    pub(super) fn is_closed(&self, part: u32) -> bool {
        self.open.get(part as usize) == Some(&0)
    }
}

/// Bounds of points.
pub(super) fn bounds_of(points: &[[i32; 3]]) -> Option<[[i32; 3]; 2]> {
    points.iter().fold(None, |bounds, point| join_bounds(bounds, Some([*point; 2])))
}

/// Union of two boxes.
pub(super) fn join_bounds(a: Option<[[i32; 3]; 2]>, b: Option<[[i32; 3]; 2]>) -> Option<[[i32; 3]; 2]> {
    let (Some([low, high]), Some([other_low, other_high])) = (a, b) else { return a.or(b) };
    Some([
        [0, 1, 2].map(|axis| low[axis].min(other_low[axis])),
        [0, 1, 2].map(|axis| high[axis].max(other_high[axis])),
    ])
}

/// Sum of edge hashes of a face. The two directions of an edge cancel.
pub(super) fn edges(face: &Face<'_>) -> u128 {
    let mut sum = 0u128;
    for ring in face.rings() {
        for (i, &from) in ring.iter().enumerate() {
            let to = ring[(i + 1) % ring.len()];
            if from < to {
                sum = sum.wrapping_add(hash(from, to));
            } else {
                sum = sum.wrapping_sub(hash(to, from));
            }
        }
    }
    sum
}

fn hash(a: [i32; 3], b: [i32; 3]) -> u128 {
    let mut bytes = [0; 24];
    for (place, number) in bytes.chunks_exact_mut(4).zip(a.iter().chain(&b)) {
        place.copy_from_slice(&number.to_le_bytes());
    }
    xxhash_rust::xxh3::xxh3_128(&bytes)
}
