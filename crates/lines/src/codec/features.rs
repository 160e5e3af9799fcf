//! Blocks of features: their lines and attributes.

use std::collections::HashMap;

use super::numbers::{Reader, write, write_near};
use crate::attribute::LineValue;
use crate::source::LineFeature;

/// Maximum number of features in a block.
pub(crate) const MAX_FEATURES: usize = 1 << 12;
/// Maximum number of vertices in a block. A feature is never split between blocks.
pub(crate) const MAX_VERTICES: usize = 1 << 24;
/// Maximum total bytes of a feature's strings, and of the distinct strings of an attribute in a
/// block.
pub(crate) const MAX_TEXT: usize = 1 << 24;

/// Total bytes of a feature's strings.
pub(crate) fn text_bytes(feature: &LineFeature) -> usize {
    let text = |value: &LineValue| match value {
        LineValue::Text(text) | LineValue::Json(text) => text.len(),
        _ => 0,
    };
    feature.values.iter().map(text).sum()
}

/// Approximate bytes of memory of a feature.
pub(crate) fn weight(feature: &LineFeature) -> usize {
    let vertices: usize = feature.lines.iter().map(|line| 12 * line.len() + 24).sum();
    vertices + 32 * feature.values.len() + text_bytes(feature)
}

/// Type tags of values.
const NONE: i64 = 0;
const INTEGER: i64 = 1;
const NUMBER: i64 = 2;
const TEXT: i64 = 3;
const FALSE: i64 = 4;
const TRUE: i64 = 5;
const JSON: i64 = 6;

/// Encodes features of two or three axes, each with a value for each of `attributes` attributes.
pub(crate) fn encode_features(features: &[LineFeature], attributes: usize, axes: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let lines = features.iter().map(|feature| feature.lines.len() as i64).collect::<Vec<_>>();
    let all = || features.iter().flat_map(|feature| &feature.lines);
    let vertices = all().map(|line| line.len() as i64).collect::<Vec<_>>();
    write(&lines, &[], &mut bytes);
    write(&vertices, &[], &mut bytes);
    // A line often begins near the end of the previous one. The first vertex of each line has a
    // context of its own.
    let contexts: Vec<u8> =
        all().flat_map(|line| (0..line.len()).map(|vertex| u8::from(vertex == 0))).collect();
    for axis in 0..axes {
        let mut before = 0;
        let steps = all().flatten().map(|vertex| {
            let here = i64::from(vertex[axis]);
            here - std::mem::replace(&mut before, here)
        });
        let steps: Vec<i64> = steps.collect();
        write(&steps, &contexts, &mut bytes);
    }
    for attribute in 0..attributes {
        let values: Vec<&LineValue> = features
            .iter()
            .map(|feature| feature.values.get(attribute).unwrap_or(&LineValue::None))
            .collect();
        write_values(&values, &mut bytes);
    }
    bytes
}

fn write_values(values: &[&LineValue], bytes: &mut Vec<u8>) {
    let (mut marks, mut integers, mut numbers, mut string_indices) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut known: HashMap<&str, i64> = HashMap::new();
    let mut strings: Vec<&str> = Vec::new();
    for value in values {
        marks.push(match value {
            LineValue::None => NONE,
            LineValue::Integer(number) => {
                integers.push(*number);
                INTEGER
            }
            LineValue::Number(number) => {
                numbers.push(number.to_bits() as i64);
                NUMBER
            }
            LineValue::Boolean(is) => {
                if *is {
                    TRUE
                } else {
                    FALSE
                }
            }
            LineValue::Text(text) | LineValue::Json(text) => {
                let number = *known.entry(text).or_insert_with(|| {
                    strings.push(text);
                    strings.len() as i64 - 1
                });
                string_indices.push(number);
                if matches!(value, LineValue::Text(_)) { TEXT } else { JSON }
            }
        });
    }
    write(&marks, &[], bytes);
    write_near(&integers, bytes);
    write_near(&numbers, bytes);
    if string_indices.is_empty() {
        return;
    }
    write(&[strings.len() as i64], &[], bytes);
    write(&string_indices, &[], bytes);
    let lengths: Vec<i64> = strings.iter().map(|word| word.len() as i64).collect();
    write(&lengths, &[], bytes);
    let letters: Vec<i64> = strings.iter().flat_map(|word| word.bytes()).map(i64::from).collect();
    write(&letters, &[], bytes);
}

