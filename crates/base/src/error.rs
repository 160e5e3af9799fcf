//! Error type of the library.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::url::{redacted, shown, url_of};

/// Result of a fallible operation of this library.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A failure: in which file, what was found there, what was expected, and what to do about it.
///
/// Messages contain no secrets of URLs: see [`io::redacted`](crate::io::redacted).
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
        /// Error of the operating system.
        #[source]
        cause: io::Error,
    },
    /// The file's bytes violate the rules of its format.
    #[error(
        "{}: {}: found {}, expected {}; the file is corrupt, or its name is wrong",
        shown(path),
        redacted(location),
        redacted(found),
        redacted(expected)
    )]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// Location in the file: a section, record, tag or offset.
        location: String,
        /// Description of the bytes that were found.
        found: String,
        /// Description of what the format requires.
        expected: String,
    },
    /// The file is (or may be) valid, but uses a feature that is not supported.
    #[error("{}: {} is not supported; {}", shown(path), redacted(found), redacted(advice))]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature that was found.
        found: String,
        /// Advice to the user: what to do instead.
        advice: String,
    },
    /// The file has another format, but a tree is expected.
    #[error("{}: is {found}, not a Spinney file; {}", shown(path), redacted(advice))]
    NotATree {
        /// The file.
        path: PathBuf,
        /// Name of the format.
        found: String,
        /// Advice to the user: what to do with the file.
        advice: String,
    },
    /// The surface of a model does not bound a solid.
    #[error("{}: {}; {}{}", shown(path), redacted(what), redacted(advice), listed(locations, *count))]
    NotASolid {
        /// The file.
        path: PathBuf,
        /// Description of the surface's defect.
        what: String,
        /// Descriptions of the defect's locations: at most 100.
        locations: Vec<String>,
        /// Number of all such locations.
        count: u64,
        /// Advice to the user: what to do instead.
        advice: String,
    },
    /// Reading the file would need more memory than is allowed.
    #[error(
        "{}: {what} needs {needed} bytes of memory, the limit is {limit}; {}",
        shown(path),
        redacted(advice)
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Name of the data that would have to be in memory.
        what: String,
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
        /// Advice to the user.
        advice: String,
    },
    /// The output would be larger than the free space, or than is allowed.
    #[error("{}: would have about {needed} bytes, but {limit} {whose}; {}", shown(path), redacted(advice))]
    InsufficientSpace {
        /// The file.
        path: PathBuf,
        /// Estimated size of the output in bytes.
        needed: u64,
        /// Maximum number of bytes.
        limit: u64,
        /// Meaning of the limit, as a verb phrase: "are allowed".
        whose: &'static str,
        /// Advice to the user.
        advice: String,
    },
    /// Another process is editing the file.
    #[error("{}: is being edited by {holder}; try again when it is done", shown(path))]
    Locked {
        /// The file.
        path: PathBuf,
        /// Process that holds the lock, as far as is known.
        holder: String,
    },
    /// Another process changed the file while it was read.
    #[error(
        "{}: {what} while it was read, so the result may mix both states; run the query again",
        shown(path)
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// The change: "was overwritten", "was cut short".
        what: &'static str,
    },
    /// A file, or the output that would be made from it, differs from the plan.
    #[error("{}: {}, but {} was planned; {advice}", shown(path), redacted(found), redacted(expected))]
    PlanMismatch {
        /// The file.
        path: PathBuf,
        /// Description of what was found.
        found: String,
        /// Description of what was planned.
        expected: String,
        /// Advice to the user.
        advice: &'static str,
    },
    /// The file that is being edited is no longer at its path: it was moved, removed or replaced.
    #[error(
        "{}: {what} while it was edited; the file at this path does not have the edits{}",
        shown(path),
        now_at(file)
    )]
    Moved {
        /// The path at which it was opened.
        path: PathBuf,
        /// Predicate of the message: "was removed", "was replaced by another file".
        what: &'static str,
        /// Present path of the edited file, if it has one and that is known.
        file: Option<PathBuf>,
    },
    /// An earlier write or sync failed, so the state on disk is unknown. To continue, open the file
    /// again.
    #[error(
        "{}: cannot be written after a failed write or sync; open the file again, its last commit is complete",
        shown(path)
    )]
    Poisoned {
        /// The file.
        path: PathBuf,
    },
    /// An argument is invalid, in itself or for this file.
    #[error("{}: got {}, expected {}", redacted(what), redacted(found), redacted(expected))]
    Invalid {
        /// The argument, option or parameter.
        what: String,
        /// The value that was given.
        found: String,
        /// Description of the valid values.
        expected: String,
    },
    /// Bytes of a remote file have not been fetched yet: fetch them, and run the query again. See
    /// [`io::batch`](crate::io::batch).
    #[error(
        "the query needs bytes of a remote file that were not fetched; fetch them and run the query again"
    )]
    NotFetched,
    /// The operation was cancelled. It left no output.
    #[error("interrupted; no output was written")]
    Interrupted,
}

