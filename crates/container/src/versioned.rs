//! Sections that store a struct after a version number.

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use spinney_base::{Error, Result};

/// A type of section: its name for messages and its version. `LIMIT` is the maximum size in bytes,
/// on disk and decoded. It limits the memory that an untrusted length can allocate.
pub struct VersionedSection<const LIMIT: usize> {
    /// The name.
    pub name: &'static str,
    /// The version that is written, and the only one that is read.
    pub version: u32,
}

impl<const LIMIT: usize> VersionedSection<LIMIT> {
    /// Encodes a struct; `None` if it exceeds the limit.
    pub fn encode<T: Serialize>(&self, value: &T) -> Option<Vec<u8>> {
        let config = bincode::config::standard().with_limit::<LIMIT>();
        let bytes = bincode::serde::encode_to_vec((self.version, value), config).ok();
        bytes.filter(|bytes| bytes.len() <= LIMIT)
    }

    /// Decodes a struct and returns how many bytes it used. `path` is for messages.
    ///
    /// # Errors
    /// If the bytes are invalid, or of another version.
    pub fn decode<T: DeserializeOwned>(&self, path: &Path, bytes: &[u8]) -> Result<(T, usize)> {
        let VersionedSection { name, version } = self;
        let config = bincode::config::standard().with_limit::<LIMIT>();
        let corrupt = |found: String, expected: &str| Error::corrupt(path, *name, found, expected);
        let (found, used): (u32, usize) = bincode::serde::decode_from_slice(bytes, config)
            .map_err(|error| corrupt(error.to_string(), "a version number"))?;
        if found != *version {
            let advice = "install the version of Spinney that wrote the file, or a newer one";
            return Err(Error::unsupported(path, format!("{name} version {found}"), advice));
        }
        let (value, more): (T, usize) = bincode::serde::decode_from_slice(&bytes[used..], config)
            .map_err(|error| corrupt(error.to_string(), "the fields that formats.md defines"))?;
        Ok((value, used + more))
    }
}
