//! `spinney build` with several files: lists, and many of them.

use std::fs;

use crate::common::command::{complaint, spinney, stdout};
use crate::common::directory::TestDirectory;
use crate::common::tiff_file::{Ifd, Values, file};

/// Georeferences an image: its corner is at west and 100, with a cell width.
fn placed(ifd: Ifd, west: f64, cell: f64) -> Ifd {
    let keys = [1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32632];
    ifd.tag(33550, Values::Double(vec![cell, cell, 0.0]))
        .tag(33922, Values::Double(vec![0.0, 0.0, 0.0, west, 100.0, 0.0]))
        .short(34735, &keys)
}

/// Returns the value of a cell.
fn value(tree: &str, x: u64, y: u64) -> String {
    stdout(&["point", tree, "--in", "cells", &format!("{x},{y}")]).trim().into()
}

#[test]
fn lists_name_more_files_than_are_open_at_once() {
    let temp = TestDirectory::new();
    fs::create_dir(temp.name("tiles")).unwrap();
    let mut list = "# tiles, from west to east\n\n".to_string();
    for number in 0..40u8 {
        let tile = placed(Ifd::grey(4, 300, vec![number; 1200]), 4.0 * f64::from(number), 1.0);
        temp.write(&format!("tiles/{number}.tif"), file(&[tile]));
        list += &format!("  {number}.tif\r\n");
    }
    let list = temp.write("tiles/list.txt", list);
    let last = temp.write("last.tif", file(&[placed(Ifd::grey(2, 2, vec![99; 4]), 158.0, 1.0)]));
    let out = temp.name("o.goblin");
    spinney(&["-q", "build", &format!("@{list}"), &last, "-o", &out]).success();
    for (x, y, expected) in [(0, 0, "0"), (7, 299, "1"), (157, 0, "39"), (158, 0, "99"), (158, 2, "39")] {
        assert_eq!(value(&out, x, y), expected, "{x}, {y}");
    }
    let empty = temp.write("empty.txt", "# nothing\n");
    assert!(
        complaint(&["build", &format!("@{empty}"), "-o", &out], 1).contains("the list of inputs is empty")
    );
    let gone = complaint(&["build", "@/gone/list.txt", "-o", &out], 1);
    assert!(gone.contains("/gone/list.txt: cannot read the list of inputs"), "{gone}");
    let wrong = temp.write("wrong.txt", "tiles/0.tif\ntiles/77.tif\n");
    assert!(complaint(&["build", &format!("@{wrong}"), "-o", &out], 1).contains("77.tif"));
}

#[test]
fn stacks_are_planned_from_files_bands_and_pages() {
    let temp = TestDirectory::new();
    let out = temp.name("o.goblin");
    let one = temp.write("B02.tif", file(&[placed(Ifd::grey(4, 4, vec![2; 16]), 0.0, 10.0)]));
    spinney(&["-q", "build", &one, "-o", &out, "--stack"]).success();
    assert_eq!(value(&out, 3, 3), "2");
    let shifted = temp.write("B03.tif", file(&[placed(Ifd::grey(4, 4, vec![3; 16]), 5.0, 10.0)]));
    let text = complaint(&["build", &one, &shifted, "-o", &out, "--stack"], 1);
    assert!(text.contains("B03.tif") && text.contains("--resampling"), "{text}");
    spinney(&["-q", "build", &one, &shifted, "-o", &out, "--stack", "--resampling", "nearest"]).success();
    assert!(stdout(&["info", &out]).contains("B03"));
    let text = complaint(&["build", &one, &one, "-o", &out, "--stack"], 1);
    assert!(text.contains("`B02`") && text.contains("--names"), "{text}");
    let many = Ifd::grey(1, 1, vec![1, 2, 3, 4, 5]).short(258, &[8; 5]).short(277, &[5]);
    let many = temp.write("many.tif", file(&[many]));
    // Bands that do not form one value become layers in any case.
    let made = spinney(&["build", &many, "-o", &out]).success().get_output().clone();
    let text = String::from_utf8([made.stdout, made.stderr].concat()).unwrap();
    assert!(text.contains("a layer of each") && stdout(&["info", &out]).contains("many_5"), "{text}");
    assert!(text.contains(&format!("next       spinney info {out}")), "{text}");
    spinney(&["-q", "build", &many, "-o", &out, "--stack", "--band", "4", "--names", "x"]).success();
    assert_eq!(value(&out, 0, 0), "4");
    assert!(
        complaint(&["build", &many, "-o", &out, "--stack", "--names", "a,b"], 1).contains("5, one per layer")
    );
    // Pages, and incompatible files.
    let pages: Vec<Ifd> = (1..4).map(|page| Ifd::grey(2, 1, vec![page, page + 10])).collect();
    let pages = temp.write("pages.tif", file(&pages));
    spinney(&["-q", "build", &pages, "-o", &out, "--pages", "z"]).success();
    assert_eq!(stdout(&["point", &out, "--in", "cells", "1,0,2"]).trim(), "13");
    let text = complaint(&["build", &pages, "-o", &out, "--pages", "layers", "--names", "a"], 1);
    assert!(text.contains("3, one per layer"), "{text}");
    for (words, expected) in [
        (&["--pages", "x"][..], "layers, z, or a number"),
        (&["--pages", "z", "--band", "1"], "have no effect on volumes"),
        (&["--names", "a"], "--stack"),
        (&["--stack", "--grid", "xyz"], "--grid"),
    ] {
        let code = if words == ["--pages", "x"] { 2 } else { 1 };
        let text = complaint(&[&["build", &pages, "-o", &out], words].concat(), code);
        assert!(text.contains(expected), "{words:?}: {text}");
    }
}
