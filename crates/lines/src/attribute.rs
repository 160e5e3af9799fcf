//! Attributes of features.

/// Kind of an attribute's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ValueKind {
    /// Whole numbers.
    Integer,
    /// Numbers.
    Number,
    /// Texts.
    Text,
    /// Yes or no.
    Boolean,
    /// JSON, as text.
    Json,
    /// Values of several kinds.
    Mixed,
}

impl ValueKind {
    /// All kinds, in the order of the numbers that stand for them in files.
    pub(crate) const ALL: [ValueKind; 6] = [
        ValueKind::Integer,
        ValueKind::Number,
        ValueKind::Text,
        ValueKind::Boolean,
        ValueKind::Json,
        ValueKind::Mixed,
    ];

    /// Whether a value may be one of an attribute of this kind.
    pub(crate) fn has(self, value: &LineValue) -> bool {
        matches!(
            (self, value),
            (_, LineValue::None)
                | (ValueKind::Mixed, _)
                | (ValueKind::Number, LineValue::Integer(_) | LineValue::Number(_))
                | (ValueKind::Integer, LineValue::Integer(_))
                | (ValueKind::Text, LineValue::Text(_))
                | (ValueKind::Boolean, LineValue::Boolean(_))
                | (ValueKind::Json, LineValue::Json(_))
        )
    }
}

/// An attribute that features have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineAttribute {
    /// Its name.
    pub name: String,
    /// Kind of its values.
    pub kind: ValueKind,
}

/// The value of an attribute.
#[derive(Clone, Debug, PartialEq)]
pub enum LineValue {
    /// Nothing.
    None,
    /// A whole number.
    Integer(i64),
    /// A number.
    Number(f64),
    /// A text.
    Text(String),
    /// Yes or no.
    Boolean(bool),
    /// JSON, as text.
    Json(String),
}
