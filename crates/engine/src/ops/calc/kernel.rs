//! Interpreter of programs over strips of cells, and conversion from and to values: the only code
//! that knows sample types.

use super::expression::{Binary, Expression, Op, Reducer, Unary};
use super::operands::Linear;
use spinney_base::value::{MAX_VALUE_SIZE, Sample, SampleType, Value, ValueType, with_sample_type};

/// Approximate count of numbers in all strips of a machine: they fit into a cache.
const STRIP_NUMBERS: usize = 1 << 14;

/// VOID.
const VOID: f64 = f64::NAN;

#[inline(always)]
fn truth(is_true: bool) -> f64 {
    if is_true { 1.0 } else { 0.0 }
}

/// The number, or VOID if one of two others is VOID.
#[inline(always)]
fn unless_void(a: f64, b: f64, number: f64) -> f64 {
    // (Branch-free.)
    if a.is_nan() | b.is_nan() { VOID } else { number }
}

#[inline(always)]
fn unary(unary: Unary, a: f64) -> f64 {
    match unary {
        Unary::Negate => -a,
        Unary::Not => unless_void(a, a, truth(a == 0.0)),
        Unary::Abs => a.abs(),
        // (NaN for a negative number.)
        Unary::Sqrt => a.sqrt(),
    }
}

#[inline(always)]
fn binary(binary: Binary, a: f64, b: f64) -> f64 {
    match binary {
        Binary::Add => a + b,
        Binary::Subtract => a - b,
        Binary::Multiply => a * b,
        Binary::Divide => {
            if b == 0.0 {
                VOID
            } else {
                a / b
            }
        }
        Binary::Less => unless_void(a, b, truth(a < b)),
        Binary::LessOrEqual => unless_void(a, b, truth(a <= b)),
        Binary::Greater => unless_void(a, b, truth(a > b)),
        Binary::GreaterOrEqual => unless_void(a, b, truth(a >= b)),
        Binary::Equal => unless_void(a, b, truth(a == b)),
        Binary::NotEqual => unless_void(a, b, truth(a != b)),
        Binary::And => unless_void(a, b, truth((a != 0.0) & (b != 0.0))),
        Binary::Or => unless_void(a, b, truth((a != 0.0) | (b != 0.0))),
    }
}

#[inline(always)]
fn choose(condition: f64, a: f64, b: f64) -> f64 {
    let chosen = if condition != 0.0 { a } else { b };
    unless_void(condition, condition, chosen)
}

/// Buffers for the strips of programs that share their operands.
pub(super) struct Machine<'a> {
    expressions: &'a [Expression],
    /// Maximum number of cells in a strip.
    length: usize,
    /// Strip of each operand.
    operands: Vec<Vec<f64>>,
    /// Strips, contiguous.
    stack: Vec<f64>,
    /// Count of numbers in each cell.
    counts: Vec<f64>,
}

