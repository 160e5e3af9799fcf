//! Trees built in shards: byte-identical to a single build, whatever happens in between.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use spinney::raw::export::image::{Format, ImageSpec, create};
use spinney::{Crs, Frame, Metadata, Output, SampleType, ValueType};

use crate::common::Random;
use crate::common::command::{complaint, spinney, stderr};
use crate::common::directory::TestDirectory;

const PROGRAM: &str = env!("CARGO_BIN_EXE_spinney");

impl TestDirectory {
    /// Writes a grey image at a position of a grid: uniform squares and noise.
    pub(crate) fn raster(&self, name: &str, at: [u64; 2], size: [u64; 2]) -> String {
        let path = self.path(name);
        let frame = Frame {
            crs: Some(Crs::epsg(32632)),
            ..Frame::planar([
                10.0,
                0.0,
                1000.0 + 10.0 * at[0] as f64,
                0.0,
                -10.0,
                5000.0 - 10.0 * at[1] as f64,
            ])
        };
        let [width, height] = size;
        let value = ValueType::new(SampleType::U8, 1);
        let metadata = Metadata { frame, ..Metadata::default() };
        let spec = ImageSpec { width, height, value, alpha: false, void: false, metadata };
        let format = spinney::raw::export::image::format_of(&path).unwrap_or(Format::Tiff);
        let mut writer = create(Output::create(&path).unwrap(), format, &spec).unwrap();
        let mut random = Random(width + 7 * at[0]);
        for y in 0..height {
            let pixel = |x| match (x / 150 + y / 150 * 3) % 4 {
                0 => (x / 50 % 3) as u8,
                _ => random.below(5) as u8 + (x / 300) as u8,
            };
            let row: Vec<u8> = (0..width).map(pixel).collect();
            writer.write_rows(&row, None).unwrap();
        }
        writer.finish().unwrap();
        self.name(name)
    }

    /// Plans, builds all shards, and merges them; checks that the bytes are those of a single
    /// build.
    fn compare(&self, inputs: &[&str], options: &[&str], shards: &[u32]) {
        self.compare_with(["build", "plan"], &[inputs, options].concat(), shards);
    }

    /// Compares a command with its planning command.
    pub(crate) fn compare_with(&self, [command, plan]: [&str; 2], words: &[&str], shards: &[u32]) {
        let (whole, merged) = (self.name("whole.goblin"), self.name("merged.goblin"));
        spinney(&[&["-q", command, "-o", &whole], words].concat()).success();
        for count in shards {
            let (job, count) = (self.name("job"), *count);
            let number = count.to_string();
            spinney(&[&["-q", "shard", plan, "-o", &job, "--shards", &number], words].concat()).success();
            // The last ones first.
            for number in (0..count).rev() {
                spinney(&["-q", "shard", "build", &job, &number.to_string(), "--memory", "32M"]).success();
            }
            spinney(&["-q", "shard", "merge", &job, "-o", &merged]).success();
            let same = fs::read(&merged).unwrap() == fs::read(&whole).unwrap();
            assert!(same, "{count} shards of {command} {words:?}");
            assert_eq!(self.leftovers("job/shards"), Vec::<String>::new());
            fs::remove_dir_all(&job).unwrap();
        }
    }

    /// Returns the files in a directory that do not belong to a job.
    pub(crate) fn leftovers(&self, directory: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(directory)).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut rest: Vec<String> =
            names.filter(|name| !name.ends_with(".run") && !name.ends_with(".summary")).collect();
        rest.sort();
        rest
    }
}

