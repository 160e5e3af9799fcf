//! Coordinate systems in the program: preserved, written back, reported, and compared.

use std::path::{Path, PathBuf};

use serde_json::{Value as Json, json};
use spinney::raw::import::raster::{self, RasterOptions};
use spinney::{Crs, Frame};
use tempfile::TempDir;

use crate::common::command::{command, complaint, stderr, stdout};
use crate::common::shared_data;
use crate::common::tiff_file::{Ifd, Values, file};

/// An equal-area map of Africa, without an EPSG code.
const AFRICA: &str = r#"PROJCS["Africa & beyond",GEOGCS["ball",DATUM["ball",SPHEROID["ball",6370997,0]],
    PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Lambert_Azimuthal_Equal_Area"],
    PARAMETER["latitude_of_center",12],PARAMETER["longitude_of_center",3],UNIT["metre",1]]"#;
const JSON: &str = r#"{"type":"EngineeringCRS","name":"a <yard>","datum":{"name":"a corner"},"coordinate_system":
    {"subtype":"Cartesian","axis":[{"name":"E","abbreviation":"E","direction":"east","unit":"metre"}]}}"#;

struct Setting(TempDir);

impl Setting {
    fn new() -> Setting {
        Setting(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().into()
    }

    /// Builds a tree of an image. Returns the messages.
    fn build(&self, raster: &str, tree: &str, options: &[&str]) -> String {
        let run = command(&["build", raster, "-o", &self.name(tree)]).args(options).assert().success();
        stderr(run)
    }

    /// Exports a tree as an image. Returns the messages.
    fn get(&self, tree: &str, raster: &str) -> String {
        stderr(command(&["-q", "get", &self.name(tree), &self.name(raster)]).assert().success())
    }

    fn info(&self, tree: &str) -> Json {
        serde_json::from_str(&stdout(&["info", &self.name(tree), "--json"])).unwrap()
    }

    /// Writes a GeoTIFF file of four pixels with an equal-area projection by parameters, at a
    /// latitude.
    fn equal_area(&self, name: &str, latitude: f64) -> String {
        let keys = [
            [1, 1, 0, 9],
            [1024, 0, 1, 1],
            [1025, 0, 1, 1],
            [1026, 34737, 8, 0],
            [2048, 0, 1, 4326],
            [3072, 0, 1, 32767],
            [3074, 0, 1, 32767],
            [3075, 0, 1, 10],
            [3076, 0, 1, 9001],
            [3089, 34736, 1, 0],
        ];
        let ifd = placed().short(34735, keys.as_flattened()).tag(34736, Values::Double(vec![latitude]));
        self.write(name, &file(&[ifd.tag(34737, Values::Text("unknown|"))]))
    }

    fn write(&self, name: &str, bytes: &[u8]) -> String {
        std::fs::write(self.path(name), bytes).unwrap();
        self.name(name)
    }
}

/// Returns four pixels of 10 x 10, starting at 100, 200.
fn placed() -> Ifd {
    let ifd = Ifd::grey(2, 2, vec![1, 2, 3, 4]);
    let ifd = ifd.tag(33550, Values::Double(vec![10.0, 10.0, 0.0]));
    ifd.tag(33922, Values::Double(vec![0.0, 0.0, 0.0, 100.0, 200.0, 0.0]))
}

fn frame(path: &Path) -> Frame {
    raster::open(path, &RasterOptions::default()).unwrap().info().frame.clone()
}

/// Returns the little-endian bytes of a tag's values in the first directory of a TIFF file of any
/// kind.
fn tag_bytes(path: &Path, wanted: u64) -> Option<Vec<u8>> {
    let bytes = std::fs::read(path).unwrap();
    let is_little = bytes[0] == b'I';
    let number = |at: usize, width: usize| {
        let digits = bytes.get(at..at + width)?;
        let push = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        Some(if is_little { digits.iter().rev().fold(0, push) } else { digits.iter().fold(0, push) })
    };
    let is_big = number(2, 2)? == 43;
    let (word, head) = if is_big { (8, 8) } else { (4, 2) };
    let directory = number(if is_big { 8 } else { 4 }, word)? as usize;
    let mut entries = (0..number(directory, head)? as usize).map(|i| directory + head + i * (4 + 2 * word));
    let entry = entries.find(|entry| number(*entry, 2) == Some(wanted))?;
    let width = match number(entry + 2, 2)? {
        2 => 1,
        3 => 2,
        _ => 8,
    };
    let count = number(entry + 4, word)? as usize;
    let value = entry + 4 + word;
    let at = if count * width <= word { value } else { number(value, word)? as usize };
    let mut values = bytes.get(at..at + count * width)?.to_vec();
    if !is_little {
        values.chunks_exact_mut(width).for_each(<[u8]>::reverse);
    }
    Some(values)
}

/// Returns a file's geokeys except the raster type: entries, doubles, and strings without trailing
/// NULs, which some writers omit.
fn keys(path: &Path) -> (Vec<[u16; 4]>, Vec<u8>, Vec<u8>) {
    let table = tag_bytes(path, 34735).unwrap_or_default();
    let table: Vec<u16> = table.as_chunks::<2>().0.iter().map(|number| u16::from_le_bytes(*number)).collect();
    let entries = table.as_chunks::<4>().0;
    let count = entries.first().map_or(0, |[.., count]| usize::from(*count));
    let entries = entries.iter().skip(1).take(count).filter(|entry| entry[0] != 1025).copied().collect();
    let [doubles, mut strings] = [34736, 34737].map(|tag| tag_bytes(path, tag).unwrap_or_default());
    strings.truncate(strings.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1));
    (entries, doubles, strings)
}