impl<'a> Machine<'a> {
    /// Machine for this number of operands, sized for this number of cells.
    pub(super) fn new(expressions: &'a [Expression], operands: usize, cells: u64) -> Machine<'a> {
        let stack = expressions.iter().map(Expression::stack).max().unwrap_or(0);
        let strips = stack + operands + 2;
        let length = (STRIP_NUMBERS / strips).clamp(16, 1024).min(cells.max(1) as usize);
        Machine {
            expressions,
            length,
            operands: (0..operands).map(|_| Vec::with_capacity(length)).collect(),
            stack: vec![0.0; stack * length],
            counts: vec![0.0; length],
        }
    }

    /// Maximum number of cells in a strip.
    pub(super) fn length(&self) -> usize {
        self.length
    }

    /// Sets an operand's strip: the scaled samples of a channel, VOID where `valid` is false or a
    /// sample is missing.
    pub(super) fn load(
        &mut self,
        operand: usize,
        ((value, channel), (factor, summand)): ((ValueType, usize), Linear),
        bytes: &[u8],
        valid: &[bool],
    ) {
        let strip = &mut self.operands[operand];
        strip.clear();
        value.push_numbers(channel, bytes, strip);
        if (factor, summand) != (1.0, 0.0) {
            strip.iter_mut().for_each(|number| *number = *number * factor + summand);
        }
        for (number, valid) in strip.iter_mut().zip(valid) {
            *number = if *valid { *number } else { VOID };
        }
    }

    /// Results of an expression for `cells` cells, at most a strip.
    pub(super) fn run(&mut self, expression: usize, cells: usize) -> &[f64] {
        let length = self.length;
        let mut height = 0;
        for op in self.expressions[expression].ops() {
            let first = height - op.takes();
            let (below, above) = self.stack.split_at_mut((first + 1) * length);
            let result = &mut below[first * length..][..cells];
            let argument = |number: usize| &above[(number - 1) * length..][..cells];
            match *op {
                Op::Number(number) => result.fill(number),
                Op::Operand(operand) => result.copy_from_slice(&self.operands[operand][..cells]),
                Op::Unary(of) => run_unary(of, result),
                Op::Binary(of) => run_binary(of, result, argument(1)),
                Op::Where => {
                    for ((result, a), b) in result.iter_mut().zip(argument(1)).zip(argument(2)) {
                        *result = choose(*result, *a, *b);
                    }
                }
                Op::Reduce(reducer, count, constants) => {
                    let strips = &mut self.stack[first * length..(height) * length];
                    reduce(reducer, (strips, length, cells), (count, constants), &mut self.counts[..cells]);
                }
            }
            height = first + 1;
        }
        &self.stack[..cells]
    }
}

fn run_unary(of: Unary, result: &mut [f64]) {
    /// One loop per operation, so that the compiler can vectorize each.
    macro_rules! each {
        ($($kind:ident)*) => {
            match of {
                $(Unary::$kind => result.iter_mut().for_each(|a| *a = unary(Unary::$kind, *a)),)*
            }
        };
    }
    each!(Negate Not Abs Sqrt);
}

fn run_binary(of: Binary, result: &mut [f64], other: &[f64]) {
    macro_rules! each {
        ($($kind:ident)*) => {
            match of {
                $(Binary::$kind => {
                    result.iter_mut().zip(other).for_each(|(a, b)| *a = binary(Binary::$kind, *a, *b));
                })*
            }
        };
    }
    each!(Add Subtract Multiply Divide Less LessOrEqual Greater GreaterOrEqual Equal NotEqual And Or);
}

/// Reduces strips into the first one. The last `constants` strips are the same for all cells, and
/// count only where others do.
fn reduce(
    reducer: Reducer,
    (strips, length, cells): (&mut [f64], usize, usize),
    (count, constants): (usize, usize),
    counts: &mut [f64],
) {
    counts.fill(0.0);
    for (number, strip) in strips.chunks_exact_mut(length).enumerate() {
        let strip = &mut strip[..cells];
        if number < count || reducer == Reducer::Count {
            strip.iter().zip(&mut *counts).for_each(|(number, count)| *count += truth(!number.is_nan()));
        } else {
            // If all others are VOID, constants do not count.
            strip.iter_mut().zip(&mut *counts).for_each(|(number, count)| {
                *number = if *count > 0.0 { *number } else { VOID };
                *count += truth(!number.is_nan());
            });
        }
    }
    if reducer == Reducer::Median {
        return median((strips, length, cells), count + constants, counts);
    }
    let (result, others) = strips.split_at_mut(length);
    let result = &mut result[..cells];
    let others = others.chunks_exact(length).map(|strip| &strip[..cells]);
    match reducer {
        Reducer::Count => result.copy_from_slice(counts),
        Reducer::Min | Reducer::Max => {
            let sign = if reducer == Reducer::Min { 1.0 } else { -1.0 };
            for strip in others {
                for (best, number) in result.iter_mut().zip(strip) {
                    let is_better = best.is_nan() | (sign * number < sign * *best);
                    *best = if is_better { *number } else { *best };
                }
            }
        }
        Reducer::Mean => {
            result.iter_mut().for_each(|sum| *sum = if sum.is_nan() { 0.0 } else { *sum });
            for strip in others {
                for (sum, number) in result.iter_mut().zip(strip) {
                    *sum += if number.is_nan() { 0.0 } else { *number };
                }
            }
            // (0 divided by 0 is VOID.)
            result.iter_mut().zip(&*counts).for_each(|(sum, count)| *sum /= count);
        }
        Reducer::Median => {}
    }
}

/// Medians by a sorting network (Batcher's merge exchange: Knuth 5.2.2, M) on whole strips, so that
/// many cells are sorted at a time.
fn median((strips, length, cells): (&mut [f64], usize, usize), count: usize, counts: &[f64]) {
    // VOID sorts last.
    strips.iter_mut().for_each(|number| *number = if number.is_nan() { f64::INFINITY } else { *number });
    let first = count.next_power_of_two() / 2;
    let mut p = first;
    while p > 0 {
        let (mut q, mut r, mut distance) = (first, 0, p);
        loop {
            for low in (0..count.saturating_sub(distance)).filter(|low| low & p == r) {
                let (below, above) = strips.split_at_mut((low + distance) * length);
                let (below, above) = (&mut below[low * length..][..cells], &mut above[..cells]);
                for (a, b) in below.iter_mut().zip(above) {
                    (*a, *b) = if *b < *a { (*b, *a) } else { (*a, *b) };
                }
            }
            if q == p {
                break;
            }
            distance = q - p;
            q /= 2;
            r = p;
        }
        p /= 2;
    }
    for (cell, count) in counts.iter().enumerate() {
        let count = *count as usize;
        strips[cell] = match count.checked_sub(1) {
            None => VOID,
            Some(last) if count % 2 == 1 => strips[last / 2 * length + cell],
            Some(last) => {
                let (low, high) = (strips[last / 2 * length + cell], strips[count / 2 * length + cell]);
                if low == high { low } else { low.midpoint(high) }
            }
        };
    }
}

/// Result of an expression, if the known operands determine it. `None` is unknown; VOID is NaN.
pub(super) fn settle(expression: &Expression, operands: &[Option<f64>]) -> Option<f64> {
    let mut stack: Vec<Option<f64>> = Vec::with_capacity(expression.stack());
    for op in expression.ops() {
        let first = stack.len() - op.takes();
        let result = match (*op, &stack[first..]) {
            (Op::Number(number), _) => Some(number),
            (Op::Operand(operand), _) => operands[operand],
            (Op::Unary(of), [a]) => a.map(|a| unary(of, a)),
            (Op::Binary(of), [Some(a), Some(b)]) => Some(binary(of, *a, *b)),
            // Independent of the other operand.
            (Op::Binary(_), [a, b]) => a.or(*b).filter(|known| known.is_nan()),
            (Op::Where, [Some(condition), a, b]) => {
                if condition.is_nan() {
                    Some(VOID)
                } else if *condition != 0.0 {
                    *a
                } else {
                    *b
                }
            }
            (Op::Where, [None, Some(a), Some(b)]) => Some(VOID).filter(|_| a.is_nan() && b.is_nan()),
            (Op::Reduce(reducer, count, constants), known) => {
                let known: Option<Vec<f64>> = known.iter().copied().collect();
                known.map(|mut numbers| {
                    reduce(reducer, (&mut numbers, 1, 1), (count, constants), &mut [0.0]);
                    numbers[0]
                })
            }
            _ => None,
        };
        stack.truncate(first);
        stack.push(result);
    }
    stack.pop().flatten()
}

/// Writes results as the samples of a channel, and sets which cells are valid: if samples can be
/// missing, cells with a sample in any channel, else cells with samples in all channels. (Channels
/// must be stored in order.)
///
/// Integers are rounded to the nearest, half up as in means. Numbers beyond the type's range are
/// clamped to it. In floating-point types only numbers that were infinite before stay infinite.
pub(super) fn store(
    (value, channel): (ValueType, usize),
    numbers: &[f64],
    bytes: &mut [u8],
    valid: &mut [bool],
) {
    for (valid, number) in valid.iter_mut().zip(numbers) {
        let before = match channel {
            0 => !value.is_masked(),
            _ => *valid,
        };
        *valid = if value.is_masked() { before | !number.is_nan() } else { before & !number.is_nan() };
    }
    let sample = value.sample;
    with_sample_type!(sample, S => {
        let none = value.all_missing().map_or(S::from_f64_lossy(0.0), |missing| S::read(&missing.to_bytes()));
        let first = channel * size_of::<S>();
        for (number, bytes) in numbers.iter().zip(bytes.chunks_exact_mut(value.size())) {
            let sample = if number.is_nan() { none } else { S::from_f64_lossy(fitted(sample, *number)) };
            sample.write(&mut bytes[first..first + size_of::<S>()]);
        }
    });
}

#[inline(always)]
fn fitted(sample: SampleType, number: f64) -> f64 {
    match sample {
        SampleType::F64 => number,
        SampleType::F32 if number.is_finite() => number.clamp(f64::from(f32::MIN), f64::from(f32::MAX)),
        SampleType::F32 => number,
        _ => {
            let whole = number.floor();
            if number - whole >= 0.5 { whole + 1.0 } else { whole }
        }
    }
}

/// Results of one cell as a value; `None` is VOID.
pub(super) fn value_of(value: ValueType, numbers: &[f64]) -> Option<Value> {
    let (mut bytes, mut valid) = ([0; MAX_VALUE_SIZE], [false]);
    let bytes = &mut bytes[..value.size()];
    for (channel, number) in numbers.iter().enumerate() {
        store((value, channel), &[*number], bytes, &mut valid);
    }
    valid[0].then(|| Value::from_bytes(bytes))
}
