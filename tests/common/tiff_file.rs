//! Small TIFF files with arbitrary tags.

use std::io::Write;

/// The values of a tag.
#[derive(Clone)]
pub(crate) enum Values {
    Short(Vec<u16>),
    Long(Vec<u32>),
    Double(Vec<f64>),
    Text(&'static str),
}

/// One image of a file.
#[derive(Clone, Default)]
pub(crate) struct Ifd {
    tags: Vec<(u16, Values)>,
    chunks: Vec<Vec<u8>>,
}

impl Ifd {
    /// Returns a grey image of bytes in one strip, to be changed by other tags.
    pub(crate) fn grey(width: u16, height: u16, strip: Vec<u8>) -> Ifd {
        Ifd { tags: Vec::new(), chunks: vec![strip] }
            .short(256, &[width])
            .short(257, &[height])
            .short(258, &[8])
            .short(262, &[1])
    }

    pub(crate) fn short(self, tag: u16, values: &[u16]) -> Ifd {
        self.tag(tag, Values::Short(values.to_vec()))
    }

    /// Sets a tag, replacing its previous values.
    pub(crate) fn tag(mut self, tag: u16, values: Values) -> Ifd {
        self.tags.retain(|(other, _)| *other != tag);
        self.tags.push((tag, values));
        self
    }

    /// Sets the strips, or the tiles if the tags have a tile width. An empty chunk is omitted from
    /// the file.
    pub(crate) fn chunks(mut self, chunks: &[Vec<u8>]) -> Ifd {
        self.chunks = chunks.to_vec();
        self
    }
}

/// Returns the bytes of a little-endian file of these images.
pub(crate) fn file(ifds: &[Ifd]) -> Vec<u8> {
    let mut bytes = b"II*\0\0\0\0\0".to_vec();
    let mut link = 4;
    for ifd in ifds {
        let mut tags = ifd.tags.clone();
        let offsets = ifd.chunks.iter().map(|chunk| {
            bytes.extend(chunk);
            if chunk.is_empty() { 0 } else { (bytes.len() - chunk.len()) as u32 }
        });
        let offsets = offsets.collect();
        let counts = ifd.chunks.iter().map(|chunk| chunk.len() as u32).collect();
        let tiled = tags.iter().any(|(tag, _)| *tag == 322);
        tags.push((if tiled { 324 } else { 273 }, Values::Long(offsets)));
        tags.push((if tiled { 325 } else { 279 }, Values::Long(counts)));
        tags.sort_by_key(|(tag, _)| *tag);
        let mut entries = Vec::new();
        for (tag, values) in tags {
            let (kind, size, data): (u16, usize, Vec<u8>) = match values {
                Values::Short(v) => (3, 2, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
                Values::Long(v) => (4, 4, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
                Values::Double(v) => (12, 8, v.iter().flat_map(|n| n.to_le_bytes()).collect()),
                Values::Text(text) => (2, 1, [text.as_bytes(), b"\0"].concat()),
            };
            entries.extend(tag.to_le_bytes());
            entries.extend(kind.to_le_bytes());
            entries.extend(((data.len() / size) as u32).to_le_bytes());
            if data.len() <= 4 {
                entries.extend(&data);
                entries.extend(vec![0; 4 - data.len()]);
            } else {
                entries.extend((bytes.len() as u32).to_le_bytes());
                bytes.extend(&data);
            }
        }
        let here = bytes.len() as u32;
        bytes[link..link + 4].copy_from_slice(&here.to_le_bytes());
        bytes.extend(((entries.len() / 12) as u16).to_le_bytes());
        bytes.extend(entries);
        link = bytes.len();
        bytes.extend([0; 4]);
    }
    bytes
}

/// A file on disk, removed when dropped.
pub(crate) fn on_disk(bytes: &[u8]) -> tempfile::NamedTempFile {
    let mut file = tempfile::Builder::new().suffix(".tif").tempfile().unwrap();
    file.write_all(bytes).unwrap();
    file
}
