//! Status of remote files without fetching their bytes, and their removal.

use std::path::Path;

use futures_util::StreamExt;
use futures_util::stream;
use object_store::{Error as StoreError, GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt};
use spinney_base::Result;
use spinney_base::io::{FileStat, FileVersion};

use super::connections::Connections;
use super::error;
use super::store::ObjectLocation;

/// Verb for messages.
const STAT: &str = "stat";

/// Maximum number of concurrent requests.
const AT_ONCE: usize = 32;

/// Converts a host's description of a file. Without an entity tag, the modification time identifies
/// the version.
pub(super) fn state(meta: &ObjectMeta) -> FileStat {
    let tag = meta.e_tag.clone().unwrap_or_else(|| format!("{} ms", meta.last_modified.timestamp_millis()));
    FileStat { length: meta.size, version: FileVersion::Tag(tag) }
}

/// Queries the status of files, in their order; `None` for files that do not exist.
///
/// # Errors
/// On cancellation. Per file, if its host returns an error.
pub(super) fn stat(urls: &[&str], connections: &Connections) -> Result<Vec<Result<Option<FileStat>>>> {
    let one = |url: &str| {
        let location = ObjectLocation::of(url, &[], connections);
        let path = Path::new(url).to_path_buf();
        async move {
            let found = async {
                match head(&location?).await {
                    Ok(meta) => Ok(Some(state(&meta))),
                    Err(StoreError::NotFound { .. }) => Ok(None),
                    Err(cause) => Err(error::of_store(&path, STAT, cause)),
                }
            };
            connections.limited((&path, STAT), found).await
        }
    };
    let Some(first) = urls.first() else { return Ok(Vec::new()) };
    let all = stream::iter(urls.iter().map(|url| one(url))).buffered(AT_ONCE).collect::<Vec<_>>();
    connections.wait(Path::new(first), all)
}

/// Requests the description of a file.
async fn head(location: &ObjectLocation) -> object_store::Result<ObjectMeta> {
    match location.store.head(&location.name).await {
        // Signed URLs may be valid for GET only, and some servers do not support HEAD. A root name
        // means a web server: the store's URL is that of the file.
        Err(cause) if location.name.is_root() && !matches!(cause, StoreError::NotFound { .. }) => {
            let options = GetOptions { range: Some(GetRange::Bounded(0..1)), ..GetOptions::default() };
            location.store.get_opts(&location.name, options).await.map(|found| found.meta)
        }
        found => found,
    }
}

/// Removes files; missing files are ignored.
///
/// # Errors
/// If a file cannot be removed, or on cancellation. Other files may have been removed then.
pub(super) fn remove(urls: &[&str], connections: &Connections) -> Result<()> {
    let one = |url: &str| {
        let location = ObjectLocation::of(url, &[], connections);
        let path = Path::new(url).to_path_buf();
        async move {
            let removed = async {
                let location = location?;
                match location.store.delete(&location.name).await {
                    Err(StoreError::NotFound { .. }) => Ok(()),
                    done => done.map_err(|cause| error::of_store(&path, "remove", cause)),
                }
            };
            connections.limited((&path, "remove"), removed).await
        }
    };
    let Some(first) = urls.first() else { return Ok(()) };
    let all = stream::iter(urls.iter().map(|url| one(url))).buffered(AT_ONCE).collect::<Vec<_>>();
    let done = connections.wait(Path::new(first), all)?;
    done.into_iter().collect()
}
