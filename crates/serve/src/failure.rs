//! Error responses.

use std::error::Error as _;
use std::path::Path;

use axum::body::Body;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::json;
use spinney_base::Error;

/// Status and message of an error response.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) status: StatusCode,
    pub(crate) message: String,
}

impl Failure {
    pub(crate) fn new(status: StatusCode, message: impl Into<String>) -> Failure {
        Failure { status, message: message.into() }
    }

    pub(crate) fn bad(message: impl Into<String>) -> Failure {
        Failure::new(StatusCode::BAD_REQUEST, message)
    }

    pub(crate) fn missing(message: impl Into<String>) -> Failure {
        Failure::new(StatusCode::NOT_FOUND, message)
    }

    pub(crate) fn too_large(message: impl Into<String>) -> Failure {
        Failure::new(StatusCode::PAYLOAD_TOO_LARGE, message)
    }

    pub(crate) fn busy(message: impl Into<String>) -> Failure {
        Failure::new(StatusCode::SERVICE_UNAVAILABLE, message)
    }

    /// Body: the message as JSON.
    pub(crate) fn body(&self) -> String {
        format!("{}\n", json!({ "error": self.message }))
    }

    /// Removes a directory's path from the message, so that clients do not learn it.
    pub(crate) fn without(mut self, directory: &Path) -> Failure {
        if let Some(directory) = directory.to_str().filter(|directory| directory.len() > 1) {
            self.message = self.message.replace(&format!("{directory}/"), "").replace(directory, ".");
        }
        self
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        let status = match &error {
            Error::Invalid { .. } => StatusCode::BAD_REQUEST,
            Error::Io { cause, .. } if cause.kind() == std::io::ErrorKind::NotFound => StatusCode::NOT_FOUND,
            Error::Unsupported { .. } | Error::NotATree { .. } | Error::NotASolid { .. } => {
                StatusCode::UNPROCESSABLE_ENTITY
            }
            Error::TooLarge { .. } | Error::InsufficientSpace { .. } => StatusCode::PAYLOAD_TOO_LARGE,
            Error::Locked { .. } | Error::Changed { .. } | Error::Interrupted => {
                StatusCode::SERVICE_UNAVAILABLE
            }
            _ => StatusCode::INTERNAL_SERVER_ERROR,
        };
        let mut message = error.to_string();
        let mut cause = error.source();
        while let Some(next) = cause {
            message += &format!(": {next}");
            cause = next.source();
        }
        Failure { status, message }
    }
}

impl IntoResponse for Failure {
    fn into_response(self) -> Response {
        let mut response = Response::new(Body::from(self.body()));
        *response.status_mut() = self.status;
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/json"));
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        if self.status == StatusCode::SERVICE_UNAVAILABLE {
            headers.insert(header::RETRY_AFTER, HeaderValue::from_static("1"));
        }
        response
    }
}
