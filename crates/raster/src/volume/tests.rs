//! Merged shards of volumes have the same bytes as a single build.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::{RawLayout, VolumeImport, VolumeInput, VolumeOptions, plan_raw};
use spinney_base::Result;
use spinney_base::io::Output;
use spinney_base::space::{Code, CodeRange, Dimension};
use spinney_base::value::{DataKind, SampleType};
use spinney_engine::store::goblin::{Shard, ShardRange, merge_shards};
use spinney_engine::store::{Packing, TreeWriter};

/// Cells along x, y and z: more than one unit along two axes.
const SIZE: [u64; 3] = [150, 70, 131];

/// Two-byte samples: blobs, noise, and a uniform region.
fn samples() -> Vec<u16> {
    let mut state = 7u64;
    let [width, height, planes] = SIZE;
    let mut samples = Vec::new();
    for (z, y, x) in
        (0..planes).flat_map(|z| (0..height).flat_map(move |y| (0..width).map(move |x| (z, y, x))))
    {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let noise = if x > 100 { (state >> 60) as u16 } else { 0 };
        samples.push(if y > 40 { 9 } else { ((x * x + y * z) / 700) as u16 + noise });
    }
    samples
}

/// Builds and merges shards. `cuts` are the numbers of the first unit of each.
fn in_shards(directory: &Path, open: &dyn Fn() -> Result<VolumeImport>, cuts: &[u64]) -> Vec<u8> {
    let (head, merged) = (directory.join("head.goblin"), directory.join("merged.goblin"));
    let depth = open().unwrap().options().depth;
    let write = |mut file: TreeWriter| {
        open().unwrap().write(&mut file, directory, &()).unwrap();
        file.finish().unwrap();
    };
    write(TreeWriter::head(Output::create(&head).unwrap(), (Dimension::Oct, depth), 1).unwrap());
    let level = depth.saturating_sub(6).min(3);
    let units = 1u64 << (3 * level);
    let unit = |number: u64| {
        let digits = (0..level).rev().map(|digit| (number >> (3 * digit) & 7) as usize);
        Code::from_digits(Dimension::Oct, digits).unwrap()
    };
    let ends: Vec<u64> = cuts.iter().copied().chain([units]).collect();
    let mut shards = Vec::new();
    for (number, pair) in (0..).zip(ends.windows(2)) {
        let mut run = CodeRange::of(unit(pair[0]), unit(pair[1] - 1)).unwrap();
        if pair[1] == units {
            run = CodeRange::new(run.ends()[0], CodeRange::ALL.ends()[1]).unwrap();
        }
        let ranges = vec![ShardRange { layer: 0, run }];
        let shard = Shard { directory: directory.into(), job: 1, number, ranges, access: Default::default() };
        write(TreeWriter::shard(&head, shard.clone()).unwrap());
        shards.push(shard);
    }
    merge_shards(&head, &shards, Output::create(&merged).unwrap().into(), 1 << 20, &()).unwrap();
    std::fs::read(merged).unwrap()
}

/// Compares the bytes of merged shards with those of a single build.
fn compare(directory: &Path, open: &dyn Fn() -> Result<VolumeImport>) {
    let whole = directory.join("whole.goblin");
    open().unwrap().build(Output::create(&whole).unwrap(), &()).unwrap();
    let whole = std::fs::read(whole).unwrap();
    for cuts in [&[0][..], &[0, 8], &[0, 1, 2, 5, 9, 33, 50]] {
        assert!(in_shards(directory, open, cuts) == whole, "{cuts:?}");
    }
}

#[test]
fn shards_of_raw_volumes_equal_a_single_build() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let samples = samples();
    let bytes =
        |order: fn(u16) -> [u8; 2]| samples.iter().flat_map(|sample| order(*sample)).collect::<Vec<u8>>();
    let mut options = VolumeOptions::new();
    options.memory = Some(8 << 20);

    // Raw samples, with VOID samples, in both byte orders, packed and not.
    let raw = directory.join("a.raw");
    std::fs::write(&raw, [&[1, 2, 3][..], &bytes(u16::to_be_bytes)].concat()).unwrap();
    let mut layout = RawLayout::new(SIZE, SampleType::U16);
    (layout.is_big_endian, layout.skip) = (true, 3);
    options.nodata = Some(9.into());
    compare(directory, &|| plan_raw(&raw, &layout, &options));
    options.packing = Packing::packed();
    compare(directory, &|| plan_raw(&raw, &layout, &options));
    (options.nodata, options.packing) = (None, Packing::default());
    // Floats, and a space of many units, most of them empty.
    let floats: Vec<u8> =
        samples.iter().flat_map(|sample| (f32::from(*sample) / 3.0).to_le_bytes()).collect();
    std::fs::write(&raw, &floats).unwrap();
    let layout = RawLayout::new(SIZE, SampleType::F32);
    options.depth = Some(9);
    compare(directory, &|| plan_raw(&raw, &layout, &options));
    options.depth = None;
    // A tree of one unit.
    std::fs::write(&raw, &floats[..4 * 60]).unwrap();
    let layout = RawLayout::new([5, 4, 3], SampleType::F32);
    let open = || plan_raw(&raw, &layout, &options);
    let whole = directory.join("whole.goblin");
    open().unwrap().build(Output::create(&whole).unwrap(), &()).unwrap();
    assert!(in_shards(directory, &open, &[0]) == std::fs::read(whole).unwrap());
}

#[test]
fn shards_of_compressed_streams_equal_a_single_build() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let bytes: Vec<u8> = samples().iter().flat_map(|sample| sample.to_le_bytes()).collect();
    let mut options = VolumeOptions::new();
    options.kind = Some(DataKind::Categorical);
    let (head, data) = (directory.join("a.nhdr"), directory.join("a.raw.gz"));
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(&[&[0; 5][..], &bytes].concat()).unwrap();
    std::fs::write(&data, packed.finish().unwrap()).unwrap();
    let [x, y, z] = SIZE;
    let text = format!(
        "NRRD0004\ntype: uint16\ndimension: 3\nsizes: {x} {y} {z}\nendian: little\nencoding: gzip\nbyte skip: 5\ndata file: a.raw.gz\n"
    );
    std::fs::write(&head, text).unwrap();
    let input = VolumeInput::File(head.clone());
    compare(directory, &|| input.plan(&options));
    assert_eq!(input.files(&Default::default()).unwrap(), [data, head]);
}

#[test]
fn shards_of_sections_equal_a_single_build() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let sections = directory.join("sections");
    std::fs::create_dir(&sections).unwrap();
    let [width, height, _] = SIZE;
    let planes = samples();
    let mut paths: Vec<PathBuf> = Vec::new();
    for (z, plane) in planes.chunks_exact((width * height) as usize).enumerate() {
        let path = sections.join(format!("{z}.png"));
        let file = std::fs::File::create(&path).unwrap();
        let mut encoder = png::Encoder::new(file, width as u32, height as u32);
        encoder.set_color(png::ColorType::Grayscale);
        let grey: Vec<u8> = plane.iter().map(|sample| *sample as u8).collect();
        encoder.write_header().unwrap().write_image_data(&grey).unwrap();
        paths.push(path);
    }
    let options = VolumeOptions::new();
    let input = VolumeInput::Sections(vec![sections]);
    compare(directory, &|| input.plan(&options));
    let files = input.files(&Default::default()).unwrap();
    assert!(paths.iter().all(|path| files.contains(path)) && files.len() > 2 * paths.len());
}