#[test]
fn shards_of_a_raster_make_the_bytes_of_a_build() {
    let temp = TestDirectory::new();
    let tiff = temp.raster("a.tif", [0, 0], [1400, 1100]);
    temp.compare(&[&tiff], &[], &[1, 2, 7, 64]);
    temp.compare(&[&tiff], &["--codec", "packed", "--kind", "categorical"], &[1, 7]);
    temp.compare(&[&tiff], &["--depth", "12", "--rule", "max", "--nodata", "2"], &[3]);
    // Readable only from top to bottom, whole, and with opacity.
    let png = temp.raster("b.png", [0, 0], [1300, 900]);
    temp.compare(&[&png], &["--transform", "1,0,0.1,0,-1,1e7"], &[1, 2, 7]);
    let webp = temp.raster("c.webp", [0, 0], [1000, 600]);
    temp.compare(&[&webp], &[], &[5]);
    temp.compare(&["tests/import/images/rgb.jpg"], &[], &[2]);
    temp.compare(&["tests/import/images/whole/rgb.bmp"], &[], &[2]);
    temp.compare(&["fixtures/island_rgb.png"], &["--band", "2"], &[2]);
    temp.compare(&["fixtures/island_classes.tif"], &[], &[64]);
}

#[test]
fn shards_of_several_rasters_make_the_bytes_of_a_build() {
    let temp = TestDirectory::new();
    let mut tiles = Vec::new();
    // More than are open at a time; some overlap, some are disjoint, one is read from top to
    // bottom.
    for number in 0..20 {
        let ending = if number == 7 { "png" } else { "tif" };
        let at = [number % 5 * 230 + number, number / 5 * 260 + 5 * (number % 3)];
        tiles.push(temp.raster(&format!("{number}.{ending}"), at, [200 + 5 * number, 256]));
        if number == 7 {
            let world = format!("10\n0\n0\n-10\n{}\n{}\n", 1005 + 10 * at[0], 4995 - 10 * at[1]);
            fs::write(temp.path("7.pgw"), world).unwrap();
            fs::copy(temp.path("7.pgw"), temp.path("7.wld")).unwrap();
        }
    }
    let tiles: Vec<&str> = tiles.iter().map(String::as_str).collect();
    temp.compare(&tiles, &["--crs", "EPSG:32632"], &[1, 2, 7, 64]);
    let sources: String = [0, 1, 5]
        .iter()
        .map(|number: &u64| {
            let (x, y, width) = (number % 5 * 230, number / 5 * 260, 200 + 5 * number);
            format!(
                "<SimpleSource><SourceFilename relativeToVRT=\"1\">{number}.tif</SourceFilename><SourceBand>1</SourceBand>\
                 <SrcRect xOff=\"0\" yOff=\"0\" xSize=\"{width}\" ySize=\"256\"/>\
                 <DstRect xOff=\"{x}\" yOff=\"{y}\" xSize=\"{width}\" ySize=\"256\"/></SimpleSource>"
            )
        })
        .collect();
    let vrt = format!(
        "<VRTDataset rasterXSize=\"700\" rasterYSize=\"600\"><VRTRasterBand dataType=\"Byte\" band=\"1\">\
         <NoDataValue>0</NoDataValue>{sources}</VRTRasterBand></VRTDataset>"
    );
    fs::write(temp.path("all.vrt"), vrt).unwrap();
    temp.compare(&[&temp.name("all.vrt")], &["--codec", "packed"], &[4]);
}

#[test]
fn shards_of_stacks_make_the_bytes_of_a_build() {
    let temp = TestDirectory::new();
    let fine = temp.raster("B02.tif", [0, 0], [1200, 1000]);
    let other = temp.raster("B03.png", [0, 0], [1200, 1000]);
    fs::write(temp.path("B03.pgw"), "10\n0\n0\n-10\n1005\n4995\n").unwrap();
    temp.compare(&[&fine, &other], &["--stack", "--crs", "EPSG:32632"], &[1, 2, 7, 64]);
    let times = ["--stack", "--crs", "EPSG:32632", "--names", "a,b", "--times", "2024-05-31,2024-06-01"];
    temp.compare(&[&fine, &other], &[&times[..], &["--codec", "packed"]].concat(), &[3]);
}

/// Returns a job of an image, and the bytes of a single build.
pub(crate) fn job(temp: &TestDirectory, shards: &str) -> (String, Vec<u8>) {
    let raster = temp.raster("p.tif", [0, 0], [1500, 1200]);
    let (job, whole) = (temp.name("job"), temp.name("whole.goblin"));
    spinney(&["-q", "build", &raster, "-o", &whole]).success();
    spinney(&["-q", "shard", "plan", &raster, "-o", &job, "--shards", shards]).success();
    (job, fs::read(whole).unwrap())
}

