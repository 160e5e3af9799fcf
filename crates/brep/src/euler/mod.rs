//! Euler operators: they change a body's topology one entity at a time, and preserve the
//! Euler-Poincaré formula (M. Mäntylä, *An introduction to solid modeling*, 1988). Each has an
//! inverse.
//!
//! | operator | makes | kills | inverse |
//! | --- | --- | --- | --- |
//! | *mvfs* | vertex, face, shell | | *kvfs* |
//! | *mev* | edge, vertex | | *kev* |
//! | *mef* | edge, face | | *kef* |
//! | *kemr* | ring | edge | *mekr* |
//! | *kfmrh* | ring, handle | face | *mfkrh* |
//! | *ksfmr* | ring | shell, face | *msfkr* |
//! | *semv* | edge, vertex: an edge is divided | | *jekv* |
//! | *ringmv* | | : a ring is moved to another face | itself |
//!
//! The first five pairs are Mäntylä's. He has one pair for *kfmrh* and *ksfmr*, whose meaning
//! depends on the shells of the faces; here each says what it changes, and is refused otherwise.

mod body;
mod edges;
mod line_operators;
mod listing;
mod local;
mod model;
mod names;
mod numbered;
mod rings;
mod text;
mod undo;

pub use self::body::{EulerBody, EulerCorner};
pub use self::listing::euler_text;
pub use self::local::LocalChange;
pub use self::model::{EditReport, EditedModel, ModelBody, apply_local, edit_model};
pub use self::text::{EulerText, TextLimits};
