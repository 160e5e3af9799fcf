//! Files of glTF: JSON, or binary with a JSON chunk and a chunk of bytes.

use std::ops::Range;

use super::super::model_file::ModelFile;
use spinney_base::{Error, Result};

/// First bytes of binary glTF.
const MAGIC: &[u8] = b"glTF";
/// Bytes of the header: magic, version and length.
const HEADER: usize = 12;

/// Whether a file is binary glTF.
pub(in super::super) fn is_binary(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Whether a JSON text is glTF rather than CityJSON. Only its first and last bytes are searched:
/// the required member `asset` has any position, and is hardly in the middle.
pub(in super::super) fn is_text(bytes: &[u8], extension: &str) -> bool {
    const SEARCHED: usize = 4096;
    let ends = [&bytes[..bytes.len().min(SEARCHED)], &bytes[bytes.len().saturating_sub(SEARCHED)..]];
    let has = |word: &[u8]| ends.iter().any(|end| end.windows(word.len()).any(|at| at == word));
    let is_city = || has(b"\"CityJSON") || has(b"\"CityObjects\"");
    let is_gltf = || has(b"\"asset\"") && has(b"\"version\"") && !is_city();
    bytes.trim_ascii_start().starts_with(b"{") && (extension == "gltf" || is_gltf())
}

/// Ranges of a file's JSON text and of its binary chunk.
pub(super) struct Container {
    pub(super) json: Range<usize>,
    pub(super) binary: Option<Range<usize>>,
}

impl Container {
    pub(super) fn of(source: &ModelFile) -> Result<Container> {
        let bytes = source.bytes();
        if !is_binary(bytes) {
            return Ok(Container { json: 0..bytes.len(), binary: None });
        }
        let number = |at: usize| {
            let four = bytes.get(at..at + 4).and_then(|bytes| bytes.first_chunk());
            four.map(|four| u32::from_le_bytes(*four)).ok_or_else(|| {
                let found = format!("{} bytes", bytes.len());
                source.corrupt("binary glTF", found, format!("at least {}", at + 4))
            })
        };
        let version = number(4)?;
        if version != 2 {
            let found = format!("binary glTF version {version}");
            return Err(Error::unsupported(source.path(), found, "convert it to glTF 2.0"));
        }
        let end = number(8)? as usize;
        if end > bytes.len() {
            let found = format!("{} bytes", bytes.len());
            return Err(source.corrupt("binary glTF, header", found, format!("{end}, as declared")));
        }
        let chunk = |at: usize| {
            let length = number(at)? as usize;
            let kind = number(at + 4)?.to_le_bytes();
            let start = at + 8;
            match start.checked_add(length).filter(|stop| *stop <= end) {
                Some(stop) => Ok((kind, start..stop)),
                None => {
                    let found = format!("a chunk of {length} bytes in a file of {end}");
                    Err(source.corrupt(format!("binary glTF, byte {at}"), found, "chunks within the file"))
                }
            }
        };
        let (kind, json) = chunk(HEADER)?;
        if &kind != b"JSON" {
            let found = format!("a chunk of type {:?}", String::from_utf8_lossy(&kind));
            return Err(source.corrupt("binary glTF, first chunk", found, "type JSON"));
        }
        let binary = match json.end < end {
            true => Some(chunk(json.end)?).filter(|(kind, _)| kind == b"BIN\0").map(|(_, range)| range),
            false => None,
        };
        Ok(Container { json, binary })
    }
}
