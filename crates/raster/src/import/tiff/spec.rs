//! Constants of the TIFF 6.0 specification, its technical notes and registered extensions, by their
//! names there.

/// Tags of an image file directory.
pub(super) mod tag {
    pub(in crate::import::tiff) const NEW_SUBFILE_TYPE: u16 = 254;
    pub(in crate::import::tiff) const SUBFILE_TYPE: u16 = 255;
    pub(in crate::import::tiff) const IMAGE_WIDTH: u16 = 256;
    pub(in crate::import::tiff) const IMAGE_LENGTH: u16 = 257;
    pub(in crate::import::tiff) const BITS_PER_SAMPLE: u16 = 258;
    pub(in crate::import::tiff) const COMPRESSION: u16 = 259;
    pub(in crate::import::tiff) const PHOTOMETRIC_INTERPRETATION: u16 = 262;
    pub(in crate::import::tiff) const FILL_ORDER: u16 = 266;
    pub(in crate::import::tiff) const DOCUMENT_NAME: u16 = 269;
    pub(in crate::import::tiff) const IMAGE_DESCRIPTION: u16 = 270;
    pub(in crate::import::tiff) const STRIP_OFFSETS: u16 = 273;
    pub(in crate::import::tiff) const SAMPLES_PER_PIXEL: u16 = 277;
    pub(in crate::import::tiff) const ROWS_PER_STRIP: u16 = 278;
    pub(in crate::import::tiff) const STRIP_BYTE_COUNTS: u16 = 279;
    pub(in crate::import::tiff) const PLANAR_CONFIGURATION: u16 = 284;
    pub(in crate::import::tiff) const SOFTWARE: u16 = 305;
    pub(in crate::import::tiff) const DATE_TIME: u16 = 306;
    pub(in crate::import::tiff) const ARTIST: u16 = 315;
    pub(in crate::import::tiff) const HOST_COMPUTER: u16 = 316;
    pub(in crate::import::tiff) const PREDICTOR: u16 = 317;
    pub(in crate::import::tiff) const COLOR_MAP: u16 = 320;
    pub(in crate::import::tiff) const TILE_WIDTH: u16 = 322;
    pub(in crate::import::tiff) const TILE_LENGTH: u16 = 323;
    pub(in crate::import::tiff) const TILE_OFFSETS: u16 = 324;
    pub(in crate::import::tiff) const TILE_BYTE_COUNTS: u16 = 325;
    pub(in crate::import::tiff) const EXTRA_SAMPLES: u16 = 338;
    pub(in crate::import::tiff) const SAMPLE_FORMAT: u16 = 339;
    pub(in crate::import::tiff) const JPEG_TABLES: u16 = 347;
    pub(in crate::import::tiff) const YCBCR_COEFFICIENTS: u16 = 529;
    pub(in crate::import::tiff) const YCBCR_SUB_SAMPLING: u16 = 530;
    pub(in crate::import::tiff) const REFERENCE_BLACK_WHITE: u16 = 532;
    pub(in crate::import::tiff) const COPYRIGHT: u16 = 33432;
    pub(in crate::import::tiff) const MODEL_PIXEL_SCALE: u16 = 33550;
    pub(in crate::import::tiff) const MODEL_TIEPOINT: u16 = 33922;
    pub(in crate::import::tiff) const MODEL_TRANSFORMATION: u16 = 34264;
    pub(in crate::import::tiff) const GEO_KEY_DIRECTORY: u16 = 34735;
    pub(in crate::import::tiff) const GEO_DOUBLE_PARAMS: u16 = 34736;
    pub(in crate::import::tiff) const GEO_ASCII_PARAMS: u16 = 34737;
    pub(in crate::import::tiff) const GDAL_METADATA: u16 = 42112;
    pub(in crate::import::tiff) const GDAL_NODATA: u16 = 42113;
}

/// Types of a directory entry's values.
pub(super) mod field_type {
    pub(in crate::import::tiff) const BYTE: u16 = 1;
    pub(in crate::import::tiff) const ASCII: u16 = 2;
    pub(in crate::import::tiff) const SHORT: u16 = 3;
    pub(in crate::import::tiff) const LONG: u16 = 4;
    pub(in crate::import::tiff) const RATIONAL: u16 = 5;
    pub(in crate::import::tiff) const SBYTE: u16 = 6;
    pub(in crate::import::tiff) const UNDEFINED: u16 = 7;
    pub(in crate::import::tiff) const SSHORT: u16 = 8;
    pub(in crate::import::tiff) const SLONG: u16 = 9;
    pub(in crate::import::tiff) const SRATIONAL: u16 = 10;
    pub(in crate::import::tiff) const FLOAT: u16 = 11;
    pub(in crate::import::tiff) const DOUBLE: u16 = 12;
    pub(in crate::import::tiff) const IFD: u16 = 13;
    pub(in crate::import::tiff) const LONG8: u16 = 16;
    pub(in crate::import::tiff) const SLONG8: u16 = 17;
    pub(in crate::import::tiff) const IFD8: u16 = 18;
}

/// Values of the tag PhotometricInterpretation.
pub(super) mod photometric {
    pub(in crate::import::tiff) const WHITE_IS_ZERO: u64 = 0;
    pub(in crate::import::tiff) const BLACK_IS_ZERO: u64 = 1;
    pub(in crate::import::tiff) const RGB: u64 = 2;
    pub(in crate::import::tiff) const RGB_PALETTE: u64 = 3;
    pub(in crate::import::tiff) const TRANSPARENCY_MASK: u64 = 4;
    pub(in crate::import::tiff) const SEPARATED: u64 = 5;
    pub(in crate::import::tiff) const YCBCR: u64 = 6;
    pub(in crate::import::tiff) const CIELAB: u64 = 8;
    pub(in crate::import::tiff) const ITULAB: u64 = 10;
}
