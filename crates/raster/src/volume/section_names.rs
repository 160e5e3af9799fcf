//! Names of sections: sorting by the numbers in them, and detection of missing numbers.
//!
//! A number may have a sign, a decimal fraction and a unit of length: `z_-10um.tif`, `z=0.5mm.png`.
//! Whether a minus is a sign, and a point a decimal point, depends on all names that differ only in
//! their numbers.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::sections::ENDINGS;
use spinney_base::sort;

/// Units of length with their powers of ten in metres.
const UNITS: [(&str, i32); 13] = [
    ("nm", -9),
    ("um", -6),
    ("\u{b5}m", -6),
    ("\u{3bc}m", -6),
    ("micrometer", -6),
    ("micrometre", -6),
    ("micron", -6),
    ("microns", -6),
    ("mm", -3),
    ("cm", -2),
    ("dm", -1),
    ("m", 0),
    ("km", 3),
];

/// Maximum number of gaps in a report.
const MAX_GAPS: usize = 8;

/// A parsed name: a literal before each number, and one after the last.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct ParsedName {
    literals: Vec<String>,
    numbers: Vec<NumberText>,
}

/// A number as written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct NumberText {
    sign: Option<char>,
    digits: String,
    fraction: Option<String>,
    unit: Option<usize>,
}

impl ParsedName {
    /// Parses a file name without its image extension.
    fn of(path: &Path) -> ParsedName {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let is_image = |ending: &str| ENDINGS.contains(&&*ending.to_ascii_lowercase());
        let stem =
            name.rsplit_once('.').filter(|(_, ending)| is_image(ending)).map_or(&*name, |(stem, _)| stem);
        ParsedName::parse(stem)
    }

    fn parse(name: &str) -> ParsedName {
        let (mut parsed, mut text, mut rest) = (ParsedName::default(), String::new(), name);
        while let Some(first) = rest.chars().next() {
            let is_number = first.is_ascii_digit();
            if !is_number {
                text.push(first);
                rest = &rest[first.len_utf8()..];
                continue;
            }
            let digits = take_digits(&mut rest);
            let mut number = NumberText { digits, ..NumberText::default() };
            // A minus between two numbers, as in dates, is not a sign.
            if let Some(sign) = text.chars().last().filter(|last| "+-\u{2212}".contains(*last))
                && (text.chars().count() != 1 || parsed.numbers.is_empty())
            {
                text.truncate(text.len() - sign.len_utf8());
                number.sign = Some(if sign == '+' { '+' } else { '-' });
            }
            // In a list such as 1.2.3, no number is a fraction.
            let is_in_list = text == "." && !parsed.numbers.is_empty();
            let mut after = rest.strip_prefix('.').unwrap_or_default();
            let fraction = take_digits(&mut after);
            let goes_on =
                after.strip_prefix('.').is_some_and(|more| more.starts_with(|c: char| c.is_ascii_digit()));
            if !fraction.is_empty() && !goes_on && !is_in_list {
                (number.fraction, rest) = (Some(fraction), after);
            }
            let suffix = rest.strip_prefix([' ', '_']).unwrap_or(rest);
            let letters = suffix.find(|c: char| !c.is_alphabetic()).unwrap_or(suffix.len());
            number.unit = UNITS.iter().position(|(unit, _)| suffix[..letters].eq_ignore_ascii_case(unit));
            if number.unit.is_some() {
                rest = &suffix[letters..];
            }
            parsed.literals.push(std::mem::take(&mut text));
            parsed.numbers.push(number);
        }
        parsed.literals.push(text);
        parsed
    }
}

/// Splits leading digits off a string.
fn take_digits(rest: &mut &str) -> String {
    let end = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
    let (digits, after) = rest.split_at(end);
    *rest = after;
    digits.into()
}

/// A decimal number: digits before and after the point, without redundant zeros.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Decimal {
    is_negative: bool,
    whole: String,
    fraction: String,
}

impl Decimal {
    /// The number with these digits, times a power of ten.
    fn new(is_negative: bool, whole: &str, fraction: &str, power: i32) -> Decimal {
        let (mut whole, mut fraction) = (whole.to_string(), fraction.to_string());
        for _ in 0..power.abs() {
            match power > 0 {
                true if fraction.is_empty() => whole.push('0'),
                true => whole.push(fraction.remove(0)),
                false => fraction.insert(0, whole.pop().unwrap_or('0')),
            }
        }
        let (whole, fraction) = (whole.trim_start_matches('0'), fraction.trim_end_matches('0'));
        let is_zero = whole.is_empty() && fraction.is_empty();
        Decimal { is_negative: is_negative && !is_zero, whole: whole.into(), fraction: fraction.into() }
    }

