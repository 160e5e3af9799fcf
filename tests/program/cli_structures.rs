//! `spinney dump --as`: structures of the literature from trees of lines and points.

use std::collections::BTreeSet;
use std::fs;

use crate::common::command::{complaint, stdout};

/// Builds a tree from a table, and returns its path.
fn tree(directory: &tempfile::TempDir, name: &str, table: &str, index: &str) -> String {
    let path = |extension: &str| directory.path().join(format!("{name}.{extension}"));
    fs::write(path("csv"), table).unwrap();
    let (input, output) = (path("csv"), path("goblin"));
    stdout(&["build", input.to_str().unwrap(), "-o", output.to_str().unwrap(), "--index", index]);
    output.to_str().unwrap().to_owned()
}

/// The polygonal map of Samet and Webber has this shape: lines that meet in vertices, in 16 x 16.
const MAP: &str = "wkt,n\n\
    \"LINESTRING (0 0,5 13,15 15)\",1\n\
    \"LINESTRING (5 13,8 6,15 15)\",2\n\
    \"LINESTRING (8 6,2 2)\",3\n";

#[test]
fn edges_are_pm_quadtrees() {
    let directory = tempfile::tempdir().unwrap();
    let tree = tree(&directory, "map", MAP, "lines");
    let mut leaves = Vec::new();
    for rule in ["pm1", "pm2", "pm3"] {
        let text = stdout(&["dump", &tree, "--as", rule]);
        let (expression, rows) = text.split_once('\n').unwrap();
        let (full, all) = (expression.matches('B').count(), expression.len());
        assert_eq!(rows.lines().count(), full);
        // A quadtree has three leaves for each division, and one more.
        let divided = expression.matches('G').count();
        assert_eq!(all, 4 * divided + 1, "{expression}");
        let edges: BTreeSet<&str> = rows.lines().flat_map(|row| row.split('\t').skip(2)).collect();
        let expected = ["0,0 5,13", "5,13 15,15", "5,13 8,6", "8,6 15,15", "2,2 8,6"];
        assert_eq!(edges, expected.into_iter().collect(), "{rule}");
        let stats = stdout(&["dump", &tree, "--as", rule, "--stats"]);
        assert!(stats.contains(&format!("divided     {divided} nodes\n")), "{stats}");
        assert!(stats.contains("5 in the file") && stats.contains("file        1 nodes"), "{stats}");
        leaves.push(full);
    }
    assert!(leaves[0] >= leaves[1] && leaves[1] >= leaves[2] && leaves[0] > leaves[2], "{leaves:?}");
    assert_eq!(stdout(&["dump", &tree, "--as", "bucket"]).lines().next(), Some("B"));
    let buckets = stdout(&["dump", &tree, "--as", "bucket", "--leaf-size", "2"]);
    assert!(buckets.starts_with('G'), "{buckets}");
}

#[test]
fn edges_in_space_are_octrees() {
    let directory = tempfile::tempdir().unwrap();
    let table = "wkt,n\n\"LINESTRING Z (0 0 0,7 0 0)\",1\n\"LINESTRING Z (0 7 7,7 7 7)\",2\n";
    let tree = tree(&directory, "two", table, "lines");
    let text = stdout(&["dump", &tree, "--as", "pm1"]);
    assert_eq!(text.lines().next(), Some("MFFVVVVFF"));
    assert_eq!(text.lines().nth(1), Some("0,0,0\t4\t0,0,0 7,0,0"));
}

#[test]
fn points_are_divided_at_points() {
    let directory = tempfile::tempdir().unwrap();
    let table = "x,y,n\n1,1,1\n5,3,2\n2,7,3\n6,6,4\n6,6,5\n";
    let plane = tree(&directory, "plane", table, "points");
    for structure in ["point-quadtree", "k-d"] {
        let text = stdout(&["dump", &plane, "--as", structure]);
        let rows: Vec<Vec<&str>> = text.lines().map(|row| row.split('\t').collect()).collect();
        assert_eq!((rows.len(), rows[0][0], rows[0][1]), (4, "0", "root"), "{text}");
        assert!(rows.iter().any(|row| row[2..] == ["6,6", "2"]), "{text}");
        let stats = stdout(&["dump", &plane, "--as", structure, "--stats"]);
        assert!(stats.contains("nodes       4\n") && stats.contains("points      5\n"), "{stats}");
    }
    let space = tree(&directory, "space", "x,y,z\n1,1,1\n5,3,2\n2,7,9\n", "points");
    assert_eq!(stdout(&["dump", &space, "--as", "point-octree"]).lines().count(), 3);
    let text = complaint(&["dump", &space, "--as", "point-quadtree"], 1);
    assert!(text.contains("expected point-octree or k-d"), "{text}");
    let text = complaint(&["dump", &plane, "--as", "k-d", "--limit", "4"], 1);
    assert!(text.contains("has 5 points, expected at most 4; raise --limit"), "{text}");
}

#[test]
fn structures_that_a_file_does_not_have_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let (lines, classic) = (
        tree(&directory, "map", MAP, "lines"),
        concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/classic.goblin"),
    );
    for (arguments, expected) in [
        (vec!["dump", &lines], "--as: got nothing, expected pm1, pm2, pm3 or bucket"),
        (vec!["dump", &lines, "--as", "df"], "--as: got df, expected pm1, pm2, pm3 or bucket"),
        (vec!["dump", &classic, "--as", "k-d"], "--as: got k-d, expected df or bintree"),
        (vec!["dump", &classic, "--as", "df", "--adaptive"], "works only with --as bintree"),
        (vec!["dump", &classic, "--as", "df", "--leaf-size", "3"], "works only with --as bucket"),
        (vec!["dump", &classic, "--as", "df", "--stats"], "works only with structures of lines and points"),
        (vec!["dump", &lines, "--as", "pm1", "--limit", "6"], "leaves have more than 6 edges; raise --limit"),
    ] {
        let text = complaint(&arguments, 1);
        assert!(text.contains(expected), "{text}");
    }
}