#[test]
fn geokeys_round_trip() {
    let setting = Setting::new();
    let mut files = vec![PathBuf::from(setting.equal_area("africa.tif", 12.0))];
    if let Some(data) = shared_data() {
        for directory in
            ["raster/gdal_gcore", "raster/rasterio", "raster/georust", "raster/nlcd_zion", "hostile/raster"]
        {
            let entries = std::fs::read_dir(data.join(directory)).unwrap().map(|entry| entry.unwrap().path());
            files.extend(entries.filter(|path| path.extension().is_some_and(|ending| ending == "tif")));
        }
    }
    files.sort();
    let (tree, out) = (setting.name("t.goblin"), setting.path("out.tif"));
    let mut defined = 0;
    for path in files {
        // Other tests cover large and unreadable files.
        let is_small = path.metadata().unwrap().len() < 1 << 20;
        let Some(before) = is_small.then(|| raster::open(&path, &RasterOptions::default()).ok()).flatten()
        else {
            continue;
        };
        // Control points may have a coordinate system although the image has none.
        let control = before.info().control_points.as_ref().is_some_and(|points| points.crs.is_some());
        let before = before.info().frame.clone();
        let build = command(&["-q", "build", path.to_str().unwrap(), "-o", &tree]).output().unwrap();
        if !build.status.success() {
            continue;
        }
        setting.get("t.goblin", "out.tif");
        let after = frame(&out);
        assert_eq!(after.crs, before.crs, "{}", path.display());
        if before.crs.is_some() || control {
            defined += 1;
            assert_eq!(keys(&out), keys(&path), "{}", path.display());
        } else {
            assert_eq!(tag_bytes(&out, 34735), None, "{}: a system that is none", path.display());
        }
    }
    eprintln!("{defined} files with a coordinate system");
    assert!(defined > 0);
}

