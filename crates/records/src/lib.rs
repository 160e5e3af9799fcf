//! Files of records of numbers in formats of other programs: what their headers tell, and the numbers behind them. Pictures, meshes and
//! points are made of these elsewhere.

pub mod npy;
pub mod ply;
pub mod text;
