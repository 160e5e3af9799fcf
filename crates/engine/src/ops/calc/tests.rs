//! Programs against a naive model: every cell separately, with `None` for VOID. (Trees are tested
//! in tests/operations.)

use super::kernel::{Machine, settle, value_of};
use super::parse::parse;
use spinney_base::value::{SampleType, ValueType};

struct Random(u64);

impl Random {
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % most
    }
}

/// Expression as a tree, which can be written as a string.
enum Model {
    Number(f64),
    Operand(usize),
    Call(&'static str, Vec<Model>),
}

const INFIX: [&str; 14] = ["+", "-", "*", "/", "<", "<=", ">", ">=", "==", "!=", "and", "or", "&", "|"];
const FUNCTIONS: [(&str, usize); 12] = [
    ("neg", 1),
    ("not", 1),
    ("!", 1),
    ("abs", 1),
    ("sqrt", 1),
    ("where", 3),
    ("min", 0),
    ("max", 0),
    ("mean", 0),
    ("median", 0),
    ("count", 0),
    ("where", 3),
];

impl Model {
    fn random(random: &mut Random, depth: u64) -> Model {
        match random.below(if depth == 0 { 2 } else { 6 }) {
            0 => Model::Number([0.0, 1.0, 2.0, 0.5, 7.0, 1e300][random.below(6) as usize]),
            1 => Model::Operand(random.below(3) as usize),
            2 | 3 => {
                let operator = INFIX[random.below(INFIX.len() as u64) as usize];
                Model::Call(
                    operator,
                    vec![Model::random(random, depth - 1), Model::random(random, depth - 1)],
                )
            }
            _ => {
                let (name, takes) = FUNCTIONS[random.below(FUNCTIONS.len() as u64) as usize];
                let count = if takes == 0 { 1 + random.below(9) as usize } else { takes };
                Model::Call(name, (0..count).map(|_| Model::random(random, depth - 1)).collect())
            }
        }
    }

    fn text(&self) -> String {
        match self {
            Model::Number(number) => format!("{number:e}"),
            Model::Operand(operand) => ["a", "\"b c\"", "d.e"][*operand].into(),
            Model::Call("neg", of) => format!("(-{})", of[0].text()),
            Model::Call("not", of) => format!("(not {})", of[0].text()),
            Model::Call("!", of) => format!("!{}", of[0].text()),
            Model::Call(operator, of) if INFIX.contains(operator) => {
                format!("({} {operator} {})", of[0].text(), of[1].text())
            }
            Model::Call(name, of) => {
                format!("{name}({})", of.iter().map(Model::text).collect::<Vec<_>>().join(","))
            }
        }
    }

    fn is_constant(&self) -> bool {
        match self {
            Model::Number(_) => true,
            Model::Operand(_) => false,
            Model::Call(_, of) => of.iter().all(Model::is_constant),
        }
    }

    fn value(&self, operands: &[Option<f64>; 3]) -> Option<f64> {
        let truth = |is_true: bool| Some(f64::from(u8::from(is_true)));
        let Model::Call(name, of) = self else {
            return match self {
                Model::Number(number) => Some(*number),
                Model::Operand(operand) => operands[*operand],
                Model::Call(..) => unreachable!(),
            };
        };
        if let "min" | "max" | "mean" | "median" | "count" = *name {
            let numbers = |constant: bool| -> Vec<f64> {
                of.iter()
                    .filter(|of| of.is_constant() == constant)
                    .filter_map(|of| of.value(operands))
                    .collect()
            };
            let (mut all, constants) = (numbers(false), numbers(true));
            let has_others = of.iter().any(|of| !of.is_constant());
            if !all.is_empty() || !has_others || *name == "count" {
                all.extend(constants);
            }
            if *name == "count" {
                return Some(all.len() as f64);
            }
            if all.is_empty() {
                return None;
            }
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            all.sort_by(f64::total_cmp);
            let (low, high) = (all[(all.len() - 1) / 2], all[all.len() / 2]);
            let found = match *name {
                "min" => all[0],
                "max" => all[all.len() - 1],
                "mean" => mean,
                _ if low == high => low,
                _ => low.midpoint(high),
            };
            return Some(found).filter(|found| !found.is_nan());
        }
        if *name == "where" {
            return if of[0].value(operands)? != 0.0 { of[1].value(operands) } else { of[2].value(operands) };
        }
        let a = of[0].value(operands)?;
        let result = match *name {
            "neg" => Some(-a),
            "not" | "!" => truth(a == 0.0),
            "abs" => Some(a.abs()),
            "sqrt" => (a >= 0.0).then(|| a.sqrt()),
            operator => {
                let b = of[1].value(operands)?;
                match operator {
                    "+" => Some(a + b),
                    "-" => Some(a - b),
                    "*" => Some(a * b),
                    "/" => (b != 0.0).then(|| a / b),
                    "<" => truth(a < b),
                    "<=" => truth(a <= b),
                    ">" => truth(a > b),
                    ">=" => truth(a >= b),
                    "==" => truth(a == b),
                    "!=" => truth(a != b),
                    "and" | "&" => truth(a != 0.0 && b != 0.0),
                    _ => truth(a != 0.0 || b != 0.0),
                }
            }
        };
        result.filter(|number| !number.is_nan())
    }
}

/// Whether two results are the same; means of many numbers may be summed in another order.
fn same(a: Option<f64>, b: Option<f64>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => a == b || (a - b).abs() <= 1e-12 * a.abs().max(b.abs()),
        (a, b) => a.is_none() && b.is_none(),
    }
}

