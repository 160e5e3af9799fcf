//! Outputs elsewhere: files of this machine, put there in parts, whole or not at all.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use futures_util::stream::{FuturesUnordered, StreamExt};
use object_store::{ObjectStore, ObjectStoreExt, PutMode, PutPayload};
use spinney_base::io::must_be_new_error;
use spinney_base::{Error, Result};

use super::look::look;
use super::store::Place;
use super::{RemoteOptions, error, runtime};

/// Bytes of a part; those of large files have more, since there may be 10,000.
const PART: u64 = 8 << 20;
const MOST_PARTS: u64 = 9_000;

/// Parts that are on their way at the same time.
const AT_ONCE: usize = 4;

/// Puts a file in a place elsewhere, also in place of another one, unless it must be new.
///
/// # Errors
/// If that fails, or on interruption: nothing is there then that was not before.
pub(super) fn upload(file: &Path, url: &str, must_be_new: bool, options: &RemoteOptions) -> Result<()> {
    let path = Path::new(url);
    let place = Place::of(url, &[], options)?;
    let source = File::open(file).map_err(Error::io(file, "open"))?;
    let length = source.metadata().map_err(Error::io(file, "look at"))?.len();
    let failed = |cause| error::of_store(path, "upload", cause);
    if length <= PART {
        let bytes = read(source, length, file)?;
        let mode = if must_be_new { PutMode::Create } else { PutMode::Overwrite };
        let put = place.store.put_opts(&place.name, PutPayload::from(bytes), mode.into());
        return match runtime::wait(path, options.is_stopped, put)? {
            Err(object_store::Error::AlreadyExists { .. }) if must_be_new => Err(must_be_new_error(path)),
            done => done.map(drop).map_err(failed),
        };
    }
    // (Between this look and the end of the upload another one may appear.)
    if must_be_new && look(&[url], options)?.iter().any(|found| matches!(found, Ok(Some(_)))) {
        return Err(must_be_new_error(path));
    }
    let begin = place.store.put_multipart(&place.name);
    let mut parts = runtime::wait(path, options.is_stopped, begin)?.map_err(failed)?;
    let size = PART.max(length.div_ceil(MOST_PARTS));
    let mut source = source;
    let all = async {
        let mut under_way = FuturesUnordered::new();
        let mut left = length;
        while left > 0 {
            let next = left.min(size);
            under_way.push(parts.put_part(PutPayload::from(read(&mut source, next, file)?)));
            left -= next;
            while under_way.len() >= AT_ONCE
                && let Some(done) = under_way.next().await
            {
                done.map_err(failed)?;
            }
        }
        while let Some(done) = under_way.next().await {
            done.map_err(failed)?;
        }
        Ok(())
    };
    let done = runtime::wait(path, options.is_stopped, all).and_then(|done| done);
    let done = done.and_then(|()| {
        // (Once the store was told that it has everything, it is asked no more to forget it.)
        runtime::wait(path, || false, parts.complete())?.map(drop).map_err(failed)
    });
    if done.is_err() {
        // What has arrived would cost its room for good. (If the host cannot be told, there is nobody else to tell.)
        let _ = runtime::wait(path, || false, parts.abort());
    }
    done
}

/// The next bytes of a file.
fn read(mut source: impl Read, length: u64, file: &Path) -> Result<Vec<u8>> {
    let mut bytes = vec![0; length as usize];
    source.read_exact(&mut bytes).map_err(Error::io(file, "read"))?;
    Ok(bytes)
}
