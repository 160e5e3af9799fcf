//! The one error type of the library.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::url::{redacted, shown, url_of};

/// Result of anything in this library that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A failure: which file, what was found there, what was expected, and what to do about it. Messages have no secrets of URLs: see
/// [`io::redacted`](crate::io::redacted).
#[derive(thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused an operation on a file.
    #[error("{}: cannot {doing}", shown(path))]
    Io {
        /// The file (or `-` for a standard stream).
        path: PathBuf,
        /// The operation that failed, as a verb phrase: "open", "write the directory".
        doing: &'static str,
        /// The operating system's answer.
        #[source]
        cause: io::Error,
    },
    /// The file's bytes break the rules of its format.
    #[error(
        "{}: {}: found {}, expected {}; the file is damaged or not what its name says",
        shown(path),
        redacted(place),
        redacted(found),
        redacted(expected)
    )]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// The part of the file: a section, record, tag or offset.
        place: String,
        /// Description of what stands there.
        found: String,
        /// Description of what the format asks for.
        expected: String,
    },
    /// The file is (or may be) fine, but uses something that is not supported.
    #[error("{}: {} is not supported; {}", shown(path), redacted(found), redacted(advice))]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature that was found.
        found: String,
        /// Advice to the user: what to do instead.
        advice: String,
    },
    /// The file has another format, where a tree is expected.
    #[error("{}: is no tree but {found}; {}", shown(path), redacted(advice))]
    NotATree {
        /// The file.
        path: PathBuf,
        /// Name of what it is.
        found: String,
        /// Advice to the user: what to do with it.
        advice: String,
    },
    /// The surface of a model does not bound a solid.
    #[error("{}: {}; {}{}", shown(path), redacted(what), redacted(advice), listed(places, *count))]
    NotASolid {
        /// The file.
        path: PathBuf,
        /// Description of what is wrong with the surface.
        what: String,
        /// The places where it is, in words: at most 100.
        places: Vec<String>,
        /// Number of all such places.
        count: u64,
        /// Advice to the user: what to do instead.
        advice: String,
    },
    /// Reading the file would need more memory than was allowed.
    #[error(
        "{}: {what} needs {needed} bytes of memory, the limit is {limit}; {}",
        shown(path),
        redacted(advice)
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Name of what would have to be held in memory.
        what: String,
        /// Bytes it needs.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
        /// Advice to the user.
        advice: String,
    },
    /// More bytes would be written than there is free space, or than is allowed.
    #[error(
        "{}: about {needed} bytes would be written, and {limit} {whose}; {}",
        shown(path),
        redacted(advice)
    )]
    InsufficientSpace {
        /// The file.
        path: PathBuf,
        /// Bytes that would be written, no more than an estimate.
        needed: u64,
        /// Bytes that may be.
        limit: u64,
        /// Meaning of the limit: "are free in its folder", "are allowed".
        whose: &'static str,
        /// Advice to the user.
        advice: String,
    },
    /// The file is being edited by somebody else.
    #[error("{}: is being edited by {holder}; try again when it is done", shown(path))]
    Locked {
        /// The file.
        path: PathBuf,
        /// Who has it, as far as is known.
        holder: String,
    },
    /// The file was changed by somebody else while it was read.
    #[error(
        "{}: {what} while it was read: the answer may be of the one state or the other, or of both; ask again",
        shown(path)
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// The change: "was overwritten", "was cut short".
        what: &'static str,
    },
    /// A file, or what would be made of it, differs from the plan.
    #[error("{}: {}, but {} was planned; {advice}", shown(path), redacted(found), redacted(expected))]
    PlanMismatch {
        /// The file.
        path: PathBuf,
        /// Description of what is there.
        found: String,
        /// Description of what was planned.
        expected: String,
        /// Advice to the user.
        advice: &'static str,
    },
    /// The file that is being edited is no longer at its path: it was moved, removed or replaced.
    #[error(
        "{}: {what} while it was edited; the edits are not in the file of that name{}",
        shown(path),
        now_at(file)
    )]
    Moved {
        /// The path at which it was opened.
        path: PathBuf,
        /// The fate of the file: "was removed", "was replaced by another file".
        what: &'static str,
        /// The place of the edited file, if it has one that is known.
        file: Option<PathBuf>,
    },
    /// An earlier write or sync failed, so that nobody knows what is on the disk: whoever edits the file must
    /// open it again.
    #[error(
        "{}: nothing more can be written, an earlier write or sync failed; open the file again, its last commit is whole",
        shown(path)
    )]
    Poisoned {
        /// The file.
        path: PathBuf,
    },
    /// An argument makes no sense, by itself or for this file.
    #[error("{}: got {}, expected {}", redacted(what), redacted(found), redacted(expected))]
    Invalid {
        /// The argument, option or parameter.
        what: String,
        /// The argument as it was given.
        found: String,
        /// Description of what is possible.
        expected: String,
    },
    /// Bytes of a remote file have not been fetched yet: fetch them, and run the query again.
    /// See [`io::batch`](crate::io::batch).
    #[error("bytes of a file elsewhere that are needed have not been fetched; fetch them and ask again")]
    NotFetched,
    /// The user interrupted the work; nothing was left behind.
    #[error("interrupted; no output was written")]
    Interrupted,
}