#[test]
fn programs_do_what_the_model_does() {
    let mut random = Random(1991);
    let types = [SampleType::U8, SampleType::I16, SampleType::F32];
    let (mut settled, mut voids) = (0, 0);
    for round in 0..1500 {
        let model = Model::random(&mut random, 1 + round % 4);
        let text = model.text();
        let expression = parse(&text).unwrap_or_else(|error| panic!("{text}: {error}"));
        let cells = 1 + random.below(40) as usize;
        let numbers = [0.0, 1.0, 2.0, 3.0, 200.0, 7.0];
        let columns: Vec<Vec<Option<f64>>> = (0..3)
            .map(|_| {
                (0..cells).map(|_| (random.below(4) > 0).then(|| numbers[random.below(6) as usize])).collect()
            })
            .collect();
        let which = |name: &super::expression::Name| match name.whole.as_str() {
            "a" => 0,
            "d" => 2,
            _ => 1,
        };
        let operands: Vec<usize> = expression.names().iter().map(which).collect();
        let mut machine = Machine::new(std::slice::from_ref(&expression), operands.len(), cells as u64);
        for (number, operand) in operands.iter().enumerate() {
            let value = ValueType::new(types[*operand], 1);
            let mut bytes = Vec::new();
            for cell in &columns[*operand] {
                let value_of = value.nearest(|_| cell.unwrap_or(9.0));
                bytes.extend_from_slice(&value_of.to_bytes()[..value.size()]);
            }
            let valid: Vec<bool> = columns[*operand].iter().map(Option::is_some).collect();
            machine.load(number, ((value, 0), (1.0, 0.0)), &bytes, &valid);
        }
        let found = machine.run(0, cells).to_vec();
        for cell in 0..cells {
            let here = [columns[0][cell], columns[1][cell], columns[2][cell]];
            let expected = model.value(&here);
            let found = Some(found[cell]).filter(|number| !number.is_nan());
            assert!(same(found, expected), "{text} of {here:?}: {found:?}, not {expected:?}");
            voids += usize::from(expected.is_none());
            // A result that follows from some operands holds for all values of the others.
            let known: Vec<Option<f64>> = operands
                .iter()
                .map(|operand| (random.below(3) > 0).then(|| here[*operand].unwrap_or(f64::NAN)))
                .collect();
            if let Some(known) = settle(&expression, &known) {
                settled += 1;
                assert!(same(Some(known).filter(|number| !number.is_nan()), expected), "{text} of {here:?}");
            }
        }
    }
    assert!(settled > 5000 && voids > 5000, "{settled} {voids}");
}

#[test]
fn medians_of_many_are_those_in_the_middle() {
    let mut random = Random(7);
    for count in 1..40 {
        let names: Vec<String> = (0..count).map(|number| format!("n{number}")).collect();
        let expression = parse(&format!("median({})", names.join(","))).unwrap();
        let mut machine = Machine::new(std::slice::from_ref(&expression), count, 5);
        let value = ValueType::new(SampleType::U8, 1);
        let cells: Vec<Vec<u8>> =
            (0..count).map(|_| (0..5).map(|_| random.below(50) as u8).collect()).collect();
        for (operand, cells) in cells.iter().enumerate() {
            // 0 is VOID.
            let valid: Vec<bool> = cells.iter().map(|cell| *cell > 0).collect();
            machine.load(operand, ((value, 0), (1.0, 0.0)), cells, &valid);
        }
        let found = machine.run(0, 5).to_vec();
        for cell in 0..5 {
            let mut there: Vec<u8> = cells.iter().map(|cells| cells[cell]).filter(|cell| *cell > 0).collect();
            there.sort_unstable();
            let middle = |index: usize| f64::from(there[index]);
            let expected = match there.len() {
                0 => f64::NAN,
                length => (middle((length - 1) / 2) + middle(length / 2)) / 2.0,
            };
            assert!(found[cell] == expected || there.is_empty() && found[cell].is_nan(), "{there:?}");
        }
    }
}

#[test]
fn results_are_fitted_to_types() {
    for (sample, number, expected) in [
        (SampleType::U8, 1.5, 2.0),
        (SampleType::U8, 0.499_999_999_999_999_94, 0.0),
        (SampleType::I16, -1.5, -1.0),
        (SampleType::I16, -1.6, -2.0),
        (SampleType::U8, -3.0, 0.0),
        (SampleType::U8, 256.0, 255.0),
        (SampleType::I32, f64::INFINITY, 2_147_483_647.0),
        (SampleType::F32, 1e300, f64::from(f32::MAX)),
        (SampleType::F32, f64::NEG_INFINITY, f64::NEG_INFINITY),
        (SampleType::F64, 1e300, 1e300),
    ] {
        let value = value_of(ValueType::new(sample, 1), &[number]).unwrap();
        assert_eq!(ValueType::new(sample, 1).first_sample(value), expected, "{number} as {sample:?}");
    }
    assert_eq!(value_of(ValueType::new(SampleType::U8, 1), &[f64::NAN]), None);
}
