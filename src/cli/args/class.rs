//! Classes as arguments.

use anyhow::{Result, bail};
use spinney::{Dataset, Number};

/// Returns the value of a class, which is given by its value or by its name in a tree; `option` is
/// for messages.
pub(crate) fn class_value(tree: &Dataset, option: &str, text: &str) -> Result<Number> {
    /// Maximum number of names in a message.
    const MAX_NAMES: usize = 20;
    let text = text.trim();
    if let Ok(number) = text.parse() {
        return Ok(number);
    }
    let names = &tree.metadata().class_names;
    let mut found = names.iter().filter(|(_, name)| *name == text).map(|(value, _)| *value);
    let file = tree.name().display();
    match (found.next(), found.next()) {
        (Some(value), None) => Ok(value),
        (Some(one), Some(other)) => {
            bail!(
                "{file}: {option}: several classes have the name {text}, such as {one} and {other}; give the value"
            )
        }
        (None, _) if names.is_empty() => {
            bail!("{file}: {option}: got {text}, expected a number; classes of this file have no names")
        }
        (None, _) => {
            let some: Vec<&str> = names.values().take(MAX_NAMES).map(String::as_str).collect();
            let more = if names.len() > some.len() { ", ..." } else { "" };
            let some = some.join(", ");
            bail!("{file}: {option}: got {text}, expected a number or the name of a class: {some}{more}")
        }
    }
}
