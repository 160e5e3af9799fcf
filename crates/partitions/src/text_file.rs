//! Reading of text files into bounded memory.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use spinney_base::{Error, Result};

/// Reads a text file of `what`. Text and nodes, each of which takes at least one byte of the file,
/// may use at most `memory` bytes.
///
/// # Errors
/// If the file cannot be read, exceeds `memory`, or is not UTF-8.
pub(crate) fn read(path: &Path, what: &str, node_bytes: usize, memory: u64) -> Result<String> {
    let mut file = File::open(path).map_err(Error::io(path, "open"))?;
    let size = file.metadata().map_err(Error::io(path, "read"))?.len();
    let byte = 1 + node_bytes as u64;
    // The limit also covers a file that grows while it is read.
    let most = memory / byte;
    let mut bytes = Vec::new();
    (&mut file).take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(Error::io(path, "read"))?;
    if bytes.len() as u64 > most {
        return Err(Error::TooLarge {
            path: path.to_path_buf(),
            what: format!("the {what}"),
            needed: size.saturating_mul(byte),
            limit: memory,
            advice: "raise --memory".into(),
        });
    }
    String::from_utf8(bytes).map_err(|error| {
        let found = format!("invalid UTF-8 at byte {}", error.utf8_error().valid_up_to());
        Error::invalid(path.display().to_string(), found, format!("the text of a {what}"))
    })
}
