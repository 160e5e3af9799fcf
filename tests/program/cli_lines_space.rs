//! Trees of lines with heights: building and queries on the command line.

use std::fs;

use serde_json::Value;
use tempfile::TempDir;

use crate::common::command::{complaint, spinney, stderr, stdout};

struct Files {
    directory: TempDir,
}

impl Files {
    fn new() -> Files {
        Files { directory: tempfile::tempdir().unwrap() }
    }

    fn at(&self, name: &str) -> String {
        self.directory.path().join(name).to_str().unwrap().into()
    }

    fn write(&self, name: &str, text: &str) -> String {
        fs::write(self.at(name), text).unwrap();
        self.at(name)
    }

    /// A vertical shaft, two galleries at different depths that cross in the plan, and a ramp.
    fn mine(&self) -> String {
        let text = "wkt,name\n\
            \"LINESTRING Z (0 0 0,0 0 -100)\",shaft\n\
            \"LINESTRING Z (-50 0 -40,50 0 -40)\",upper\n\
            \"LINESTRING Z (10 -60 -70.5,10 60 -70.5)\",lower\n\
            \"MULTILINESTRING Z ((20 0 -40,40 0 -55,40 40 -70),(40 40 -70,10 40 -70.5))\",ramp\n";
        let input = self.write("mine.csv", text);
        let tree = self.at("mine.goblin");
        stdout(&["build", &input, "-o", &tree, "--index", "lines"]);
        tree
    }
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&stdout(arguments)).unwrap()
}

