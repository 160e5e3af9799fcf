//! Values of header fields: types, lists, vectors.

use crate::import::SampleFormat;

/// The sample format of a type name.
pub(super) fn format(name: &str) -> Option<SampleFormat> {
    Some(match name {
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => SampleFormat::Uint(8),
        "signed char" | "int8" | "int8_t" => SampleFormat::Int(8),
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => SampleFormat::Uint(16),
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            SampleFormat::Int(16)
        }
        "uint" | "unsigned int" | "uint32" | "uint32_t" => SampleFormat::Uint(32),
        "int" | "signed int" | "int32" | "int32_t" => SampleFormat::Int(32),
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            SampleFormat::Uint(64)
        }
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => SampleFormat::Int(64),
        "float" => SampleFormat::Float(32),
        "double" => SampleFormat::Float(64),
        _ => return None,
    })
}

/// Splits a value into `count` words.
pub(super) fn words(text: &str, count: usize) -> Option<Vec<&str>> {
    let words: Vec<&str> = text.split_ascii_whitespace().collect();
    (words.len() == count).then_some(words)
}

/// Parses `count` quoted strings.
pub(super) fn quoted(text: &str, count: usize) -> Option<Vec<String>> {
    let (mut strings, mut own, mut is_inside) = (Vec::new(), String::new(), false);
    let mut letters = text.chars();
    while let Some(letter) = letters.next() {
        match letter {
            '\\' if is_inside => own.push(letters.next()?),
            '"' if is_inside => strings.push(std::mem::take(&mut own)),
            _ if is_inside => own.push(letter),
            '"' => {}
            _ if letter.is_whitespace() => continue,
            _ => return None,
        }
        if letter == '"' {
            is_inside = !is_inside;
        }
    }
    (!is_inside && strings.len() == count).then_some(strings)
}

/// Parses `count` vectors of `axes` numbers, as in `(1,0,0)`; `None` for `none`.
pub(super) fn vectors(text: &str, count: usize, axes: usize) -> Option<Vec<Option<Vec<f64>>>> {
    let mut found = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            found.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inside, after) = rest.strip_prefix('(')?.split_once(')')?;
        let numbers: Option<Vec<f64>> = inside.split(',').map(|number| number.trim().parse().ok()).collect();
        found.push(Some(numbers.filter(|numbers| numbers.len() == axes)?));
        rest = after.trim_start();
    }
    (found.len() == count).then_some(found)
}

/// Replaces the escape sequences of line breaks and backslashes.
pub(super) fn unescaped(text: &str) -> String {
    let mut plain = String::new();
    let mut letters = text.chars();
    while let Some(letter) = letters.next() {
        match letter {
            '\\' => match letters.next() {
                Some('n') => plain.push('\n'),
                Some('\\') | None => plain.push('\\'),
                Some(other) => plain.extend(['\\', other]),
            },
            _ => plain.push(letter),
        }
    }
    plain
}
