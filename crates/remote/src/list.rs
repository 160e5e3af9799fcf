//! Lists of the files in a bucket.

use std::path::Path;

use futures_util::TryStreamExt;
use object_store::ObjectMeta;
use object_store::list::PaginatedListOptions;
use object_store::path::Path as StorePath;
use spinney_base::io::MAX_NAMES;
use spinney_base::{Error, Result};

use super::connections::Connections;
use super::error;
use super::store::ObjectLocation;

/// Verb for messages.
const LIST: &str = "list the files of";

/// Returns the URLs of a bucket's files that start with a prefix. If not `is_deep`, only those
/// without another `/` after it.
///
/// # Errors
/// If the URL is that of a web server, or there are too many files; on cancellation.
pub(super) fn list(prefix: &str, is_deep: bool, connections: &Connections) -> Result<Vec<String>> {
    let path = Path::new(prefix);
    let scheme = prefix.split("://").next().unwrap_or_default();
    if ["http", "https"].iter().any(|web| web.eq_ignore_ascii_case(scheme)) {
        let advice = "give the names of the files, or a list of these (@FILE)";
        return Err(Error::unsupported(
            path,
            "a pattern of files on a web server, which cannot list them,",
            advice,
        ));
    }
    let (directory, start) = prefix.rsplit_once('/').unwrap_or((prefix, ""));
    let ObjectLocation { store, pages, name } = ObjectLocation::of(directory, &[], connections)?;
    let bad = |cause: object_store::path::Error| error::of_store(path, LIST, cause.into());
    let start = StorePath::from_url_path(start).map_err(bad)?;
    let separator = if name.is_root() { "" } else { "/" };
    let start = format!("{name}{separator}{start}");
    let mut names = Vec::new();
    let mut add = |found: &ObjectMeta| {
        let is_within = |rest: &str| is_deep || !rest.contains('/');
        let name = found.location.as_ref();
        if name.strip_prefix(&*start).is_some_and(is_within) {
            names.push(url_of_name(directory, name));
        }
        match names.len() > MAX_NAMES {
            true => {
                let found = format!("a pattern in a directory of more than {MAX_NAMES} files");
                Err(Error::unsupported(path, found, "give parts of them, or list them in a file (@FILE)"))
            }
            false => Ok(()),
        }
    };
    let Some(pages) = pages else {
        let all = store.list(None).try_collect::<Vec<_>>();
        let all = connections.wait(path, all)?.map_err(|cause| error::of_store(path, LIST, cause))?;
        all.iter().try_for_each(add)?;
        return Ok(names);
    };
    let all = async {
        let mut token = None;
        // (Pages may be empty.)
        for _ in 0..MAX_NAMES {
            let delimiter = (!is_deep).then_some("/".into());
            let options = PaginatedListOptions { delimiter, page_token: token, ..Default::default() };
            let page = async {
                let page = pages.list_paginated(Some(&*start).filter(|start| !start.is_empty()), options);
                page.await.map_err(|cause| error::of_store(path, LIST, cause))
            };
            let page = connections.limited((path, LIST), page).await?;
            page.result.objects.iter().try_for_each(&mut add)?;
            token = page.page_token;
            if token.is_none() {
                break;
            }
        }
        Ok(())
    };
    connections.wait(path, all)??;
    Ok(names)
}

/// Returns the URL of a name in the bucket of another URL.
fn url_of_name(other: &str, name: &str) -> String {
    let host = other.find("://").map_or(0, |at| at + 3);
    let end = other[host..].find('/').map_or(other.len(), |at| host + at);
    let mut url = format!("{}/", &other[..end]);
    for c in name.chars() {
        // What would end the path, or be taken for an escape.
        if c.is_control() || " %?#\\\"<>`{}|^*".contains(c) {
            let mut bytes = [0; 4];
            c.encode_utf8(&mut bytes).bytes().for_each(|byte| url.push_str(&format!("%{byte:02X}")));
        } else {
            url.push(c);
        }
    }
    url
}

#[cfg(test)]
mod tests {
    use object_store::ObjectStoreExt;

    use super::super::RemoteOptions;
    use super::*;

    #[test]
    fn files_of_a_prefix_are_listed() {
        let connections = Connections::new(RemoteOptions::default());
        for name in
            ["dem/a1.tif", "dem/a2.tif", "dem/b.tif", "dem/a/3.tif", "dem/a #%.tif", "other", "dem/ä?*.tif"]
        {
            let stored = StorePath::parse(name).unwrap();
            let put = connections.memory.put(&stored, "1".into());
            connections.wait(Path::new(name), put).unwrap().unwrap();
        }
        let list = |prefix: &str, is_deep| {
            let mut names = list(prefix, is_deep, &connections).unwrap();
            names.sort_unstable();
            names.iter().map(|name| name.strip_prefix("memory:///").unwrap().into()).collect::<Vec<String>>()
        };
        let flat = ["dem/a%20%23%25.tif", "dem/a1.tif", "dem/a2.tif"];
        assert_eq!(list("memory:///dem/a", false), flat);
        assert_eq!(list("memory:///dem/%61", false), flat);
        assert_eq!(list("memory:///dem/a", true), [flat[0], "dem/a/3.tif", flat[1], flat[2]]);
        assert_eq!(list("memory:///", false), ["other"]);
        assert_eq!(list("memory:///", true).len(), 7);
        for name in list("memory:///", true) {
            let url = format!("memory:///{name}");
            let ObjectLocation { store, name, .. } = ObjectLocation::of(&url, &[], &connections).unwrap();
            assert!(connections.wait(Path::new(&url), store.head(&name)).unwrap().is_ok(), "{url}");
        }
        let error = super::list("http://h/a", false, &connections).unwrap_err().to_string();
        assert!(error.contains("@FILE"), "{error}");
    }
}
