//! The blocks of a GIF file, which the decoder reads no further than the first frame.

use std::collections::BTreeMap;
use std::io::{BufReader, ErrorKind, Read};
use std::path::Path;

use spinney_base::io::InputFile;
use spinney_base::{Error, Result};

/// Maximum bytes of comments that are kept.
const MAX_COMMENTS: usize = 1 << 20;

/// Metadata of a GIF file.
#[derive(Debug, Default)]
pub(super) struct GifBlocks {
    frames: u64,
    comments: Vec<u8>,
    has_more_comments: bool,
}

impl GifBlocks {
    /// Warns of what is not read.
    pub(super) fn remark(&self) -> Option<String> {
        let frames = (self.frames > 1).then(|| format!("frames after the first of {}", self.frames));
        let comments = self.has_more_comments.then(|| "comments after the first MiB".into());
        let parts: Vec<String> = frames.into_iter().chain(comments).collect();
        (!parts.is_empty()).then(|| format!("{} are not read", parts.join(" and ")))
    }

    pub(super) fn tags(&self) -> BTreeMap<String, String> {
        let comment = String::from_utf8_lossy(&self.comments).trim().to_string();
        (!comment.is_empty()).then(|| ("Comment".to_string(), comment)).into_iter().collect()
    }
}

/// Scans all blocks of a GIF file to its trailer.
///
/// # Errors
/// If the file ends before, cannot be read, or has no frame.
pub(super) fn scan(path: &Path, file: &mut BufReader<InputFile>) -> Result<GifBlocks> {
    let corrupt = |found: String| Error::corrupt(path, "GIF data", found, "a valid GIF image");
    let blocks = read_blocks(file).map_err(|error| match error.kind() {
        ErrorKind::UnexpectedEof => corrupt("the end of the file before the trailer".into()),
        ErrorKind::InvalidData => corrupt(error.to_string()),
        _ => Error::io(path, "read")(error),
    })?;
    match blocks.frames {
        0 => Err(corrupt("no frame".into())),
        _ => Ok(blocks),
    }
}

fn read_blocks(file: &mut impl Read) -> std::io::Result<GifBlocks> {
    const EXTENSION: u8 = 0x21;
    const COMMENT: u8 = 0xfe;
    const FRAME: u8 = 0x2c;
    const TRAILER: u8 = 0x3b;
    let mut blocks = GifBlocks::default();
    let header: [u8; 13] = array(file)?;
    skip_color_table(file, header[10])?;
    loop {
        match byte(file)? {
            EXTENSION => {
                let is_comment = byte(file)? == COMMENT;
                sub_blocks(file, |data| {
                    let space = if is_comment { MAX_COMMENTS - blocks.comments.len() } else { 0 };
                    blocks.has_more_comments |= is_comment && data.len() > space;
                    blocks.comments.extend_from_slice(&data[..data.len().min(space)]);
                })?;
            }
            FRAME => {
                let descriptor: [u8; 9] = array(file)?;
                skip_color_table(file, descriptor[8])?;
                let _code_size = byte(file)?;
                sub_blocks(file, |_| ())?;
                blocks.frames += 1;
            }
            TRAILER => return Ok(blocks),
            other => {
                let found = format!("a block that starts with byte {other:#04x}");
                return Err(std::io::Error::new(ErrorKind::InvalidData, found));
            }
        }
    }
}

/// Reads length-prefixed blocks of up to 255 bytes, up to an empty one.
fn sub_blocks(file: &mut impl Read, mut visit: impl FnMut(&[u8])) -> std::io::Result<()> {
    let mut data = [0; 255];
    loop {
        let data = &mut data[..usize::from(byte(file)?)];
        if data.is_empty() {
            return Ok(());
        }
        file.read_exact(data)?;
        visit(data);
    }
}

/// Skips the color table that the flags declare.
fn skip_color_table(file: &mut impl Read, flags: u8) -> std::io::Result<()> {
    let mut table = [0; 3 * 256];
    let bytes = if flags & 0x80 == 0 { 0 } else { 3 << ((flags & 7) + 1) };
    file.read_exact(&mut table[..bytes])
}

fn byte(file: &mut impl Read) -> std::io::Result<u8> {
    array(file).map(|[byte]| byte)
}

fn array<const N: usize>(file: &mut impl Read) -> std::io::Result<[u8; N]> {
    let mut bytes = [0; N];
    file.read_exact(&mut bytes).map(|()| bytes)
}