fn build(job: &str, number: u32) -> std::process::Child {
    let mut command = Command::new(PROGRAM);
    command.args(["-q", "shard", "build", job, &number.to_string()]).stderr(Stdio::null());
    command.spawn().unwrap()
}

#[test]
fn shards_that_are_killed_are_built_again() {
    let temp = TestDirectory::new();
    let (job, whole) = job(&temp, "4");
    let merged = temp.name("merged.goblin");
    let missing = complaint(&["shard", "merge", &job, "-o", &merged], 1);
    assert!(missing.contains("0 to 3 are missing") && missing.contains("shard build"), "{missing}");
    // An interrupted plan is repeated; a plan is never partial.
    let (second, raster) = (temp.name("second"), temp.name("p.tif"));
    for delay in [0, 1, 2, 4, 8, 16] {
        let mut command = Command::new(PROGRAM);
        command.args(["-q", "shard", "plan", &raster, "-o", &second, "--shards", "4"]);
        let mut child = command.stderr(Stdio::null()).spawn().unwrap();
        sleep(Duration::from_millis(delay));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    spinney(&["-q", "shard", "plan", &raster, "-o", &second, "--shards", "4"]).success();
    let plan = |job: &str| fs::read(Path::new(job).join("plan.json")).unwrap();
    assert!(plan(&second) == plan(&job));
    fs::remove_dir_all(&second).unwrap();
    let mut delay = 1;
    for number in 0..4 {
        // Kill later and later, until one finishes before.
        loop {
            let mut child = build(&job, number);
            sleep(Duration::from_millis(delay));
            delay += 3;
            child.kill().unwrap();
            child.wait().unwrap();
            if temp.path(&format!("job/shards/000{number}.summary")).exists() || delay > 60 {
                break;
            }
        }
        if number == 1 {
            let missing = complaint(&["shard", "merge", &job, "-o", &merged], 1);
            assert!(missing.contains("to 3 are missing"), "{missing}");
            assert!(!Path::new(&merged).exists());
        }
        // Two at a time, and then once more.
        let both = [build(&job, number), build(&job, number)];
        both.into_iter().for_each(|mut child| assert!(child.wait().unwrap().success()));
        let again = stderr(spinney(&["shard", "build", &job, &number.to_string()]).success());
        assert!(again.contains("was built already"), "{again}");
    }
    assert_eq!(temp.leftovers("job/shards"), Vec::<String>::new());
    // Two concurrent merges, after one that was killed.
    let merge = |name: &str| {
        let mut command = Command::new(PROGRAM);
        command.args(["-q", "shard", "merge", &job, "-o", &temp.name(name)]).spawn().unwrap()
    };
    let mut killed = merge("merged.goblin");
    killed.kill().unwrap();
    killed.wait().unwrap();
    let both = [merge("merged.goblin"), merge("merged.goblin")];
    both.into_iter().for_each(|mut child| assert!(child.wait().unwrap().success()));
    assert!(fs::read(&merged).unwrap() == whole);
    assert_eq!(temp.leftovers("."), ["job", "merged.goblin", "p.tif", "whole.goblin"]);
    // A missing run file is rebuilt, a corrupt one is detected.
    let run = temp.path("job/shards/0002-0.run");
    fs::remove_file(&run).unwrap();
    assert!(complaint(&["shard", "merge", &job, "-o", &merged], 1).contains("2 is missing"));
    spinney(&["-q", "shard", "build", &job, "2"]).success();
    let mut bytes = fs::read(&run).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&run, bytes).unwrap();
    assert!(complaint(&["shard", "merge", &job, "-o", &merged], 1).contains("0002-0.run"));
    assert!(fs::read(&merged).unwrap() == whole, "the older file stays");
}

