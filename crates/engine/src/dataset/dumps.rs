//! Small trees as text in full.

use super::{Dataset, Tree};
use crate::query::dump;
use crate::tree::{MemTree, df};
use spinney_base::{Error, Result};

impl Dataset {
    /// Returns a small tree in memory, condensed.
    ///
    /// # Errors
    /// If the file is corrupt, or the tree has more than `most` INNER nodes.
    pub fn in_memory(&self, most: u64) -> Result<MemTree> {
        let too_many = |records: String| {
            let expected = format!("at most {most}, the limit for output in full (`dump --limit`)");
            Err(Error::invalid(
                format!("{}: tree", self.name().display()),
                format!("{records} records"),
                expected,
            ))
        };
        let rule = self.header().rule;
        match &self.tree {
            Tree::Goblin(file) => {
                // (The total in the trailer may be incorrect.)
                let records = (0..file.segments()).map(|index| Ok(u64::from(file.entry(index)?.records)));
                let records = records.sum::<Result<u64>>()?;
                if records > most {
                    too_many(records.to_string())
                } else {
                    MemTree::from_source(&**file, rule)
                }
            }
            Tree::Autumnal(file) => {
                let records = file.traversable_inner_nodes()?;
                if records > most {
                    too_many(records.to_string())
                } else {
                    MemTree::from_source(&**file, rule)
                }
            }
            Tree::View(viewed) => {
                if viewed.has_more_nodes(most)? {
                    return too_many(format!("more than {most}"));
                }
                MemTree::from_source(viewed.view(), rule)
            }
        }
    }

    /// Returns the tree as a DF-expression ([`crate::tree::df`]): `B` or `F` is 255 in all
    /// channels.
    ///
    /// # Errors
    /// If the file is corrupt, or the tree has more than `most` INNER nodes.
    pub fn df_text(&self, most: u64) -> Result<String> {
        df::to_text(&self.in_memory(most)?, self.header().form.value.splat(255u8))
    }

    /// Returns the classic table of the literature, a line per record. For Goblin files and views,
    /// a line has the record's number, the children's values, and the number of the record at which
    /// to continue if the node's detail is skipped. An INNER child's representative has a minus
    /// sign, or parentheses where values may be 0 or negative; `.` is VOID. For Autumnal files, a
    /// line has the children's values with a minus sign (or in parentheses) or the numbers of their
    /// records, and the node's representative.
    ///
    /// # Errors
    /// Those of [`Dataset::df_text`].
    pub fn classic_table(&self, most: u64) -> Result<String> {
        let tree = self.in_memory(most)?;
        match &self.tree {
            Tree::Autumnal(_) => dump::classic_pointer_table(&tree),
            Tree::Goblin(_) | Tree::View(_) => dump::classic_table(&tree),
        }
    }

    /// Returns FD code and value of every leaf, a line each.
    ///
    /// # Errors
    /// Those of [`Dataset::df_text`].
    pub fn leaf_codes(&self, most: u64) -> Result<String> {
        dump::leaf_codes(&self.in_memory(most)?)
    }
}
