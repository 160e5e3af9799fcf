//! Secrets of URLs that are stored without them: manifests and job plans name files, but must not
//! contain signatures and passwords.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use spinney_base::io::{is_redacted, shown, split_query};
use spinney_base::{Error, Result};

/// Maximum number of URLs whose secrets are remembered.
const MAX_URLS: usize = 1 << 16;

/// User info and query of URLs, by URL without them. A file may refer to a URL that this process
/// has opened before. The secrets of others must be provided by the user.
#[derive(Default)]
pub(super) struct Secrets(Mutex<HashMap<String, Secret>>);

#[derive(Clone)]
struct Secret {
    /// Includes the trailing `@`.
    user: String,
    /// Includes the leading `?`.
    query: String,
}

impl Secrets {
    /// Remembers the secrets of these URLs.
    pub(super) fn new<'u>(urls: impl IntoIterator<Item = &'u str>) -> Secrets {
        let secrets = Secrets::default();
        urls.into_iter().for_each(|url| secrets.remember(url));
        secrets
    }

    fn remember(&self, url: &str) {
        let clean = shown(Path::new(url));
        if clean == url {
            return;
        }
        let (base, query) = split_query(url);
        let host = base.split_once("://").map_or(base, |(_, rest)| rest);
        let host = &host[..host.find('/').unwrap_or(host.len())];
        let user = host.rfind('@').map_or("", |at| &host[..=at]);
        let secret = Secret { user: user.into(), query: query.into() };
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if known.len() >= 2 * MAX_URLS {
            known.clear();
        }
        known.insert(stem(&clean).into(), secret.clone());
        known.insert(clean.into_owned(), secret);
    }

    /// Restores the secrets of a URL that was stored without them. Remembers those of other URLs.
    ///
    /// # Errors
    /// If the secrets are unknown.
    pub(super) fn complete<'u>(&self, url: &'u str) -> Result<Cow<'u, str>> {
        if !is_redacted(url) {
            self.remember(url);
            return Ok(url.into());
        }
        let known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Sidecar files, such as `x.prj` next to `x.tif`, have the same secrets.
        let secret = known.get(url).or_else(|| known.get(stem(url))).cloned();
        drop(known);
        let Some(secret) = secret else {
            let advice = "list the complete URL in a file with one URL per line: --signed-urls FILE, or SPINNEY_SIGNED_URLS";
            return Err(Error::unsupported(url, "a URL whose query or password was not stored", advice));
        };
        let (base, query) = split_query(url);
        let query = if query.is_empty() { "" } else { &secret.query };
        Ok(format!("{}{query}", base.replacen("...@", &secret.user, 1)).into())
    }
}

/// A redacted URL without its query, up to the first dot of its file name.
fn stem(url: &str) -> &str {
    let base = split_query(url).0;
    let name = base.rfind('/').map_or(0, |slash| slash + 1);
    base[name..].find('.').map_or(base, |dot| &base[..name + dot])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_are_completed_by_those_that_are_known() {
        let given = ["http://us:pw@host/a/x.tif?sig=1", "https://host/y.goblin?sig=2"];
        let secrets = Secrets::new(given);
        for url in given {
            assert_eq!(secrets.complete(&shown(Path::new(url))).unwrap(), url);
        }
        assert_eq!(
            secrets.complete("http://...@host/a/x.tif.aux.xml?...").unwrap(),
            "http://us:pw@host/a/x.tif.aux.xml?sig=1"
        );
        assert_eq!(secrets.complete("https://host/z.goblin?v=3").unwrap(), "https://host/z.goblin?v=3");
        assert_eq!(secrets.complete("https://host/z.goblin?...").unwrap(), "https://host/z.goblin?v=3");
        // A URL without a query is used unchanged, whatever else is known.
        assert_eq!(secrets.complete("https://host/y.goblin").unwrap(), "https://host/y.goblin");
        let error = secrets.complete("https://other/y.goblin?...").unwrap_err().to_string();
        assert!(error.contains("--signed-urls"), "{error}");
    }
}
