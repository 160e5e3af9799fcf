//! Clipping of rings to boxes (Sutherland and Hodgman 1974).

/// Returns the fragment of a ring within a box. Where the ring leaves the box and re-enters it,
/// edges along the box's border connect the fragments.
pub(super) fn clipped(ring: Vec<[f64; 2]>, [low, high]: &[[f64; 2]; 2]) -> Vec<[f64; 2]> {
    let borders = [(0, low[0], 1.0), (0, high[0], -1.0), (1, low[1], 1.0), (1, high[1], -1.0)];
    let ring = borders.into_iter().filter(|(_, at, _)| at.is_finite()).fold(ring, clip_to_half_plane);
    // (A ring that only touches the box from outside degenerates to a line.)
    let is_line = (0..2).any(|axis| ring.iter().all(|corner| corner[axis] == ring[0][axis]));
    if is_line { Vec::new() } else { ring }
}

/// Returns the fragment of a ring on one side of an axis-parallel line.
fn clip_to_half_plane(ring: Vec<[f64; 2]>, (axis, at, side): (usize, f64, f64)) -> Vec<[f64; 2]> {
    let is_in = |corner: &[f64; 2]| (corner[axis] - at) * side >= 0.0;
    if ring.iter().all(is_in) {
        return ring;
    }
    let mut clipped_ring = Vec::new();
    for (index, corner) in ring.iter().enumerate() {
        let before = &ring[(index + ring.len() - 1) % ring.len()];
        if is_in(corner) != is_in(before) {
            let part = (at - before[axis]) / (corner[axis] - before[axis]);
            let other = 1 - axis;
            let mut crossing = [at; 2];
            crossing[other] = before[other] + (corner[other] - before[other]) * part;
            clipped_ring.push(crossing);
        }
        if is_in(corner) {
            clipped_ring.push(*corner);
        }
    }
    clipped_ring
}
