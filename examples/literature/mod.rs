//! Structures from the papers in `docs/literature.md` that the library does not have: its files
//! store points and lines in other trees. The tests in `tests/literature/` compile these modules.

pub(crate) mod points;
