//! Set expressions of primitives in postfix order. They are flat, with complements only at
//! primitives, and can be simplified for a region of space.

use crate::place::Place;

/// A step of a postfix expression: operations follow their operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// A primitive by its number, or its complement if the flag is set.
    Primitive(u32, bool),
    /// Union of the last operands; the number gives their count.
    Any(u32),
    /// Intersection of the last operands; the number gives their count.
    All(u32),
    /// Points in an odd number of the last operands, or in an even number if the flag is set.
    Odd(u32, bool),
}

/// State of a subexpression in a region of space.
#[derive(Clone, Copy)]
struct Part {
    place: Place,
    /// Index in the simplified expression at which its steps begin. A subexpression that is not
    /// mixed has no steps there.
    start: usize,
}

/// Reusable buffers for simplifying expressions.
#[derive(Default)]
pub(crate) struct Pruner {
    parts: Vec<Part>,
    /// The remaining steps, if the region is mixed.
    pub(crate) steps: Vec<Step>,
}

impl Pruner {
    /// Simplifies an expression for a region of space, given the primitives' classification there.
    /// Operands that are uniform in the region are removed. The remaining steps are equivalent
    /// within the region.
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

    /// Simplifies a union or intersection of the last operands. A `decisive` operand decides the
    /// result; if all are `neutral`, so is the result.
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

/// Evaluates an expression on any representation of sets, such as bit masks.
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
