//! Set expressions of primitives in postfix order. They are flat, with complements only at
//! primitives, and can be simplified for a region of space.

use crate::box_state::BoxState;

/// An element of a postfix expression: operations follow their operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Instruction {
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
struct Operand {
    state: BoxState,
    /// Index in the simplified expression at which its instructions begin. A subexpression that is
    /// not mixed has no instructions there.
    start: usize,
}

/// Reusable buffers for simplifying expressions.
#[derive(Default)]
pub(crate) struct Pruner {
    operands: Vec<Operand>,
    /// The remaining instructions, if the region is mixed.
    pub(crate) instructions: Vec<Instruction>,
}

impl Pruner {
    /// Simplifies an expression for a region of space, given the primitives' classification there.
    /// Operands that are uniform in the region are removed. The remaining instructions are
    /// equivalent within the region.
    pub(crate) fn prune(
        &mut self,
        instructions: &[Instruction],
        mut state_of: impl FnMut(u32) -> BoxState,
    ) -> BoxState {
        self.operands.clear();
        self.instructions.clear();
        for instruction in instructions {
            let start = self.instructions.len();
            let operand = match *instruction {
                Instruction::Primitive(number, is_negated) => {
                    let state = state_of(number).negated_if(is_negated);
                    if state == BoxState::Mixed {
                        self.instructions.push(*instruction);
                    }
                    Operand { state, start }
                }
                Instruction::Any(count) => self.joined(count, BoxState::Full, BoxState::Void),
                Instruction::All(count) => self.joined(count, BoxState::Void, BoxState::Full),
                Instruction::Odd(count, is_even) => self.odd(count, is_even),
            };
            self.operands.push(operand);
        }
        self.operands.pop().map_or(BoxState::Void, |operand| operand.state)
    }

    /// Simplifies a union or intersection of the last operands. A `decisive` operand decides the
    /// result; if all are `neutral`, so is the result.
    fn joined(&mut self, count: u32, decisive: BoxState, neutral: BoxState) -> Operand {
        let operands = self.operands.drain(self.operands.len() - count as usize..);
        let (mut start, mut mixed, mut is_decided) = (usize::MAX, 0, false);
        for operand in operands {
            start = start.min(operand.start);
            mixed += u32::from(operand.state == BoxState::Mixed);
            is_decided |= operand.state == decisive;
        }
        if is_decided || mixed == 0 {
            self.instructions.truncate(start);
            return Operand { state: if is_decided { decisive } else { neutral }, start };
        }
        if mixed > 1 {
            self.instructions.push(if decisive == BoxState::Full {
                Instruction::Any(mixed)
            } else {
                Instruction::All(mixed)
            });
        }
        Operand { state: BoxState::Mixed, start }
    }

    fn odd(&mut self, count: u32, is_even: bool) -> Operand {
        let operands = self.operands.drain(self.operands.len() - count as usize..);
        let (mut start, mut mixed, mut is_even) = (usize::MAX, 0, is_even);
        for operand in operands {
            start = start.min(operand.start);
            mixed += u32::from(operand.state == BoxState::Mixed);
            is_even ^= operand.state == BoxState::Full;
        }
        if mixed == 0 {
            return Operand { state: BoxState::uniform(is_even), start };
        }
        if mixed > 1 || is_even {
            self.instructions.push(Instruction::Odd(mixed, is_even));
        }
        Operand { state: BoxState::Mixed, start }
    }
}

/// Evaluates an expression on any representation of sets, such as bit masks.
pub(crate) fn fold<T>(
    instructions: &[Instruction],
    stack: &mut Vec<T>,
    mut primitive: impl FnMut(u32, bool) -> T,
    mut operation: impl FnMut(Instruction, &[T]) -> T,
) -> Option<T> {
    stack.clear();
    for instruction in instructions {
        let value = match *instruction {
            Instruction::Primitive(number, is_negated) => primitive(number, is_negated),
            Instruction::Any(count) | Instruction::All(count) | Instruction::Odd(count, _) => {
                let first = stack.len() - count as usize;
                let value = operation(*instruction, &stack[first..]);
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
        use BoxState::{Full, Mixed, Void};
        let instructions = [
            Instruction::Primitive(0, false),
            Instruction::Primitive(1, true),
            Instruction::All(2),
            Instruction::Primitive(2, false),
            Instruction::Primitive(3, false),
            Instruction::Odd(2, false),
            Instruction::Any(2),
        ];
        let mut pruner = Pruner::default();
        let mut of = |states: [BoxState; 4]| {
            let state = pruner.prune(&instructions, |number| states[number as usize]);
            (state, pruner.instructions.clone())
        };
        assert_eq!(of([Full, Void, Mixed, Mixed]), (Full, vec![]));
        assert_eq!(of([Void, Mixed, Full, Full]), (Void, vec![]));
        assert_eq!(of([Mixed, Void, Void, Void]), (Mixed, vec![Instruction::Primitive(0, false)]));
        assert_eq!(of([Full, Mixed, Void, Void]), (Mixed, vec![Instruction::Primitive(1, true)]));
        let left = vec![Instruction::Primitive(3, false), Instruction::Odd(1, true)];
        assert_eq!(of([Void, Mixed, Full, Mixed]), (Mixed, left));
        assert_eq!(of([Mixed; 4]), (Mixed, instructions.to_vec()));
    }
}