#[test]
fn shards_of_other_inputs_than_planned_are_refused() {
    let temp = TestDirectory::new();
    let (job, _) = job(&temp, "3");
    spinney(&["-q", "shard", "build", &job, "0"]).success();
    let path = temp.path("p.tif");
    let before = fs::metadata(&path).unwrap().modified().unwrap();
    let touch = |time| fs::File::options().append(true).open(&path).unwrap().set_modified(time).unwrap();
    touch(before + Duration::from_secs(5));
    let text = complaint(&["shard", "build", &job, "1"], 1);
    assert!(text.contains("p.tif") && text.contains("was planned"), "{text}");
    // Existing shards are not rebuilt.
    spinney(&["-q", "shard", "build", &job, "0"]).success();
    touch(before);
    spinney(&["-q", "shard", "build", &job, "1"]).success();
    // A new sidecar file.
    let sidecar = temp.path("p.tif.aux.xml");
    fs::write(&sidecar, "<PAMDataset></PAMDataset>").unwrap();
    let text = complaint(&["shard", "build", &job, "2"], 1);
    assert!(text.contains("p.tif.aux.xml"), "{text}");
    fs::remove_file(&sidecar).unwrap();
    let away = temp.path("q.tif");
    fs::rename(&path, &away).unwrap();
    assert!(complaint(&["shard", "build", &job, "2"], 1).contains("there is no such file"));
    fs::rename(&away, &path).unwrap();
    spinney(&["-q", "shard", "build", &job, "2"]).success();
}

#[test]
fn shards_open_the_inputs_that_they_are_made_of() {
    let temp = TestDirectory::new();
    // Four images at the corners of a square, and a strip that only the first two shards touch.
    let positions = [[0, 0], [1300, 0], [0, 1300], [1300, 1300], [0, 0]];
    let sizes = [[700, 700], [700, 700], [700, 700], [700, 700], [2000, 100]];
    let inputs: Vec<String> = (0..5)
        .map(|number| temp.raster(&format!("{number}.tif"), positions[number], sizes[number]))
        .collect();
    let (job, whole, merged) = (temp.name("job"), temp.name("whole.goblin"), temp.name("merged.goblin"));
    let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
    spinney(&[&["-q", "build", "-o", &whole, "--nodata", "1"], &inputs[..]].concat()).success();
    spinney(&[&["-q", "shard", "plan", "-o", &job, "--shards", "4", "--nodata", "1"], &inputs[..]].concat())
        .success();
    let (last, away) = (temp.path("3.tif"), temp.path("away.tif"));
    fs::rename(&last, &away).unwrap();
    spinney(&["-q", "shard", "build", &job, "0"]).success();
    assert!(complaint(&["shard", "build", &job, "3"], 1).contains("3.tif"));
    fs::rename(&away, &last).unwrap();
    for number in 0..4 {
        spinney(&["-q", "shard", "build", &job, &number.to_string()]).success();
    }
    spinney(&["-q", "shard", "merge", &job, "-o", &merged]).success();
    assert!(fs::read(&merged).unwrap() == fs::read(&whole).unwrap());
    // Invalid positions.
    let plan = temp.path("job/plan.json");
    let json: serde_json::Value = serde_json::from_slice(&fs::read(&plan).unwrap()).unwrap();
    for (pointer, value, word) in [
        ("/work/rasters/mosaic/regions/1", "[18446744073709551615, 0, 700, 700]", "one region per input"),
        ("/work/rasters/mosaic/regions/1", "[1301, 0, 700, 700]", "one region per input"),
        ("/work/rasters/mosaic/regions", "[]", "one region per input"),
        ("/work/rasters/mosaic/regions/4", "[0, 0, 1999, 100]", "4.tif"),
        ("/work/rasters/mosaic/size", "[2001, 2000]", "one region per input"),
        ("/work/rasters/mosaic/nodata", "\"x\"", "number"),
    ] {
        let mut bad = json.clone();
        *bad.pointer_mut(pointer).unwrap() = serde_json::from_str(value).unwrap();
        fs::write(&plan, bad.to_string()).unwrap();
        fs::remove_file(temp.path("job/shards/0000.summary")).unwrap_or_default();
        let said = complaint(&["shard", "build", &job, "0"], 1);
        assert!(said.contains(word), "{pointer}: {said}");
    }
}

