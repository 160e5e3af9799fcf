//! Host names of the server: those that requests may use, and the URL that clients see.

use std::net::{IpAddr, SocketAddr};

use axum::http::{HeaderMap, StatusCode, Uri, header};
use spinney_base::{Error, Result};

use crate::ServeOptions;
use crate::failure::Failure;

/// Host names that requests may use. At a loopback address, only local names are allowed: in a DNS
/// rebinding attack, a page's requests reach this machine under the attacker's host name.
pub(crate) struct Hosts {
    address: SocketAddr,
    /// Allowed names in addition to the address; `None` allows all.
    allowed: Option<Vec<String>>,
    /// URL of the server as clients see it, without a trailing slash.
    public: Option<String>,
}

impl Hosts {
    /// Names of a server that listens at `address`.
    ///
    /// # Errors
    /// If the public URL is invalid.
    pub(crate) fn new(options: &ServeOptions, address: SocketAddr) -> Result<Hosts> {
        let public = options.public_url.as_deref().map(public_url).transpose()?;
        let is_any = options.allow_hosts.iter().any(|host| host == "*")
            || options.allow_hosts.is_empty() && !address.ip().is_loopback();
        let own = public.as_deref().and_then(|url| url.split_once("://")).map(|(_, rest)| rest);
        let own = own.map(|rest| rest.split('/').next().unwrap_or(rest));
        let named = options.allow_hosts.iter().map(String::as_str).chain(own);
        let named = named.map(|host| name_of(host).to_ascii_lowercase()).collect();
        Ok(Hosts { address, allowed: (!is_any).then_some(named), public })
    }

    /// Checks that a request has exactly one host, and that it is allowed.
    ///
    /// # Errors
    /// If it does not.
    pub(crate) fn check(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), Failure> {
        let mut given = headers.get_all(header::HOST).iter();
        let (Some(host), None) = (given.next(), given.next()) else {
            return Err(Failure::bad("Host: expected exactly one header"));
        };
        let host = host.to_str().ok().filter(|host| is_host(host));
        let Some(host) = host else {
            return Err(Failure::bad("Host: expected a host name, as in localhost:8000"));
        };
        // An authority in the request target overrides the header.
        let host = uri.authority().map_or(host, |authority| authority.as_str());
        let name = name_of(host).to_ascii_lowercase();
        let Some(allowed) = &self.allowed else { return Ok(()) };
        if self.is_own(&name) || allowed.contains(&name) {
            return Ok(());
        }
        let message = format!(
            "Host: `{}` is not a name of this server; add it: `spinney serve --allow-host NAME`",
            name.escape_debug()
        );
        Err(Failure::new(StatusCode::MISDIRECTED_REQUEST, message))
    }

    /// Whether a name is one of the server's address.
    fn is_own(&self, name: &str) -> bool {
        let bare = name.trim_start_matches('[').trim_end_matches(']');
        match bare.parse::<IpAddr>() {
            Ok(ip) => ip == self.address.ip() || self.address.ip().is_loopback() && ip.is_loopback(),
            Err(_) => {
                self.address.ip().is_loopback() && (name == "localhost" || name.ends_with(".localhost"))
            }
        }
    }

    /// URL of the server as the client sees it, to prepend to paths. Sources in this order:
    /// `--public-url`, proxy headers (`X-Forwarded-Proto`, `-Host`, `-Prefix`, or `Forwarded`), the
    /// request itself.
    pub(crate) fn public(&self, headers: &HeaderMap) -> String {
        if let Some(url) = &self.public {
            return url.clone();
        }
        let first = |name: &str| {
            let value = headers.get(name)?.to_str().ok()?;
            Some(value.split(',').next().unwrap_or(value).trim().to_string())
        };
        let forwarded = first("forwarded");
        let pair = |name: &str| {
            let pairs = forwarded.as_deref()?.split(';').filter_map(|pair| pair.split_once('='));
            let mut pairs = pairs.filter(|(key, _)| key.trim().eq_ignore_ascii_case(name));
            pairs.next().map(|(_, value)| value.trim().trim_matches('"').to_string())
        };
        let scheme = first("x-forwarded-proto").or_else(|| pair("proto"));
        let scheme = scheme.filter(|scheme| scheme == "https").unwrap_or_else(|| "http".into());
        let host = first("x-forwarded-host").or_else(|| pair("host")).filter(|host| is_host(host));
        let host = host.or_else(|| first("host").filter(|host| is_host(host)));
        let host = host.unwrap_or_else(|| self.address.to_string());
        let prefix = first("x-forwarded-prefix").filter(|prefix| is_prefix(prefix)).unwrap_or_default();
        format!("{scheme}://{host}{}", prefix.trim_end_matches('/'))
    }
}