    /// The number in units of `10^-digits`, unless it is too long.
    fn scaled(&self, digits: usize) -> Option<i128> {
        let text = format!("0{}{:0<digits$}", self.whole, self.fraction);
        let number: i128 = if text.len() < 38 { text.parse().ok()? } else { return None };
        Some(if self.is_negative { -number } else { number })
    }
}

impl Ord for Decimal {
    fn cmp(&self, other: &Decimal) -> Ordering {
        let size = |number: &Decimal| (number.whole.len(), number.whole.clone(), number.fraction.clone());
        match (self.is_negative, other.is_negative) {
            (true, false) => Ordering::Less,
            (false, true) => Ordering::Greater,
            (false, false) => size(self).cmp(&size(other)),
            (true, true) => size(other).cmp(&size(self)),
        }
    }
}

impl PartialOrd for Decimal {
    fn partial_cmp(&self, other: &Decimal) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Sort key of a component of a name; numbers come before literals.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Key {
    Number(Decimal),
    Text(String),
}

/// Interpretation of a number in all names that differ only in their numbers.
#[derive(Clone, Copy)]
struct NumberFormat {
    has_signs: bool,
    has_fractions: bool,
    /// Whether units differ, so that numbers are compared in metres.
    in_metres: bool,
}

impl NumberFormat {
    /// Interprets the numbers at one position of several names; `before` is the literal before
    /// them.
    fn of(numbers: &[&NumberText], before: &str) -> NumberFormat {
        // A minus that all numbers have after a word is a hyphen: slice-01, slice-02.
        let is_after_word = before.chars().last().is_some_and(char::is_alphanumeric);
        let is_hyphen = is_after_word && numbers.iter().all(|number| number.sign == Some('-'));
        // Fractions are decimal if they have equal lengths or no trailing zeros. Otherwise 1.9 and
        // 1.10 are pairs of integers.
        let fractions = || numbers.iter().map(|number| number.fraction.as_deref().unwrap_or_default());
        let length = fractions().next().map_or(0, str::len);
        let are_equal = fractions().all(|fraction| fraction.len() == length);
        let unit = numbers.first().and_then(|number| number.unit);
        NumberFormat {
            has_signs: !is_hyphen,
            has_fractions: are_equal
                || unit.is_some()
                || !fractions().any(|fraction| fraction.ends_with('0')),
            in_metres: numbers.iter().all(|number| number.unit.is_some())
                && numbers.iter().any(|number| number.unit.map(power) != unit.map(power)),
        }
    }

    fn number(self, written: &NumberText) -> Decimal {
        let fraction = written.fraction.as_deref().filter(|_| self.has_fractions).unwrap_or_default();
        let power = if self.in_metres { written.unit.map_or(0, power) } else { 0 };
        Decimal::new(self.has_signs && written.sign == Some('-'), &written.digits, fraction, power)
    }
}

fn power(unit: usize) -> i32 {
    UNITS[unit].1
}

/// Names that differ only in their numbers, and the interpretations of these.
struct NamePatterns(HashMap<Vec<String>, Vec<NumberFormat>>);

impl NamePatterns {
    fn of(names: &[ParsedName]) -> NamePatterns {
        let mut groups: HashMap<&[String], Vec<&ParsedName>> = HashMap::new();
        names.iter().for_each(|name| groups.entry(&name.literals).or_default().push(name));
        let meanings = groups.into_iter().map(|(literals, group)| {
            let of = |at: usize| {
                let numbers: Vec<&NumberText> = group.iter().map(|name| &name.numbers[at]).collect();
                NumberFormat::of(&numbers, &literals[at])
            };
            (literals.to_vec(), (0..literals.len() - 1).map(of).collect())
        });
        NamePatterns(meanings.collect())
    }

