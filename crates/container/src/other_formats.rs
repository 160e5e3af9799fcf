//! Detection of other file formats, with advice for each.

use std::path::Path;

use spinney_base::io::{FileAccess, Output};
use spinney_base::{Error, Result};

use crate::format::TreeFormat;

/// A file format other than Spinney's own.
#[derive(Debug)]
pub struct OtherFormat {
    /// Noun for one such file, with its article.
    name: &'static str,
    /// File name extensions, in lower case.
    endings: &'static [&'static str],
    /// Marks in the first bytes, one of which a file must have. Empty if the format is known by
    /// name only.
    marks: &'static [Mark],
    role: Role,
}

/// Bytes that identify a format.
#[derive(Debug)]
enum Mark {
    /// At an offset.
    At(usize, &'static [u8]),
    /// Anywhere in the first bytes.
    Within(&'static str),
}

/// Use of files of a format in Spinney.
#[derive(Debug)]
enum Role {
    /// Input of `spinney build`.
    Source,
    /// Read, but not a plain source of cells: advice on what the files are for.
    Read(&'static str),
    /// Not read: what to do instead.
    Refused(&'static str),
}

use Mark::{At, Within};
use Role::{Read, Refused, Source};

/// Number of bytes at a file's start that format detection inspects.
pub const FIRST_BYTES: usize = 512;

const DRAW: &str = "convert it to GeoJSON first (`ogr2ogr zones.geojson IN`): `spinney build zones.geojson --cell 10 --value FIELD -o OUT.goblin` makes cells of features, \
    and polygons are zones for `spinney stats TREE --zones zones.geojson`";
const FEATURES: &str = "it has no cells: `spinney build FILE --cell 10 --value FIELD -o OUT.goblin` makes cells of its features; its polygons are zones for \
    `spinney stats TREE --zones FILE`, and `spinney transform FILE warp=EPSG:NUMBER -o OUT.gpkg` brings it to another coordinate system";
const TRANSLATE: &str = "convert it to GeoTIFF first (`gdal_translate IN OUT.tif`)";
const VARIABLES: &str = "convert the variable that is meant to GeoTIFF first (`gdalinfo IN` lists them; `gdal_translate 'NETCDF:\"IN\":NAME' OUT.tif`, or HDF5: for NETCDF:); \
    in Python, open it with xarray, and give the DataArray to spinney.build";
const PICTURE: &str = "convert it to PNG or TIFF first (`magick IN OUT.png`)";
const POINTS: &str = "convert it to LAS or LAZ first (`pdal translate IN OUT.laz`)";
const CLOUD: &str = "it has no cells: `spinney build FILE -o OUT.goblin` makes a tree of points of it (in Python `spinney.build_points`)";
const SURFACES: &str = "export it as OBJ, PLY or STL from the program that made it, or from Blender, with the measures that it has";
const SOLIDS: &str = "its surfaces are curved: export it as STL or OBJ from the program that made it, or from FreeCAD, as fine as needed";
const DRAWING: &str = "export its solids as STL or OBJ from the CAD program; what is drawn flat can become GeoJSON (`ogr2ogr out.geojson IN`, for DXF)";
const SCAN: &str =
    "convert it to an NPY array of shape (z, y, x) first, in Python with pydicom, nibabel or SimpleITK";
const PACKED: &str = "unpack it first";
const TILES: &str = "it has finished tiles for viewers: open the tree that they were made of";

const fn format(
    name: &'static str,
    endings: &'static [&'static str],
    marks: &'static [Mark],
    role: Role,
) -> OtherFormat {
    OtherFormat { name, endings, marks, role }
}

/// All known formats. If several formats have the mark of a file, the one with the file's extension
/// wins, else the first.
static FORMATS: &[OtherFormat] = &[
    format(
        "a TIFF picture",
        &["tif", "tiff", "gtiff"],
        &[At(0, b"II*\0"), At(0, b"II+\0"), At(0, b"MM\0*"), At(0, b"MM\0+")],
        Source,
    ),
    format("a PNG picture", &["png"], &[At(0, b"\x89PNG")], Source),
    format("a JPEG picture", &["jpg", "jpeg", "jpe"], &[At(0, b"\xff\xd8\xff")], Source),
    format("a WebP picture", &["webp"], &[At(8, b"WEBP")], Source),
    format("a BMP image", &["bmp", "dib"], &[], Source),
    format("a GIF image", &["gif"], &[At(0, b"GIF8")], Source),
    // The extension .hdr belongs to ENVI headers.
    format("a Radiance HDR image", &["rgbe"], &[At(0, b"#?RADIANCE"), At(0, b"#?RGBE")], Source),
    format("a PNM image", &["pbm", "pgm", "ppm", "pnm", "pam"], &[], Source),
    format("a QOI image", &["qoi"], &[At(0, b"qoif")], Source),
    format("a TGA image", &["tga"], &[], Source),
    format("an OpenEXR picture", &["exr"], &[At(0, b"\x76\x2f\x31\x01")], Source),
    format("an SRTM elevation model", &["hgt"], &[], Source),
    format("a GDAL virtual raster (VRT)", &["vrt"], &[Within("<VRTDataset")], Source),
    format("a chain code", &["chain"], &[At(0, b"freeman-chain-code")], Source),
    format("an NPY array", &["npy"], &[At(0, b"\x93NUMPY")], Source),
    format("a PLY model", &["ply"], &[At(0, b"ply\n"), At(0, b"ply\r"), At(0, b"ply ")], Source),
    format("an OBJ model", &["obj"], &[], Source),
    format("an STL model", &["stl"], &[], Source),
    format("an OFF model", &["off"], &[], Source),
    format("a bintree", &["bintree"], &[], Source),
    format(
        "a GeoJSON document",
        &["geojson"],
        &[Within("\"FeatureCollection\""), Within("\"Feature\"")],
        Read("its polygons are zones for `spinney stats TREE --zones FILE`"),
    ),
    format(
        "a manifest of files",
        &[],
        &[Within("\"spinney_manifest\"")],
        Read("make one tree of its files first (`spinney transform FILE -o OUT.goblin`)"),
    ),
    format("a CityJSON model", &["json", "jsonl", "cityjson"], &[], Source),
    format("a point cloud (LAS or LAZ)", &["las", "laz"], &[At(0, b"LASF")], Read(CLOUD)),
    format("a point cloud (E57)", &["e57"], &[At(0, b"ASTM-E57")], Refused(POINTS)),
    format("a point cloud (PCD)", &["pcd"], &[At(0, b"# .PCD")], Refused(POINTS)),
    format("a GeoPackage", &["gpkg"], &[At(0, b"SQLite format 3\0")], Read(FEATURES)),
    format("an MBTiles archive", &["mbtiles"], &[At(0, b"SQLite format 3\0")], Refused(TILES)),
    format("a PMTiles archive", &["pmtiles"], &[At(0, b"PMTiles")], Refused(TILES)),
    format("a shapefile", &["shp", "shx", "dbf"], &[At(0, b"\0\0\x27\x0a\0\0\0\0")], Read(FEATURES)),
    format("a FlatGeobuf file", &["fgb"], &[At(0, b"fgb\x03")], Read(FEATURES)),
    format("a KML document", &["kml", "kmz"], &[Within("<kml")], Refused(DRAW)),
    format("a GML document", &["gml"], &[Within("<gml:")], Refused(DRAW)),
    format("a GPX document", &["gpx"], &[Within("<gpx")], Refused(DRAW)),
    format("a file geodatabase", &["gdb"], &[], Refused(DRAW)),
    format("a Parquet file", &["parquet", "geoparquet"], &[At(0, b"PAR1")], Refused(DRAW)),
    format(
        "a NetCDF file",
        &["nc", "nc4", "cdf"],
        &[At(0, b"CDF\x01"), At(0, b"CDF\x02"), At(0, b"CDF\x05"), At(0, b"\x89HDF\r\n\x1a\n")],
        Refused(VARIABLES),
    ),
    format(
        "an HDF5 file",
        &["h5", "hdf", "hdf5", "he5"],
        &[At(0, b"\x89HDF\r\n\x1a\n"), At(0, b"\x0e\x03\x13\x01")],
        Refused(VARIABLES),
    ),
    format(
        "a Zarr store",
        &["zarr"],
        &[],
        Refused(
            "in Python, open it with zarr or xarray, and give the array to spinney.build; or convert it to GeoTIFF (`gdal_translate 'ZARR:\"IN\":/NAME' OUT.tif`)",
        ),
    ),
    format("a GRIB file", &["grib", "grib2", "grb", "grb2"], &[At(0, b"GRIB")], Refused(TRANSLATE)),
    format(
        "a JPEG 2000 picture",
        &["jp2", "j2k", "jpx", "jpf"],
        &[At(4, b"jP  \r\n\x87\n"), At(0, b"\xff\x4f\xff\x51")],
        Refused(TRANSLATE),
    ),
    format("a JPEG XL picture", &["jxl"], &[At(4, b"JXL \r\n\x87\n")], Refused(PICTURE)),
    format(
        "a HEIC picture",
        &["heic", "heif"],
        &[At(4, b"ftyphei"), At(4, b"ftyphev"), At(4, b"ftypmif1")],
        Refused(PICTURE),
    ),
    format("an AVIF picture", &["avif"], &[At(4, b"ftypavi")], Refused(PICTURE)),
    format("a Photoshop picture", &["psd"], &[At(0, b"8BPS")], Refused(PICTURE)),
    format(
        "an SVG drawing",
        &["svg"],
        &[Within("<svg")],
        Refused(
            "it has shapes, not pixels: draw it as PNG first, as large as needed (`rsvg-convert -w 4096 IN -o OUT.png`)",
        ),
    ),
    format(
        "a PDF document",
        &["pdf"],
        &[At(0, b"%PDF")],
        Refused("draw it as PNG first (`pdftoppm -png -r 300 IN OUT`)"),
    ),
    format(
        "an ERDAS IMAGINE or ENVI raster",
        &["img", "hdr", "ige"],
        &[At(0, b"EHFA_HEADER_TAG"), At(0, b"ENVI")],
        Refused(TRANSLATE),
    ),
    format("an ASCII grid", &["asc", "grd"], &[At(0, b"ncols"), At(0, b"NCOLS")], Refused(TRANSLATE)),
    format("a USGS elevation model", &["dem", "dt0", "dt1", "dt2"], &[], Refused(TRANSLATE)),
    format("a MrSID or ECW picture", &["sid", "ecw"], &[At(0, b"msid")], Refused(TRANSLATE)),
    format(
        "an IFC model",
        &["ifc", "ifczip"],
        &[At(0, b"ISO-10303-21")],
        Refused("export it as OBJ or STL first (`IfcConvert IN OUT.obj`), or as CityJSON"),
    ),
    format("a STEP model", &["step", "stp"], &[At(0, b"ISO-10303-21")], Refused(SOLIDS)),
    format("an IGES model", &["iges", "igs"], &[], Refused(SOLIDS)),
    format("a BREP model", &["brep", "x_t", "x_b"], &[At(0, b"DBRep_DrawableShape")], Refused(SOLIDS)),
    format("an FBX model", &["fbx"], &[At(0, b"Kaydara FBX")], Refused(SURFACES)),
    format("a glTF model", &["gltf", "glb"], &[At(0, b"glTF")], Refused(SURFACES)),
    format("a COLLADA model", &["dae"], &[Within("<COLLADA")], Refused(SURFACES)),
    format("a 3MF model", &["3mf"], &[At(0, b"PK\x03\x04")], Refused(SURFACES)),
    format("a 3DS model", &["3ds"], &[], Refused(SURFACES)),
    format(
        "a USD scene",
        &["usd", "usda", "usdc", "usdz"],
        &[At(0, b"PXR-USDC"), At(0, b"#usda")],
        Refused(SURFACES),
    ),
    format("a Blender file", &["blend"], &[At(0, b"BLENDER")], Refused(SURFACES)),
    format("a DWG or DXF drawing", &["dwg", "dxf"], &[At(0, b"AC10")], Refused(DRAWING)),
    format("a DICOM image", &["dcm", "dicom"], &[At(128, b"DICM")], Refused(SCAN)),
    format("a NIfTI volume", &["nii"], &[At(344, b"n+1\0"), At(344, b"ni1\0")], Refused(SCAN)),
    format("an NRRD volume", &["nrrd", "nhdr"], &[At(0, b"NRRD000")], Source),
    format(
        "an NPZ archive",
        &["npz"],
        &[At(0, b"PK\x03\x04")],
        Refused("it has several arrays: write the one that is meant as NPY (numpy.save)"),
    ),
    format("a ZIP archive", &["zip"], &[At(0, b"PK\x03\x04")], Refused(PACKED)),
    format(
        "a compressed file",
        &["gz", "tgz", "xz", "bz2", "zst", "7z"],
        &[
            At(0, b"\x1f\x8b\x08"),
            At(0, b"\xfd7zXZ\0"),
            At(0, b"BZh"),
            At(0, b"\x28\xb5\x2f\xfd"),
            At(0, b"7z\xbc\xaf"),
        ],
        Refused(PACKED),
    ),
    format(
        "a table (CSV)",
        &["csv", "tsv"],
        &[],
        Refused(
            "cells and their values can be put into a tree that is there (`spinney edit TREE.autumn set IN`)",
        ),
    ),
];

/// List of readable formats, for files of other formats.
const WHAT_IS_READ: &str = "TIFF, PNG, JPEG, WebP, OpenEXR, BMP, GIF, PNM, TGA, QOI, Radiance HDR, .hgt and NPY are read, and PLY, OBJ, STL, OFF, CityJSON and CityJSONSeq; \
    GDAL converts most other rasters (`gdal_translate IN OUT.tif`)";

impl OtherFormat {
    /// Detects the format of a file by its first bytes, up to [`FIRST_BYTES`] of them, and its
    /// name.
    pub fn of(path: &Path, first: &[u8]) -> Option<&'static OtherFormat> {
        let ending = ending(path);
        let has_name = |format: &&OtherFormat| format.endings.contains(&ending.as_str());
        let marked = || FORMATS.iter().filter(|format| format.marks.iter().any(|mark| mark.is_in(first)));
        // A file that has the name of a source format but not its mark is something else.
        let by_name = || FORMATS.iter().find(|format| has_name(format) && !format.needs_mark());
        marked().find(has_name).or_else(|| marked().next()).or_else(by_name)
    }

    fn needs_mark(&self) -> bool {
        !self.marks.is_empty() && matches!(self.role, Role::Source)
    }

    /// Returns the error for a file whose format is not read at all; `None` for other files.
    pub fn refuse_unread(path: &Path, first: &[u8]) -> Option<Error> {
        match OtherFormat::of(path, first) {
            Some(OtherFormat { name, role: Refused(advice), .. }) => {
                Some(Error::unsupported(path, *name, advice.replace("IN", &shown(path))))
            }
            _ => None,
        }
    }

    /// Returns the error for a file that is not a source of trees.
    pub fn refuse_source(path: &Path, first: &[u8]) -> Error {
        if let Some(error) = OtherFormat::refuse_unread(path, first) {
            return error;
        }
        match OtherFormat::of(path, first) {
            Some(OtherFormat { name, role: Read(purpose), .. }) => {
                Error::unsupported(path, format!("{name} as a source"), purpose.replace("FILE", &shown(path)))
            }
            _ => Error::unsupported(path, "a file of this format", WHAT_IS_READ.replace("IN", &shown(path))),
        }
    }

    /// Returns the error for a file that is not a tree but should be; `None` if its format is
    /// unknown.
    pub(crate) fn refuse_tree(path: &Path, first: &[u8]) -> Option<Error> {
        let OtherFormat { name, role, .. } = OtherFormat::of(path, first)?;
        let file = shown(path);
        let advice = match role {
            Source => {
                let tree = shown(&path.with_extension("goblin"));
                format!("build one: `spinney build {file} -o {tree}`")
            }
            Read(purpose) => purpose.replace("FILE", &file),
            Refused(advice) => advice.replace("IN", &file),
        };
        Some(Error::NotATree { path: path.into(), found: (*name).into(), advice })
    }
}

impl Mark {
    fn is_in(&self, bytes: &[u8]) -> bool {
        match self {
            At(place, mark) => bytes.get(*place..).is_some_and(|rest| rest.starts_with(mark)),
            Within(text) => bytes
                .get(..FIRST_BYTES)
                .unwrap_or(bytes)
                .windows(text.len())
                .any(|part| part == text.as_bytes()),
        }
    }
}

/// Checks that a tree's file name does not have the extension of another format.
///
/// # Errors
/// If it has.
pub fn check_tree_name(path: &Path) -> Result<()> {
    let ending = ending(path);
    let Some(format) = FORMATS.iter().find(|format| format.endings.contains(&ending.as_str())) else {
        return Ok(());
    };
    let (goblin, autumn) = (shown(&path.with_extension("goblin")), shown(&path.with_extension("autumn")));
    let advice = format!(
        "trees have names that end with .goblin (compact, read-only) or .autumn (to be edited), such as {goblin} or {autumn}"
    );
    Err(Error::unsupported(path, format!("a tree with the name of {}", format.name), advice))
}

/// Creates the file of a tree, as [`FileAccess::create`] does.
///
/// # Errors
/// If the name has the extension of another format; also those of [`FileAccess::create`].
pub fn create_tree_file(path: &Path, access: &FileAccess) -> Result<Output> {
    check_tree_name(path)?;
    match TreeFormat::of(path) {
        // Only Goblin files are written sequentially.
        TreeFormat::Goblin => access.append_only(path),
        TreeFormat::Autumnal => access.create(path),
    }
}

/// File name extension in lower case, without the dot.
fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// A path quoted as a shell word.
fn shown(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/\\._-+@:%,~".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        text
    } else {
        format!("'{}'", text.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(path: &str, bytes: &[u8]) -> Option<&'static str> {
        OtherFormat::of(Path::new(path), bytes).map(|format| format.name)
    }

    #[test]
    fn bytes_go_before_names() {
        assert_eq!(name("a.png", b"II*\0...."), Some("a TIFF picture"));
        assert_eq!(name("a.mbtiles", b"SQLite format 3\0"), Some("an MBTiles archive"));
        assert_eq!(name("a", b"SQLite format 3\0"), Some("a GeoPackage"));
        assert_eq!(name("a.h5", b"\x89HDF\r\n\x1a\n"), Some("an HDF5 file"));
        assert_eq!(name("a.IFC", b"ISO-10303-21;"), Some("an IFC model"));
        assert_eq!(name("a.stp", b"ISO-10303-21;"), Some("a STEP model"));
        assert_eq!(name("a.bin", b"<?xml version='1.0'?>\n<svg>"), Some("an SVG drawing"));
        assert_eq!(name("a.json", b"{\"type\": \"FeatureCollection\""), Some("a GeoJSON document"));
        assert_eq!(name("a.json", b"{\"type\": \"CityJSON\""), Some("a CityJSON model"));
        assert_eq!(name("a.LAZ", b""), Some("a point cloud (LAS or LAZ)"));
        for (path, bytes) in
            [("a.tif", &b"text"[..]), ("a.goblin", b"\x93Goblin\n"), ("a", b""), (".tif", b"")]
        {
            assert_eq!(name(path, bytes), None, "{path}");
        }
    }

    #[test]
    fn endings_and_marks_are_told_apart() {
        let endings: Vec<_> = FORMATS.iter().flat_map(|format| format.endings).collect();
        for (index, ending) in endings.iter().enumerate() {
            assert!(!endings[..index].contains(ending), "{ending} twice");
            assert_eq!(**ending, ending.to_ascii_lowercase());
            assert!(!["goblin", "autumn"].contains(ending));
            let path = format!("map.{ending}");
            assert!(check_tree_name(Path::new(&path)).is_err(), "{path}");
        }
        for format in FORMATS {
            assert!(!(format.endings.is_empty() && format.marks.is_empty()), "{}", format.name);
            let fits = |mark: &Mark| match mark {
                At(place, bytes) => place + bytes.len() <= FIRST_BYTES && bytes.len() >= 3,
                Within(text) => text.len() >= 4,
            };
            assert!(format.marks.iter().all(fits), "{}", format.name);
        }
    }

    #[test]
    fn names_of_trees() {
        for fine in ["a.goblin", "a.autumn", "a", "-", "a.b.Goblin", "tif", "a.tree", "/dev/stdout"] {
            assert!(check_tree_name(Path::new(fine)).is_ok(), "{fine}");
        }
        let message = check_tree_name(Path::new("a b.TIF")).unwrap_err().to_string();
        assert!(message.contains("TIFF") && message.contains("'a b.goblin'"), "{message}");
    }

    #[test]
    fn advice_names_the_file() {
        let refused = |path, bytes: &[u8]| OtherFormat::refuse_source(Path::new(path), bytes).to_string();
        assert!(refused("my scan.e57", b"ASTM-E57").contains("pdal translate 'my scan.e57' OUT.laz"));
        assert!(refused("a.geojson", b"{}").contains("--zones a.geojson"));
        assert!(
            refused("a.las", b"LASF").contains("`spinney build a.las -o OUT.goblin` makes a tree of points")
        );
        assert!(refused("a.txt", b"text").contains("are read"));
        let no_tree =
            |path, bytes: &[u8]| OtherFormat::refuse_tree(Path::new(path), bytes).map(|e| e.to_string());
        let told = "map.tif: is no tree but a TIFF picture; build one: `spinney build map.tif -o map.goblin`";
        assert_eq!(no_tree("map.tif", b"II*\0").as_deref(), Some(told));
        assert_eq!(no_tree("map.goblin", b"something"), None);
    }
}
