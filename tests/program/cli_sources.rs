//! Inputs of `spinney build`, and reports of what it omits: trees as sources, pages, colours, files
//! of other programs.

use std::fs;
use std::path::Path;

use spinney::Region;
use spinney::raw::import::raster::{self, Pixels, RasterInfo};

use crate::common::command::{complaint, spinney, stderr, stdout};
use crate::common::directory::TestDirectory;
use crate::common::tiff_file::{Ifd, Values, file};

const CLASSES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/classes.goblin");
const HEIGHTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/elevation.goblin");
const BALL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/ball.goblin");
const RASTER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_elevation.tif");

/// Returns an image's properties and samples.
fn read_image(path: &str) -> (RasterInfo, Vec<u8>) {
    let mut raster = raster::open(Path::new(path), &Default::default()).unwrap();
    let info = raster.info().clone();
    let mut pixels = Pixels::default();
    raster.read(Region::new(0, 0, info.width, info.height), &mut pixels).unwrap();
    (info, pixels.bytes)
}

#[test]
fn a_tree_as_a_source_keeps_its_properties() {
    let temp = TestDirectory::new();
    let (made, published) = (temp.name("a.goblin"), temp.name("b.goblin"));
    let history = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/history.autumn@1");
    for tree in [CLASSES, HEIGHTS, BALL, history] {
        spinney(&["-q", "build", tree, "-o", &made]).success();
        spinney(&["-q", "convert", tree, &published]).success();
        assert!(fs::read(&made).unwrap() == fs::read(&published).unwrap(), "{tree}");
    }
    // Options take precedence: coarser levels are recomputed from all cells, exactly as from the
    // image itself.
    for (words, kind) in [
        (&["--rule", "max"][..], "continuous, averaged by max"),
        (&["--kind", "categorical", "--depth", "9"], "categorical, averaged by majority"),
        (&["--crs", "EPSG:3857", "--transform", "2,0,5,0,-2,7"], "continuous, averaged by mean"),
    ] {
        let of = |source: &str, name: &str| {
            spinney(&[&["-q", "build", source, "-o", &temp.name(name)], words].concat()).success();
            spinney(&["-q", "verify", &temp.name(name)]).success();
            let printed = stdout(&["info", &temp.name(name)]);
            let lines = printed
                .lines()
                .skip(1)
                .filter(|line| !line.starts_with("made ") && !line.starts_with("source"));
            let printed: Vec<String> = lines.map(String::from).collect();
            assert!(printed.iter().any(|line| line.ends_with(kind)), "{printed:?}");
            [0, 3, 6].map(|level| {
                let window = temp.name("w.npy");
                spinney(&["-q", "get", &temp.name(name), &window, "--level", &level.to_string()]).success();
                fs::read(window).unwrap()
            })
        };
        spinney(&["-q", "build", RASTER, "-o", &temp.name("t.goblin")]).success();
        assert!(of(RASTER, "p.goblin") == of(&temp.name("t.goblin"), "q.goblin"), "{words:?}");
    }
    let autumn = temp.name("t.autumn");
    spinney(&["-q", "build", HEIGHTS, "-o", &autumn, "--share"]).success();
    for (words, message) in [
        (&[HEIGHTS, CLASSES][..], "`spinney combine over`"),
        (&[HEIGHTS, "--nodata", "0"], "--nodata: works only with rasters"),
        (
            &[CLASSES, "--rule", "mean"],
            "classes.goblin: the rule mean for categorical values is not supported",
        ),
        (&[HEIGHTS, "--band", "1"], "--band: works only with rasters"),
        (&[HEIGHTS, "--grid", "xyz"], "grid=xyz -o OUT"),
        (&[HEIGHTS, "--cells", "9"], "the input has its own cells"),
        (&[HEIGHTS, "--depth", "5"], "expected 6 to"),
        (&[HEIGHTS, "--transform", "1,1,1"], "expected 6 numbers"),
        (&[BALL, "--transform", "1,0,0,0,1,0"], "expected 3 or 12 numbers"),
        (&[HEIGHTS, "--transform", "0,0,0,0,0,0"], "no inverse"),
    ] {
        let text = complaint(&[&["build", "-o", &temp.name("x.goblin")], words].concat(), 1);
        assert!(text.contains(message), "{words:?}: {text}");
    }
    assert!(complaint(&["build", HEIGHTS, "-o", &autumn], 1).contains("its history would be lost"));
    assert!(!temp.files().contains(&"x.goblin".into()));
}

