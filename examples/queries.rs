//! Builds a tree from a raster and queries it, using only the library.
//!
//! `cargo run --release --example queries -- fixtures/island_elevation.tif`

use std::path::PathBuf;

use spinney::import::raster::{ImportOptions, plan};
use spinney::query::Condition;
use spinney::raw::dataset::open;
use spinney::{Bounds, Number, Output};

fn main() -> spinney::Result<()> {
    let input = std::env::args_os()
        .nth(1)
        .map_or_else(|| PathBuf::from("fixtures/island_elevation.tif"), PathBuf::from);
    let file = std::env::temp_dir().join("queries.goblin");

    // The raster's content determines the aggregation rule; options can override it.
    let import = plan(&[input], &ImportOptions::new())?;
    import.build(Output::create(&file)?, &())?;

    let tree = open(&file, &Default::default())?;
    println!("{} levels, {} segments, {} bytes", tree.depth(), tree.segments(), tree.file_size());

    // One cell of the deepest level, and the average of the block of 16 x 16 cells around it.
    let mut value = [Number::default(); 4];
    for level in [tree.depth(), tree.depth() - 4] {
        let shift = tree.depth() - level;
        let there = tree.point([128 >> shift, 100 >> shift, 0], level, &mut value)?;
        println!("level {level}: {}", if there { value[0].to_string() } else { "void".into() });
    }

    // A window of coarse detail, as bytes that can be written or displayed.
    let level = tree.depth() - 3;
    let bounds = Bounds { min: [8, 8, 0], max: [16, 16, 1] };
    let mut bytes = vec![0; bounds.volume() as usize * tree.header().form.width()];
    tree.window(level, &bounds, f64::NAN, &mut bytes, None)?;
    println!("{} bytes of an 8 x 8 window", bytes.len());

    // Statistics of a region, from those that are stored with every segment.
    let region = Bounds { min: [64, 50, 0], max: [192, 150, 1] };
    let statistics = tree.statistics(Some(region), &())?;
    println!("{} cells, first channel {:?}", statistics.cells, statistics.channels.first());

    // The first large blocks above the mean.
    let mean = statistics.channels.first().map_or(0.0, |channel| channel.mean);
    let mut left = 5;
    tree.find(Condition::Above(mean.into()), Some(region), &(), &mut |block| {
        println!("{} of level {}: {:?}", block.code, block.level, block.bounds.min);
        left -= 1;
        Ok(left > 0)
    })
}
