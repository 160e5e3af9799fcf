//! Operations on trees: sources made of sources.
//!
//! A [`View`] shows a source through any chain of windows, translations, scalings, mirrorings and rotations; a
//! [`Combined`] settles several sources into one, by presence or by value. Both read only what somebody asks for, and
//! can be asked, walked and stored like any other source.

mod area;
mod combine;
mod look;
mod map;
mod view;

pub use combine::{Combined, CombinedNode, Operation, Prefer};
pub use look::{Around, ViewNode};
pub use map::{Axis, Map};
pub use view::{Sampling, View};
