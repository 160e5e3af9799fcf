//! HTTP clients of stores that do not leak secrets.
//!
//! They send no `Referer` when a host redirects to another one, since the URL may be signed. User
//! names and passwords go only to the host that they are for.

use std::time::Duration;

use object_store::client::{HttpClient, HttpConnector};
use object_store::{ClientConfigKey as Key, ClientOptions};
use reqwest::header::{AUTHORIZATION, HeaderMap};
use reqwest::tls::Certificate;
use reqwest::{ClientBuilder, NoProxy, Proxy};
use url::Url;

/// Creates clients from the options of `object_store`, whose own connector cannot omit the
/// `Referer`.
#[derive(Debug)]
pub(super) struct Connector;

impl HttpConnector for Connector {
    fn connect(&self, options: &ClientOptions) -> object_store::Result<HttpClient> {
        let client = builder(options)?.build().map_err(failed)?;
        Ok(HttpClient::new(client))
    }
}

fn failed(cause: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> object_store::Error {
    object_store::Error::Generic { store: "HTTP client", source: cause.into() }
}

/// Creates a client builder with all options that have a readable value. The others (in-memory
/// certificates and resolvers) cannot be set by options of a store.
fn builder(options: &ClientOptions) -> object_store::Result<ClientBuilder> {
    let text = |key: Key| options.get_config_value(&key);
    let is_set = |key: Key| text(key).is_some_and(|value| is_true(&value));
    let time = |key: Key| text(key).map(|value| duration(&value)).transpose();
    let number = |key: Key| text(key).map(|value| value.parse::<u32>().map_err(failed)).transpose();
    let mut builder = ClientBuilder::new().referer(false).no_gzip().no_brotli().no_zstd().no_deflate();
    let agent = text(Key::UserAgent);
    builder = builder.user_agent(agent.as_deref().unwrap_or(concat!("spinney/", env!("CARGO_PKG_VERSION"))));
    if let Some(headers) = options.get_default_headers() {
        builder = builder.default_headers(headers.clone());
    }
    if let Some(proxy) = text(Key::ProxyUrl) {
        let excluded = text(Key::ProxyExcludes).and_then(|list| NoProxy::from_string(&list));
        builder = builder.proxy(Proxy::all(proxy).map_err(failed)?.no_proxy(excluded));
        if let Some(certificate) = text(Key::ProxyCaCertificate) {
            let certificate = Certificate::from_pem(certificate.as_bytes()).map_err(failed)?;
            builder = builder.tls_certs_merge([certificate]);
        }
    }
    if is_set(Key::NoSystemCertificates) {
        builder = builder.tls_certs_only([]);
    }
    if let Some(time) = time(Key::Timeout)? {
        builder = builder.timeout(time);
    }
    if let Some(time) = time(Key::ConnectTimeout)? {
        builder = builder.connect_timeout(time);
    }
    if let Some(time) = time(Key::ReadTimeout)? {
        builder = builder.read_timeout(time);
    }
    if let Some(time) = time(Key::PoolIdleTimeout)? {
        builder = builder.pool_idle_timeout(time);
    }
    if let Some(count) = number(Key::PoolMaxIdlePerHost)? {
        builder = builder.pool_max_idle_per_host(count as usize);
    }
    if is_set(Key::Http1Only) {
        builder = builder.http1_only();
    }
    if is_set(Key::AllowInvalidCertificates) {
        builder = builder.danger_accept_invalid_certs(true);
    }
    Ok(builder.https_only(!is_set(Key::AllowHttp)))
}

fn is_true(value: &str) -> bool {
    ["1", "true", "on", "yes", "y"].contains(&value.to_ascii_lowercase().as_str())
}

/// Parses a duration in the notation of `object_store`: "30s", "1m 30s 500ms".
fn duration(text: &str) -> object_store::Result<Duration> {
    let wrong = || failed(format!("`{text}`, expected a duration such as 30s or 1m 30s"));
    let mut time = Duration::ZERO;
    let mut rest = text.trim();
    while !rest.is_empty() {
        let digits = rest.find(|c: char| !c.is_ascii_digit()).ok_or_else(wrong)?;
        let (number, more) = rest.split_at(digits);
        let (unit, more) = more.split_at(more.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(more.len()));
        let number: u32 = number.parse().map_err(|_| wrong())?;
        let unit = match unit.trim_end_matches('s') {
            "n" => Duration::from_nanos(1),
            "u" => Duration::from_micros(1),
            "m" if unit == "ms" => Duration::from_millis(1),
            "" | "sec" | "second" => Duration::from_secs(1),
            "m" | "min" | "minute" => Duration::from_secs(60),
            "h" | "hour" => Duration::from_secs(3600),
            _ => return Err(wrong()),
        };
        time = unit.checked_mul(number).and_then(|part| time.checked_add(part)).ok_or_else(wrong)?;
        rest = more.trim_start();
    }
    Ok(time)
}

/// Moves user name and password from a URL to an `Authorization` header (HTTP Basic).
pub(super) fn take_user(url: &mut Url) -> object_store::Result<HeaderMap> {
    let mut headers = HeaderMap::new();
    if url.username().is_empty() && url.password().is_none() {
        return Ok(headers);
    }
    let client = ClientBuilder::new().no_proxy().build().map_err(failed)?;
    let request = client.get(url.clone()).build().map_err(failed)?;
    if let Some(value) = request.headers().get(AUTHORIZATION) {
        let mut value = value.clone();
        value.set_sensitive(true);
        headers.insert(AUTHORIZATION, value);
    }
    // These fail only for URLs without a host, which have no user info either.
    let _ = url.set_username("");
    let _ = url.set_password(None);
    Ok(headers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_the_store() {
        for (text, millis) in [("30s", 30_000), ("1m 30s 5ms", 90_005), ("2h", 7_200_000), ("1min", 60_000)] {
            assert_eq!(duration(text).unwrap(), Duration::from_millis(millis), "{text}");
        }
        for wrong in ["30", "s", "1x", "99999999999s", "-1s"] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
        let options = ClientOptions::new().with_timeout(Duration::from_millis(1500));
        assert_eq!(duration(&options.get_config_value(&Key::Timeout).unwrap()).unwrap().as_millis(), 1500);
        assert!(builder(&options.with_config(Key::ReadTimeout, "soon")).is_err());
    }

    #[test]
    fn users_go_into_a_header() {
        let _ = rustls::crypto::ring::default_provider().install_default();
        let mut url = Url::parse("http://us%40er:p%3Aw@host/x").unwrap();
        let headers = take_user(&mut url).unwrap();
        // Base64 of `us@er:p:w`.
        assert_eq!(headers[AUTHORIZATION], "Basic dXNAZXI6cDp3");
        assert!(headers[AUTHORIZATION].is_sensitive() && url.as_str() == "http://host/x");
        assert!(take_user(&mut url).unwrap().is_empty());
    }
}
