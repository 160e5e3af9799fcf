//! Pages: pictures of their own in one file, besides overviews and masks.

use super::ifd::{Directory, Input, LinkedDirectory};
use super::spec::tag;
use spinney_base::{Error, Result};

/// Bits of NewSubfileType: an overview, a mask.
const REDUCED_OR_MASK: u64 = 1 | 4;
/// The value of SubfileType for an overview.
const OLD_REDUCED: u64 = 2;

/// Whether a directory is that of a page.
fn is_page(directory: &Directory<'_>) -> bool {
    let number = |tag| directory.number(tag).ok().flatten();
    match number(tag::NEW_SUBFILE_TYPE) {
        Some(bits) => bits & REDUCED_OR_MASK == 0,
        None => number(tag::SUBFILE_TYPE) != Some(OLD_REDUCED),
    }
}

/// The directory of the page of a number, which counts from 1; `first` is the offset of the first directory, which is always a
/// page.
///
/// # Errors
/// If there is no such page, or the file is damaged before it.
pub(super) fn find<'a>(input: &'a Input, first: u64, page: &str) -> Result<LinkedDirectory<'a>> {
    let wanted = page.parse::<usize>().ok().filter(|page| *page > 0);
    let mut found = 0;
    for directory in input.chain(first) {
        let (directory, next) = directory?;
        found += usize::from(found == 0 || is_page(&directory));
        if Some(found) == wanted {
            return Ok((directory, next));
        }
    }
    let expected = format!("a page of {}, by its number: 1 to {found}", input.path.display());
    Err(Error::invalid("layer", format!("`{page}`"), expected))
}

/// What to know of a file whose first page is read, if there are others; `next` is the offset of its second directory.
pub(super) fn remark(input: &Input, next: u64) -> Option<String> {
    let readable = input.chain(next).map_while(Result::ok);
    let pages = 1 + readable.filter(|(directory, _)| is_page(directory)).count();
    (pages > 1).then(|| {
        format!(
            "has {pages} pages, of which the first is read; --layer 2 (in Python layer=\"2\") reads another"
        )
    })
}
