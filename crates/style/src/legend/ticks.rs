//! Round numbers along a colour ramp.

use super::super::resolve::round_step;
use super::Tick;

/// Fraction of the ramp next to each end that has no other ticks.
const END: f64 = 0.1;

/// Returns ticks at both ends, and about four round numbers between them.
pub(super) fn ticks(low: f64, high: f64) -> Vec<Tick> {
    let step = round_step((high - low).abs() / 5.0);
    let (least, most) = (low.min(high), low.max(high));
    let at = |number: f64| ((number - low) / (high - low)).clamp(0.0, 1.0);
    let (first, last) = ((least / step).ceil(), (most / step).floor());
    let end = |at: f64, end: f64| Tick { at, label: number(end) };
    let (begin, end) = (end(0.0, low), end(1.0, high));
    // No round numbers between equal or infinite ends.
    let is_divided = most > least && (last - first) >= 0.0 && (last - first) < 20.0;
    let count = if is_divided { (last - first) as usize + 1 } else { 0 };
    let round = (0..count).map(|i| {
        let place = (first + i as f64) * step;
        Tick { at: at(place), label: number(place) }
    });
    let mut ticks: Vec<Tick> = round.filter(|tick| (END..=1.0 - END).contains(&tick.at)).collect();
    if low > high {
        ticks.reverse();
    }
    ticks.insert(0, begin);
    ticks.push(end);
    ticks
}

/// Formats a number with a readable number of digits.
pub(super) fn number(number: f64) -> String {
    let size = number.abs();
    if size != 0.0 && !(1e-4..1e9).contains(&size) {
        return format!("{number:.3e}");
    }
    let digits = if size == 0.0 { 0 } else { (3 - size.log10().floor() as i32).clamp(0, 8) as usize };
    let text = format!("{number:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    // No negative zero.
    if text == "-0" { "0".into() } else { text.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers() {
        let labels = |low: f64, high: f64| -> Vec<String> {
            ticks(low, high).into_iter().map(|tick| tick.label).collect()
        };
        assert_eq!(labels(0.0, 100.0), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(labels(193.4, 4031.0), ["193.4", "1000", "2000", "3000", "4031"]);
        assert_eq!(labels(-0.013, 0.011), ["-0.013", "-0.01", "-0.005", "0", "0.005", "0.011"]);
        assert_eq!(labels(5.0, 5.0), ["5", "5"]);
        assert_eq!(labels(f64::MIN, f64::MAX).len(), 2);
        assert_eq!(ticks(100.0, 0.0)[0], Tick { at: 0.0, label: "100".into() });
        let middle = &ticks(-100.0, 300.0)[1];
        assert_eq!((middle.at, middle.label.as_str()), (0.25, "0"));
    }

    #[test]
    fn numbers_are_short() {
        for (found, expected) in [
            (0.1 + 0.2, "0.3"),
            (1234.0, "1234"),
            (2.5e-7, "2.500e-7"),
            (-0.0, "0"),
            (99.9999, "100"),
            (1.23456, "1.235"),
            (1e12, "1.000e12"),
        ] {
            assert_eq!(number(found), expected);
        }
    }
}