/// The message, with those of the causes: paths and strings in it may be URLs with secrets.
impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = self.to_string();
        let mut cause = std::error::Error::source(self);
        while let Some(next) = cause {
            text += &format!(": {}", redacted(&next.to_string()));
            cause = next.source();
        }
        f.debug_tuple("Error").field(&text).finish()
    }
}

/// For messages: where a file is now.
fn now_at(file: &Option<PathBuf>) -> String {
    file.as_ref().map_or(String::new(), |file| format!(", but in {}", shown(file)))
}

/// For messages: places, one per line.
fn listed(places: &[String], count: u64) -> String {
    let mut text: String = places.iter().map(|place| format!("\n  {}", redacted(place))).collect();
    let more = count.saturating_sub(places.len() as u64);
    if more > 0 {
        text.push_str(&format!("\n  and {more} more"));
    }
    text
}

impl Error {
    /// An operating-system error while `doing` something to `path`; use with `map_err`. One that has an error of this library inside, as of
    /// an [`io::InputFile`](crate::io::InputFile), becomes that.
    pub fn io(path: impl Into<PathBuf>, doing: &'static str) -> impl FnOnce(io::Error) -> Error {
        let path = path.into();
        move |cause| {
            let cause = match cause.downcast::<Error>() {
                Ok(inside) => return inside,
                Err(cause) => cause,
            };
            // (The system knows no URLs: that there is no file of that name would say the wrong thing.)
            if cause.raw_os_error().is_some() && url_of(&path).is_some() {
                let advice = "copy it to this machine first (trees and exact models are read where they are)";
                return Error::unsupported(
                    path,
                    "a file elsewhere, where one of this machine is needed,",
                    advice,
                );
            }
            Error::Io { path, doing, cause }
        }
    }

    /// The error inside of one of the system, of the same kind, for readers and writers that others use: [`Error::io`] finds it there.
    pub fn into_io(self) -> io::Error {
        let kind = match &self {
            // (What is interrupted here is not to be tried again.)
            Error::Io { cause, .. } if cause.kind() != io::ErrorKind::Interrupted => cause.kind(),
            _ => io::ErrorKind::Other,
        };
        io::Error::new(kind, self)
    }

    /// Bytes of `path` that break the format's rules.
    pub fn corrupt(
        path: impl AsRef<Path>,
        place: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Error {
        Error::Corrupt {
            path: path.as_ref().to_path_buf(),
            place: place.into(),
            found: found.into(),
            expected: expected.into(),
        }
    }

    /// Something in `path` that is not supported, and what the user can do instead.
    pub fn unsupported(path: impl AsRef<Path>, found: impl Into<String>, advice: impl Into<String>) -> Error {
        Error::Unsupported { path: path.as_ref().to_path_buf(), found: found.into(), advice: advice.into() }
    }

    /// An argument that makes no sense.
    pub fn invalid(what: impl Into<String>, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::Invalid { what: what.into(), found: found.into(), expected: expected.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_have_no_secrets_of_urls() {
        const URL: &str = "https://user:SECRET@host/x.tif?X-Amz-Signature=SECRET";
        let path = || PathBuf::from(URL);
        let text = || URL.to_string();
        let all = [
            Error::io(URL, "open")(io::Error::other(format!("GET {URL}: 403"))),
            Error::corrupt(URL, URL, URL, URL),
            Error::unsupported(URL, URL, URL),
            Error::NotATree {
                path: path(),
                found: "TIFF".into(),
                advice: format!("spinney build {URL} -o x"),
            },
            Error::NotASolid { path: path(), what: text(), places: vec![text()], count: 2, advice: text() },
            Error::TooLarge { path: path(), what: "x".into(), needed: 2, limit: 1, advice: text() },
            Error::InsufficientSpace { path: path(), needed: 2, limit: 1, whose: "are free", advice: text() },
            Error::Locked { path: path(), holder: "x".into() },
            Error::Changed { path: path(), what: "was overwritten" },
            Error::PlanMismatch { path: path(), found: text(), expected: text(), advice: "plan another" },
            Error::Moved { path: path(), what: "was removed", file: Some(path()) },
            Error::Poisoned { path: path() },
            Error::invalid(URL, URL, URL),
        ];
        for error in all {
            for text in [error.to_string(), format!("{error:?}")] {
                assert!(text.contains("host/x.tif?...") && !text.contains("SECRET"), "{text}");
            }
        }
    }
}
