//! Compressed blocks of points. Each attribute is a column of integers, predicted from the
//! preceding points and entropy-coded as tokens.

mod block;
mod prediction;

pub(crate) use block::{BlockLayout, MAX_POINTS, columns_of, decode, encode};
