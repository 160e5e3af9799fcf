//! Parsing of text formats without copying: lines, words and numbers, and line numbers for
//! messages.

/// Formats bytes of a file for a message: short, on one line, with escapes.
pub fn shown(bytes: &[u8]) -> String {
    const MAX_SHOWN: usize = 40;
    let text = bytes[..bytes.len().min(MAX_SHOWN)].escape_ascii();
    if bytes.len() > MAX_SHOWN {
        format!("\"{text}\"... ({} bytes)", bytes.len())
    } else {
        format!("\"{text}\"")
    }
}

/// Returns the 1-based number of the line that contains an offset. Scans everything before it: use
/// it for messages only.
pub fn line_number(bytes: &[u8], offset: usize) -> u64 {
    let ends_line = |at: &usize| match bytes[*at] {
        b'\n' => true,
        b'\r' => bytes.get(at + 1) != Some(&b'\n'),
        _ => false,
    };
    (0..offset.min(bytes.len())).filter(ends_line).count() as u64 + 1
}

/// Iterator over lines, which end with LF, CR LF or CR.
#[derive(Clone)]
pub struct Lines<'a> {
    bytes: &'a [u8],
    /// Offset of the next line.
    pub offset: usize,
}

impl<'a> Lines<'a> {
    /// Creates an iterator that starts at an offset.
    pub fn new(bytes: &'a [u8], offset: usize) -> Lines<'a> {
        Lines { bytes, offset }
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = self.bytes.get(self.offset..).filter(|rest| !rest.is_empty())?;
        let length = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(rest.len());
        let end = match rest.get(length..) {
            Some([b'\r', b'\n', ..]) => 2,
            Some([_, ..]) => 1,
            _ => 0,
        };
        self.offset += length + end;
        Some(&rest[..length])
    }
}

/// Iterator over words, which are separated by blanks and line ends.
#[derive(Clone)]
pub struct Words<'a> {
    bytes: &'a [u8],
    /// Offset at which the search for the next word begins.
    pub offset: usize,
}

impl<'a> Words<'a> {
    /// Creates an iterator that starts at an offset.
    pub fn new(bytes: &'a [u8], offset: usize) -> Words<'a> {
        Words { bytes, offset }
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a [u8];

    #[inline]
    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = self.bytes.get(self.offset..)?;
        let start = rest.iter().position(|byte| !is_blank(*byte))?;
        let rest = &rest[start..];
        let length = rest.iter().position(|byte| is_blank(*byte)).unwrap_or(rest.len());
        self.offset += start + length;
        Some(&rest[..length])
    }
}

fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\n' | b'\r' | 0x0b | 0x0c)
}

/// Iterates over the words of one line.
pub fn words(line: &[u8]) -> Words<'_> {
    Words::new(line, 0)
}

/// Parses a finite number.
pub fn real(word: &[u8]) -> Option<f64> {
    let number: f64 = str::from_utf8(word).ok()?.parse().ok()?;
    number.is_finite().then_some(number)
}

/// Parses a number, which may be infinite or NaN: `nan`, `inf` and variants, including those of
/// Windows (`-nan(ind)`, `1.#QNAN`, `-1.#INF`).
pub(crate) fn real_or_none(word: &[u8]) -> Option<f64> {
    if let Some(number) = real(word) {
        return Some(number);
    }
    let word = str::from_utf8(word).ok()?.to_ascii_lowercase();
    let (sign, rest) = match word.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, word.strip_prefix('+').unwrap_or(&word)),
    };
    let rest = rest.strip_prefix("1.#").unwrap_or(rest);
    match rest {
        "inf" | "infinity" => Some(sign * f64::INFINITY),
        "nan" | "qnan" | "snan" | "ind" => Some(f64::NAN),
        _ => (rest.starts_with("nan(") && rest.ends_with(')')).then_some(f64::NAN),
    }
}

/// Parses an integer.
pub fn whole(word: &[u8]) -> Option<i64> {
    // Fast path: nearly all integers are short and have no sign.
    if !word.is_empty() && word.len() < 18 && word.iter().all(u8::is_ascii_digit) {
        return Some(word.iter().fold(0, |number, digit| number * 10 + i64::from(digit - b'0')));
    }
    str::from_utf8(word).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_in_three_ways() {
        let text = b"a\nb\r\nc\rd\n\ne";
        let lines: Vec<_> = Lines::new(text, 0).collect();
        assert_eq!(lines, [&b"a"[..], b"b", b"c", b"d", b"", b"e"]);
        for (offset, line) in [(0, 1), (2, 2), (5, 3), (7, 4), (10, 6)] {
            assert_eq!(line_number(text, offset), line, "{offset}");
        }
    }

    #[test]
    fn numbers() {
        assert_eq!(whole(b"0042"), Some(42));
        assert_eq!(whole(b"-7"), Some(-7));
        assert_eq!(whole(b"9223372036854775807"), Some(i64::MAX));
        for word in [&b""[..], b"-", b"1.0", b"9223372036854775808", b"0x1"] {
            assert_eq!(whole(word), None, "{}", shown(word));
        }
        assert_eq!(real(b"-1.5e3"), Some(-1500.0));
        assert_eq!(real_or_none(b"-1.5e3"), Some(-1500.0));
        assert_eq!(real_or_none(b"-Inf"), Some(f64::NEG_INFINITY));
        for word in [&b"nan"[..], b"NaN", b"-nan", b"-nan(ind)", b"1.#QNAN", b"-1.#IND"] {
            assert!(real_or_none(word).is_some_and(f64::is_nan), "{}", shown(word));
        }
        for word in [&b"1e999"[..], b"nano", b"", b"in", b"1,5"] {
            assert_eq!(real_or_none(word), None, "{}", shown(word));
        }
        for word in [&b"nan"[..], b"inf", b"-Infinity", b"1e999", b"1,5", b"\xff"] {
            assert_eq!(real(word), None, "{}", shown(word));
        }
    }

    #[test]
    fn words_of_any_length_are_shown_shortly() {
        assert_eq!(shown(b"a\n\xff"), r#""a\n\xff""#);
        assert!(shown(&vec![b'x'; 1 << 20]).len() < 80);
    }
}
