//! Errors of the library and of parsers, in terms of the command line.

use std::borrow::Cow;

use spinney::Error;

use super::super::args::GivenOptions;

/// Parameters of the library, and the options that set them. Other parameters have the name of
/// their option: `leaf size` is set by `--leaf-size`.
const PARAMETERS: [(&str, &[&str]); 9] = [
    ("attribute", &["--attribute", "--value", "--width", "--where", "--tin", "--heights"]),
    ("bands", &["--band"]),
    ("cell width", &["--cell"]),
    ("cells along the longer side", &["--cells"]),
    ("condition", &["--where"]),
    ("contour levels", &["--every", "--at"]),
    ("maximum error", &["--max-error"]),
    ("quantile", &["--quantiles"]),
    ("zoom", &["--max-zoom"]),
];

/// Messages of Rust's parsers of numbers, and their replacements.
const NUMBERS: [(&str, &str); 6] = [
    ("invalid float literal", "expected a number"),
    ("cannot parse float from empty string", "expected a number"),
    ("invalid digit found in string", "expected an integer"),
    ("cannot parse integer from empty string", "expected an integer"),
    ("number too large to fit in target type", "expected a smaller number"),
    ("number too small to fit in target type", "expected a larger number"),
];

/// Returns a message with its causes, where parameters of the library are named by their options,
/// if these are on the command line.
pub(super) fn message_of(error: &anyhow::Error, given: &GivenOptions) -> String {
    let text = |cause: &(dyn std::error::Error + 'static)| match cause.downcast_ref() {
        Some(Error::Invalid { what, found, expected }) => {
            Error::invalid(named(what, given), found, expected).to_string()
        }
        _ => cause.to_string(),
    };
    let mut message = error.chain().map(text).collect::<Vec<_>>().join(": ");
    if given.has("--max-bytes") {
        message = message.replace("bytes that are allowed", "bytes that --max-bytes allows");
    }
    in_words(&message).into_owned()
}

/// Returns the option for a parameter, which may follow a file name, if exactly one such option is
/// on the command line, or else the parameter.
fn named(what: &str, given: &GivenOptions) -> String {
    let (file, parameter) = what.rsplit_once(": ").map_or(("", what), |(file, own)| (file, own));
    let own = format!("--{}", parameter.replace(' ', "-"));
    let own = [own.as_str()];
    let listed = PARAMETERS.iter().find(|(name, _)| *name == parameter).map(|(_, options)| *options);
    let mut options = listed.unwrap_or(&own).iter().filter(|option| given.has(option));
    match (options.next(), options.next()) {
        (Some(option), None) if file.is_empty() => (*option).into(),
        (Some(option), None) => format!("{file}: {option}"),
        _ => what.into(),
    }
}

/// Replaces the messages of parsers of numbers.
pub(super) fn in_words(text: &str) -> Cow<'_, str> {
    let is_there = NUMBERS.iter().any(|(message, _)| text.contains(message));
    if !is_there {
        return text.into();
    }
    NUMBERS.iter().fold(text.to_owned(), |text, (message, words)| text.replace(message, words)).into()
}
