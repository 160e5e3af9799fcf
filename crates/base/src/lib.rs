//! Foundation of all Spinney crates: errors, file I/O, space, values, and multithreading.

pub mod array;
mod decimal_steps;
mod error;
pub mod guard;
pub mod io;
pub mod parallel;
mod progress;
mod set_operation;
pub mod sort;
pub mod space;
pub mod text_fields;
mod tree_type;
mod url;
pub mod value;

pub use decimal_steps::DecimalSteps;
pub use error::{Error, Result};
pub use progress::{Progress, SilentProgress, SubProgress};
pub use set_operation::SetOperation;
pub use tree_type::TreeType;
