//! Exact arithmetic: the one room where whole numbers decide, and where it stands how many bits and how much rounding
//! that takes.
//!
//! Coordinates are whole numbers on a grid, so that every question about them has an answer in whole numbers. Doubles are
//! asked first, since they are fast, and believed where they are farther from a tie than they can be rounded ([`bounds`]).

pub mod bounds;
pub mod crossing;
pub mod lattice;
pub mod normal;
pub(crate) mod perturbation;
pub(crate) mod rank;
pub mod union_find;
pub mod vector;