#[test]
fn plans_are_made_again_and_not_mixed() {
    let temp = TestDirectory::new();
    let (job, _) = job(&temp, "3");
    let (raster, plan) = (temp.name("p.tif"), temp.path("job/plan.json"));
    let text = fs::read_to_string(&plan).unwrap();
    let again = ["shard", "plan", &raster, "-o", &job, "--shards", "3"];
    assert!(stderr(spinney(&again).success()).contains("planned before"));
    assert_eq!(fs::read_to_string(&plan).unwrap(), text);
    let other = complaint(&["shard", "plan", &raster, "-o", &job, "--shards", "4"], 1);
    assert!(other.contains("another job"), "{other}");
    // A plan interrupted before its last operation is repeated.
    fs::remove_file(&plan).unwrap();
    let none = complaint(&["shard", "build", &job, "0"], 1);
    assert!(none.contains("without a job") && none.contains("shard plan"), "{none}");
    spinney(&["-q", "shard", "plan", &raster, "-o", &job, "--shards", "3"]).success();
    assert_eq!(fs::read_to_string(&plan).unwrap(), text);
    spinney(&["-q", "shard", "build", &job, "0"]).success();
    fs::remove_file(&plan).unwrap();
    assert!(complaint(&again, 1).contains("without a plan"));
    fs::write(&plan, &text).unwrap();
    let full = complaint(&["shard", "plan", &raster, "-o", &temp.name("")], 1);
    assert!(full.contains("with other files"), "{full}");
    // Shards of one job are not valid in another.
    let second = temp.name("second");
    spinney(&["-q", "shard", "plan", &raster, "-o", &second, "--shards", "2"]).success();
    for name in ["0000.summary", "0000-0.run"] {
        fs::copy(temp.path("job/shards").join(name), temp.path("second/shards").join(name)).unwrap();
    }
    assert!(complaint(&["shard", "build", &second, "0"], 1).contains("another job"));
    assert!(complaint(&["shard", "build", &job, "3"], 1).contains("0 to 2"));
}

#[test]
fn corrupt_plans_are_rejected() {
    let temp = TestDirectory::new();
    let (job, _) = job(&temp, "2");
    let plan = temp.path("job/plan.json");
    let text = fs::read_to_string(&plan).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let refused = |bad: &str, word: &str| {
        fs::write(&plan, bad).unwrap();
        let said = complaint(&["shard", "build", &job, "0"], 1);
        assert!(said.contains(word), "{bad}\n{said}");
        complaint(&["shard", "merge", &job, "-o", &temp.name("merged.goblin")], 1);
    };
    refused("", "plan");
    refused("[]", "plan");
    refused(&"[".repeat(100_000), "plan");
    for length in (1..text.len() - 2).step_by(1 + text.len() / 40) {
        refused(&text[..length], "plan");
    }
    let changed = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut json = json.clone();
        change(&mut json);
        serde_json::to_string(&json).unwrap()
    };
    for (pointer, value, word) in [
        ("/spinney_job", "2", "version"),
        ("/program", "\"0.0.0\"", "version 0.0.0"),
        ("/shards/0/0/first", "\"0000000000000001\"", "code ranges"),
        ("/shards/0/0/last", "\"ffffffffffffffff\"", "code ranges"),
        ("/shards/0/0/last", "\"x\"", "code ranges"),
        ("/shards/0/0/layer", "1", "once"),
        ("/shards/1", "[]", "once"),
        ("/shards", "[]", "once"),
        ("/head/bytes", "1", "head.goblin"),
        ("/head/xxh3", "\"\"", "head.goblin"),
        ("/work/rasters/options/kind", "\"odd\"", "`odd`, expected `Categorical`"),
        ("/work/rasters/options/depth", "200", "depth"),
        ("/work/rasters/options/transform", "[\"nan\",\"0\",\"0\",\"0\",\"0\",\"0\"]", "transform"),
        ("/inputs", "[]", "at least one"),
        ("/inputs/0/files/0/path", "\"/gone\"", "/gone"),
        ("/inputs/0/path", "\"/gone\"", "/gone"),
        (
            "/work/rasters/mosaic",
            "{\"size\": [9, 9], \"nodata\": null, \"flag_all\": false, \"regions\": [[0, 0, 9, 9]]}",
            "one region per input",
        ),
        ("/work/rasters/options/rule", "\"Max\"", "was planned"),
    ] {
        let bad = changed(&|json| *json.pointer_mut(pointer).unwrap() = serde_json::from_str(value).unwrap());
        refused(&bad, word);
    }
    fs::write(&plan, &text).unwrap();
    let head = temp.path("job/head.goblin");
    let bytes = fs::read(&head).unwrap();
    for at in (0..bytes.len()).step_by(1 + bytes.len() / 20) {
        let mut bad = bytes.clone();
        bad[at] ^= 0x10;
        fs::write(&head, bad).unwrap();
        assert!(complaint(&["shard", "build", &job, "0"], 1).contains("head.goblin"));
    }
    fs::write(&head, bytes).unwrap();
    spinney(&["-q", "shard", "build", &job, "0"]).success();
}

