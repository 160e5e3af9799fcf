//! Set operations on polygons with the program: messages, conditions, regions, and errors.

use crate::common::command::{spinney, stderr};

const A: &str = r#"{"type":"FeatureCollection","features":[
{"type":"Feature","properties":{"soil":"clay"},"geometry":{"type":"Polygon","coordinates":[[[0,0],[4,0],[4,4],[0,4],[0,0]]]}},
{"type":"Feature","properties":{"soil":"sand"},"geometry":{"type":"Polygon","coordinates":[[[4,0],[8,0],[8,4],[4,4],[4,0]]]}}]}"#;
const B: &str = r#"{"type":"Feature","properties":{"owner":"Ada"},"geometry":{"type":"Polygon","coordinates":[[[2,1],[6,1],[6,3],[2,3],[2,1]]]}}"#;

#[test]
fn polygons_are_combined() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (a, b, c) = (at("a.geojson"), at("b.geojson"), at("c.geojson"));
    std::fs::write(&a, A).unwrap();
    std::fs::write(&b, B).unwrap();
    let area = |arguments: &[&str]| {
        let all = [&["combine"], arguments, &["-o", &c]].concat();
        let said = stderr(spinney(&all).success());
        let line = said.lines().find(|line| line.starts_with("result")).unwrap().to_owned();
        line.rsplit(' ').next().unwrap().parse::<f64>().unwrap()
    };
    assert_eq!(area(&["and", &a, &b]), 8.0);
    assert_eq!(area(&["union", &a, &b]), 32.0);
    assert_eq!(area(&["and", &a, &b, "--where", "soil=clay"]), 4.0);
    assert_eq!(area(&["nor", &a, &b, "--within", "-1,-1,9,5"]), 60.0 - 32.0);
    assert_eq!(area(&["not", &b, "--within", &a]), 24.0);
    assert_eq!(area(&["partition", &a, &b, &a, "--snap", "0.5"]), 32.0);
    let text = std::fs::read_to_string(&c).unwrap();
    assert!(text.contains(r#""features_1":"1","features_2":"1","features_3":"1""#), "{text}");
    let tree = at("a.goblin");
    spinney(&["-q", "build", &a, "--cell", "1", "-o", &tree]).success();
    let refused = |arguments: &[&str], reason: &str| {
        let output = at("refused.gpkg");
        let all = [&["combine"], arguments, &["-o", &output]].concat();
        let said = stderr(spinney(&all).failure());
        assert!(!said.contains("panicked"), "{said}");
        assert!(said.contains(reason), "{arguments:?}: {said}");
        assert!(!std::path::Path::new(&output).exists());
    };
    refused(&["and", &a, &at("none.geojson")], "none.geojson");
    refused(&["over", &a, &b], "over: works only with trees");
    refused(&["partition", &a, &tree], "partition: works only with polygon files");
    refused(&["nor", &a, &b], "region of the result");
    refused(&["b-a", &a, &b, &a], "one or two for this operation");
    refused(&["and", &a, &b, "--snap", "0"], "expected 1e-120 to 1e120");
    refused(&["and", &a, &b, "--values", "b"], "--values: has no effect on polygons");
    refused(
        &["and", &a, &b, "--edge", "touch"],
        "--edge: works only with features that are combined with trees",
    );
    refused(&["and", &a, &b, "--where", "colour=red"], "colour");
    refused(&["and", &a, &b, "--within", "1,2,3,4,5,6"], "got 6 numbers, expected 4 or a polygon file");
    refused(&["and", &a, &b, "--memory", "1k"], "memory");
    refused(&["and", &tree, &tree, "--snap", "1"], "--snap: works only with polygons");
    refused(&["nor", &tree, &tree, "--within", &a], "give a box");
}
