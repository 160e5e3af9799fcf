//! Blocks of points in few bytes: each attribute is a column of whole numbers, foretold from the points before and coded by tokens.

mod block;
mod prediction;

pub(crate) use block::{BlockLayout, MAX_POINTS, columns_of, decode, encode};
