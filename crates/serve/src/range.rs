//! Byte ranges of requests.

/// Bytes that the header `Range` requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Asked {
    /// All bytes: there is no range, or the header is not understood.
    All,
    /// First and last byte, inclusive.
    Part(u64, u64),
    /// A range outside of the file.
    Nothing,
    /// Several ranges, which are not supported in one request.
    Several,
}

/// Parses the header for a file of `length` bytes. A header that is not a valid byte range is
/// ignored (RFC 9110, 14.2).
pub(crate) fn asked(header: &str, length: u64) -> Asked {
    let Some((unit, ranges)) = header.split_once('=') else { return Asked::All };
    if !unit.trim().eq_ignore_ascii_case("bytes") {
        return Asked::All;
    }
    let mut ranges = ranges.split(',').map(str::trim).filter(|range| !range.is_empty());
    let Some(range) = ranges.next() else { return Asked::All };
    let is_several = ranges.next().is_some();
    let Some((first, last)) = range.split_once('-') else { return Asked::All };
    let found = match (number(first), number(last)) {
        (Some(None), Some(Some(0))) => Asked::Nothing,
        (Some(None), Some(Some(_))) if length == 0 => Asked::Nothing,
        (Some(None), Some(Some(count))) => Asked::Part(length.saturating_sub(count), length - 1),
        (Some(Some(first)), Some(None)) if first < length => Asked::Part(first, length - 1),
        (Some(Some(_)), Some(None)) => Asked::Nothing,
        (Some(Some(first)), Some(Some(last))) if first > last => Asked::All,
        (Some(Some(first)), Some(Some(last))) if first < length => Asked::Part(first, last.min(length - 1)),
        (Some(Some(_)), Some(Some(_))) => Asked::Nothing,
        _ => Asked::All,
    };
    if is_several && found != Asked::All { Asked::Several } else { found }
}

/// Parses a number; `Some(None)` if the text is empty, `None` if it is not a number. Numbers that
/// are too large are clamped to the maximum.
fn number(text: &str) -> Option<Option<u64>> {
    if text.is_empty() {
        return Some(None);
    }
    let is_number = text.bytes().all(|byte| byte.is_ascii_digit());
    is_number.then(|| Some(text.parse().unwrap_or(u64::MAX)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_by_the_letter() {
        for (header, expected) in [
            ("bytes=0-3", Asked::Part(0, 3)),
            ("bytes=2-", Asked::Part(2, 9)),
            ("bytes=-3", Asked::Part(7, 9)),
            ("bytes=-30", Asked::Part(0, 9)),
            ("bytes=5-99999999999999999999999", Asked::Part(5, 9)),
            ("Bytes = 9-9", Asked::Part(9, 9)),
            ("bytes=10-", Asked::Nothing),
            ("bytes=10-12", Asked::Nothing),
            ("bytes=-0", Asked::Nothing),
            ("bytes=99999999999999999999999-", Asked::Nothing),
            ("bytes=0-1,3-4", Asked::Several),
            ("bytes=0-1, 3-4", Asked::Several),
            ("bytes=0-1,", Asked::Part(0, 1)),
            ("bytes=3-2", Asked::All),
            ("bytes=-", Asked::All),
            ("bytes=a-b", Asked::All),
            ("bytes=+1-2", Asked::All),
            ("bytes=1", Asked::All),
            ("bytes=", Asked::All),
            ("rows=0-3", Asked::All),
            ("", Asked::All),
        ] {
            assert_eq!(asked(header, 10), expected, "{header}");
        }
        assert_eq!(asked("bytes=0-", 0), Asked::Nothing);
        assert_eq!(asked("bytes=-1", 0), Asked::Nothing);
    }
}
