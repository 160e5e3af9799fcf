//! Expressions over numbers of cells, checked and in postfix form.

use spinney_base::{Error, Result};

/// A name of an operand: `B08`, or `a.b2`, a channel of what another name stands for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Name {
    pub(super) whole: String,
    pub(super) channel: Option<String>,
}

/// What is made of two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Equal,
    NotEqual,
    And,
    Or,
}

/// What is made of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unary {
    Negate,
    Not,
    Abs,
    Sqrt,
}

/// What is made of any count of numbers, of which those that are VOID are left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reducer {
    /// The one in the middle, or the mean of the two there.
    Median,
    /// The mean.
    Mean,
    /// The least.
    Min,
    /// The largest.
    Max,
    /// How many there are.
    Count,
}

impl Reducer {
    /// All of them.
    pub(super) const ALL: [Reducer; 5] = {
        use Reducer::*;
        [Median, Mean, Min, Max, Count]
    };

    /// The name in expressions, and of `reduce=`.
    pub(super) fn name(self) -> &'static str {
        ["median", "mean", "min", "max", "count"][self as usize]
    }

    /// The one with a name.
    pub(super) fn named(name: &str) -> Option<Reducer> {
        Reducer::ALL.into_iter().find(|reducer| reducer.name() == name)
    }
}

/// A step of a program, which takes its numbers from a stack and leaves one there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Op {
    /// A number for all cells.
    Number(f64),
    /// The operand with this number.
    Operand(usize),
    Unary(Unary),
    Binary(Binary),
    /// Of three: the second where the first is not 0, else the third.
    Where,
    /// Of so many: first those that are made of operands, then so many that are the same for all cells, which do not
    /// count where all the others are VOID.
    Reduce(Reducer, usize, usize),
}

impl Op {
    /// Numbers that it takes from the stack.
    pub(super) fn takes(self) -> usize {
        match self {
            Op::Number(_) | Op::Operand(_) => 0,
            Op::Unary(_) => 1,
            Op::Binary(_) => 2,
            Op::Where => 3,
            Op::Reduce(_, count, constants) => count + constants,
        }
    }
}

/// Operands and steps that a program has at most: each takes time and memory for every cell.
pub(super) const MAX_STEPS: usize = 8192;

/// A program: its operands' names, and its steps in postfix order.
///
/// Numbers are f64; one that is not a number is VOID, and there is no other: what is VOID stays so through all but [`Op::Where`] and
/// [`Op::Reduce`] because arithmetic hands on what is not a number.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Expression {
    names: Vec<Name>,
    ops: Vec<Op>,
    /// Numbers on the stack at most.
    stack: usize,
}

impl Expression {
    /// A program of some steps, which leave one number in the end.
    ///
    /// # Errors
    /// If there are too many.
    pub(super) fn new(names: Vec<Name>, ops: Vec<Op>) -> Result<Expression> {
        if ops.len() > MAX_STEPS || names.len() > MAX_STEPS {
            let found = format!("{} operations on {} operands", ops.len(), names.len());
            return Err(Error::invalid("calculation", found, format!("at most {MAX_STEPS} of either")));
        }
        let (mut height, mut stack) = (0usize, 0usize);
        for op in &ops {
            // (A parser that leaves too few has an error, which is not the user's.)
            height = height.checked_sub(op.takes()).expect("operands before each operation") + 1;
            stack = stack.max(height);
        }
        assert_eq!(height, 1, "one result");
        Ok(Expression { names, ops, stack })
    }

    /// The same of all of so many operands.
    ///
    /// # Errors
    /// If there are none, or too many.
    pub(super) fn reduction(reducer: Reducer, operands: usize) -> Result<Expression> {
        if operands == 0 || operands >= MAX_STEPS {
            let expected = format!("1 to {}", MAX_STEPS - 1);
            return Err(Error::invalid("operands", operands.to_string(), expected));
        }
        let mut ops: Vec<Op> = (0..operands).map(Op::Operand).collect();
        ops.push(Op::Reduce(reducer, operands, 0));
        Expression::new(Vec::new(), ops)
    }

    /// An operand as it is.
    pub(super) fn operand(operand: usize) -> Expression {
        Expression { names: Vec::new(), ops: vec![Op::Operand(operand)], stack: 1 }
    }

    /// Names of the operands, each once, in the order of their numbers.
    pub(super) fn names(&self) -> &[Name] {
        &self.names
    }

    pub(super) fn ops(&self) -> &[Op] {
        &self.ops
    }

    /// Numbers on the stack at most.
    pub(super) fn stack(&self) -> usize {
        self.stack
    }
}
