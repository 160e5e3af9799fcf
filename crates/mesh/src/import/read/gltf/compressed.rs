//! Decompression of buffer views (EXT_meshopt_compression, KHR_meshopt_compression).

use super::super::model_file::ModelFile;
use super::document::{BufferView, Compression};
use spinney_base::{Error, Result};

/// Returns the bytes of a view. `bytes` are its compressed ones.
#[cfg(feature = "meshopt")]
pub(super) fn decompress(
    source: &ModelFile,
    place: &str,
    view: &BufferView,
    packed: &Compression,
    bytes: &[u8],
    memory: u64,
) -> Result<Vec<u8>> {
    use meshoptimizer_rs::codec::{BufferView as Layout, Filter, Mode};
    use meshoptimizer_rs::{Limits, Workspace};

    let wrong = |error: meshoptimizer_rs::Error| {
        source.corrupt(format!("{place}, meshopt compression"), error.to_string(), "compressed bytes")
    };
    let size = packed.count.saturating_mul(packed.byte_stride);
    let limit = memory.max(1 << 20);
    // The codecs decode a view as a whole.
    if size > limit {
        return Err(Error::TooLarge {
            path: source.path().to_path_buf(),
            what: format!("compressed {place}"),
            needed: size,
            limit,
            advice: "allow more memory, or write the model without compression".into(),
        });
    }
    let mode = Mode::parse(&packed.mode).map_err(wrong)?;
    let filter = packed.filter.as_deref().unwrap_or("NONE");
    if filter == "COLOR" {
        let found = "glTF with KHR_meshopt_compression and its filter COLOR";
        let advice = "write the model with EXT_meshopt_compression, or without compression";
        return Err(Error::unsupported(source.path(), found, advice));
    }
    let filter = Filter::parse(filter).map_err(wrong)?;
    let [count, stride] = [packed.count, packed.byte_stride].map(|number| number as usize);
    let layout = Layout::new(mode, filter, count, stride).map_err(wrong)?;
    if view.byte_length > size || view.byte_stride.is_some_and(|stride| stride != packed.byte_stride) {
        let found = format!("{size} bytes, {} each", packed.byte_stride);
        return Err(source.corrupt(place, found, format!("the view's {} bytes", view.byte_length)));
    }
    let limits = Limits { max_bytes: limit as usize, ..Limits::default() };
    let mut plain = spinney_base::guard::guard(source.path(), "compressed vertices", || {
        layout.decode(bytes, &mut Workspace::new(limits)).map_err(wrong)
    })?;
    plain.truncate(view.byte_length as usize);
    Ok(plain)
}

#[cfg(not(feature = "meshopt"))]
pub(super) fn decompress(
    source: &ModelFile,
    _: &str,
    _: &BufferView,
    _: &Compression,
    _: &[u8],
    _: u64,
) -> Result<Vec<u8>> {
    let found = "glTF with meshopt compression, in a build without the feature `meshopt`,";
    Err(Error::unsupported(
        source.path(),
        found,
        "enable the feature, or write the model without compression",
    ))
}
