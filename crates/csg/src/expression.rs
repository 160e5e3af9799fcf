//! Expressions of primitives in postfix order: flat, without negations but of primitives, and made shorter for a part of space.

use crate::place::Place;

/// A step of an expression: operations come behind what they are of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// A primitive by its number, or all but it.
    Primitive(u32, bool),
    /// The union of the last ones, so many.
    Any(u32),
    /// The intersection of the last ones, so many.
    All(u32),
    /// Points in an odd number of the last ones, so many; or in an even number.
    Odd(u32, bool),
}

/// An expression in a part of space.
#[derive(Clone, Copy)]
struct Part {
    place: Place,
    /// Where its steps begin in the shorter expression, if it is mixed; otherwise those of what comes next.
    start: usize,
}

/// Buffers for making expressions shorter.
#[derive(Default)]
pub(crate) struct Pruner {
    parts: Vec<Part>,
    /// The steps that are left, if the part of space is mixed.
    pub(crate) steps: Vec<Step>,
}

impl Pruner {
    /// Looks at an expression in a part of space, by the places of its primitives: what is the same all over there is left out, and the
    /// steps that are left are the same there.
    pub(crate) fn prune(&mut self, steps: &[Step], mut place_of: impl FnMut(u32) -> Place) -> Place {
        self.parts.clear();
        self.steps.clear();
        for step in steps {
            let start = self.steps.len();
            let part = match *step {
                Step::Primitive(number, is_negated) => {
                    let place = place_of(number).negated_if(is_negated);
                    if place == Place::Mixed {
                        self.steps.push(*step);
                    }
                    Part { place, start }
                }
                Step::Any(count) => self.joined(count, Place::Full, Place::Void),
                Step::All(count) => self.joined(count, Place::Void, Place::Full),
                Step::Odd(count, is_even) => self.odd(count, is_even),
            };
            self.parts.push(part);
        }
        self.parts.pop().map_or(Place::Void, |part| part.place)
    }

    /// The union or intersection of the last ones: if one is `decisive`, so are all, and if all are `neutral`, so is it.
    fn joined(&mut self, count: u32, decisive: Place, neutral: Place) -> Part {
        let parts = self.parts.drain(self.parts.len() - count as usize..);
        let (mut start, mut mixed, mut is_decided) = (usize::MAX, 0, false);
        for part in parts {
            start = start.min(part.start);
            mixed += u32::from(part.place == Place::Mixed);
            is_decided |= part.place == decisive;
        }
        if is_decided || mixed == 0 {
            self.steps.truncate(start);
            return Part { place: if is_decided { decisive } else { neutral }, start };
        }
        if mixed > 1 {
            self.steps.push(if decisive == Place::Full { Step::Any(mixed) } else { Step::All(mixed) });
        }
        Part { place: Place::Mixed, start }
    }

    fn odd(&mut self, count: u32, is_even: bool) -> Part {
        let parts = self.parts.drain(self.parts.len() - count as usize..);
        let (mut start, mut mixed, mut is_even) = (usize::MAX, 0, is_even);
        for part in parts {
            start = start.min(part.start);
            mixed += u32::from(part.place == Place::Mixed);
            is_even ^= part.place == Place::Full;
        }
        if mixed == 0 {
            return Part { place: Place::uniform(is_even), start };
        }
        if mixed > 1 || is_even {
            self.steps.push(Step::Odd(mixed, is_even));
        }
        Part { place: Place::Mixed, start }
    }
}

/// The value of an expression of sets, or of what stands for sets, such as bits.
pub(crate) fn fold<T>(
    steps: &[Step],
    stack: &mut Vec<T>,
    mut primitive: impl FnMut(u32, bool) -> T,
    mut operation: impl FnMut(Step, &[T]) -> T,
) -> Option<T> {
    stack.clear();
    for step in steps {
        let value = match *step {
            Step::Primitive(number, is_negated) => primitive(number, is_negated),
            Step::Any(count) | Step::All(count) | Step::Odd(count, _) => {
                let first = stack.len() - count as usize;
                let value = operation(*step, &stack[first..]);
                stack.truncate(first);
                value
            }
        };
        stack.push(value);
    }
    stack.pop()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_settled_vanishes() {
        use Place::{Full, Mixed, Void};
        let steps = [
            Step::Primitive(0, false),
            Step::Primitive(1, true),
            Step::All(2),
            Step::Primitive(2, false),
            Step::Primitive(3, false),
            Step::Odd(2, false),
            Step::Any(2),
        ];
        let mut pruner = Pruner::default();
        let mut of = |places: [Place; 4]| {
            let place = pruner.prune(&steps, |number| places[number as usize]);
            (place, pruner.steps.clone())
        };
        assert_eq!(of([Full, Void, Mixed, Mixed]), (Full, vec![]));
        assert_eq!(of([Void, Mixed, Full, Full]), (Void, vec![]));
        assert_eq!(of([Mixed, Void, Void, Void]), (Mixed, vec![Step::Primitive(0, false)]));
        assert_eq!(of([Full, Mixed, Void, Void]), (Mixed, vec![Step::Primitive(1, true)]));
        let left = vec![Step::Primitive(3, false), Step::Odd(1, true)];
        assert_eq!(of([Void, Mixed, Full, Mixed]), (Mixed, left));
        assert_eq!(of([Mixed; 4]), (Mixed, steps.to_vec()));
    }
}
