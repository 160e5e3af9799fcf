//! Answers that were made of a file, with the tag that tells whether they still hold.

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use quick_cache::Weighter;
use quick_cache::sync::Cache;

/// Answers that were given, by their tags and by what was asked. Invariant: a tag tells the state of the file, and an answer is a function of that and
/// of the address; so what is kept is never of an older state. (Whoever looks for it can find two addresses of one tag.)
pub(crate) struct AnswerCache(Cache<(String, String), Answer, AnswerWeight>);

/// Bytes of answers that are kept.
const MAX_CACHED: u64 = 32 << 20;
/// Bytes of an answer that is kept at most: larger ones are seldom asked for twice.
const MAX_EACH: usize = 1 << 20;
/// Answers that are expected to be kept.
const EXPECTED: usize = 4096;

/// Weighs answers by the memory that they take.
#[derive(Clone)]
struct AnswerWeight;

impl Weighter<(String, String), Answer> for AnswerWeight {
    fn weight(&self, (tag, target): &(String, String), answer: &Answer) -> u64 {
        const OTHERS: usize = 256;
        (2 * tag.len() + target.len() + answer.bytes.len() + OTHERS) as u64
    }
}

impl Default for AnswerCache {
    fn default() -> AnswerCache {
        AnswerCache(Cache::with_weighter(EXPECTED, MAX_CACHED, AnswerWeight))
    }
}

impl AnswerCache {
    /// The answer to a question, as long as its tag is the same.
    pub(crate) fn get(&self, question: &(String, String)) -> Option<Answer> {
        self.0.get(question)
    }

    /// Keeps an answer.
    pub(crate) fn keep(&self, question: (String, String), answer: &Answer) {
        if answer.bytes.len() <= MAX_EACH {
            self.0.insert(question, answer.clone());
        }
    }
}

/// An answer of some bytes.
#[derive(Clone, Debug)]
pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) content_type: &'static str,
    /// A strong one: equal tags are equal bytes. None where what was asked is not all in the address.
    pub(crate) tag: Option<String>,
    pub(crate) bytes: Bytes,
}

impl Answer {
    pub(crate) fn new(content_type: &'static str, tag: String, bytes: impl Into<Bytes>) -> Answer {
        Answer { status: StatusCode::OK, content_type, tag: Some(tag), bytes: bytes.into() }
    }

    /// An answer to what came in a body.
    pub(crate) fn untagged(content_type: &'static str, bytes: Vec<u8>) -> Answer {
        Answer { status: StatusCode::OK, content_type, tag: None, bytes: bytes.into() }
    }

    /// The answer that a client has already what it asks for.
    pub(crate) fn not_modified(tag: String) -> Answer {
        Answer { status: StatusCode::NOT_MODIFIED, content_type: "", tag: Some(tag), bytes: Bytes::new() }
    }

    /// The answer that nothing is there, such as the tile of a place without data.
    pub(crate) fn nothing(tag: String) -> Answer {
        Answer { status: StatusCode::NO_CONTENT, content_type: "", tag: Some(tag), bytes: Bytes::new() }
    }
}

impl IntoResponse for Answer {
    fn into_response(self) -> Response {
        let mut response = Response::new(Body::from(self.bytes));
        *response.status_mut() = self.status;
        let headers = response.headers_mut();
        if !self.content_type.is_empty() {
            headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(self.content_type));
        }
        match &self.tag {
            Some(tag) => tell_tag(headers, tag),
            None => {
                headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
            }
        }
        response
    }
}

/// Tells a tag, and that what was kept is to be compared with it each time: files change.
pub(crate) fn tell_tag(headers: &mut HeaderMap, tag: &str) {
    if let Ok(tag) = HeaderValue::from_str(tag) {
        headers.insert(header::ETAG, tag);
    }
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
}

/// Whether one of the tags of a header is this one, or all are meant. Weak ones count where `is_weak_enough`.
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
