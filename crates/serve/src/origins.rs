//! Origins whose pages may read responses (CORS).

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};

use crate::routes::App;

/// Middleware that lets pages of the allowed origins read responses, and responds to preflight
/// requests.
pub(crate) async fn add_origin(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let is_preflight = request.method() == Method::OPTIONS;
    let allowed = allowed(&app.options.allow_origins, request.headers());
    let mut response =
        if is_preflight { StatusCode::NO_CONTENT.into_response() } else { next.run(request).await };
    let headers = response.headers_mut();
    let mut set = |name: HeaderName, value| headers.insert(name, HeaderValue::from_static(value));
    set(header::X_CONTENT_TYPE_OPTIONS, "nosniff");
    if is_preflight {
        set(header::ALLOW, "GET, HEAD, POST, OPTIONS");
    }
    if allowed.is_some() {
        set(header::ACCESS_CONTROL_EXPOSE_HEADERS, "Accept-Ranges, Content-Length, Content-Range, ETag");
        if is_preflight {
            set(header::ACCESS_CONTROL_ALLOW_METHODS, "GET, HEAD, POST, OPTIONS");
            set(
                header::ACCESS_CONTROL_ALLOW_HEADERS,
                "Content-Type, If-Match, If-None-Match, If-Range, Range",
            );
            set(header::ACCESS_CONTROL_MAX_AGE, "86400");
        }
    }
    if !app.options.allow_origins.iter().any(|origin| origin == "*") {
        headers.append(header::VARY, HeaderValue::from_static("Origin"));
    }
    if let Some(allowed) = allowed {
        headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, allowed);
    }
    response
}

/// Value of `Access-Control-Allow-Origin`: the request's origin if it is allowed, `*` if all are.
pub(crate) fn allowed(origins: &[String], headers: &HeaderMap) -> Option<HeaderValue> {
    if origins.iter().any(|origin| origin == "*") {
        return Some(HeaderValue::from_static("*"));
    }
    let origin = headers.get(header::ORIGIN)?;
    let is_right =
        |known: &String| known.trim_end_matches('/').as_bytes().eq_ignore_ascii_case(origin.as_bytes());
    origins.iter().any(is_right).then(|| origin.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origins_are_those_that_are_named() {
        let mut headers = HeaderMap::new();
        headers.insert(header::ORIGIN, HeaderValue::from_static("https://maps.example"));
        let of = |origins: &[&str]| {
            allowed(&origins.iter().map(|origin| origin.to_string()).collect::<Vec<_>>(), &headers)
        };
        assert_eq!(of(&["*"]).unwrap(), "*");
        assert_eq!(of(&["https://a.example", "https://MAPS.example/"]).unwrap(), "https://maps.example");
        assert!(
            of(&[]).is_none()
                && of(&["https://maps.example:8443"]).is_none()
                && of(&["http://maps.example"]).is_none()
        );
    }
}
