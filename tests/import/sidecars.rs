//! Frames and coordinate systems from sidecar files, and from ground control points.

use std::fs;
use std::path::Path;

use spinney::raw::import::raster::{RasterInfo, RasterOptions, open};
use spinney::{Crs, Frame};

use crate::common::shared_data;
use crate::common::tiff_file::{Ifd, Values, file};

const LOCAL: &str = "LOCAL_CS[\"site <A> & B\",UNIT[\"metre\",1]]";
const ESCAPED: &str = "LOCAL_CS[&quot;site &lt;A&gt; &amp; B&quot;,UNIT[&quot;metre&quot;,1]]";
const TRANSFORM: &str = "<GeoTransform>  1.0e+02,  2.0, 0.0, 2.0e+02, 0.0, -2.0</GeoTransform>";

fn info(path: &Path) -> Result<RasterInfo, String> {
    let raster = open(path, &RasterOptions::default()).map_err(|error| error.to_string())?;
    Ok(raster.info().clone())
}

fn placed(crs: Option<Crs>) -> Frame {
    Frame { crs, ..Frame::planar([2.0, 0.0, 100.0, 0.0, -2.0, 200.0]) }
}

#[test]
fn sidecars_georeference_rasters() {
    let directory = tempfile::tempdir().unwrap();
    let grey = file(&[Ifd::grey(2, 2, vec![1, 2, 3, 4])]);
    let png = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/classic.png")).unwrap();
    let local = Some(Crs::Wkt(LOCAL.into()));
    for (name, bytes) in [("a.tif", &grey), ("a.png", &png)] {
        let path = directory.path().join(name);
        fs::write(&path, bytes).unwrap();
        assert_eq!(info(&path).unwrap().frame, Frame::identity());
        // A coordinate system without a frame is ignored: it may belong to another file of that
        // name.
        let definition = directory.path().join("a.prj");
        fs::write(&definition, format!("\u{feff}{LOCAL}\n")).unwrap();
        assert_eq!(info(&path).unwrap().frame, Frame::identity());
        let world = directory.path().join(if name == "a.tif" { "a.tfw" } else { "a.pgw" });
        fs::write(&world, "2\n0\n0\n-2\n101\n199\n").unwrap();
        assert_eq!(info(&path).unwrap().frame, placed(local.clone()));
        // GDAL's file takes precedence, and has both.
        let sidecar = directory.path().join(format!("{name}.aux.xml"));
        let xml = format!(
            "<PAMDataset>\n  <SRS dataAxisToSRSAxisMapping=\"1,2\">EPSG:2056</SRS>\n  {TRANSFORM}\n</PAMDataset>"
        );
        fs::write(&sidecar, &xml).unwrap();
        assert_eq!(info(&path).unwrap().frame, placed(Some(Crs::epsg(2056))));
        fs::remove_file(&world).unwrap();
        fs::write(&sidecar, xml.replace("EPSG:2056", ESCAPED)).unwrap();
        assert_eq!(info(&path).unwrap().frame, placed(local.clone()));
        // Corrupt sidecars are errors with their position.
        for (from, to) in
            [("EPSG:2056", "Projection UTM"), ("EPSG:2056", "PROJCS["), ("-2.0", "0.0"), ("-2.0", "x")]
        {
            fs::write(&sidecar, xml.replace(from, to)).unwrap();
            let error = info(&path).unwrap_err();
            assert!(error.contains("aux.xml"), "{error}");
        }
        fs::remove_file(&sidecar).unwrap();
        fs::write(&world, "2\n0\n0\n-2\n101\n199\n").unwrap();
        fs::write(&definition, "Projection GEOGRAPHIC\nDatum WGS84\n").unwrap();
        let error = info(&path).unwrap_err();
        assert!(error.contains("a.prj") && error.contains("--crs"), "{error}");
        fs::remove_file(&world).unwrap();
    }
    // The image's own metadata takes precedence over all of these.
    let path = directory.path().join("a.tif");
    let keys = [[1, 1, 0, 2], [1024, 0, 1, 1], [3072, 0, 1, 32628]];
    let ifd = Ifd::grey(2, 2, vec![1, 2, 3, 4]).short(34735, keys.as_flattened());
    let ifd = ifd.tag(33550, Values::Double(vec![2.0, 2.0, 0.0]));
    let ifd = ifd.tag(33922, Values::Double(vec![0.0, 0.0, 0.0, 100.0, 200.0, 0.0]));
    fs::write(&path, file(&[ifd])).unwrap();
    fs::write(directory.path().join("a.tif.aux.xml"), "<PAMDataset><SRS>EPSG:2056</SRS></PAMDataset>")
        .unwrap();
    assert_eq!(info(&path).unwrap().frame, placed(Some(Crs::epsg(32628))));
}

#[test]
fn ground_control_points_do_not_lose_their_system() {
    let points =
        [[0.0, 0.0, 0.0, 7.0, 50.0, 0.0], [1.0, 2.0, 0.0, 8.0, 49.0, 0.0], [2.0, 0.0, 0.0, 9.0, 50.0, 0.0]];
    let keys = [[1, 1, 0, 2], [1024, 0, 1, 2], [2048, 0, 1, 4258]];
    let ifd = Ifd::grey(2, 2, vec![1, 2, 3, 4]).short(34735, keys.as_flattened());
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.tif");
    fs::write(&path, file(&[ifd.tag(33922, Values::Double(points.concat()))])).unwrap();
    let info = info(&path).unwrap();
    // The image's own cells have no coordinate system.
    assert_eq!(info.frame, Frame::identity());
    let control = info.control_points.unwrap();
    assert_eq!((control.crs, control.points.len()), (Some(Crs::epsg(4258)), 3));
}

#[test]
fn malicious_keys_are_harmless() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.tif");
    // Counts and indices beyond the end, missing tags, and a truncated directory.
    let tables: [&[u16]; 5] = [
        &[1, 1, 0, 65535, 1024, 0, 1, 1, 3072, 0, 1, 2056],
        &[1, 1, 0, 2, 2057, 34736, 65535, 65535, 1026, 34737, 65535, 65535],
        &[1, 1, 0, 1, 3072, 34735, 1, 65535],
        &[1, 1, 0, 1, 3072],
        &[0; 4],
    ];
    let expected = [Some(Crs::epsg(2056)), None, None, None, None];
    for (table, expected) in tables.into_iter().zip(expected) {
        let ifd = Ifd::grey(2, 2, vec![1, 2, 3, 4]).short(34735, table).tag(34737, Values::Text("a|"));
        fs::write(&path, file(&[ifd.tag(34736, Values::Double(vec![1.0]))])).unwrap();
        let crs = info(&path).unwrap().frame.crs;
        assert_eq!(
            crs.as_ref().and_then(Crs::numbers),
            expected.as_ref().and_then(Crs::numbers),
            "{table:?}"
        );
        assert!(crs.is_none_or(|crs| !crs.definition().is_empty()));
    }
}

#[test]
fn coordinate_systems_without_codes_are_kept_and_distinguished() {
    let Some(directory) = shared_data().map(|data| data.join("hostile/raster")) else { return };
    let files = ["custom.tif", "customtm.tif", "nt_20201024_f18_nrt_s.tif"];
    let systems = files.map(|name| info(&directory.join(name)).unwrap().frame.crs.unwrap());
    for (a, crs) in systems.iter().enumerate() {
        assert_eq!((crs.numbers(), crs.unit()), (None, Some("m")));
        for (b, other) in systems.iter().enumerate() {
            assert_eq!(crs.is_same(other), a == b, "{} and {}", files[a], files[b]);
        }
    }
}
