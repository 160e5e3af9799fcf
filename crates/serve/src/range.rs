//! Byte ranges of requests.

/// Bytes that the header `Range` requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RequestedRange {
    /// All bytes: there is no range, or the header is not understood.
    All,
    /// First and last byte, inclusive.
    Bytes(u64, u64),
    /// A range outside of the file.
    Unsatisfiable,
    /// Several ranges, which are not supported in one request.
    Multiple,
}

/// Parses the header for a file of `length` bytes. A header that is not a valid byte range is
/// ignored (RFC 9110, 14.2).
pub(crate) fn parse_range(header: &str, length: u64) -> RequestedRange {
    let Some((unit, ranges)) = header.split_once('=') else { return RequestedRange::All };
    if !unit.trim().eq_ignore_ascii_case("bytes") {
        return RequestedRange::All;
    }
    let mut ranges = ranges.split(',').map(str::trim).filter(|range| !range.is_empty());
    let Some(range) = ranges.next() else { return RequestedRange::All };
    let is_several = ranges.next().is_some();
    let Some((first, last)) = range.split_once('-') else { return RequestedRange::All };
    let found = match (number(first), number(last)) {
        (Some(None), Some(Some(0))) => RequestedRange::Unsatisfiable,
        (Some(None), Some(Some(_))) if length == 0 => RequestedRange::Unsatisfiable,
        (Some(None), Some(Some(count))) => RequestedRange::Bytes(length.saturating_sub(count), length - 1),
        (Some(Some(first)), Some(None)) if first < length => RequestedRange::Bytes(first, length - 1),
        (Some(Some(_)), Some(None)) => RequestedRange::Unsatisfiable,
        (Some(Some(first)), Some(Some(last))) if first > last => RequestedRange::All,
        (Some(Some(first)), Some(Some(last))) if first < length => {
            RequestedRange::Bytes(first, last.min(length - 1))
        }
        (Some(Some(_)), Some(Some(_))) => RequestedRange::Unsatisfiable,
        _ => RequestedRange::All,
    };
    if is_several && found != RequestedRange::All { RequestedRange::Multiple } else { found }
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
            ("bytes=0-3", RequestedRange::Bytes(0, 3)),
            ("bytes=2-", RequestedRange::Bytes(2, 9)),
            ("bytes=-3", RequestedRange::Bytes(7, 9)),
            ("bytes=-30", RequestedRange::Bytes(0, 9)),
            ("bytes=5-99999999999999999999999", RequestedRange::Bytes(5, 9)),
            ("Bytes = 9-9", RequestedRange::Bytes(9, 9)),
            ("bytes=10-", RequestedRange::Unsatisfiable),
            ("bytes=10-12", RequestedRange::Unsatisfiable),
            ("bytes=-0", RequestedRange::Unsatisfiable),
            ("bytes=99999999999999999999999-", RequestedRange::Unsatisfiable),
            ("bytes=0-1,3-4", RequestedRange::Multiple),
            ("bytes=0-1, 3-4", RequestedRange::Multiple),
            ("bytes=0-1,", RequestedRange::Bytes(0, 1)),
            ("bytes=3-2", RequestedRange::All),
            ("bytes=-", RequestedRange::All),
            ("bytes=a-b", RequestedRange::All),
            ("bytes=+1-2", RequestedRange::All),
            ("bytes=1", RequestedRange::All),
            ("bytes=", RequestedRange::All),
            ("rows=0-3", RequestedRange::All),
            ("", RequestedRange::All),
        ] {
            assert_eq!(parse_range(header, 10), expected, "{header}");
        }
        assert_eq!(parse_range("bytes=0-", 0), RequestedRange::Unsatisfiable);
        assert_eq!(parse_range("bytes=-1", 0), RequestedRange::Unsatisfiable);
    }
}