/// Prints the message with those of its causes, without the secrets of URLs in paths and strings.
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

/// For messages: the present path of a file.
fn now_at(file: &Option<PathBuf>) -> String {
    file.as_ref().map_or(String::new(), |file| format!("; they are in {}", shown(file)))
}

/// For messages: locations, one per line.
fn listed(locations: &[String], count: u64) -> String {
    let mut text: String = locations.iter().map(|location| format!("\n  {}", redacted(location))).collect();
    let more = count.saturating_sub(locations.len() as u64);
    if more > 0 {
        text.push_str(&format!("\n  and {more} more"));
    }
    text
}

impl Error {
    /// Returns a conversion of operating-system errors, for `map_err`. `doing` is the operation on
    /// `path` that failed, as in [`Error::Io`].
    ///
    /// An error of this library inside of the [`io::Error`], such as one from an
    /// [`io::InputFile`](crate::io::InputFile), is returned unchanged. If `path` is a URL that was
    /// passed to the operating system, the result is [`Error::Unsupported`].
    pub fn io(path: impl Into<PathBuf>, doing: &'static str) -> impl FnOnce(io::Error) -> Error {
        let path = path.into();
        move |cause| {
            let cause = match cause.downcast::<Error>() {
                Ok(inside) => return inside,
                Err(cause) => cause,
            };
            // The system takes a URL for a file name, and its "no such file" would mislead the
            // user.
            if cause.raw_os_error().is_some() && url_of(&path).is_some() {
                let advice = "download it first; only trees and exact models are read from URLs";
                return Error::unsupported(path, "reading this format from a URL", advice);
            }
            Error::Io { path, doing, cause }
        }
    }

    /// Wraps this error in an [`io::Error`] of the same kind, for `Read` and `Write`
    /// implementations. [`Error::io`] unwraps it.
    pub fn into_io(self) -> io::Error {
        let kind = match &self {
            // Callers of `Read` and `Write` retry after `Interrupted`, which must not happen here.
            Error::Io { cause, .. } if cause.kind() != io::ErrorKind::Interrupted => cause.kind(),
            _ => io::ErrorKind::Other,
        };
        io::Error::new(kind, self)
    }

    /// Creates an [`Error::Corrupt`].
    pub fn corrupt(
        path: impl AsRef<Path>,
        location: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Error {
        Error::Corrupt {
            path: path.as_ref().to_path_buf(),
            location: location.into(),
            found: found.into(),
            expected: expected.into(),
        }
    }

    /// Creates an [`Error::Unsupported`]; `advice` is what the user can do instead.
    pub fn unsupported(path: impl AsRef<Path>, found: impl Into<String>, advice: impl Into<String>) -> Error {
        Error::Unsupported { path: path.as_ref().to_path_buf(), found: found.into(), advice: advice.into() }
    }

    /// Adds the name of the file that an [`Error::Invalid`] is about. Other errors have one.
    pub fn of_file(self, path: &Path) -> Error {
        match self {
            Error::Invalid { what, found, expected } => {
                Error::Invalid { what: format!("{}: {what}", path.display()), found, expected }
            }
            other => other,
        }
    }

    /// Creates an [`Error::Invalid`].
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
            Error::NotASolid {
                path: path(),
                what: text(),
                locations: vec![text()],
                count: 2,
                advice: text(),
            },
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