#[test]
fn trees_have_names_of_trees() {
    let temp = TestDirectory::new();
    for ending in ["tif", "TIFF", "png", "npy", "ply", "json", "geojson", "gpkg", "nc", "zip", "las"] {
        let out = temp.name(&format!("out.{ending}"));
        for words in [
            &["build", RASTER, "-o", &out][..],
            &["build", RASTER, "-o", &out, "--grid", "xyz"],
            &["build", CLASSES, "-o", &out],
            &["convert", CLASSES, &out],
            &["transform", CLASSES, "crop", "-o", &out],
            &["combine", "over", CLASSES, CLASSES, "-o", &out],
            &["diff", CLASSES, CLASSES, "-o", &out],
        ] {
            let text = complaint(words, 1);
            let expected = [".goblin (compact, read-only) or .autumn (editable)", &temp.name("out.goblin")];
            assert!(expected.iter().all(|part| text.contains(part)), "{words:?}: {text}");
        }
    }
    assert_eq!(temp.files(), [""; 0]);
    // Other file name extensions are allowed.
    spinney(&["-q", "build", CLASSES, "-o", &temp.name("out.tree")]).success();
}

#[test]
fn files_that_are_no_trees_are_reported_with_advice() {
    let temp = TestDirectory::new();
    let tif = temp.write("my map.tif", fs::read(RASTER).unwrap());
    let png = temp.name("o.png");
    for words in [
        &["info", &tif][..],
        &["get", &tif, &png],
        &["point", &tif, "1,1"],
        &["stats", &tif],
        &["find", &tif, "--class", "3"],
        &["contours", &tif, "--every", "5", "-o", "-", "--format", "csv"],
        &["section", &tif, "z=1", "-o", "-", "--format", "csv"],
        &["render", &tif, &png],
        &["dump", &tif],
        &["export", &tif, &temp.name("o.ply")],
        &["verify", &tif],
        &["log", &tif],
        &["transform", &tif, "crop", "-o", &temp.name("o.goblin")],
        &["convert", &tif, &temp.name("o.goblin")],
        &["combine", "over", CLASSES, &tif, "-o", &temp.name("o.goblin")],
        &["diff", CLASSES, &tif],
    ] {
        let text = complaint(words, 1);
        let build = format!("build one: `spinney build '{tif}' -o '{}'`", temp.name("my map.goblin"));
        assert!(
            text.contains("is a TIFF image, not a Spinney file") && text.contains(&build),
            "{words:?}: {text}"
        );
    }
    for (name, bytes, found, advice) in [
        ("a.obj", "v 0 0 0", "an OBJ model", "spinney build"),
        ("a.geojson", "{}", "a GeoJSON document", "--zones"),
        ("a.manifest.json", "{\"a\":1}", "a JSON document, not", "has the first key \"spinney_manifest\""),
        ("b.manifest.json", "{\"spin", "a JSON document, not", "has the first key \"spinney_manifest\""),
        ("a.city.json", "{\"type\":\"CityJSON\"}", "a CityJSON model", "spinney build"),
        ("a.bin", "SQLite format 3\0", "a GeoPackage", "--zones"),
        ("a.zip", "PK\x03\x04", "a ZIP archive", "unpack"),
    ] {
        let text = complaint(&["info", &temp.write(name, bytes)], 1);
        assert!(text.contains(found) && text.contains(advice), "{text}");
    }
    // Unrecognized bytes are a corrupt file, as before.
    assert!(complaint(&["info", &temp.write("a.goblin", [7; 100])], 1).contains("the file is corrupt"));
}

