//! Constants of the TIFF 6.0 specification, its technical notes and registered extensions, by their
//! names there.

/// Values of the tag Compression.
pub(crate) mod compression {
    pub(crate) const NONE: u64 = 1;
    pub(crate) const CCITT_GROUP_4: u64 = 4;
    pub(crate) const LZW: u64 = 5;
    pub(crate) const JPEG: u64 = 7;
    pub(crate) const ADOBE_DEFLATE: u64 = 8;
    pub(crate) const PACK_BITS: u64 = 32773;
    pub(crate) const DEFLATE: u64 = 32946;
    pub(crate) const ZSTD: u64 = 50000;
    pub(crate) const WEBP: u64 = 50001;
}

/// Tags of an image file directory.
#[cfg(feature = "native")]
pub(crate) mod tag {
    pub(crate) const IMAGE_WIDTH: u16 = 256;
    pub(crate) const IMAGE_LENGTH: u16 = 257;
    pub(crate) const BITS_PER_SAMPLE: u16 = 258;
    pub(crate) const COMPRESSION: u16 = 259;
    pub(crate) const PHOTOMETRIC_INTERPRETATION: u16 = 262;
    pub(crate) const STRIP_OFFSETS: u16 = 273;
    pub(crate) const SAMPLES_PER_PIXEL: u16 = 277;
    pub(crate) const ROWS_PER_STRIP: u16 = 278;
    pub(crate) const STRIP_BYTE_COUNTS: u16 = 279;
    pub(crate) const SOFTWARE: u16 = 305;
    pub(crate) const JPEG_TABLES: u16 = 347;
}

/// Types of a directory entry's values.
#[cfg(feature = "native")]
pub(crate) mod field_type {
    pub(crate) const ASCII: u16 = 2;
    pub(crate) const SHORT: u16 = 3;
    pub(crate) const LONG: u16 = 4;
    pub(crate) const UNDEFINED: u16 = 7;
}

/// Values of the tag PhotometricInterpretation.
#[cfg(feature = "native")]
pub(crate) mod photometric {
    pub(crate) const BLACK_IS_ZERO: u64 = 1;
}
