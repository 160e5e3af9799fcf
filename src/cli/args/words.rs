//! Command-line words.

use std::ffi::OsString;

/// Returns the command-line words. A list of numbers that begins with a minus gets a leading blank:
/// clap then does not parse it as options, and the parsers of lists skip blanks.
pub(crate) fn words() -> impl Iterator<Item = OsString> {
    std::env::args_os().map(|word| match word.to_str() {
        Some(text) if is_negative_list(text) => format!(" {text}").into(),
        _ => word,
    })
}

/// Whether a word is several numbers, the first of them negative.
fn is_negative_list(word: &str) -> bool {
    let numbers = || word.split([',', ' ', '\t', ';']).filter(|number| !number.is_empty());
    word.starts_with('-') && numbers().count() > 1 && numbers().all(|number| number.parse::<f64>().is_ok())
}

#[cfg(test)]
mod tests {
    use super::is_negative_list;

    #[test]
    fn lists_of_numbers_are_known() {
        for list in ["-1,2", "-123.5,49.5", "-1e3 -2", "-.5;0,1", "-1,2,3"] {
            assert!(is_negative_list(list), "{list}");
        }
        for other in ["-1", "1,2", "-", "--", "-q", "-q,1", "--window=-1,2", "-1,x", ""] {
            assert!(!is_negative_list(other), "{other}");
        }
    }
}
