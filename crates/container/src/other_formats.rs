//! Detection of other file formats, with advice for each.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use spinney_base::io::{FileAccess, Output, sibling_path, url_of, without_query};
use spinney_base::{Error, Result};

use crate::file_header::FileHeader;
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
const VARIABLES: &str = "convert a variable to GeoTIFF first (`gdalinfo IN` lists them; `gdal_translate 'NETCDF:\"IN\":NAME' OUT.tif` converts one; HDF5 files: HDF5: instead of NETCDF:); \
    in Python, open it with xarray, and give the DataArray to spinney.build";
const IMAGE: &str = "convert it to PNG or TIFF first (`magick IN OUT.png`)";
const POINTS: &str = "convert it to LAS or LAZ first (`pdal translate IN OUT.laz`)";
const CLOUD: &str = "it has no cells: `spinney build FILE -o OUT.goblin` makes a tree of points (in Python: `spinney.build_points`)";
const JSON: &str = "a manifest has the first key \"spinney_manifest\" (`spinney manifest TREE... -o FILE` writes one); if it is a CityJSON model, build a tree: \
    `spinney build FILE -o OUT.goblin`";
const SURFACES: &str =
    "export it as OBJ, PLY or STL with a scale of 1 from the program that made it, or from Blender";
const SOLIDS: &str = "its surfaces are curved: export it as STL or OBJ, as fine as needed, from the program that made it, or from FreeCAD";
const DRAWING: &str = "export its solids as STL or OBJ from the CAD program; convert plane drawings to GeoJSON (`ogr2ogr out.geojson IN`, for DXF)";
const SCAN: &str =
    "convert it to an NPY array of shape (z, y, x) first, in Python with pydicom, nibabel or SimpleITK";
const PACKED: &str = "unpack it first";
const TILES: &str = "it contains rendered tiles: open the tree from which they were made";

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
        "a TIFF image",
        &["tif", "tiff", "gtiff"],
        &[At(0, b"II*\0"), At(0, b"II+\0"), At(0, b"MM\0*"), At(0, b"MM\0+")],
        Source,
    ),
    format("a PNG image", &["png"], &[At(0, b"\x89PNG")], Source),
    format("a JPEG image", &["jpg", "jpeg", "jpe"], &[At(0, b"\xff\xd8\xff")], Source),
    format("a WebP image", &["webp"], &[At(8, b"WEBP")], Source),
    format("a BMP image", &["bmp", "dib"], &[], Source),
    format("a GIF image", &["gif"], &[At(0, b"GIF8")], Source),
    // The extension .hdr belongs to ENVI headers.
    format("a Radiance HDR image", &["rgbe"], &[At(0, b"#?RADIANCE"), At(0, b"#?RGBE")], Source),
    format("a PNM image", &["pbm", "pgm", "ppm", "pnm", "pam"], &[], Source),
    format("a QOI image", &["qoi"], &[At(0, b"qoif")], Source),
    format("a TGA image", &["tga"], &[], Source),
    format("an OpenEXR image", &["exr"], &[At(0, b"\x76\x2f\x31\x01")], Source),
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
        Read("make one tree from its files first (`spinney transform FILE -o OUT.goblin`)"),
    ),
    format("a CityJSON model", &["jsonl", "cityjson"], &[Within("\"CityJSON")], Source),
    format("a JSON document", &["json"], &[], Read(JSON)),
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
        "a JPEG 2000 image",
        &["jp2", "j2k", "jpx", "jpf"],
        &[At(4, b"jP  \r\n\x87\n"), At(0, b"\xff\x4f\xff\x51")],
        Refused(TRANSLATE),
    ),
    format("a JPEG XL image", &["jxl"], &[At(4, b"JXL \r\n\x87\n")], Refused(IMAGE)),
    format(
        "a HEIC image",
        &["heic", "heif"],
        &[At(4, b"ftyphei"), At(4, b"ftyphev"), At(4, b"ftypmif1")],
        Refused(IMAGE),
    ),
    format("an AVIF image", &["avif"], &[At(4, b"ftypavi")], Refused(IMAGE)),
    format("a Photoshop image", &["psd"], &[At(0, b"8BPS")], Refused(IMAGE)),
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
    format("a MrSID or ECW image", &["sid", "ecw"], &[At(0, b"msid")], Refused(TRANSLATE)),
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
    format("a glTF model", &["gltf", "glb"], &[At(0, b"glTF")], Source),
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
        Refused("it has several arrays: write one of them as NPY (numpy.save)"),
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
        Read(
            "`spinney build FILE --cell 10 --value FIELD -o OUT.goblin` makes cells of its features; `spinney edit TREE.autumn set FILE` sets cells of an existing tree",
        ),
    ),
];

