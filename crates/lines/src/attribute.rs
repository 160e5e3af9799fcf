//! Attributes of features.

/// Type of an attribute's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ValueKind {
    /// Integers.
    Integer,
    /// Floating-point numbers or integers.
    Number,
    /// Strings.
    Text,
    /// Booleans.
    Boolean,
    /// JSON documents, as strings.
    Json,
    /// Values of several types.
    Mixed,
}

impl ValueKind {
    /// All kinds, in the order of their numbers in files.
    pub(crate) const ALL: [ValueKind; 6] = [
        ValueKind::Integer,
        ValueKind::Number,
        ValueKind::Text,
        ValueKind::Boolean,
        ValueKind::Json,
        ValueKind::Mixed,
    ];

    /// Whether an attribute of this kind may have a value.
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

/// Attribute of features.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineAttribute {
    /// Name.
    pub name: String,
    /// Type of the values.
    pub kind: ValueKind,
}

/// Value of an attribute.
#[derive(Clone, Debug, PartialEq)]
pub enum LineValue {
    /// No value.
    None,
    /// Integer.
    Integer(i64),
    /// Floating-point number.
    Number(f64),
    /// String.
    Text(String),
    /// Boolean.
    Boolean(bool),
    /// JSON document, as a string.
    Json(String),
}