#[test]
fn coordinate_systems_without_geokeys_are_in_sidecars() {
    let setting = Setting::new();
    let raster = setting.name("rows.png");
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/classic.png"), &raster).unwrap();
    setting.write("rows.pgw", b"2\n0\n0\n-2\n101\n199\n");
    // Geokeys have no number for this method.
    let world = AFRICA.replace("Lambert_Azimuthal_Equal_Area", "Mollweide").replace(
        "PARAMETER[\"latitude_of_center\",12],PARAMETER[\"longitude_of_center\",3]",
        "PARAMETER[\"central_meridian\",3]",
    );
    setting.write("rows.prj", world.as_bytes());
    let said = setting.build(&raster, "t.goblin", &[]);
    assert!(said.contains("Africa & beyond (WKT without an EPSG number)"), "{said}");
    let said = setting.get("t.goblin", "out.tif");
    assert!(said.contains("out.tif.aux.xml"), "{said}");
    let sidecar = std::fs::read_to_string(setting.path("out.tif.aux.xml")).unwrap();
    assert!(
        sidecar.starts_with("<PAMDataset>\n  <SRS>PROJCS[") && sidecar.contains("Africa &amp; beyond"),
        "{sidecar}"
    );
    assert_eq!(tag_bytes(&setting.path("out.tif"), 34735), None);
    assert_eq!(frame(&setting.path("out.tif")).crs, Some(Crs::Wkt(world)));
    // Standard output cannot have a sidecar file.
    let run = command(&["get", &setting.name("t.goblin"), "-", "--format", "tif"]).assert().success();
    assert!(stderr(run).contains("has no coordinate system"));
    // Likewise PROJJSON, and EPSG codes that geokeys cannot store.
    for definition in [JSON, "EPSG:900913"] {
        setting.build(&raster, "t.goblin", &["--crs", definition]);
        setting.get("t.goblin", "out.tif");
        assert_eq!(frame(&setting.path("out.tif")).crs, Some(Crs::parse(definition).unwrap()));
    }
    // A system with an EPSG code becomes geokeys; the old sidecar is removed, which is reported.
    let numbered = AFRICA.replace("UNIT[\"metre\",1]", "UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"32628\"]");
    setting.build(&raster, "t.goblin", &["--crs", &numbered]);
    assert!(setting.get("t.goblin", "out.tif").contains("earlier image"));
    assert_eq!(setting.get("t.goblin", "out.tif"), "");
    assert_eq!(frame(&setting.path("out.tif")).crs, Some(Crs::epsg(32628)));
    assert!(!setting.path("out.tif.aux.xml").exists());
}

#[test]
fn systems_without_a_number_become_keys() {
    let setting = Setting::new();
    let raster = setting.name("rows.png");
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/classic.png"), &raster).unwrap();
    setting.write("rows.pgw", b"2\n0\n0\n-2\n101\n199\n");
    setting.write("rows.prj", AFRICA.as_bytes());
    setting.build(&raster, "t.goblin", &[]);
    assert_eq!(setting.get("t.goblin", "out.tif"), "");
    assert!(!setting.path("out.tif.aux.xml").exists());
    let crs = frame(&setting.path("out.tif")).crs.unwrap();
    assert!(matches!(crs, Crs::GeoKeys(_)) && crs.is_same(&Crs::Wkt(AFRICA.into())), "{}", crs.definition());
}

#[test]
fn coordinate_systems_are_set_by_build_options() {
    let setting = Setting::new();
    let raster = setting.equal_area("africa.tif", 12.0);
    let definition = setting.write("africa.wkt", AFRICA.as_bytes());
    let at = format!("@{definition}");
    for given in [AFRICA, &definition, &at] {
        let said = setting.build(&raster, "t.goblin", &["--crs", given]);
        assert!(said.contains("as requested; the input has unknown (GeoTIFF keys without"), "{said}");
        let info = setting.info("t.goblin");
        let text = Crs::parse(AFRICA).unwrap().to_wkt2().unwrap();
        assert!(text.starts_with("PROJCRS[\"Africa & beyond\",BASEGEOGCRS[\"ball\""), "{text}");
        let crs = json!({ "form": "WKT", "name": "Africa & beyond", "definition": AFRICA, "text": text, "problem": null });
        assert_eq!((&info["crs"], &info["epsg"], &info["unit"]), (&crs, &Json::Null, &json!("m")));
    }
    let text = stdout(&["info", &setting.name("t.goblin")]);
    assert!(
        text.contains("crs         Africa & beyond (WKT without an EPSG number)\n            PROJCS["),
        "{text}"
    );
    assert!(text.contains("... (--json shows all)"), "{text}");
    setting.build(&raster, "t.goblin", &["--crs", "EPSG:4326+5773"]);
    let info = setting.info("t.goblin");
    assert_eq!(
        [&info["epsg"], &info["vertical_epsg"], &info["unit"]],
        [&json!(4326), &json!(5773), &json!("degrees")]
    );
    setting.get("t.goblin", "out.tif");
    assert_eq!(frame(&setting.path("out.tif")).crs, Some(Crs::parse("EPSG:4326+5773").unwrap()));
    for (given, word) in [("EPSG:x", "EPSG:4326"), ("@nowhere.wkt", "nowhere.wkt"), ("PROJCS[", "WKT")] {
        let said = complaint(&["build", &raster, "-o", &setting.name("x.goblin"), "--crs", given], 2);
        assert!(said.contains(word), "{said}");
    }
}

