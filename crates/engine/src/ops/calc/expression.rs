//! Validated expressions over cell values, in postfix form.

use spinney_base::{Error, Result};

/// Name of an operand: `B08`, or `a.b2`, a channel of another name's tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Name {
    pub(super) whole: String,
    pub(super) channel: Option<String>,
}

/// Operation on two numbers.
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

/// Operation on one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unary {
    Negate,
    Not,
    Abs,
    Sqrt,
}

/// Operation on any count of numbers, which ignores VOID ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reducer {
    /// Middle number, or the mean of the two middle ones.
    Median,
    /// Mean.
    Mean,
    /// Minimum.
    Min,
    /// Maximum.
    Max,
    /// Count of numbers.
    Count,
}

impl Reducer {
    /// All reducers.
    pub(super) const ALL: [Reducer; 5] = {
        use Reducer::*;
        [Median, Mean, Min, Max, Count]
    };

    /// Name in expressions, and of `reduce=`.
    pub(super) fn name(self) -> &'static str {
        ["median", "mean", "min", "max", "count"][self as usize]
    }

    /// Reducer with a name.
    pub(super) fn named(name: &str) -> Option<Reducer> {
        Reducer::ALL.into_iter().find(|reducer| reducer.name() == name)
    }
}

/// Instruction of a program, which takes its numbers from a stack and pushes one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Op {
    /// Number that all cells have.
    Number(f64),
    /// Operand with this index.
    Operand(usize),
    Unary(Unary),
    Binary(Binary),
    /// Of three numbers: the second if the first is not 0, else the third.
    Where,
    /// Reduction of this many numbers: first those that depend on operands, then those that are the
    /// same for all cells, which are ignored where all the others are VOID.
    Reduce(Reducer, usize, usize),
}

impl Op {
    /// Count of numbers that it takes from the stack.
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

/// Maximum number of operands and instructions of a program: each takes time and memory for every
/// cell.
pub(super) const MAX_STEPS: usize = 8192;

/// Program: names of its operands, and its instructions in postfix order.
///
/// Numbers are f64. NaN is VOID, and nothing else is: VOID propagates through all instructions but
/// [`Op::Where`] and [`Op::Reduce`], since arithmetic propagates NaN.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Expression {
    names: Vec<Name>,
    ops: Vec<Op>,
    /// Maximum stack height.
    stack: usize,
}

impl Expression {
    /// Program of some instructions, which leave one number on the stack.
    ///
    /// # Errors
    /// If there are too many.
    pub(super) fn new(names: Vec<Name>, ops: Vec<Op>) -> Result<Expression> {
        if ops.len() > MAX_STEPS || names.len() > MAX_STEPS {
            let found = format!("{} operations on {} operands", ops.len(), names.len());
            return Err(Error::invalid("calculation", found, format!("at most {MAX_STEPS} of each")));
        }
        let (mut height, mut stack) = (0usize, 0usize);
        for op in &ops {
            // (Too few numbers would be an error of the parser, not of the user.)
            height = height.checked_sub(op.takes()).expect("operands before each operation") + 1;
            stack = stack.max(height);
        }
        assert_eq!(height, 1, "one result");
        Ok(Expression { names, ops, stack })
    }

    /// Reduction of the given number of operands.
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

    /// Operand, unchanged.
    pub(super) fn operand(operand: usize) -> Expression {
        Expression { names: Vec::new(), ops: vec![Op::Operand(operand)], stack: 1 }
    }

    /// Names of the operands, each once, by index.
    pub(super) fn names(&self) -> &[Name] {
        &self.names
    }

    pub(super) fn ops(&self) -> &[Op] {
        &self.ops
    }

    /// Maximum stack height.
    pub(super) fn stack(&self) -> usize {
        self.stack
    }
}
