//! `spinney dump --as`: structures of the literature from trees of lines and points, and from class
//! maps.

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
        (vec!["dump", &lines], "--as: got nothing, expected bsp, pm1, pm2, pm3 or bucket"),
        (vec!["dump", &lines, "--as", "df"], "--as: got df, expected bsp, pm1, pm2, pm3 or bucket"),
        (vec!["dump", &classic, "--as", "k-d"], "--as: got k-d, expected df, bintree or bsp"),
        (vec!["dump", &classic, "--as", "df", "--adaptive"], "works only with --as bintree"),
        (vec!["dump", &classic, "--as", "df", "--leaf-size", "3"], "works only with --as bucket"),
        (vec!["dump", &classic, "--as", "bsp"], "which needs --class"),
        (vec!["dump", &classic, "--as", "df", "--class", "1"], "works only with --as bsp"),
        (vec!["dump", &classic, "--as", "bsp", "--class", "9"], "no cell has the value 9"),
        (
            vec!["dump", &classic, "--as", "bsp", "--class", "1", "--eye", "1,2,3"],
            "works only with exact models",
        ),
        (vec!["dump", &lines, "--as", "pm1", "--limit", "6"], "leaves have more than 6 edges; raise --limit"),
    ] {
        let text = complaint(&arguments, 1);
        assert!(text.contains(expected), "{text}");
    }
}

/// Lines divide the plane; each half-plane is on the side that its line's numbers say.
#[test]
fn lines_are_bsp_trees() {
    let directory = tempfile::tempdir().unwrap();
    let lines = tree(&directory, "map", MAP, "lines");
    let text = stdout(&["dump", &lines, "--as", "bsp"]);
    let nodes: Vec<&str> = text.lines().skip(1).map(str::trim).collect();
    let divided = nodes.iter().filter(|node| node.contains('#')).count();
    assert_eq!((nodes.len(), divided >= 5), (2 * divided + 1, true), "{text}");
    // The end 2, 2 of the last edge is on its line, in grid units from the text's corner.
    let words: Vec<f64> =
        text.lines().next().unwrap().split([' ', ',', ';']).filter_map(|word| word.parse().ok()).collect();
    let [width, _, x, y] = words[..] else { panic!("{words:?}") };
    let on_line = |node: &str| {
        let numbers: Vec<f64> =
            node.split('#').next().unwrap().split_whitespace().map(|word| word.parse().unwrap()).collect();
        let [a, b, d] = numbers[..] else { panic!("{node}") };
        a * ((2.0 - x) / width) + b * ((2.0 - y) / width) + d == 0.0
    };
    assert!(nodes.iter().any(|node| node.contains('#') && on_line(node)), "{text}");
    let stats = stdout(&["dump", &lines, "--as", "bsp", "--stats"]);
    assert!(
        stats.contains(&format!("divided     {divided} nodes\n")) && stats.contains("file   "),
        "{stats}"
    );
}

/// The expression of the literature is built from its text alone, and printed again.
#[test]
fn df_expressions_are_built() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    for (name, text, head) in [
        ("paper", "GWGWWBBGWGWBBBWBGBBGBBBWW", "df:xy:3:u8:8x8"),
        ("octree", "MVVVVFMVVVVVVVFFF", "df:xyz:2:u8:4x4x4"),
        ("leaf", "7", "df:xy:0:u8:1x1"),
        ("wide", "df:xy:2:i16:4x3 GG7[-7]WW[300]WW", "df:xy:2:i16:4x3"),
    ] {
        let symbols = text.split_whitespace().last().unwrap();
        for (round, text) in [text.to_owned(), format!("{head} {symbols}")].into_iter().enumerate() {
            let (input, tree) = (path(&format!("{name}{round}.df")), path(&format!("{name}{round}.goblin")));
            fs::write(&input, text).unwrap();
            stdout(&["build", &input, "-o", &tree, "--kind", "categorical"]);
            assert_eq!(stdout(&["dump", &tree, "--as", "df"]).trim(), format!("{head} {symbols}"));
        }
    }
    let paper = path("paper0.goblin");
    let stats = stdout(&["dump", &paper, "--as", "df", "--stats"]);
    // 25 symbols of two bits, and eleven leaves of a byte.
    assert!(
        stats.contains("symbols     25, 11 of them") && stats.contains("bytes       18, with"),
        "{stats}"
    );
    for (text, expected) in [
        ("", "its end after symbol 0"),
        ("GWW", "its end after symbol 3"),
        ("GWWWWW", "1 symbols after the end"),
        ("GWWWx", "one of G B W M F V"),
        ("df:xy:2:u8:9x4 W", "expected `df:xy:DEPTH:TYPE:WIDTHxHEIGHT`"),
        ("df:xy:2:u8:3x4 GWBWW", "values beyond the extent"),
        ("df:xy:1:i8:2x2 GWBWW", "255, which B and F mean, is none"),
        ("df:xy:1:u8:2x2 GWGWWWWWW", "a depth of at most 1"),
        (&"G".repeat(40), "at most 29 levels"),
    ] {
        let input = path("bad.df");
        fs::write(&input, text).unwrap();
        let found = complaint(&["build", &input, "-o", &path("bad.goblin")], 1);
        assert!(found.contains(expected), "{text}: {found}");
    }
}

/// The BSP tree of a class is built as the cells of that class.
#[test]
fn classes_are_bsp_trees() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let classes = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/classic.goblin");
    let (text, tree, mask) = (path("class.bsp"), path("class.goblin"), path("mask.goblin"));
    for class in ["1", "2", "3"] {
        fs::write(&text, stdout(&["dump", classes, "--as", "bsp", "--class", class])).unwrap();
        stdout(&["build", &text, "-o", &tree, "--kind", "categorical"]);
        let mask_of = format!("calc=(b1=={class})*255,type=u8");
        stdout(&["transform", classes, &mask_of, "void=0", "-o", &mask]);
        let [built, expected] = [&tree, &mask].map(|tree| stdout(&["dump", tree, "--as", "df"]));
        assert_eq!(built, expected, "{class}");
    }
    let stats = stdout(&["dump", classes, "--as", "bsp", "--class", "2", "--stats"]);
    assert!(stats.contains(" inside, ") && stats.contains("depth  "), "{stats}");
    for (text, expected) in [
        ("bsp:xy:3:u8:8x8\n1 0 -4\nin\n", "1 more nodes"),
        ("bsp:xy:3:u8:8x8\n1 0 0 -4\nin\nout\n", "a line, `A B D`"),
        ("bsp:xy:3:u8:8x8\n0 0 4\nin\nout\n", "a line, `A B D`"),
        ("bsp:xy:3:f32:8x8\nin\n", "expected `bsp:xy:DEPTH:u8:WIDTHxHEIGHT`"),
        ("bsp:xy:3:u8:8x8\nin\nout\n", "the tree is complete"),
        ("bsp:xy:29:u8:8x8\nin\n", "expected `bsp:xy:DEPTH:u8:WIDTHxHEIGHT`"),
    ] {
        let input = path("bad.bsp");
        fs::write(&input, text).unwrap();
        let found = complaint(&["build", &input, "-o", &path("bad.goblin")], 1);
        assert!(found.contains(expected), "{text}: {found}");
    }
}