#[test]
fn different_systems_do_not_pass_as_equal() {
    let setting = Setting::new();
    let rasters = [("a", 12.0), ("b", 52.0), ("again", 12.0)];
    for (name, latitude) in rasters {
        let raster = setting.equal_area(&format!("{name}.tif"), latitude);
        setting.build(&raster, &format!("{name}.goblin"), &[]);
    }
    let plain = setting.write("none.tif", &file(&[placed()]));
    setting.build(&plain, "none.goblin", &[]);
    let name = |name: &str| setting.name(name);
    let out = name("out.goblin");
    let refused = |a: &str, b: &str| {
        let [a_tree, b_tree] = [a, b].map(|stem| name(&format!("{stem}.goblin")));
        let [a_tif, b_tif] = [a, b].map(|stem| name(&format!("{stem}.tif")));
        let like = format!("like={b_tree}");
        for arguments in [
            &["combine", "union", &a_tree, &b_tree, "-o", &out][..],
            &["combine", "cross", &a_tree, &b_tree],
            &["diff", &a_tree, &b_tree],
            &["transform", &a_tree, &like, "-o", &out],
            &["build", &a_tif, &b_tif, "-o", &out],
        ] {
            let said = complaint(arguments, 1);
            assert!(said.contains("coordinate system") && said.contains("crs"), "{arguments:?}: {said}");
        }
    };
    // Neither can be computed, since one would have to be transformed.
    refused("a", "b");
    refused("a", "none");
    refused("none", "a");
    command(&["-q", "combine", "union", &name("a.goblin"), &name("again.goblin"), "-o", &out])
        .assert()
        .success();
    // The workarounds.
    let step = format!("crs=@{}", setting.write("mine.wkt", AFRICA.as_bytes()));
    for tree in ["a", "none"] {
        let named = setting.name(&format!("{tree}_named.goblin"));
        command(&["-q", "transform", &name(&format!("{tree}.goblin")), &step, "-o", &named])
            .assert()
            .success();
    }
    let trees = [name("a_named.goblin"), name("none_named.goblin")];
    command(&["-q", "combine", "union", &trees[0], &trees[1], "-o", &out]).assert().success();
    assert_eq!(setting.info("out.goblin")["crs"]["definition"], AFRICA);
    let view = ["--view", "crs=EPSG:2056", "--view", "rotate=90"];
    command(&["-q", "get", &name("a.goblin"), &name("out.tif")]).args(view).assert().success();
    assert_eq!(frame(&setting.path("out.tif")).crs, Some(Crs::epsg(2056)));
    let crs = ["--crs", "EPSG:2056"];
    command(&["-q", "build", &name("a.tif"), &name("none.tif"), "-o", &out]).args(crs).assert().success();
    if let Some(data) = shared_data() {
        let [a, b] = ["custom.tif", "nt_20201024_f18_nrt_s.tif"]
            .map(|file| frame(&data.join("hostile/raster").join(file)).crs);
        assert!(a.is_some() && b.is_some() && !a.unwrap().is_same(&b.unwrap()));
    }
}

#[test]
fn definitions_survive_edits_and_operations() {
    let setting = Setting::new();
    let raster = setting.equal_area("africa.tif", 12.0);
    setting.build(&raster, "t.autumn", &[]);
    let (tree, out) = (setting.name("t.autumn"), setting.name("out.goblin"));
    let expected = setting.info("t.autumn")["crs"].clone();
    assert!(expected["definition"].as_str().unwrap().contains("3089=12.0"), "{expected}");
    command(&["-q", "transform", &tree, "rotate=90", "-o", &out]).assert().success();
    assert_eq!(setting.info("out.goblin")["crs"], expected);
    command(&["-q", "edit", &tree, "fill", "--value", "9", "--window", "0,0,1,1"]).assert().success();
    command(&["-q", "convert", &tree, &out]).assert().success();
    assert_eq!(setting.info("out.goblin")["crs"], expected);
}
