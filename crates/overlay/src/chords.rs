//! Pairs of edges that may cross in a square, for edges that pass right through it and have no end
//! in it.
//!
//! Such edges are chords. Two chords cross if their ends alternate along the square's border. One
//! pass around the border, with a stack of the chords that are open, finds these pairs without
//! testing all pairs. Positions on the border are rounded. Positions that differ by less than the
//! rounding error count as both before and after each other.

use crate::crossings::Square;
use crate::exact::Point;

/// Positions at which a chord begins and ends along the border, counterclockwise from the lower
/// left corner.
struct Chord {
    number: u32,
    from: f64,
    to: f64,
}

/// Yields pairs of edges that may cross: all that do cross, and possibly others. A pair may be
/// yielded more than once where rounding leaves the order undecided.
pub(crate) fn alternating_pairs<E>(
    square: &Square,
    edges: &[(u32, [Point; 2])],
    pair: &mut dyn FnMut(u32, u32) -> Result<(), E>,
) -> Result<(), E> {
    let low = square.first.map(|first| first as f64 - 0.5);
    let side = square.side as f64;
    // (Each position is computed from a few numbers of this magnitude, with one rounding each.)
    let size =
        edges.iter().flat_map(|(_, ends)| ends.as_flattened()).fold(0f64, |most, at| most.max(at.abs()));
    let slack = 64.0 * f64::EPSILON * size;
    let (mut chords, mut unsure) = (Vec::with_capacity(edges.len()), Vec::new());
    for (number, ends) in edges {
        match chord(low, side, *ends) {
            Some((from, to)) if from > slack && to < 4.0 * side - slack => {
                chords.push(Chord { number: *number, from, to });
            }
            // The edge meets the corner where positions start, or barely touches the square.
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
    // Open chords in the order of their beginnings, and chords that ended within the slack.
    let (mut open, mut ended): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    let mut next = 0;
    for own in ends {
        let chord = &chords[own];
        while next < chords.len() && chords[next].from <= chord.to + slack {
            open.push(next);
            next += 1;
        }
        // Open chords that began after this one, or within the slack of it.
        let place = open.iter().rposition(|other| *other == own).unwrap_or(0);
        let begin = open[..place].iter().rposition(|other| chords[*other].from < chord.from - slack);
        for other in &open[begin.map_or(0, |begin| begin + 1)..] {
            if *other != own {
                pair(chord.number, chords[*other].number)?;
            }
        }
        open.remove(place);
        // Chords that ended within the slack of this one.
        let begin = ended.iter().rposition(|other| chords[*other].to < chord.to - slack);
        ended.drain(..begin.map_or(0, |begin| begin + 1));
        for other in &ended {
            pair(chord.number, chords[*other].number)?;
        }
        ended.push(own);
    }
    Ok(())
}

/// Positions on a square's border where an edge enters and leaves, the smaller one first. `None` if
/// rounding leaves it undecided whether the edge passes right through the square.
fn chord(low: Point, side: f64, [a, b]: [Point; 2]) -> Option<(f64, f64)> {
    let (mut enter, mut leave) = ((f64::NEG_INFINITY, 0.0), (f64::INFINITY, 0.0));
    let at = |axis: usize, border: f64| {
        // The edge parameter at the border line, and the position along the border,
        // counterclockwise from the lower left corner.
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