/// Validates a public URL, and removes trailing slashes.
fn public_url(text: &str) -> Result<String> {
    let rest = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    let is_right = rest.is_some_and(|rest| {
        let (host, path) = rest.split_at(rest.find('/').unwrap_or(rest.len()));
        is_host(host) && (path.is_empty() || is_prefix(path))
    });
    if !is_right {
        return Err(Error::invalid("public URL", format!("`{text}`"), "https://HOST or https://HOST/PATH"));
    }
    Ok(text.trim_end_matches('/').to_string())
}

/// Whether a string is a host, with or without a port.
fn is_host(host: &str) -> bool {
    (1..256).contains(&host.len())
        && host.bytes().all(|byte| byte.is_ascii_alphanumeric() || b".:-[]_".contains(&byte))
}

/// Whether a string is a path prefix.
fn is_prefix(path: &str) -> bool {
    path.len() < 256
        && path.starts_with('/')
        && path.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"/.-_~%".contains(&byte))
}

/// Name of a host without its port, and without a trailing dot.
fn name_of(host: &str) -> &str {
    let name = match host.rfind(']') {
        Some(end) => &host[..=end],
        // An IPv6 address without brackets has several colons.
        None if host.matches(':').count() > 1 => host,
        None => host.split(':').next().unwrap_or(host),
    };
    name.strip_suffix('.').unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for (name, value) in pairs {
            headers.append(*name, value.parse().unwrap());
        }
        headers
    }

    fn hosts(address: &str, allowed: &[&str], public: Option<&str>) -> Hosts {
        let options = ServeOptions {
            allow_hosts: allowed.iter().map(|host| host.to_string()).collect(),
            public_url: public.map(String::from),
            ..ServeOptions::default()
        };
        Hosts::new(&options, address.parse().unwrap()).unwrap()
    }

    #[test]
    fn loopback_servers_accept_only_local_names() {
        let right =
            |hosts: &Hosts, host: &str| hosts.check(&Uri::default(), &headers(&[("host", host)])).is_ok();
        let local = hosts("127.0.0.1:8000", &[], None);
        for host in
            ["localhost", "LOCALHOST:9000", "127.0.0.1:8000", "[::1]:8000", "a.localhost", "localhost."]
        {
            assert!(right(&local, host), "{host}");
        }
        for host in ["evil.example", "localhost.evil.example", "10.0.0.1", "127.0.0.1.evil", "", "a b", "a/b"]
        {
            assert!(!right(&local, host), "{host}");
        }
        assert!(local.check(&Uri::default(), &headers(&[])).is_err(), "none");
        assert!(
            local.check(&Uri::default(), &headers(&[("host", "localhost"), ("host", "localhost")])).is_err()
        );
        let other = "http://evil.example/".parse().unwrap();
        assert!(local.check(&other, &headers(&[("host", "localhost")])).is_err());
        let named = hosts("127.0.0.1:8000", &["maps.example:443"], Some("https://public.example/maps/"));
        assert!(
            right(&named, "maps.example") && right(&named, "public.example") && right(&named, "localhost")
        );
        assert!(!right(&named, "other.example"));
        assert!(right(&hosts("127.0.0.1:1", &["*"], None), "any.example"));
        // Servers at other addresses may have names that are unknown here.
        let open = hosts("0.0.0.0:8000", &[], None);
        assert!(
            right(&open, "any.example") && !right(&hosts("10.0.0.1:80", &["a.example"], None), "b.example")
        );
        assert!(right(&hosts("10.0.0.1:80", &["a.example"], None), "10.0.0.1"));
    }

    #[test]
    fn public_urls_follow_proxy_headers() {
        let local = hosts("127.0.0.1:8000", &[], None);
        let host = ("host", "localhost:8000");
        for (more, expected) in [
            (&[][..], "http://localhost:8000"),
            (&[("x-forwarded-proto", "https"), ("x-forwarded-host", "maps.example")], "https://maps.example"),
            (
                &[("forwarded", "for=1.2.3.4; Proto=https;host=\"maps.example:8443\", for=x")],
                "https://maps.example:8443",
            ),
            (
                &[("x-forwarded-prefix", "/maps/"), ("x-forwarded-proto", "https, http")],
                "https://localhost:8000/maps",
            ),
            (&[("x-forwarded-host", "a b"), ("x-forwarded-proto", "javascript")], "http://localhost:8000"),
            (&[("x-forwarded-prefix", "//evil\\")], "http://localhost:8000"),
        ] {
            assert_eq!(local.public(&headers(&[&[host], more].concat())), expected);
        }
        let public = hosts("127.0.0.1:8000", &[], Some("https://maps.example/a/"));
        assert_eq!(
            public.public(&headers(&[host, ("x-forwarded-host", "b.example")])),
            "https://maps.example/a"
        );
        for wrong in ["maps.example", "ftp://x", "https://", "https://a b", "https://u:p@x", "https://x?y"] {
            assert!(public_url(wrong).is_err(), "{wrong}");
        }
    }
}
