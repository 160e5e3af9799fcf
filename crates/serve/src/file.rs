//! Downloads of files, or of byte ranges.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::Response;
use spinney_base::Error;
use spinney_base::io::platform::read_exact_at;

use crate::failure::Failure;
use crate::range::{RequestedRange, parse_range};
use crate::response::{has_tag, insert_tag};
use crate::version::FileVersion;

/// Bytes that are read and buffered at a time.
const CHUNK_BYTES: u64 = 256 << 10;

/// Maximum number of attempts to read the start of a response while the file is being modified.
const TIMES: usize = 20;

/// Range of a file to send, with its start already read.
pub(crate) struct FileResponse {
    file: Arc<File>,
    version: FileVersion,
    status: StatusCode,
    /// First byte, and the end (exclusive).
    part: [u64; 2],
    start: Vec<u8>,
}

/// Opens a file, and reads the requested range or its first chunk, all from one version of the
/// file. Later bytes of the range do not change: edits append records, and if the file is replaced,
/// the open handle refers to the old one.
///
/// # Errors
/// If the file cannot be read, or a condition of the request does not hold.
pub(crate) fn respond(path: &Path, method: &Method, headers: &HeaderMap) -> Result<FileResponse, Failure> {
    for _ in 0..TIMES {
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        let (version, _) = FileVersion::settled(path, || file.metadata())?;
        let (status, part) = wanted(&version, method, headers)?;
        let mut start = Vec::new();
        if *method == Method::GET && !status.is_redirection() {
            start = vec![0; (part[1] - part[0]).min(CHUNK_BYTES) as usize];
            let read = read_exact_at(&file, &mut start, part[0]);
            let metadata = file.metadata().map_err(Error::io(path, "stat"))?;
            if FileVersion::of(&metadata, path)? != version {
                continue;
            }
            read.map_err(Error::io(path, "read"))?;
        }
        return Ok(FileResponse { file: Arc::new(file), version, status, part, start });
    }
    Err(Error::Changed { path: path.to_path_buf(), what: "was changed repeatedly" }.into())
}

/// Status of a response, and its byte range.
fn wanted(
    version: &FileVersion,
    method: &Method,
    headers: &HeaderMap,
) -> Result<(StatusCode, [u64; 2]), Failure> {
    let (length, tag) = (version.length, version.tag(""));
    if headers.contains_key(header::IF_MATCH) && !has_tag(headers, header::IF_MATCH, &tag, false) {
        let message = format!("If-Match: the file's tag is {tag}; it has changed");
        return Err(Failure::new(StatusCode::PRECONDITION_FAILED, message));
    }
    if has_tag(headers, header::IF_NONE_MATCH, &tag, true) {
        return Ok((StatusCode::NOT_MODIFIED, [0, length]));
    }
    let range = headers.get(header::RANGE).and_then(|range| range.to_str().ok());
    // Responses have no `Last-Modified`, so a date in this header never matches.
    let is_same = headers.get(header::IF_RANGE).is_none_or(|given| given.as_bytes() == tag.as_bytes());
    let requested = match range {
        Some(range) if is_same && *method == Method::GET => parse_range(range, length),
        _ => RequestedRange::All,
    };
    match requested {
        RequestedRange::All => Ok((StatusCode::OK, [0, length])),
        RequestedRange::Bytes(first, last) => Ok((StatusCode::PARTIAL_CONTENT, [first, last + 1])),
        RequestedRange::Unsatisfiable => Err(Failure::new(
            StatusCode::RANGE_NOT_SATISFIABLE,
            format!("Range: is outside of the file's {length} bytes"),
        )),
        RequestedRange::Multiple => Err(Failure::new(
            StatusCode::RANGE_NOT_SATISFIABLE,
            "Range: got several ranges, expected one; send one request per range",
        )),
    }
}

impl FileResponse {
    /// Response whose body is read in chunks while it is sent.
    pub(crate) fn into_response(self) -> Response {
        let FileResponse { file, version, status, part: [first, end], start } = self;
        let next = first + start.len() as u64;
        // `start` is empty if the body is not requested.
        let is_whole = start.is_empty() || next == end;
        let body = if is_whole { Body::from(start) } else { stream(file, start, next, end) };
        let mut response = Response::new(body);
        *response.status_mut() = status;
        let headers = response.headers_mut();
        let mut set = |name: HeaderName, value: String| {
            HeaderValue::from_str(&value).map(|value| headers.insert(name, value)).is_ok()
        };
        if status != StatusCode::NOT_MODIFIED {
            set(header::CONTENT_LENGTH, (end - first).to_string());
        }
        if status == StatusCode::PARTIAL_CONTENT {
            set(header::CONTENT_RANGE, format!("bytes {first}-{}/{}", end - 1, version.length));
        }
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream"));
        headers.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        insert_tag(headers, &version.tag(""));
        response
    }
}

/// Body that consists of `start` and the rest of the range.
fn stream(file: Arc<File>, start: Vec<u8>, next: u64, end: u64) -> Body {
    let chunks = futures_util::stream::unfold((Some(start), next), move |(start, next)| {
        let file = file.clone();
        async move {
            if let Some(start) = start {
                return Some((Ok(Bytes::from(start)), (None, next)));
            }
            if next >= end {
                return None;
            }
            let count = (end - next).min(CHUNK_BYTES);
            let read = tokio::task::spawn_blocking(move || {
                let mut bytes = vec![0; count as usize];
                read_exact_at(&file, &mut bytes, next).map(|()| Bytes::from(bytes))
            });
            let read = read.await.unwrap_or_else(|error| Err(std::io::Error::other(error)));
            // On an error, the connection closes before `Content-Length` bytes, which the client
            // detects.
            let next = if read.is_ok() { next + count } else { end };
            Some((read, (None, next)))
        }
    });
    Body::from_stream(chunks)
}