/// List of readable formats, for files of other formats.
const WHAT_IS_READ: &str = "these are read: rasters and volumes (TIFF, PNG, JPEG, WebP, OpenEXR, BMP, GIF, PNM, TGA, QOI, Radiance HDR, .hgt, VRT, NPY, NRRD, raw samples with \
    --raw-size, .chain and .bintree), solids (PLY, OBJ, STL, OFF, glTF, CityJSON, CityJSONSeq, .csg and .bpt), features (GeoJSON, GeoPackage, FlatGeobuf, shapefile and CSV), points (LAS and \
    LAZ), and Spinney's own files; GDAL converts most other rasters (`gdal_translate IN OUT.tif`)";

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
                Some(Error::unsupported(path, *name, advice.replace("IN", &shell_word(path))))
            }
            _ => None,
        }
    }

    /// Returns whether a file starts with the mark of a known format.
    pub fn is_marked(first: &[u8]) -> bool {
        let starts = |mark: &Mark| matches!(mark, At(..)) && mark.is_in(first);
        FORMATS.iter().any(|format| format.marks.iter().any(starts))
    }

    /// Returns the error for a file whose first bytes are those of another format than `expected`;
    /// `None` if they are of no known format.
    pub fn refuse_content(path: &Path, first: &[u8], expected: &str) -> Option<Error> {
        let found =
            OtherFormat::of(path, first).filter(|format| format.marks.iter().any(|m| m.is_in(first)))?;
        Some(Error::corrupt(path, "content", found.name, expected))
    }

    /// Returns the error for a file that is not a source of trees, where `expected` is one.
    pub fn refuse_source(path: &Path, first: &[u8], expected: &str) -> Error {
        if let Some(error) = refuse_own(path, first).or_else(|| OtherFormat::refuse_unread(path, first)) {
            return error;
        }
        match OtherFormat::of(path, first) {
            Some(OtherFormat { name, role: Read(purpose), .. }) => Error::unsupported(
                path,
                format!("{name} as input of a build"),
                purpose.replace("FILE", &shell_word(path)),
            ),
            _ => OtherFormat::refuse_content(path, first, expected).unwrap_or_else(|| {
                Error::unsupported(
                    path,
                    "a file of this format",
                    WHAT_IS_READ.replace("IN", &shell_word(path)),
                )
            }),
        }
    }

    /// Returns the error for a file that is not a tree but should be; `None` if its format is
    /// unknown.
    pub(crate) fn refuse_tree(path: &Path, first: &[u8]) -> Option<Error> {
        let OtherFormat { name, endings, role, .. } = OtherFormat::of(path, first)?;
        let file = shell_word(path);
        let advice = match role {
            Source => {
                // (The output must not be the input, which may have the name of a tree.)
                let tree = path.with_extension("goblin");
                let tree = if tree == path { "OUT.goblin".into() } else { shell_word(&tree) };
                let build = format!("build one: `spinney build {file} -o {tree}`");
                match endings.first() {
                    Some(&"tif") => {
                        let index = shell_word(&index_of(path));
                        format!(
                            "{build}, or index it without a copy of its cells: `spinney index {file} -o {index}`"
                        )
                    }
                    _ => build,
                }
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

/// Returns the error for a file of Spinney's that is not a source of trees of cells; `None` for
/// other files.
fn refuse_own(path: &Path, first: &[u8]) -> Option<Error> {
    if ![TreeFormat::Goblin, TreeFormat::Autumnal].iter().any(|format| first.starts_with(&format.magic())) {
        return None;
    }
    let checked = FileHeader::from_bytes(path, first).and_then(|header| header.check_cells(path));
    let advice = "build a tree from it alone, or combine trees: `spinney combine over`";
    Some(checked.err().unwrap_or_else(|| Error::unsupported(path, "a tree among other inputs", advice)))
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
    let (goblin, autumn) =
        (shell_word(&path.with_extension("goblin")), shell_word(&path.with_extension("autumn")));
    let advice = format!(
        "names of trees end with .goblin (compact, read-only) or .autumn (editable), such as {goblin} or {autumn}"
    );
    Err(Error::unsupported(path, format!("a tree with the file extension of {}", format.name), advice))
}

/// Checks the file name of what has no editable form, and so is always a Goblin file: as
/// [`check_tree_name`], and that the name does not end with `.autumn`. `what` is a plural.
///
/// # Errors
/// If it has another extension.
pub fn check_goblin_name(path: &Path, what: &str) -> Result<()> {
    check_tree_name(path)?;
    if TreeFormat::of(path) != TreeFormat::Autumnal {
        return Ok(());
    }
    let advice = format!(
        "{what} have no editable form: choose a name that ends with .goblin, such as {}",
        shell_word(&path.with_extension("goblin"))
    );
    Err(Error::unsupported(path, format!("an Autumnal file (.autumn) of {what}"), advice))
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

/// Path of the index next to a file, or of one in the working directory for a file on a web server.
fn index_of(path: &Path) -> PathBuf {
    let is_web = url_of(path)
        .is_some_and(|url| url.get(..4).is_some_and(|scheme| scheme.eq_ignore_ascii_case("http")));
    let with_ending = |name: &OsStr| {
        let mut name = name.to_os_string();
        name.push(".goblin");
        name.into()
    };
    match without_query(path).file_name() {
        Some(name) if is_web => with_ending(name),
        _ => sibling_path(path, |path| with_ending(path.as_os_str())),
    }
}

/// File name extension in lower case, without the dot.
fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// Returns a path as a word of a shell, with quotes if it needs them.
pub fn shell_word(path: &Path) -> String {
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
    fn file_contents_precede_file_names() {
        assert_eq!(name("a.png", b"II*\0...."), Some("a TIFF image"));
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
    fn endings_and_marks_are_unambiguous() {
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
    fn all_formats_that_are_read_are_listed() {
        let list = WHAT_IS_READ.to_lowercase();
        for format in FORMATS.iter().filter(|format| !matches!(format.role, Refused(_))) {
            let name = format.name.split(' ').nth(1).unwrap().to_lowercase();
            let is_listed = format.endings.iter().any(|ending| list.contains(ending)) || list.contains(&name);
            assert!(is_listed || format.endings.is_empty(), "{}", format.name);
        }
    }

    #[test]
    fn files_of_spinney_are_refused_for_what_they_are() {
        let refused =
            |bytes: &[u8]| OtherFormat::refuse_source(Path::new("a.autumn"), bytes, "a raster").to_string();
        let mut header = b"\x93Autumn\n\x01\0\0\0\x02\0\x08\0\0\0\0\0....".to_vec();
        assert!(refused(&header).contains("a.autumn: header: found checksum"), "{}", refused(&header));
        header.truncate(9);
        assert!(refused(&header).contains("found 9 bytes"), "{}", refused(&header));
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
        let refused =
            |path, bytes: &[u8]| OtherFormat::refuse_source(Path::new(path), bytes, "a model").to_string();
        assert!(refused("my scan.e57", b"ASTM-E57").contains("pdal translate 'my scan.e57' OUT.laz"));
        assert!(refused("a.geojson", b"{}").contains("--zones a.geojson"));
        assert!(
            refused("a.las", b"LASF").contains("`spinney build a.las -o OUT.goblin` makes a tree of points")
        );
        assert!(refused("a.txt", b"text").contains("are read"));
        assert!(refused("a.stl", b"\x89PNG").contains("a.stl: content: found a PNG image, expected a model"));
        let no_tree =
            |path, bytes: &[u8]| OtherFormat::refuse_tree(Path::new(path), bytes).map(|e| e.to_string());
        let expected = "map.tif: is a TIFF image, not a Spinney file; build one: `spinney build map.tif -o map.goblin`, \
             or index it without a copy of its cells: `spinney index map.tif -o map.tif.goblin`";
        assert_eq!(no_tree("map.tif", b"II*\0").as_deref(), Some(expected));
        let misnamed = no_tree("map.goblin", b"II*\0").unwrap();
        assert!(misnamed.contains("`spinney build map.goblin -o OUT.goblin`"), "{misnamed}");
        assert_eq!(no_tree("map.goblin", b"something"), None);
    }
}
