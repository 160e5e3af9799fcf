//! Exact arithmetic: the module that contains all integer predicates, their bit widths and their
//! rounding bounds.
//!
//! Coordinates are integers on a grid, so every predicate has an exact integer result. Doubles are
//! evaluated first, since they are fast. Their result is used if its distance from a tie exceeds
//! the rounding error ([`bounds`]).

pub mod bounds;
pub mod crossing;
pub mod lattice;
pub mod normal;
pub(crate) mod perturbation;
pub(crate) mod rank;
pub mod union_find;
pub mod vector;
