//! Names of a model's parts.

use std::borrow::Cow;
use std::collections::HashMap;

use super::model_file::ModelFile;
use spinney_base::{Error, Result};

/// Text of a name in a file: UTF-8, or else Latin-1, so that distinct names stay distinct.
pub(super) fn decoded(name: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(name) {
        Ok(name) => name.into(),
        Err(_) => name.iter().copied().map(char::from).collect::<String>().into(),
    }
}

/// Distinct names, numbered in the order of first occurrence.
pub(super) struct PartNames {
    names: Vec<String>,
    numbers: HashMap<String, u32>,
    bytes: u64,
    limit: u64,
}

impl PartNames {
    /// Empty list for names that take up to about `memory` bytes, or one MiB.
    pub(super) fn new(memory: u64) -> PartNames {
        PartNames { names: Vec::new(), numbers: HashMap::new(), bytes: 0, limit: memory.max(1 << 20) }
    }

    fn check_limit(&mut self, source: &ModelFile, copies: u64, name: &str) -> Result<()> {
        // Length of the string, and the overhead of the containers.
        self.bytes += copies * (name.len() as u64 + 48);
        if self.bytes > self.limit || self.names.len() >= u32::MAX as usize {
            return Err(Error::TooLarge {
                path: source.path().to_path_buf(),
                what: format!("the list of names of at least {} parts", self.names.len() + 1),
                needed: self.bytes,
                limit: self.limit,
                advice: "allow more memory, merge parts, or split the file".into(),
            });
        }
        Ok(())
    }

    /// Number of the part with this name. Adds a part if there is none.
    pub(super) fn number(&mut self, source: &ModelFile, name: &[u8]) -> Result<u32> {
        let name = decoded(name);
        if let Some(number) = self.numbers.get(&*name) {
            return Ok(*number);
        }
        self.check_limit(source, 2, &name)?;
        let number = self.names.len() as u32;
        self.numbers.insert(name.clone().into_owned(), number);
        self.names.push(name.into_owned());
        Ok(number)
    }

    /// Ends the list and returns all names.
    pub(super) fn into_names(self) -> Vec<String> {
        self.names
    }

    /// Number of the next part.
    pub(super) fn len(&self) -> u32 {
        // (`check_limit` ensures that it fits.)
        self.names.len() as u32
    }

    /// Adds a part that is distinct from all others, even if they share the name.
    pub(super) fn push(&mut self, source: &ModelFile, name: String) -> Result<()> {
        self.check_limit(source, 1, &name)?;
        self.names.push(name);
        Ok(())
    }

    /// All names, or a default name for a model without parts.
    pub(super) fn names(&self) -> Vec<String> {
        if self.names.is_empty() { vec!["mesh".into()] } else { self.names.clone() }
    }
}
