//! Pages: independent images in one file, as opposed to overviews and masks.

use super::ifd::{Directory, Input, LinkedDirectory};
use spinney_base::{Error, Result};
use spinney_chunks::spec::{new_subfile_type, tag};

/// Bits of overviews and masks.
const REDUCED_OR_MASK: u64 = new_subfile_type::REDUCED_RESOLUTION | new_subfile_type::TRANSPARENCY_MASK;
/// The value of SubfileType for an overview.
const OLD_REDUCED: u64 = 2;

/// Whether a directory is a page.
pub(super) fn is_page(directory: &Directory<'_>) -> bool {
    let number = |tag| directory.number(tag).ok().flatten();
    match number(tag::NEW_SUBFILE_TYPE) {
        Some(bits) => bits & REDUCED_OR_MASK == 0,
        None => number(tag::SUBFILE_TYPE) != Some(OLD_REDUCED),
    }
}

/// Finds the directory of a page by its number, from 0. `first` is the offset of the first
/// directory, which is always a page.
///
/// # Errors
/// If there is no such page, or the file is corrupt before it.
pub(super) fn find(input: &Input, first: u64, page: usize) -> Result<LinkedDirectory<'_>> {
    let mut found = 0;
    for directory in input.chain(first) {
        let (directory, next) = directory?;
        if found == 0 || is_page(&directory) {
            if found == page {
                return Ok((directory, next));
            }
            found += 1;
        }
    }
    let last = found.saturating_sub(1);
    let expected = format!("a page number of {}: 0 to {last}", input.path.display());
    Err(Error::invalid("pages", page.to_string(), expected))
}

/// Counts the pages up to the first corrupt directory. `next` is the offset of the second
/// directory.
pub(super) fn count(input: &Input, next: u64) -> usize {
    let readable = input.chain(next).map_while(Result::ok);
    1 + readable.filter(|(directory, _)| is_page(directory)).count()
}

/// Returns the offsets of the directories of all pages.
///
/// # Errors
/// If one of the directories is corrupt.
pub(super) fn directories(input: &Input, first: u64) -> Result<Vec<u64>> {
    let (mut offsets, mut offset) = (Vec::new(), first);
    for directory in input.chain(first) {
        let (directory, next) = directory?;
        if offsets.is_empty() || is_page(&directory) {
            offsets.push(offset);
        }
        offset = next;
    }
    Ok(offsets)
}