#[test]
fn unsupported_options_of_shards_are_reported() {
    let temp = TestDirectory::new();
    let raster = temp.raster("p.tif", [0, 0], [300, 200]);
    let (job, tree) = (temp.name("job"), temp.name("t.goblin"));
    spinney(&["-q", "build", &raster, "-o", &tree]).success();
    let refused = |arguments: &[&str], word: &str| {
        let said = complaint(&[&["shard", "plan"], arguments].concat(), 1);
        assert!(said.contains(word), "{arguments:?}: {said}");
        assert!(!Path::new(&job).exists());
    };
    refused(&[&raster, "-o", &job, "--share"], "--share: works only with `spinney build`");
    refused(&[&raster, "-o", &job, "--grid", "xyz"], "--grid: works only with `spinney build`");
    refused(&[&raster, "-o", &job, "--max-bytes", "1G"], "--max-bytes: works only with `spinney build`");
    refused(
        &[&raster, "-o", &job, "--resampling", "nearest"],
        "--resampling: works only with `spinney build`",
    );
    refused(&[&tree, &tree, "-o", &job], "got 2 inputs, expected one tree");
    refused(&[&tree, &raster, "-o", &job], "build one tree for each");
    let zones = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_districts.geojson");
    refused(&[zones, "-o", &job, "--cell", "50"], "is a feature file, expected rasters");
    for task in [&["build", &tree, "0"][..], &["merge", &tree, "-o", &temp.name("never.goblin")]] {
        let said = complaint(&[&["shard"], task].concat(), 1);
        assert!(said.contains("got a file, expected the directory of a job"), "{said}");
    }
    refused(&[&tree, "-o", &job, "--nodata", "1"], "--nodata: works only with rasters and volumes");
    refused(&[&raster, "-o", &temp.name("job.autumn")], "expected a directory for the job");
    refused(&[&raster, "-o", &temp.name("job.goblin")], "expected a directory for the job");
    refused(&[&raster, "-o", "-"], "standard output");
    refused(&["-", "-o", &job], "standard input");
    refused(&[&temp.name("gone.tif"), "-o", &job], "gone.tif");
    let coarse = temp.raster("coarse.tif", [0, 0], [30, 20]);
    let world = [&raster, &coarse, "-o", &job, "--stack", "--resampling", "nearest"];
    spinney(&[&["-q", "shard", "plan"], &world[..]].concat()).success();
    fs::remove_dir_all(&job).unwrap();
    spinney(&["shard", "plan", &raster, "-o", &job, "--shards", "0"]).code(2);
    spinney(&["-q", "shard", "plan", &raster, "-o", &job]).success();
    spinney(&["-q", "shard", "build", &job, "0"]).success();
    let said = complaint(&["shard", "merge", &job, "-o", &temp.name("t.autumn")], 1);
    assert!(said.contains("shards make a .goblin file"), "{said}");
    let said = complaint(&["shard", "merge", &job, "-o", &temp.name("u.goblin"), "--max-bytes", "100"], 1);
    assert!(said.contains("100"), "{said}");
    assert!(!temp.path("u.goblin").exists());
    // To standard output, too.
    let written = spinney(&["-q", "shard", "merge", &job, "-o", "-"]).success().get_output().stdout.clone();
    assert!(written == fs::read(&tree).unwrap());
}
