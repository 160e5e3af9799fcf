//! Writes the files in `fixtures/`, the same bytes every time:
//!
//!     cargo run --example make_fixtures
//!
//! With `--frozen` it also writes `fixtures/v1/`, the Goblin files that every later version must be
//! able to read. Those must not change any more: a new format version gets a new directory.

mod frozen;
mod island;

use std::path::{Path, PathBuf};

use island::{HEIGHT, Island, WIDTH};
use spinney::raw::export::image::{ImageSpec, create, format_of};
use spinney::raw::value::Palette;
use spinney::{Frame, Metadata, Output, Result, SampleType, ValueType};

fn main() -> Result<()> {
    let directory = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let island = island::make();
    write_images(&directory, &island)?;
    if std::env::args().any(|argument| argument == "--frozen") {
        for name in frozen::FILES {
            frozen::make(name, &island, &directory.join("v1").join(format!("{name}.goblin")))?;
        }
        for (codec, end) in frozen::CODECS {
            let path = |name: &str| directory.join("v1").join(format!("{name}{end}.goblin"));
            frozen::make_model(&path(frozen::MODEL), codec)?;
            frozen::make_crossing(&path(frozen::CROSSING), codec)?;
        }
        let history = directory.join("v1/history.autumn");
        // (Files with a history are not replaced.)
        let _ = std::fs::remove_file(&history);
        frozen::make_history(&island, &history)?;
        for name in frozen::STACKS {
            let path = directory.join("v1").join(name);
            let _ = std::fs::remove_file(&path);
            frozen::make_stack(&island, &path)?;
        }
    }
    Ok(())
}

fn spec(size: [usize; 2], sample: SampleType, channels: u8, frame: Option<Frame>) -> ImageSpec {
    ImageSpec {
        width: size[0] as u64,
        height: size[1] as u64,
        value: ValueType::new(sample, channels),
        alpha: false,
        void: false,
        metadata: Metadata { frame: frame.unwrap_or_else(Frame::identity), ..Metadata::default() },
    }
}

fn write(path: &Path, spec: &ImageSpec, bytes: &[u8]) -> Result<()> {
    let format = format_of(path).expect("a known extension");
    let mut writer = create(Output::create(path)?, format, spec)?;
    writer.write_rows(bytes, None)?;
    writer.finish()
}

fn write_images(directory: &Path, island: &Island) -> Result<()> {
    let size = [WIDTH, HEIGHT];
    let frame = Some(frozen::frame());

    // Land cover: a palette, 0 is no data.
    let classes: Vec<u8> = island.cover.iter().map(|cover| *cover as u8).collect();
    let palette = Some(Palette { colours: island::COLOURS.to_vec() });
    let mut spec_classes = spec(size, SampleType::U8, 1, frame.clone());
    spec_classes.void = true;
    (spec_classes.metadata.nodata, spec_classes.metadata.palette) = (Some(0.into()), palette);
    write(&directory.join("island_classes.png"), &spec_classes, &classes)?;
    spec_classes.metadata.band_names = vec!["land cover".into()];
    write(&directory.join("island_classes.tif"), &spec_classes, &classes)?;

    // Heights: -9999 is no data.
    let nodata = -9999f32;
    let heights: Vec<u8> =
        island.elevation().iter().flat_map(|height| height.unwrap_or(nodata).to_le_bytes()).collect();
    let mut spec_heights = spec(size, SampleType::F32, 1, frame);
    (spec_heights.void, spec_heights.metadata.nodata) = (true, Some(nodata.into()));
    spec_heights.metadata.band_names = vec!["height".into()];
    write(&directory.join("island_elevation.tif"), &spec_heights, &heights)?;

    let image: Vec<u8> = island.image().into_iter().flatten().collect();
    write(&directory.join("island_rgb.png"), &spec(size, SampleType::U8, 3, None), &image)?;

    let mut spec_classic = spec([8, 8], SampleType::U8, 1, None);
    let colours = vec![[0, 0, 0, 255], [246, 240, 214, 255], [92, 158, 110, 255], [62, 96, 160, 255]];
    spec_classic.metadata.palette = Some(Palette { colours });
    write(&directory.join("classic.png"), &spec_classic, &frozen::CLASSIC.concat())
}
