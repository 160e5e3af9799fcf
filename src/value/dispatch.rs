//! From types known at run time to types known at compile time.

/// Evaluates an expression with a type name bound to the Rust type of a [`ValueType`](crate::value::ValueType),
/// or another expression if trees cannot have such values.
///
/// ```
/// use spinney::value::{SampleType, Value, ValueType};
/// let rgb = ValueType { sample: SampleType::U8, channels: 3 };
/// let bytes = spinney::with_value_type!(rgb, V => Some(size_of::<V>()), else None);
/// assert_eq!(bytes, Some(3));
/// ```
#[macro_export]
macro_rules! with_value_type {
    ($type:expr, $V:ident => $body:expr, else $other:expr) => {{
        use $crate::value::SampleType;
        let value_type: $crate::value::ValueType = $type;
        macro_rules! with {
            ($Rust:ty) => {{
                type $V = $Rust;
                $body
            }};
        }
        match (value_type.sample, value_type.channels) {
            (SampleType::U8, 1) => with!([u8; 1]),
            (SampleType::U8, 2) => with!([u8; 2]),
            (SampleType::U8, 3) => with!([u8; 3]),
            (SampleType::U8, 4) => with!([u8; 4]),
            (SampleType::U16, 1) => with!([u16; 1]),
            (SampleType::U16, 2) => with!([u16; 2]),
            (SampleType::U16, 3) => with!([u16; 3]),
            (SampleType::U16, 4) => with!([u16; 4]),
            (SampleType::I16, 1) => with!([i16; 1]),
            (SampleType::U32, 1) => with!([u32; 1]),
            (SampleType::I32, 1) => with!([i32; 1]),
            (SampleType::F32, 1) => with!([f32; 1]),
            (SampleType::F32, 2) => with!([f32; 2]),
            (SampleType::F32, 3) => with!([f32; 3]),
            (SampleType::F32, 4) => with!([f32; 4]),
            (SampleType::F64, 1) => with!([f64; 1]),
            _ => $other,
        }
    }};
}