    fn keys(&self, name: &ParsedName) -> Vec<Key> {
        let mut keys = Vec::new();
        let meanings = &self.0[&name.literals];
        let text = |text: &str, keys: &mut Vec<Key>| {
            if !text.is_empty() {
                keys.push(Key::Text(text.into()));
            }
        };
        for (at, (written, meaning)) in name.numbers.iter().zip(meanings).enumerate() {
            text(&name.literals[at], &mut keys);
            keys.push(Key::Number(meaning.number(written)));
            if let Some(fraction) = written.fraction.as_ref().filter(|_| !meaning.has_fractions) {
                keys.push(Key::Number(Decimal::new(false, fraction, "", 0)));
            }
        }
        text(name.literals.last().map_or("", String::as_str), &mut keys);
        keys
    }
}

/// Sorts files by the numbers in their names, directory by directory.
pub(super) fn sort_by_numbers(files: &mut Vec<PathBuf>) {
    let parent =
        |file: &PathBuf| ParsedName::parse(&file.parent().unwrap_or(Path::new("")).to_string_lossy());
    let parents: Vec<ParsedName> = files.iter().map(parent).collect();
    let names: Vec<ParsedName> = files.iter().map(|file| ParsedName::of(file)).collect();
    let (of_parents, of_names) = (NamePatterns::of(&parents), NamePatterns::of(&names));
    let keys =
        parents.iter().zip(&names).map(|(parent, name)| (of_parents.keys(parent), of_names.keys(name)));
    let mut keyed: Vec<_> = keys.zip(std::mem::take(files)).collect();
    // Names that differ only in leading zeros of numbers are sorted by their letters.
    sort::by(&mut keyed, &mut |a, b| a.cmp(b));
    *files = keyed.into_iter().map(|(_, file)| file).collect();
}

/// Reports missing and repeated numbers in sorted section names. `None` if there are none, or if
/// names differ in more than one number.
pub(super) fn missing_numbers(files: &[PathBuf]) -> Option<String> {
    let names: Vec<ParsedName> = files.iter().map(|file| ParsedName::of(file)).collect();
    let first = names.first()?;
    let have_one_parent = files.iter().all(|file| file.parent() == files[0].parent());
    if !have_one_parent || names.iter().any(|name| name.literals != first.literals) {
        return None;
    }
    let shapes = NamePatterns::of(&names);
    let meanings = &shapes.0[&first.literals];
    let column = |at: usize| names.iter().map(move |name| &name.numbers[at]);
    let mut varying =
        (0..first.numbers.len()).filter(|at| column(*at).any(|number| *number != first.numbers[*at]));
    let (at, None) = (varying.next()?, varying.next()) else { return None };
    let meaning = meanings[at];
    if !meaning.has_fractions {
        return None;
    }
    let numbers: Vec<Decimal> = column(at).map(|written| meaning.number(written)).collect();
    let digits = numbers.iter().map(|number| number.fraction.len()).max()?;
    let numbers: Vec<i128> = numbers.iter().map(|number| number.scaled(digits)).collect::<Option<_>>()?;
    let unit = match first.numbers[at].unit {
        Some(_) if meaning.in_metres => " m".to_string(),
        Some(unit) => format!(" {}", UNITS[unit].0),
        None => String::new(),
    };
    let shown = |number: i128| format!("{}{unit}", decimal(number, digits));
    if !numbers.is_sorted() {
        return None;
    }
    if let Some(pair) = numbers.windows(2).find(|pair| pair[0] == pair[1]) {
        return Some(format!("two sections have the number {}", shown(pair[0])));
    }
    let step = numbers.windows(2).map(|pair| pair[1] - pair[0]).min()?;
    if let Some(pair) = numbers.windows(2).find(|pair| (pair[1] - pair[0]) % step != 0) {
        let (from, to) = (shown(pair[0]), shown(pair[1]));
        return Some(format!(
            "sections are not evenly spaced: from {from} to {to}, where the smallest distance is {}; they become consecutive planes",
            shown(step)
        ));
    }
    let gaps: Vec<&[i128]> = numbers.windows(2).filter(|pair| pair[1] - pair[0] > step).collect();
    let count: i128 = gaps.iter().map(|pair| (pair[1] - pair[0]) / step - 1).sum();
    let listed = gaps.iter().take(MAX_GAPS).map(|pair| match (pair[0] + step, pair[1] - step) {
        (from, to) if from == to => shown(from),
        (from, to) => format!("{} to {}", shown(from), shown(to)),
    });
    let listed = listed.collect::<Vec<_>>().join(", ");
    let more = if gaps.len() > MAX_GAPS { " and others" } else { "" };
    let (are, they) = if count == 1 { ("section is", "its") } else { ("sections are", "their") };
    (count > 0).then(|| {
        format!("{count} {are} missing between {} and {}: {listed}{more}; the planes next to {they} positions become neighbours", shown(numbers[0]), shown(numbers[numbers.len() - 1]))
    })
}

/// Formats a number in units of `10^-digits` as a decimal.
fn decimal(number: i128, digits: usize) -> String {
    let text = format!("{:0>width$}", number.unsigned_abs(), width = digits + 1);
    let (whole, fraction) = text.split_at(text.len() - digits);
    let fraction = fraction.trim_end_matches('0');
    let (sign, point) = (if number < 0 { "-" } else { "" }, if fraction.is_empty() { "" } else { "." });
    format!("{sign}{whole}{point}{fraction}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths(names: &[&str]) -> Vec<PathBuf> {
        names.iter().map(PathBuf::from).collect()
    }

    /// Checks that all rotations of the names are sorted into the expected order.
    fn check(expected: &[&str]) {
        let expected = paths(expected);
        for turn in 0..expected.len() {
            let mut files = expected.clone();
            files.rotate_left(turn);
            files.reverse();
            sort_by_numbers(&mut files);
            assert_eq!(files, expected, "{turn}");
        }
    }

    #[test]
    fn names_are_in_the_order_of_their_numbers() {
        check(&["z1.png", "z2.png", "z10.png"]);
        check(&["a2_b9", "a2_b10", "a10_b1"]);
        check(&["01", "1", "2", "010"]);
        check(&["a2/z10.png", "a2/z20.png", "a10/z3.png"]);
        check(&["1", &"9".repeat(40)]);
        check(&["2024-01-09.tif", "2024-01-10.tif", "2024-02-01.tif"]);
        check(&["v1.2.9.tif", "v1.2.10.tif"]);
        check(&["v1.9.tif", "v1.10.tif"]);
    }

    #[test]
    fn signs_fractions_and_units_count() {
        check(&["z_-10.png", "z_-5.png", "z_0.png", "z_+5.png", "z_10.png"]);
        check(&["-10.png", "-5.png", "-1.png"]);
        check(&["z-10mm.tif", "z-5mm.tif", "z0mm.tif", "z5mm.tif", "z10mm.tif"]);
        check(&["z=-0.5.tif", "z=0.tif", "z=0.25.tif", "z=0.5.tif", "z=10.tif"]);
        check(&["900um.png", "1mm.png", "1.05mm.png", "1.1 mm.png", "0.2cm.png"]);
        // Hyphens are not signs.
        check(&["slice-1.png", "slice-2.png", "slice-10.png"]);
    }

    #[test]
    fn missing_numbers_are_reported() {
        let report = |names: &[&str]| missing_numbers(&paths(names)).unwrap_or_default();
        assert_eq!(report(&["z1.png", "z2.png", "z3.png"]), "");
        assert_eq!(report(&["z2.png", "z4.png", "z6.png"]), "");
        assert_eq!(report(&["z-5mm.png", "z0mm.png", "z+5mm.png"]), "");
        assert_eq!(report(&["a.png", "z1.png", "z3.png", "z4.png"]), "");
        let found = report(&["z08.png", "z09.png", "z11.png", "z15.png"]);
        assert!(found.starts_with("4 sections are missing between 8 and 15: 10, 12 to 14;"), "{found}");
        let found = report(&["z_-10um.png", "z_-5um.png", "z_5um.png"]);
        assert!(found.starts_with("1 section is missing between -10 um and 5 um: 0 um;"), "{found}");
        let found = report(&["z0.5.png", "z1.png", "z2.png"]);
        assert!(found.starts_with("1 section is missing between 0.5 and 2: 1.5;"), "{found}");
        let found = report(&["z900um.png", "z1mm.png", "z1.2mm.png"]);
        assert!(found.contains("between 0.0009 m and 0.0012 m: 0.0011 m;"), "{found}");
        assert!(
            report(&["z0.png", "z10.png", "z15.png", "z22.png"]).contains("not evenly spaced: from 15 to 22")
        );
        assert!(report(&["z01.png", "z1.png", "z2.png"]).contains("two sections have the number 1"));
        let many: Vec<String> = (0..100).map(|z| format!("z{}.png", z * z + z)).collect();
        assert!(
            report(&many.iter().map(String::as_str).collect::<Vec<_>>())
                .ends_with("and others; the planes next to their positions become neighbours")
        );
    }
}
