//! Components that several results have in common.

use std::borrow::Cow;

use spinney_base::value::Number;
use spinney_engine::dataset::Dataset;

/// Returns the name of a class, if it has one.
pub fn class_name(tree: &Dataset, value: Number) -> Option<&str> {
    tree.metadata().class_names.get(&value).map(String::as_str)
}

/// Returns JSON without control characters other than line ends. The JSON writer leaves delete and
/// the C1 control characters unescaped in strings; here they are escaped, too.
pub fn printable_json(text: &str) -> Cow<'_, str> {
    if !text.chars().any(|c| c.is_control() && c != '\n') {
        return text.into();
    }
    let escape = |c: char| match c {
        c if c.is_control() && c != '\n' => format!("\\u{:04x}", u32::from(c)),
        c => c.to_string(),
    };
    text.chars().map(escape).collect::<String>().into()
}

#[cfg(test)]
mod tests {
    use super::printable_json;

    #[test]
    fn escape_sequences_are_shown_and_not_done() {
        let json = serde_json::json!({ "name": "a\u{1b}\u{9b}\u{7f}" }).to_string();
        let clean = printable_json(&json);
        assert!(clean.chars().all(|c| !c.is_control()), "{clean}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&clean).unwrap()["name"], "a\u{1b}\u{9b}\u{7f}");
    }
}
