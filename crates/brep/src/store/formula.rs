//! The formula that a model was computed by: a string of operations and file names.

use super::reader::ExactModel;
use spinney_base::{Result, SetOperation};

/// Tag of the section.
pub(crate) const FORMULA: [u8; 4] = *b"FORM";
/// Maximum number of bytes of a formula.
pub(crate) const MAX_FORMULA: u64 = 1 << 20;

/// Maximum number of bytes of an operand's formula; a longer one is replaced by the operand's file
/// name.
const MAX_NESTED: usize = 1 << 12;

impl ExactModel {
    /// Returns the formula that the model was computed by, if it has one. Its innermost operands
    /// are files.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn formula(&self) -> Result<Option<String>> {
        let section = self.trailer.section(FORMULA);
        if section.length == 0 {
            return Ok(None);
        }
        let bytes = section.read(&self.path, &*self.backend, "formula")?.into_owned();
        let wrong = |_| self.corrupt("formula".into(), "bytes that are not UTF-8", "UTF-8");
        String::from_utf8(bytes).map(Some).map_err(wrong)
    }
}

/// Returns the formula of a model that was transformed by the coefficients of a map.
pub(crate) fn moved_formula(numbers: &str, model: &ExactModel) -> Result<String> {
    Ok(format!("(map {numbers} {})", operand(model)?))
}

/// Returns a model as operand in another formula: its own formula, or its name.
fn operand(model: &ExactModel) -> Result<String> {
    let own = model.formula()?.filter(|own| own.len() <= MAX_NESTED);
    Ok(own.unwrap_or_else(|| serde_json::Value::from(model.path().display().to_string()).to_string()))
}

/// Returns the formula of a set operation on models.
pub(crate) fn formula(operation: SetOperation, models: &[&ExactModel]) -> Result<String> {
    let mut text = format!("(op{}", operation.index());
    for model in models {
        text.push(' ');
        text.push_str(&operand(model)?);
        if text.len() as u64 >= MAX_FORMULA - 1 {
            // (A formula of this length is of no use.)
            return Ok(String::new());
        }
    }
    text.push(')');
    Ok(text)
}
