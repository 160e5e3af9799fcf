//! Dispatch from run-time types to compile-time types, at the entry of kernels.

/// Evaluates an expression with a name bound to the Rust type of a
/// [`ValueType`](crate::value::ValueType), for kernels.
///
/// # Panics
/// If no tree has that type. Types from untrusted sources are checked earlier, with
/// [`ValueType::is_supported`](crate::value::ValueType::is_supported).
#[doc(hidden)]
#[macro_export]
macro_rules! with_native_type {
    ($type:expr, $V:ident => $body:expr) => {{
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
            (SampleType::I8, 1) => with!([i8; 1]),
            (SampleType::U64, 1) => with!([u64; 1]),
            (SampleType::I64, 1) => with!([i64; 1]),
            (sample, channels) => unreachable!("no tree has {channels} channels of {}", sample.name()),
        }
    }};
}

pub use with_native_type;