/// Decodes `count` features of two or three axes with `attributes` attributes; `None` if the bytes
/// are invalid.
pub(crate) fn decode_features(
    bytes: &[u8],
    count: usize,
    attributes: usize,
    axes: usize,
) -> Option<Vec<LineFeature>> {
    if count > MAX_FEATURES {
        return None;
    }
    let mut reader = Reader::new(bytes);
    let sum = |numbers: &[i64]| -> Option<usize> {
        let sum =
            numbers.iter().try_fold(0u64, |sum, number| sum.checked_add(u64::try_from(*number).ok()?))?;
        usize::try_from(sum).ok().filter(|sum| *sum <= MAX_VERTICES)
    };
    let lines = reader.numbers(count, &[])?;
    let vertices = reader.numbers(sum(&lines)?, &[])?;
    if vertices.iter().any(|vertices| *vertices < 2) {
        return None;
    }
    let all = sum(&vertices)?;
    let mut contexts = Vec::with_capacity(all);
    for vertices in &vertices {
        contexts.push(1);
        contexts.resize(contexts.len() + *vertices as usize - 1, 0);
    }
    let steps = (0..axes).map(|_| reader.numbers(all, &contexts)).collect::<Option<Vec<_>>>()?;
    let mut features = vec![LineFeature::default(); count];
    let (mut line, mut vertex, mut here) = (0, 0, [0i64; 3]);
    for (feature, lines) in features.iter_mut().zip(&lines) {
        for vertices in &vertices[line..line + *lines as usize] {
            let mut own = Vec::with_capacity(*vertices as usize);
            for _ in 0..*vertices {
                let mut position = [0; 3];
                for (axis, steps) in steps.iter().enumerate() {
                    here[axis] = here[axis].checked_add(steps[vertex])?;
                    position[axis] = i32::try_from(here[axis]).ok()?;
                }
                own.push(position);
                vertex += 1;
            }
            feature.lines.push(own);
        }
        line += *lines as usize;
    }
    for _ in 0..attributes {
        for (feature, value) in features.iter_mut().zip(read_values(&mut reader, count)?) {
            feature.values.push(value);
        }
    }
    reader.is_whole().then_some(features)
}

fn read_values(reader: &mut Reader<'_>, count: usize) -> Option<Vec<LineValue>> {
    let marks = reader.numbers(count, &[])?;
    let with = |wanted: &[i64]| marks.iter().filter(|mark| wanted.contains(*mark)).count();
    let mut integers = reader.numbers(with(&[INTEGER]), &[])?.into_iter();
    let mut numbers = reader.numbers(with(&[NUMBER]), &[])?.into_iter();
    let mut strings: Vec<String> = Vec::new();
    let mut string_indices = Vec::new().into_iter();
    let string_count = with(&[TEXT, JSON]);
    if string_count > 0 {
        let known =
            usize::try_from(reader.numbers(1, &[])?[0]).ok().filter(|known| *known <= string_count)?;
        string_indices = reader.numbers(string_count, &[])?.into_iter();
        let lengths = reader.numbers(known, &[])?;
        let mut all = 0usize;
        for length in &lengths {
            all = all.checked_add(usize::try_from(*length).ok()?).filter(|all| *all <= MAX_TEXT)?;
        }
        let letters = reader.numbers(all, &[])?;
        let letters = letters.into_iter().map(u8::try_from).collect::<Result<Vec<u8>, _>>().ok()?;
        let mut rest = &letters[..];
        for length in lengths {
            let (word, remaining) = rest.split_at_checked(length as usize)?;
            strings.push(String::from_utf8(word.to_vec()).ok()?);
            rest = remaining;
        }
    }
    let mut word = || strings.get(usize::try_from(string_indices.next()?).ok()?).cloned();
    let value = |mark: i64| {
        Some(match mark {
            NONE => LineValue::None,
            INTEGER => LineValue::Integer(integers.next()?),
            NUMBER => LineValue::Number(f64::from_bits(numbers.next()? as u64)),
            TEXT => LineValue::Text(word()?),
            FALSE => LineValue::Boolean(false),
            TRUE => LineValue::Boolean(true),
            JSON => LineValue::Json(word()?),
            _ => return None,
        })
    };
    marks.into_iter().map(value).collect()
}
