//! Decimal formatting of coordinates.

/// Returns the number of decimal places of a grid unit, if it is a decimal fraction with at most 12
/// of them.
pub(super) fn digits_of(scale: f64) -> Option<usize> {
    (0..=12)
        .find(|digits| {
            let steps = scale * 10f64.powi(*digits);
            steps >= 1.0 - 1e-9 && (steps - steps.round()).abs() < 1e-6
        })
        .map(|digits| digits as usize)
}

/// Writes a coordinate with the decimal places of its grid.
pub(super) fn coordinate(text: &mut String, number: f64, digits: Option<usize>) {
    use std::fmt::Write;
    // Writing to a string cannot fail.
    let _ = match digits {
        Some(digits) => write!(text, "{number:.digits$}"),
        None => write!(text, "{number}"),
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_those_of_the_grid() {
        let found = [1.0, 0.01, 0.001, 0.25, 1e-7, 100.0, 1.0 / 3.0].map(digits_of);
        assert_eq!(found, [Some(0), Some(2), Some(3), Some(2), Some(7), Some(0), None]);
    }
}
