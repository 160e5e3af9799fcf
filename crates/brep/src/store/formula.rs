//! The formula that a model was made by: a text of names of operations and files.

use super::reader::ExactModel;
use spinney_base::{Result, SetOperation};

/// Tag of the section.
pub(crate) const FORMULA: [u8; 4] = *b"FORM";
/// Most bytes of a formula.
pub(crate) const MAX_FORMULA: u64 = 1 << 20;

/// Most bytes of the formula of a model that becomes part of another one: with more, its name stands there instead.
const MAX_NESTED: usize = 1 << 12;

impl ExactModel {
    /// The formula that the model was made by, if it is told: in the end, of files.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read.
    pub fn formula(&self) -> Result<Option<String>> {
        let section = self.trailer.section(FORMULA);
        if section.length == 0 {
            return Ok(None);
        }
        let bytes = section.read(&self.path, &*self.backend, "formula")?.into_owned();
        let wrong = |_| self.corrupt("formula".into(), "a text that is none", "UTF-8");
        String::from_utf8(bytes).map(Some).map_err(wrong)
    }
}

/// The formula of a model that was moved by the numbers of a map.
pub(crate) fn moved_formula(numbers: &str, model: &ExactModel) -> Result<String> {
    Ok(format!("(map {numbers} {})", operand(model)?))
}

/// The operand that a model is in the formula of another one: its own formula, or its name.
fn operand(model: &ExactModel) -> Result<String> {
    let own = model.formula()?.filter(|own| own.len() <= MAX_NESTED);
    Ok(own.unwrap_or_else(|| serde_json::Value::from(model.path().display().to_string()).to_string()))
}

/// The formula of an operation, of the models that it was done to.
pub(crate) fn formula(operation: SetOperation, models: &[&ExactModel]) -> Result<String> {
    let mut text = format!("(op{}", operation.index());
    for model in models {
        text.push(' ');
        text.push_str(&operand(model)?);
        if text.len() as u64 >= MAX_FORMULA - 1 {
            // (Of so many models, a formula says nothing to anybody.)
            return Ok(String::new());
        }
    }
    text.push(')');
    Ok(text)
}
