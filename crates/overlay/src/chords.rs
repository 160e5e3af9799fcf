//! Pairs of edges that may cross in a square through which all of them pass, without an end in it.
//!
//! Such edges are chords, and two of them cross if their ends alternate along the border of the square. So those that do are found by going once around it, with a
//! stack of the chords that have begun, whatever number of others lies beside them. Places on the border are rounded: what is nearer to each other than that may be off counts
//! as both before and behind.

use crate::crossings::Square;
use crate::exact::Point;

/// Where a chord begins and ends along the border, counted from the lower left corner on.
struct Chord {
    number: u32,
    from: f64,
    to: f64,
}

/// Hands out pairs of edges that may cross, at least all that do; each pair once, or more often where it is not sure.
///
/// # Errors
/// Those of `pair`.
pub(crate) fn alternating_pairs<E>(
    square: &Square,
    edges: &[(u32, [Point; 2])],
    pair: &mut dyn FnMut(u32, u32) -> Result<(), E>,
) -> Result<(), E> {
    let low = square.first.map(|first| first as f64 - 0.5);
    let side = square.side as f64;
    // (Each place is made of a few numbers of this size, with a rounding each.)
    let size =
        edges.iter().flat_map(|(_, ends)| ends.as_flattened()).fold(0f64, |most, at| most.max(at.abs()));
    let slack = 64.0 * f64::EPSILON * size;
    let (mut chords, mut unsure) = (Vec::with_capacity(edges.len()), Vec::new());
    for (number, ends) in edges {
        match chord(low, side, *ends) {
            Some((from, to)) if from > slack && to < 4.0 * side - slack => {
                chords.push(Chord { number: *number, from, to });
            }
            // At the corner where counting begins, or only just in the square.
            _ => unsure.push(*number),
        }
    }
    for (index, one) in unsure.iter().enumerate() {
        let others = unsure[index + 1..].iter().copied().chain(chords.iter().map(|chord| chord.number));
        others.into_iter().try_for_each(|other| pair(*one, other))?;
    }
    chords.sort_unstable_by(|one, other| one.from.total_cmp(&other.from));
    let mut ends: Vec<usize> = (0..chords.len()).collect();
    ends.sort_unstable_by(|one, other| chords[*one].to.total_cmp(&chords[*other].to));
    // Chords that have begun, in the order of their beginnings, and those that have ended just now.
    let (mut open, mut ended): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    let mut next = 0;
    for own in ends {
        let chord = &chords[own];
        while next < chords.len() && chords[next].from <= chord.to + slack {
            open.push(next);
            next += 1;
        }
        // All that began behind it, or as good as with it, and have not ended.
        let place = open.iter().rposition(|other| *other == own).unwrap_or(0);
        let begin = open[..place].iter().rposition(|other| chords[*other].from < chord.from - slack);
        for other in &open[begin.map_or(0, |begin| begin + 1)..] {
            if *other != own {
                pair(chord.number, chords[*other].number)?;
            }
        }
        open.remove(place);
        // And those that ended as good as with it.
        let begin = ended.iter().rposition(|other| chords[*other].to < chord.to - slack);
        ended.drain(..begin.map_or(0, |begin| begin + 1));
        for other in &ended {
            pair(chord.number, chords[*other].number)?;
        }
        ended.push(own);
    }
    Ok(())
}

/// Places on the border of a square where an edge enters and leaves it, the smaller one first; nothing if it is not sure that it does.
fn chord(low: Point, side: f64, [a, b]: [Point; 2]) -> Option<(f64, f64)> {
    let (mut enter, mut leave) = ((f64::NEG_INFINITY, 0.0), (f64::INFINITY, 0.0));
    let at = |axis: usize, border: f64| {
        // The share of the way at a side, and the place on it, from the lower left corner around to the right.
        let share = (border - a[axis]) / (b[axis] - a[axis]);
        let other = 1 - axis;
        let along = a[other] + share * (b[other] - a[other]) - low[other];
        let is_far = border > low[axis];
        let place = match (axis, is_far) {
            (1, false) => along,
            (0, true) => side + along,
            (1, true) => 3.0 * side - along,
            _ => 4.0 * side - along,
        };
        (share, place)
    };
    for axis in 0..2 {
        if a[axis] == b[axis] {
            continue;
        }
        let (first, second) = (at(axis, low[axis]), at(axis, low[axis] + side));
        let (first, second) = if first.0 <= second.0 { (first, second) } else { (second, first) };
        if first.0 > enter.0 {
            enter = first;
        }
        if second.0 < leave.0 {
            leave = second;
        }
    }
    let is_sure = enter.0 < leave.0 && enter.0 >= 0.0 && leave.0 <= 1.0;
    is_sure.then(|| (enter.1.min(leave.1), enter.1.max(leave.1)))
}
