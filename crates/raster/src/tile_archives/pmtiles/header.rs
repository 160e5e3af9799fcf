//! The first 127 bytes of a `PMTiles` archive, version 3.

use crate::tile_archives::TileFormat;

/// Size of the header in bytes.
pub(super) const HEADER: usize = 127;
/// Bytes at the start of an archive that are reserved for the header and the root directory.
pub(super) const START: usize = 16_384;

/// A byte range of an archive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ByteRange {
    pub(super) offset: u64,
    pub(super) length: u64,
}

/// The header's fields.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Header {
    pub(super) root: ByteRange,
    pub(super) metadata: ByteRange,
    pub(super) leaves: ByteRange,
    pub(super) tiles: ByteRange,
    /// Numbers of tiles, directory entries and distinct contents; 0 is unknown.
    pub(super) counts: [u64; 3],
    pub(super) is_clustered: bool,
    /// Compression of directories and metadata: 1 none, 2 gzip.
    pub(super) compression: u8,
    /// Compression of tiles.
    pub(super) tile_compression: u8,
    pub(super) tile_type: u8,
    pub(super) zooms: [u8; 2],
    /// West, south, east, north in degrees.
    pub(super) degrees: [f64; 4],
    pub(super) centre_zoom: u8,
    pub(super) centre: [f64; 2],
}

/// Code of a tile format.
pub(super) fn tile_type(format: TileFormat) -> u8 {
    match format {
        TileFormat::Png => 2,
        TileFormat::Jpeg => 3,
        TileFormat::Webp => 4,
        // There are no codes for arrays.
        TileFormat::Npy | TileFormat::Tiff => 0,
    }
}

impl Header {
    pub(super) fn to_bytes(self) -> Vec<u8> {
        let mut bytes = b"PMTiles\x03".to_vec();
        for part in [self.root, self.metadata, self.leaves, self.tiles] {
            bytes.extend(part.offset.to_le_bytes());
            bytes.extend(part.length.to_le_bytes());
        }
        bytes.extend(self.counts.iter().flat_map(|count| count.to_le_bytes()));
        bytes.extend([u8::from(self.is_clustered), self.compression, self.tile_compression, self.tile_type]);
        bytes.extend(self.zooms);
        let degree = |degrees: f64| ((degrees * 1e7).round() as i32).to_le_bytes();
        bytes.extend(self.degrees.into_iter().flat_map(degree));
        bytes.push(self.centre_zoom);
        bytes.extend(self.centre.into_iter().flat_map(degree));
        bytes
    }

    /// Parses the fields, if the bytes are a header of version 3.
    pub(super) fn from_bytes(bytes: &[u8; HEADER]) -> Option<Header> {
        if !bytes.starts_with(b"PMTiles\x03") {
            return None;
        }
        let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte]));
        let part = |at: usize| ByteRange { offset: number(at), length: number(at + 8) };
        let degree =
            |at: usize| f64::from(i32::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte]))) / 1e7;
        Some(Header {
            root: part(8),
            metadata: part(24),
            leaves: part(40),
            tiles: part(56),
            counts: [number(72), number(80), number(88)],
            is_clustered: bytes[96] == 1,
            compression: bytes[97],
            tile_compression: bytes[98],
            tile_type: bytes[99],
            zooms: [bytes[100], bytes[101]],
            degrees: [degree(102), degree(106), degree(110), degree(114)],
            centre_zoom: bytes[118],
            centre: [degree(119), degree(123)],
        })
    }
}
