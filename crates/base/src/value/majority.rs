//! Tie-breaking of [`Rule::Majority`](super::Rule::Majority) by the order of the children.
//!
//! If the lowest class won, every tie would be resolved in the same way, and low classes would grow
//! from level to level. Instead, a tie goes to the first child, in child order, whose value is one
//! of the tied classes. If no child has one of them, a hash of the children's values chooses. Both
//! depend only on a node's children and counts, so the bytes of a tree do not depend on how it was
//! built.

use super::erased::Value;

/// Returns the class that wins a tie.
///
/// `tied` are the classes that have `cells` cells each, in ascending order. `children` are the
/// values of the children that are not VOID, in child order.
///
/// # Panics
/// If `tied` is empty.
pub fn break_tie(children: impl Iterator<Item = Value> + Clone, tied: &[Value], cells: u64) -> Value {
    let first = children.clone().find(|value| tied.contains(value));
    first.unwrap_or_else(|| tied[(hash(children, cells) % tied.len() as u64) as usize])
}

/// Returns a hash of values, with a number as the seed.
fn hash(values: impl Iterator<Item = Value>, number: u64) -> u64 {
    values.fold(number, |hash, value| {
        let hash = (hash ^ value.folded()).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        hash ^ hash >> 32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn class(number: u8) -> Value {
        Value::from([number])
    }

    #[test]
    fn the_first_child_of_a_tied_class_wins() {
        let children = [9, 7, 3, 7].map(class);
        assert_eq!(break_tie(children.into_iter(), &[3, 7].map(class), 5), class(7));
        assert_eq!(break_tie(children.into_iter(), &[3, 8].map(class), 5), class(3));
    }

    #[test]
    fn a_hash_chooses_where_no_child_has_a_tied_class() {
        // As specified in formats.md, for 5 cells and four children.
        let children = [9, 7, 3, 7];
        let mut hash = 5u64;
        for child in children {
            hash = (hash ^ child).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            hash ^= hash >> 32;
        }
        let tied = [1, 2, 4].map(class);
        let expected = tied[(hash % 3) as usize];
        assert_eq!(break_tie(children.map(|child| class(child as u8)).into_iter(), &tied, 5), expected);
        // Each class wins about equally often.
        let mut wins = [0; 3];
        for number in 0..3000u64 {
            let children = [10 + number % 7, 20 + number / 7 % 11, 10 + number % 7, 40 + number % 13];
            let winner = break_tie(children.map(|child| class(child as u8)).into_iter(), &tied, number / 500);
            wins[tied.iter().position(|class| *class == winner).unwrap()] += 1;
        }
        assert!(wins.iter().all(|wins| (900..1100).contains(wins)), "{wins:?}");
    }

    #[test]
    fn values_of_16_bytes_count_in_full() {
        let wide = |last| Value::from([1i32, 2, 3, last]);
        let tied: Vec<_> = (0..64).map(class).collect();
        let winners: std::collections::HashSet<_> =
            (0..64).map(|last| break_tie([wide(last)].into_iter(), &tied, 1)).collect();
        assert!(winners.len() > 20, "{}", winners.len());
    }
}