#[test]
fn unsupported_formats_get_matching_advice() {
    let temp = TestDirectory::new();
    for (name, bytes, advice) in [
        ("a.e57", "ASTM-E57", "pdal translate"),
        ("a.gpkg", "SQLite format 3\0", "--cell"),
        ("a.shp", "\0\0\x27\x0a", "--cell"),
        ("a.nc", "CDF\x01", "NETCDF:"),
        ("a.h5", "\u{89}HDF", "gdal_translate"),
        ("a.jp2", "....jP", "gdal_translate"),
        ("a.heic", "....ftypheic", "magick"),
        ("a.svg", "<?xml version='1.0'?><svg/>", "rsvg-convert"),
        ("a.step", "ISO-10303-21;", "export it as STL or OBJ"),
        ("a.igs", "", "export it as STL or OBJ"),
        ("a.fbx", "Kaydara FBX", "Blender"),
        ("a.dwg", "AC1032", "CAD"),
        ("a.ifc", "ISO-10303-21;", "IfcConvert"),
        ("a.txt", "text", "TIFF, PNG, JPEG"),
    ] {
        let bytes = if bytes.is_empty() { "?" } else { bytes };
        let text = complaint(&["build", &temp.write(name, bytes), "-o", &temp.name("o.goblin")], 1);
        assert!(text.contains(advice) && text.contains(name), "{name}: {text}");
        // Commands in messages contain the file name.
        assert!(!text.contains("IN "), "{text}");
    }
    // Polygons for statistics, and features without a cell size.
    for (name, bytes, expected) in [
        ("z.kml", &b"<kml>"[..], "ogr2ogr zones.geojson"),
        ("z.gpkg", b"SQLite format 3\0\xff\xfe", "z.gpkg"),
        ("z.shp", b"?", "expected features in GeoJSON, GeoPackage, FlatGeobuf, a shapefile"),
    ] {
        let text = complaint(&["stats", CLASSES, "--zones", &temp.write(name, bytes)], 1);
        assert!(text.contains(expected), "{text}");
    }
    let polygons = temp.write("p.json", r#"{"type": "FeatureCollection", "features": []}"#);
    for (more, expected) in
        [(&[][..], "features need cells"), (&["--brep"], "--brep: has no effect on cells of features")]
    {
        let text = complaint(&[&["build", &polygons, "-o", &temp.name("o.goblin")], more].concat(), 1);
        assert!(text.contains(expected), "{text}");
    }
    fs::create_dir(temp.name("a.zarr")).unwrap();
    assert!(complaint(&["build", &temp.name("a.zarr"), "-o", &temp.name("o.goblin")], 1).contains("xarray"));
    assert!(!temp.files().contains(&"o.goblin".into()));
}

#[test]
fn contents_of_another_format_are_named() {
    let temp = TestDirectory::new();
    let out = temp.name("o.goblin");
    let image = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_rgb.png")).unwrap();
    for (name, option) in [
        ("a.stl", "--cells=8"),
        ("a.obj", "--brep"),
        ("a.json", "--brep"),
        ("a.laz", "-q"),
        ("a.gpkg", "--cell=2"),
        ("a.csv", "--cell=2"),
    ] {
        let text = complaint(&["build", &temp.write(name, &image), "-o", &out, option], 1);
        assert!(text.contains(&format!("{name}: content: found a PNG image, expected ")), "{text}");
    }
    let mut tree = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/history.autumn")).unwrap();
    tree[20] ^= 1;
    let text = complaint(&["build", &temp.write("a.autumn", &tree), "-o", &out], 1);
    assert!(text.contains("a.autumn: header: found checksum"), "{text}");
    let text = complaint(&["build", &temp.write("a.txt", "text"), "-o", &out], 1);
    for format in ["VRT", "NRRD", "GeoPackage", "LAZ", ".csg", ".chain", "own files"] {
        assert!(text.contains(format), "{format}: {text}");
    }
}

#[test]
fn contours_need_continuous_values() {
    let temp = TestDirectory::new();
    let out = temp.name("o.geojson");
    let text = complaint(&["contours", CLASSES, "--every", "1", "-o", &out], 1);
    for advice in ["classes", "spinney stats", "--polygons", "--kind continuous"] {
        assert!(text.contains(advice), "{text}");
    }
    let continuous = temp.name("a.goblin");
    spinney(&["-q", "build", CLASSES, "-o", &continuous, "--kind", "continuous"]).success();
    spinney(&["-q", "contours", &continuous, "--every", "1", "-o", &out]).success();
    let labels = temp.name("l.goblin");
    spinney(&["-q", "build", BALL, "-o", &labels, "--kind", "categorical"]).success();
    let text = complaint(&["contours", &labels, "--at", "9", "-o", &temp.name("o.ply")], 1);
    assert!(text.contains("a categorical tree") && text.contains("spinney export"), "{text}");
}

#[test]
fn pages_are_listed_and_selected() {
    let temp = TestDirectory::new();
    let page = |value: u8| Ifd::grey(2, 2, vec![value; 4]);
    let overview = |kind: u16| Ifd::grey(1, 1, vec![9]).short(254, &[kind]);
    let old_overview = Ifd::grey(1, 1, vec![9]).short(255, &[2]);
    let mask = Ifd::grey(2, 2, vec![255; 4]).short(254, &[4]);
    let alone =
        temp.write("alone.tif", file(&[page(1), overview(1), old_overview, mask.clone(), overview(5)]));
    let out = temp.name("o.goblin");
    let built = |words: &[&str]| stderr(spinney(&[&["-q", "build", "-o", &out], words].concat()).success());
    assert_eq!(built(&[&alone]), "");
    let several =
        temp.write("several.tif", file(&[page(1), overview(1), page(2), mask, page(3).short(254, &[2])]));
    let text = complaint(&["build", "-o", &out, &several], 1);
    assert!(text.contains("several.tif: a raster of 3 pages") && text.contains("--pages"), "{text}");
    for (number, value) in [("0", "1"), ("1", "2"), ("2", "3")] {
        assert_eq!(built(&[&several, "--pages", number]), "");
        assert_eq!(stdout(&["point", &out, "--in", "cells", "0,0"]).trim(), value);
    }
    let text = complaint(&["build", "-o", &out, &several, "--pages", "3"], 1);
    assert!(text.contains("0 to 2"), "{text}");
    assert!(complaint(&["build", "-o", &out, &several, "--layer", "1"], 1).contains("--pages"));
}

/// Returns an image of four bands with different values.
fn bands(extra: u16, xml: &'static str) -> Vec<u8> {
    let image = Ifd::grey(2, 1, vec![10, 20, 30, 4, 50, 60, 70, 4]);
    let image = image.short(258, &[8; 4]).short(277, &[4]).short(262, &[2]).short(338, &[extra]);
    file(&[if xml.is_empty() { image } else { image.tag(42112, Values::Text(xml)) }])
}

const INFRARED_LAST: &str =
    r#"<GDALMetadata><Item name="COLORINTERP" sample="3" role="colorinterp">NIR</Item></GDALMetadata>"#;
const INFRARED_FIRST: &str = r#"<GDALMetadata><Item name="COLORINTERP" sample="0" role="colorinterp">NIR</Item>
    <Item name="COLORINTERP" sample="1" role="colorinterp">Red</Item><Item name="COLORINTERP" sample="2" role="colorinterp">Green</Item>
    <Item name="COLORINTERP" sample="3" role="colorinterp">Blue</Item></GDALMetadata>"#;

#[test]
fn bands_have_the_colours_that_files_define() {
    let temp = TestDirectory::new();
    let sidecar = |roles: [&str; 4]| {
        let band = |(index, role): (usize, &str)| {
            format!("<PAMRasterBand band=\"{}\"><ColorInterp>{role}</ColorInterp></PAMRasterBand>", index + 1)
        };
        let bands: String = roles.into_iter().enumerate().map(band).collect();
        format!("<PAMDataset>{bands}</PAMDataset>")
    };
    let rgb = [[10, 20, 30], [50, 60, 70]].concat();
    for (name, bytes, sidecar_roles, expected, roles) in [
        ("none", bands(0, ""), None, rgb.clone(), None),
        ("alpha", bands(2, ""), None, vec![10, 20, 30, 4, 50, 60, 70, 4], None),
        ("last", bands(2, INFRARED_LAST), None, rgb.clone(), Some("Red,Green,Blue,NIR")),
        ("first", bands(0, INFRARED_FIRST), None, vec![20, 30, 4, 60, 70, 4], Some("NIR,Red,Green,Blue")),
        (
            "sidecar",
            bands(2, ""),
            Some(["Blue", "Green", "Red", "NIR"]),
            vec![30, 20, 10, 70, 60, 50],
            Some("Blue,Green,Red,NIR"),
        ),
        (
            "opaque",
            bands(0, ""),
            Some(["Red", "Green", "Blue", "Alpha"]),
            vec![10, 20, 30, 4, 50, 60, 70, 4],
            None,
        ),
    ] {
        let input = temp.write(&format!("{name}.tif"), bytes);
        if let Some(roles) = sidecar_roles {
            temp.write(&format!("{name}.tif.aux.xml"), sidecar(roles));
        }
        let [tree, png, tif] = ["t.goblin", "o.png", "o.tif"].map(|out| temp.name(out));
        spinney(&["-q", "build", &input, "-o", &tree]).success();
        spinney(&["-q", "get", &tree, &png]).success();
        assert_eq!(read_image(&png).1, expected, "{name}");
        let line = roles.map(|roles| format!("colour_roles = {roles}"));
        let info = stdout(&["info", &tree]);
        assert_eq!(info.contains("colour_roles"), line.is_some(), "{name}: {info}");
        assert!(line.is_none_or(|line| info.contains(&line)), "{name}: {info}");
        // An exported raster of values has all of them, with the same metadata.
        spinney(&["-q", "get", &tree, &tif]).success();
        let (before, after) = (read_image(&input), read_image(&tif));
        assert_eq!(after.1, before.1, "{name}");
        assert_eq!(after.0.alpha, before.0.alpha, "{name}");
        if roles.is_some() {
            assert_eq!(after.0.colour_roles, before.0.colour_roles, "{name}");
        }
        // A style without bands uses them, too; one with bands uses its own.
        spinney(&[
            "-q",
            "get",
            &tree,
            &png,
            "--style",
            r#"{"draw": "rgb", "domain": [0, 255], "bands": [4, 3, 2]}"#,
        ])
        .success();
        assert_eq!(read_image(&png).1[..3], [4, 30, 20], "{name}");
    }
    // Selected bands keep their roles.
    let chosen = temp.name("c.goblin");
    spinney(&["-q", "build", &temp.name("first.tif"), "-o", &chosen, "--band", "4,3,2"]).success();
    assert!(stdout(&["info", &chosen]).contains("colour_roles = Blue,Green,Red"));
    // Two bands are not grey with opacity.
    let two = Ifd::grey(2, 1, vec![10, 20, 30, 40]).short(258, &[8; 2]).short(277, &[2]).short(338, &[0]);
    let input = temp.write("two.tif", file(&[two]));
    spinney(&["-q", "build", &input, "-o", &chosen]).success();
    spinney(&["-q", "get", &chosen, &temp.name("two.png")]).success();
    assert_eq!(read_image(&temp.name("two.png")).1, [10, 30]);
}
