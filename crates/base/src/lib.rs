//! The base of all of Spinney: errors, files, space, values, work for several threads.

pub mod array;
mod decimal_steps;
mod error;
mod form;
pub mod guard;
pub mod io;
pub mod parallel;
mod progress;
mod set_operation;
pub mod sort;
pub mod space;
pub mod text_fields;
mod url;
pub mod value;

pub use decimal_steps::DecimalSteps;
pub use error::{Error, Result};
pub use form::TreeType;
pub use progress::{Progress, SilentProgress, SubProgress};
pub use set_operation::SetOperation;
