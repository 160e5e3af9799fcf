//! Constants of the TIFF 6.0 specification, its technical notes and registered extensions, by their
//! names there.

/// Values of the tag Compression.
pub mod compression {
    pub const NONE: u64 = 1;
    pub(crate) const CCITT_RLE: u64 = 2;
    pub(crate) const CCITT_GROUP_3: u64 = 3;
    pub(crate) const CCITT_GROUP_4: u64 = 4;
    pub const LZW: u64 = 5;
    pub(crate) const OLD_JPEG: u64 = 6;
    pub const JPEG: u64 = 7;
    pub const ADOBE_DEFLATE: u64 = 8;
    pub const NEXT: u64 = 32766;
    pub(crate) const PACK_BITS: u64 = 32773;
    pub(crate) const THUNDERSCAN: u64 = 32809;
    pub const DEFLATE: u64 = 32946;
    pub(crate) const SGI_LOG: u64 = 34676;
    pub(crate) const SGI_LOG_24: u64 = 34677;
    pub(crate) const JPEG_2000: u64 = 34712;
    pub const LERC: u64 = 34887;
    pub(crate) const LZMA: u64 = 34925;
    pub const ZSTD: u64 = 50000;
    pub const WEBP: u64 = 50001;
    pub(crate) const JPEG_XL: u64 = 50002;
}

/// Tags of an image file directory.
pub mod tag {
    pub const NEW_SUBFILE_TYPE: u16 = 254;
    pub const SUBFILE_TYPE: u16 = 255;
    pub const IMAGE_WIDTH: u16 = 256;
    pub const IMAGE_LENGTH: u16 = 257;
    pub const BITS_PER_SAMPLE: u16 = 258;
    pub const COMPRESSION: u16 = 259;
    pub const PHOTOMETRIC_INTERPRETATION: u16 = 262;
    pub const FILL_ORDER: u16 = 266;
    pub const DOCUMENT_NAME: u16 = 269;
    pub const IMAGE_DESCRIPTION: u16 = 270;
    pub const STRIP_OFFSETS: u16 = 273;
    pub const SAMPLES_PER_PIXEL: u16 = 277;
    pub const ROWS_PER_STRIP: u16 = 278;
    pub const STRIP_BYTE_COUNTS: u16 = 279;
    pub const PLANAR_CONFIGURATION: u16 = 284;
    pub const SOFTWARE: u16 = 305;
    pub const DATE_TIME: u16 = 306;
    pub const ARTIST: u16 = 315;
    pub const HOST_COMPUTER: u16 = 316;
    pub const PREDICTOR: u16 = 317;
    pub const COLOR_MAP: u16 = 320;
    pub const TILE_WIDTH: u16 = 322;
    pub const TILE_LENGTH: u16 = 323;
    pub const TILE_OFFSETS: u16 = 324;
    pub const TILE_BYTE_COUNTS: u16 = 325;
    pub const EXTRA_SAMPLES: u16 = 338;
    pub const SAMPLE_FORMAT: u16 = 339;
    pub const JPEG_TABLES: u16 = 347;
    pub const YCBCR_COEFFICIENTS: u16 = 529;
    pub const YCBCR_SUB_SAMPLING: u16 = 530;
    pub const REFERENCE_BLACK_WHITE: u16 = 532;
    pub const COPYRIGHT: u16 = 33432;
    pub const MODEL_PIXEL_SCALE: u16 = 33550;
    pub const MODEL_TIEPOINT: u16 = 33922;
    pub const MODEL_TRANSFORMATION: u16 = 34264;
    pub const GEO_KEY_DIRECTORY: u16 = 34735;
    pub const GEO_DOUBLE_PARAMS: u16 = 34736;
    pub const GEO_ASCII_PARAMS: u16 = 34737;
    pub const GDAL_METADATA: u16 = 42112;
    pub const GDAL_NODATA: u16 = 42113;
    pub const RPC_COEFFICIENTS: u16 = 50844;
}

/// Types of a directory entry's values.
pub mod field_type {
    pub const BYTE: u16 = 1;
    pub const ASCII: u16 = 2;
    pub const SHORT: u16 = 3;
    pub const LONG: u16 = 4;
    pub const RATIONAL: u16 = 5;
    pub const SBYTE: u16 = 6;
    pub const UNDEFINED: u16 = 7;
    pub const SSHORT: u16 = 8;
    pub const SLONG: u16 = 9;
    pub const SRATIONAL: u16 = 10;
    pub const FLOAT: u16 = 11;
    pub const DOUBLE: u16 = 12;
    pub const IFD: u16 = 13;
    pub const LONG8: u16 = 16;
    pub const SLONG8: u16 = 17;
    pub const IFD8: u16 = 18;
}

/// Values of the tag PhotometricInterpretation.
pub mod photometric {
    pub const WHITE_IS_ZERO: u64 = 0;
    pub const BLACK_IS_ZERO: u64 = 1;
    pub const RGB: u64 = 2;
    pub const RGB_PALETTE: u64 = 3;
    pub const TRANSPARENCY_MASK: u64 = 4;
    pub const SEPARATED: u64 = 5;
    pub const YCBCR: u64 = 6;
    pub const CIELAB: u64 = 8;
    pub const ITULAB: u64 = 10;
}

/// Bits of the tag NewSubfileType.
pub mod new_subfile_type {
    pub const REDUCED_RESOLUTION: u64 = 1;
    pub const TRANSPARENCY_MASK: u64 = 4;
}

/// Values of the tag PlanarConfiguration.
pub mod planar_configuration {
    pub const CHUNKY: u64 = 1;
    pub const PLANAR: u64 = 2;
}

/// Values of the tag Predictor.
pub mod predictor {
    pub const NONE: u64 = 1;
    pub(crate) const HORIZONTAL: u64 = 2;
    pub(crate) const FLOATING_POINT: u64 = 3;
}

/// Values of the tag ExtraSamples.
pub mod extra_samples {
    pub const UNSPECIFIED: u64 = 0;
    pub const ASSOCIATED_ALPHA: u64 = 1;
    pub const UNASSOCIATED_ALPHA: u64 = 2;
}

/// Values of the tag SampleFormat.
pub mod sample_format {
    pub const UNSIGNED: u64 = 1;
    pub const SIGNED: u64 = 2;
    pub const FLOAT: u64 = 3;
    pub const UNDEFINED: u64 = 4;
    pub const COMPLEX_SIGNED: u64 = 5;
    pub const COMPLEX_FLOAT: u64 = 6;
}
