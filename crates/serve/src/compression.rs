//! Compression of responses for clients that accept gzip, where it pays: text, JSON, scripts and
//! arrays.

use std::io::Write as _;

use axum::body::{Body, Bytes, HttpBody as _};
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use flate2::Compression;
use flate2::write::GzEncoder;
use http_body_util::BodyExt as _;

/// Minimum size of a response that is compressed, in bytes.
const MIN_BYTES: usize = 1 << 10;

/// Maximum size of a response that is compressed, in bytes: beyond, CPU time costs more.
const MAX_BYTES: u64 = 32 << 20;

/// Suffix of the tags of compressed responses, since other bytes need another tag.
const MARK: &str = "-gzip\"";

/// Middleware that compresses responses where it pays. Images and ranges of files are unchanged:
/// images are compressed already, and ranges must be the file's bytes.
pub(crate) async fn compress(mut request: Request, next: Next) -> Response {
    let takes_gzip = *request.method() != Method::HEAD && accepts(request.headers());
    let had_mark = unmark(request.headers_mut());
    let mut response = next.run(request).await;
    if is_compressible(response.headers()) {
        response.headers_mut().append(header::VARY, HeaderValue::from_static("Accept-Encoding"));
    }
    if had_mark && response.status() == StatusCode::NOT_MODIFIED {
        mark(response.headers_mut());
    }
    let length = response.body().size_hint().exact().unwrap_or(u64::MAX);
    let pays = (MIN_BYTES as u64..=MAX_BYTES).contains(&length);
    if !takes_gzip || !pays || response.status() != StatusCode::OK || !is_compressible(response.headers()) {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    // The body is in memory, since file responses have `Accept-Ranges` and are not compressible.
    let Ok(body) = body.collect().await else { return StatusCode::INTERNAL_SERVER_ERROR.into_response() };
    let body = body.to_bytes();
    let plain = body.clone();
    let packed = tokio::task::spawn_blocking(move || gzip(&plain)).await.ok().flatten();
    let Some(packed) = packed else { return Response::from_parts(parts, Body::from(body)) };
    parts.headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    parts.headers.remove(header::CONTENT_LENGTH);
    mark(&mut parts.headers);
    Response::from_parts(parts, Body::from(packed))
}

/// Compressed bytes, if compression saves more than a tenth.
fn gzip(plain: &Bytes) -> Option<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::new(4));
    encoder.write_all(plain).ok()?;
    let packed = encoder.finish().ok()?;
    (packed.len() < plain.len() / 10 * 9).then_some(packed)
}

/// Whether a client accepts gzip.
fn accepts(headers: &HeaderMap) -> bool {
    let lists = headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    lists.flat_map(|list| list.split(',')).any(|item| {
        let (name, quality) = item.split_once(';').unwrap_or((item, ""));
        let quality = quality.trim().strip_prefix("q=").map_or(Some(1.0), |text| text.trim().parse().ok());
        name.trim().eq_ignore_ascii_case("gzip") && quality.is_some_and(|quality: f64| quality > 0.0)
    })
}

/// Whether a response's type is compressible.
fn is_compressible(headers: &HeaderMap) -> bool {
    const TYPES: [&str; 6] = [
        "text/",
        "application/json",
        "application/javascript",
        "application/wasm",
        "image/svg",
        "application/octet-stream",
    ];
    let of_type = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
    !headers.contains_key(header::CONTENT_RANGE)
        && !headers.contains_key(header::ACCEPT_RANGES)
        && of_type.is_some_and(|of_type| TYPES.iter().any(|known| of_type.starts_with(known)))
}

/// Removes the suffix from the tags of a request; returns whether there was one.
fn unmark(headers: &mut HeaderMap) -> bool {
    let Some(given) = headers.get(header::IF_NONE_MATCH).and_then(|value| value.to_str().ok()) else {
        return false;
    };
    if !given.contains(MARK) {
        return false;
    }
    if let Ok(plain) = HeaderValue::from_str(&given.replace(MARK, "\"")) {
        headers.insert(header::IF_NONE_MATCH, plain);
    }
    true
}

/// Adds the suffix to the tag of a compressed response.
fn mark(headers: &mut HeaderMap) {
    let tag = headers.get(header::ETAG).and_then(|tag| tag.to_str().ok());
    let marked = tag.and_then(|tag| HeaderValue::from_str(&format!("{}{MARK}", tag.strip_suffix('"')?)).ok());
    if let Some(marked) = marked {
        headers.insert(header::ETAG, marked);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_say_what_they_take() {
        let takes = |text: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::ACCEPT_ENCODING, text.parse().unwrap());
            accepts(&headers)
        };
        assert!(takes("gzip") && takes("br, GZIP;q=0.5") && takes("deflate, gzip"));
        assert!(!takes("br") && !takes("gzip;q=0") && !takes("identity") && !takes("gzip;q=x"));
        assert!(gzip(&vec![7; 5000].into()).is_some_and(|packed| packed.len() < 100));
    }
}
