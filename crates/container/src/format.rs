//! The formats of tree files.

use std::borrow::Cow;
use std::path::Path;

/// The formats of tree files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeFormat {
    /// Compact, read-only, published.
    Goblin,
    /// Pointered, edited, with history.
    Autumnal,
}

impl TreeFormat {
    /// The format that a file of this name gets: Autumnal if it ends with `.autumn`, else Goblin.
    pub fn of(path: &Path) -> TreeFormat {
        let is_autumnal = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("autumn"));
        if is_autumnal { TreeFormat::Autumnal } else { TreeFormat::Goblin }
    }

    /// The first bytes of every file: one that is no text, the name, and an end of line.
    pub fn magic(self) -> [u8; 8] {
        match self {
            TreeFormat::Goblin => *b"\x93Goblin\n",
            TreeFormat::Autumnal => *b"\x93Autumn\n",
        }
    }

    /// The format's name.
    pub fn name(self) -> &'static str {
        match self {
            TreeFormat::Goblin => "Goblin",
            TreeFormat::Autumnal => "Autumnal",
        }
    }
}

/// The file and the commit that a path means: `map.autumn@12` is commit 12 of `map.autumn`, unless there is a
/// file of that name.
pub fn split_commit(path: &Path) -> (Cow<'_, Path>, Option<u64>) {
    let split = || {
        let name = path.file_name()?.to_str()?;
        let (name, number) = name.rsplit_once('@')?;
        let is_number = !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
        let number = number.parse().ok().filter(|_| is_number && !name.is_empty())?;
        Some((path.with_file_name(name), number))
    };
    match split() {
        Some((file, number)) if !path.exists() => (Cow::Owned(file), Some(number)),
        _ => (Cow::Borrowed(path), None),
    }
}

/// The format that a file has, whatever its name.
///
/// # Errors
/// If it cannot be read, or is no tree file.
pub(crate) fn file_format(file: &Path) -> spinney_base::Result<TreeFormat> {
    Ok(crate::Header::read(file, &spinney_base::io::Positioned::open(file)?)?.0)
}

/// Whether a file, or one of its commits, is a tree of either format, whatever its name.
pub fn file_is_tree(path: &Path) -> bool {
    file_format(&split_commit(path).0).is_ok()
}
