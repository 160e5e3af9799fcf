//! Rings clipped at boxes (Sutherland and Hodgman 1974).

/// What of a ring lies in a box. Where it leaves the box and comes back elsewhere, edges along the box's border join the pieces.
pub(super) fn clipped(ring: Vec<[f64; 2]>, [low, high]: &[[f64; 2]; 2]) -> Vec<[f64; 2]> {
    let borders = [(0, low[0], 1.0), (0, high[0], -1.0), (1, low[1], 1.0), (1, high[1], -1.0)];
    let ring = borders.into_iter().filter(|(_, at, _)| at.is_finite()).fold(ring, beside);
    // (Of what touches the box from outside a line is left.)
    let is_line = (0..2).any(|axis| ring.iter().all(|corner| corner[axis] == ring[0][axis]));
    if is_line { Vec::new() } else { ring }
}

/// What of a ring lies on one side of a line across an axis.
fn beside(ring: Vec<[f64; 2]>, (axis, at, side): (usize, f64, f64)) -> Vec<[f64; 2]> {
    let is_in = |corner: &[f64; 2]| (corner[axis] - at) * side >= 0.0;
    if ring.iter().all(is_in) {
        return ring;
    }
    let mut kept = Vec::new();
    for (index, corner) in ring.iter().enumerate() {
        let before = &ring[(index + ring.len() - 1) % ring.len()];
        if is_in(corner) != is_in(before) {
            let part = (at - before[axis]) / (corner[axis] - before[axis]);
            let other = 1 - axis;
            let mut crossing = [at; 2];
            crossing[other] = before[other] + (corner[other] - before[other]) * part;
            kept.push(crossing);
        }
        if is_in(corner) {
            kept.push(*corner);
        }
    }
    kept
}