#[test]
fn heights_are_an_axis() {
    let files = Files::new();
    let tree = files.mine();
    let info = json(&["info", &tree, "--json"]);
    assert_eq!(info["tree"], "octree of lines");
    let expected = 100.0 + 100.0 + 120.0 + 25.0 + (40f64.powi(2) + 15.0 * 15.0).sqrt() + 30f64.hypot(0.5);
    assert!((info["length"].as_f64().unwrap() - expected).abs() < 1e-9);
    assert_eq!(info["bounds"], serde_json::json!([[-50.0, -60.0, -100.0], [50.0, 60.0, 0.0]]));
    assert!(stdout(&["info", &tree]).contains("bounds      -50, -60, -100 to 50, 60, 0"));
    assert_eq!(stdout(&["verify", &tree]), format!("{tree}: good\n"));
    // Windows in space, and of all heights.
    let names = |window: &str| {
        let out = files.at("part.csv");
        stdout(&["get", &tree, &out, "--window", window, "--attribute", "name"]);
        let text = fs::read_to_string(&out).unwrap();
        text.lines().skip(1).filter_map(|line| line.rsplit(',').next()).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(names("9,-1,-50,11,1,-30"), "upper");
    assert_eq!(names("9,-1,11,1"), "upper lower");
    assert_eq!(names("-1,-1,-100,1,1,-100"), "shaft");
    assert_eq!(stdout(&["stats", &tree, "--window", "9,-1,-50,11,1,-30"]), "features    1\n");
    // Nearest lines in space and in the plan, with the height of the nearest point.
    assert_eq!(stdout(&["point", &tree, "12,5,-70.5"]), "1\t2\t10,5,-70.5\t2\n");
    assert_eq!(stdout(&["point", &tree, "10,5,-41"]), "1\t5.0990195135927845\t10,0,-40\t1\n");
    assert_eq!(stdout(&["point", &tree, "12,5"]), "1\t2\t10,5,-70.5\t2\n");
    // Heights come out again.
    for name in ["back.geojson", "back.csv", "back.shp", "back.obj"] {
        stdout(&["get", &tree, &files.at(name)]);
    }
    let back: Value = serde_json::from_str(&fs::read_to_string(files.at("back.geojson")).unwrap()).unwrap();
    let shaft = &back["features"][0]["geometry"]["coordinates"];
    assert_eq!(*shaft, serde_json::json!([[0, 0, 0], [0, 0, -100]]));
    assert!(fs::read_to_string(files.at("back.csv")).unwrap().contains("\"LINESTRING Z (0 0 0,0 0 -100)\""));
    let again = files.at("again.goblin");
    stdout(&["build", &files.at("back.shp"), "-o", &again, "--index", "lines"]);
    assert_eq!(json(&["info", &again, "--json"])["length"], info["length"]);
}

#[test]
fn lines_cross_in_space_and_lines_without_heights_at_any() {
    let files = Files::new();
    let tree = files.mine();
    let crossings = |text: &str, radius: &[&str]| {
        let lines = files.write("other.csv", text);
        let out = files.at("crossings.csv");
        stdout(&[&["stats", &tree, "--crossing", &lines, "-o", &out], radius].concat());
        let text = fs::read_to_string(&out).unwrap();
        text.lines().skip(1).map(str::to_owned).collect::<Vec<_>>()
    };
    // Through the shaft at -50, and above the lower gallery: it meets the shaft only.
    let inclined = "wkt,bore\n\"LINESTRING Z (-10 0 -60,10 0 -40)\",a\n";
    assert_eq!(
        crossings(inclined, &[]),
        ["\"POINT Z (0 0 -50)\",a,0,shaft", "\"POINT Z (10 0 -40)\",a,1,upper"]
    );
    let near = crossings(inclined, &["--radius", "31"]);
    assert_eq!(near.len(), 4, "{near:?}");
    let lower = format!("\"POINT Z (-5.25 0 -55.25)\",a,2,{},lower", 15.25f64.hypot(15.25));
    assert!(near.contains(&lower), "{near:?}");
    // In the plan, with the height of the tree's line.
    let flat = "wkt,road\n\"LINESTRING (5 -5,15 5)\",b\n";
    assert_eq!(
        crossings(flat, &[]),
        ["\"POINT Z (10 0 -40)\",b,1,upper", "\"POINT Z (10 0 -70.5)\",b,2,lower"]
    );
    let counted = json(&["stats", &tree, "--crossing", &files.at("other.csv"), "--json"]);
    assert_eq!(counted, serde_json::json!({ "lines": 1, "features": 2, "crossings": 2 }));
    let (lines, out) = (files.write("other.csv", inclined), files.at("features.csv"));
    stdout(&["get", &tree, &out, "--crossing", &lines, "--radius", "31", "--attribute", "name"]);
    assert_eq!(fs::read_to_string(&out).unwrap().lines().count(), 5);
    // Points with and without heights.
    let points = files.write("points.csv", "wkt,id\nPOINT Z (12 5 -70.5),7\nPOINT (12 5),8\n");
    let out = files.at("joined.csv");
    let warned = stderr(spinney(&["stats", &tree, "--nearest", &points, "-o", &out]));
    assert!(warned.contains("the heights of 1 points are not written"), "{warned}");
    assert_eq!(
        fs::read_to_string(&out).unwrap().lines().skip(1).collect::<Vec<_>>(),
        ["\"POINT (12 5)\",7,2,2,lower", "\"POINT (12 5)\",8,2,2,lower"]
    );
    for radius in ["-1", "nan", "inf"] {
        let text = complaint(&["stats", &tree, "--crossing", &lines, &format!("--radius={radius}")], 1);
        assert!(text.contains("a finite number of at least 0"), "{text}");
    }
}

#[test]
fn heights_that_some_lines_lack_and_degrees_are_no_lengths() {
    let files = Files::new();
    let text = "wkt,n\n\"LINESTRING Z (0 0 1,3 4 2)\",1\n\"LINESTRING (0 0,1 0)\",2\n";
    let (mixed, tree) = (files.write("mixed.csv", text), files.at("mixed.goblin"));
    let warned = stderr(spinney(&["build", &mixed, "-o", &tree, "--index", "lines"]));
    assert!(warned.contains("1 features have measures, or heights that other features lack"), "{warned}");
    let info = json(&["info", &tree, "--json"]);
    assert_eq!((&info["tree"], &info["length"]), (&"quadtree of lines".into(), &6.0.into()));
    let text = complaint(&["point", &tree, "1,2,3"], 1);
    assert!(text.contains("expected 2 for a tree of lines without heights"), "{text}");
    let text = complaint(&["stats", &tree, "--window", "0,0,0,1,1,1"], 1);
    assert!(text.contains("expected 4 for a tree of lines without heights"), "{text}");
    // A track in degrees and metres: lengths and distances are those in the plan.
    let line = "[[7.0,46.0,400.5],[7.03,46.04,3000.25]]";
    let track = files.write("track.geojson", &format!(r#"{{"type":"LineString","coordinates":{line}}}"#));
    let tree = files.at("track.goblin");
    stdout(&["build", &track, "-o", &tree, "--index", "lines"]);
    let info = json(&["info", &tree, "--json"]);
    assert_eq!((&info["tree"], &info["length"]), (&"octree of lines".into(), &0.05.into()));
    assert_eq!(info["scale"], serde_json::json!([0.01, 0.01, 0.01]));
    assert_eq!(info["length_axes"], 2);
    for command in ["info", "stats"] {
        assert!(stdout(&[command, &tree]).contains("length 0.05 in x and y"), "{command}");
    }
    assert!(stdout(&["point", &tree, "7.03,46.04,0"]).starts_with("1\t0\t7.03,46.04,3000.25"));
    assert_eq!(stdout(&["stats", &tree, "--window", "7,46,3000,8,47,3001"]), "features    1\n");
    assert_eq!(stdout(&["stats", &tree, "--window", "7,46,3001,8,47,3002"]), "features    0\n");
    assert_eq!(stdout(&["verify", &tree]), format!("{tree}: good\n"));
    // In metres, they are those in space.
    let tree = files.at("metres.goblin");
    stdout(&["build", &track, "-o", &tree, "--index", "lines", "--crs", "EPSG:2056"]);
    let length = json(&["info", &tree, "--json"])["length"].as_f64().unwrap();
    assert!((length - 2599.75f64.hypot(0.05)).abs() < 1e-9, "{length}");
}

#[test]
fn edges_of_meshes_are_lines() {
    let files = Files::new();
    // A unit cube of squares, without its top.
    let text = "o box\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
        f 4 3 2 1\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    let (mesh, tree) = (files.write("box.obj", text), files.at("edges.goblin"));
    stdout(&["build", &mesh, "-o", &tree, "--index", "lines", "--memory", "16M"]);
    let info = json(&["info", &tree, "--json"]);
    assert_eq!((&info["features"], &info["length"]), (&12.into(), &12.0.into()));
    assert_eq!(info["attributes"], serde_json::json!(["object", "faces"]));
    let out = files.at("top.csv");
    stdout(&["get", &tree, &out, "--window", "0,0,1,1,1,1"]);
    let text = fs::read_to_string(&out).unwrap();
    // The four open edges of the top, and the ends of the four vertical ones.
    let open = text.lines().filter(|line| line.ends_with("box,1")).count();
    assert_eq!((open, text.lines().count()), (4, 9), "{text}");
    assert_eq!(stdout(&["verify", &tree]), format!("{tree}: good\n"));
    let raised = files.at("raised.goblin");
    stdout(&["build", &mesh, "-o", &raised, "--index", "lines", "--up", "y"]);
    assert_eq!(json(&["info", &raised, "--json"])["bounds"][0], serde_json::json!([0.0, -1.0, 0.0]));
    let text = complaint(&["build", &mesh, "-o", &raised, "--index", "lines", "--where", "n=1"], 1);
    assert!(text.contains("--where"), "{text}");
    let coloured = files.write("coloured.obj", "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n");
    let warned = stderr(spinney(&["build", &coloured, "-o", &raised, "--index", "lines"]));
    assert!(warned.contains("a tree of edges does not have colours: not stored"), "{warned}");
    // Lines of an OBJ file are no faces.
    let lines = files.write("lines.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n");
    let text = complaint(&["build", &lines, "-o", &raised, "--index", "lines"], 1);
    assert!(text.contains("found none with vertices, expected a model with faces"), "{text}");
    let broken = files.write("broken.ply", "ply\nformat ascii 1.0\nelement vertex 1\n");
    complaint(&["build", &broken, "-o", &raised, "--index", "lines"], 1);
    let other = files.write("other.txt", "neither");
    let text = complaint(&["build", &other, "-o", &raised, "--index", "lines"], 1);
    assert!(text.contains("neither a feature file nor a mesh"), "{text}");
}
