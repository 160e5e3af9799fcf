//! Responses computed from a file, with their entity tags.

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use quick_cache::Weighter;
use quick_cache::sync::Cache;

/// Cache of responses by tag and request target. Invariant: the tag identifies the file version,
/// and a response is a function of that version and the target, so no cached response is stale.
/// (The target is in the key since a client could construct two targets with equal tags.)
pub(crate) struct ResponseCache(Cache<(String, String), QueryResponse, ResponseWeighter>);

/// Maximum size of the cache in bytes.
const MAX_CACHED: u64 = 32 << 20;
/// Maximum size of a cached response in bytes: larger ones are seldom requested twice.
const MAX_EACH: usize = 1 << 20;
/// Expected number of cached responses.
const EXPECTED: usize = 4096;

/// Weighs responses by their memory use.
#[derive(Clone)]
struct ResponseWeighter;

impl Weighter<(String, String), QueryResponse> for ResponseWeighter {
    fn weight(&self, (tag, target): &(String, String), response: &QueryResponse) -> u64 {
        const OTHERS: usize = 256;
        (2 * tag.len() + target.len() + response.bytes.len() + OTHERS) as u64
    }
}

impl Default for ResponseCache {
    fn default() -> ResponseCache {
        ResponseCache(Cache::with_weighter(EXPECTED, MAX_CACHED, ResponseWeighter))
    }
}

impl ResponseCache {
    /// Cached response to a query.
    pub(crate) fn get(&self, key: &(String, String)) -> Option<QueryResponse> {
        self.0.get(key)
    }

    /// Caches a response.
    pub(crate) fn insert(&self, key: (String, String), response: &QueryResponse) {
        if response.bytes.len() <= MAX_EACH {
            self.0.insert(key, response.clone());
        }
    }
}

/// Response with a body in memory.
#[derive(Clone, Debug)]
pub(crate) struct QueryResponse {
    pub(crate) status: StatusCode,
    pub(crate) content_type: &'static str,
    /// Strong entity tag: equal tags imply equal bytes. `None` if the response also depends on a
    /// request body.
    pub(crate) tag: Option<String>,
    pub(crate) bytes: Bytes,
}

impl QueryResponse {
    pub(crate) fn new(content_type: &'static str, tag: String, bytes: impl Into<Bytes>) -> QueryResponse {
        QueryResponse { status: StatusCode::OK, content_type, tag: Some(tag), bytes: bytes.into() }
    }

    /// Response to a query with a body.
    pub(crate) fn untagged(content_type: &'static str, bytes: Vec<u8>) -> QueryResponse {
        QueryResponse { status: StatusCode::OK, content_type, tag: None, bytes: bytes.into() }
    }

    /// Response for a client that already has the content.
    pub(crate) fn not_modified(tag: String) -> QueryResponse {
        QueryResponse {
            status: StatusCode::NOT_MODIFIED,
            content_type: "",
            tag: Some(tag),
            bytes: Bytes::new(),
        }
    }

    /// Response without content, such as for a tile without data.
    pub(crate) fn nothing(tag: String) -> QueryResponse {
        QueryResponse {
            status: StatusCode::NO_CONTENT,
            content_type: "",
            tag: Some(tag),
            bytes: Bytes::new(),
        }
    }
}

impl IntoResponse for QueryResponse {
    fn into_response(self) -> Response {
        let mut response = Response::new(Body::from(self.bytes));
        *response.status_mut() = self.status;
        let headers = response.headers_mut();
        if !self.content_type.is_empty() {
            headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(self.content_type));
        }
        match &self.tag {
            Some(tag) => insert_tag(headers, tag),
            None => {
                headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
            }
        }
        response
    }
}

/// Sets the tag. Clients must revalidate cached responses each time, since files change.
pub(crate) fn insert_tag(headers: &mut HeaderMap, tag: &str) {
    if let Ok(tag) = HeaderValue::from_str(tag) {
        headers.insert(header::ETAG, tag);
    }
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
}

/// Whether a header has this tag, or `*`. Weak tags match if `is_weak_enough`.
pub(crate) fn has_tag(
    headers: &HeaderMap,
    name: header::HeaderName,
    tag: &str,
    is_weak_enough: bool,
) -> bool {
    let lists = headers.get_all(name).iter().filter_map(|value| value.to_str().ok());
    lists.flat_map(|list| list.split(',')).map(str::trim).any(|given| {
        let strong = if is_weak_enough { given.strip_prefix("W/").unwrap_or(given) } else { given };
        given == "*" || strong == tag
    })
}
