//! Images of fixtures, compared with reviewed ones. After an intended change, review the new images
//! and copy them to `fixtures/reviewed_images/`.

use std::path::Path;

use spinney::Region;
use spinney::raw::import::raster::{self, Pixels};

use crate::common::command::{command, stdout};

/// Returns the columns, rows and samples of an image.
fn read_image(path: &Path) -> ([u64; 2], Vec<u8>) {
    let mut raster = raster::open(path, &Default::default()).unwrap();
    let mut pixels = Pixels::default();
    let size = [raster.info().width, raster.info().height];
    raster.read(Region::new(0, 0, size[0], size[1]), &mut pixels).unwrap();
    (size, pixels.bytes)
}

#[test]
fn images_match_the_reviewed_ones() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let heights = name("heights.goblin");
    command(&["-q", "build", "fixtures/island_elevation.tif", "-o", &heights]).assert().success();
    for (file, words) in [
        ("chapel.png", &["render", "fixtures/v1/chapel.goblin", "--size", "160"][..]),
        ("ball.png", &["render", "fixtures/v1/ball.goblin", "--size", "120"]),
        ("terrain.png", &["get", &heights, "--size", "128", "--style", "terrain"]),
        ("legend.png", &["legend", &heights, "--style", "terrain"]),
    ] {
        let out = name(file);
        command(&[words, &["-q", "-o", &out]].concat()).assert().success();
        let (size, samples) = read_image(Path::new(&out));
        let (wanted_size, wanted) = read_image(&Path::new("fixtures/reviewed_images").join(file));
        assert_eq!((size, samples.len()), (wanted_size, wanted.len()), "{file}");
        // Other processors may round differently.
        let sum: u64 = samples.iter().zip(&wanted).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        let mean = sum as f64 / samples.len() as f64;
        assert!(mean < 0.5, "{file}: differs by {mean} on average");
    }
}

#[test]
fn terminals_show_what_is_there() {
    let text = stdout(&["show", "fixtures/v1/chapel.goblin", "--size", "60x24"]);
    let wanted = std::fs::read_to_string("fixtures/reviewed_images/chapel.txt").unwrap();
    let others = text.chars().zip(wanted.chars()).filter(|(a, b)| a != b).count();
    assert!(text.lines().count() == wanted.lines().count() && others < 20, "{text}");
    for (file, rows) in [("fixtures/v1/classes.goblin", 5), ("fixtures/v1/ball.goblin", 20)] {
        let text = stdout(&["show", file, "--size", "50x22"]);
        assert!(
            text.lines().count() >= rows && text.lines().all(|line| line.chars().count() <= 50),
            "{text}"
        );
        // Without a terminal there are no colours.
        assert!(!text.contains('\u{1b}'), "{text}");
    }
}
