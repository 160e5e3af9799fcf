//! Raster files become trees with every pixel.

use std::path::{Path, PathBuf};

use spinney::import::raster::{ImportOptions, plan};
use spinney::raw::import::raster::{self, Band, Pixels, Raster, RasterInfo, RasterOptions};
use spinney::raw::store::goblin::Goblin;
use spinney::tree::{Child, Source};
use spinney::{
    Code, Crs, Dimension, Error, Number, Output, Region, Result, SampleType, TreeType, Value, ValueType,
};

use crate::common::{children, quad, shared_data, with};

/// Returns all pixels of a raster, and which are not VOID.
fn pixels_of(raster: &mut dyn Raster) -> Result<(Vec<u8>, Vec<bool>)> {
    let info = raster.info().clone();
    let mut pixels = Pixels::default();
    raster.read(Region::new(0, 0, info.width, info.height), &mut pixels)?;
    let size = info.sample.size();
    let valid = pixels.bytes.chunks_exact(size * info.channels).map(|pixel| {
        let numbers: Vec<Number> = pixel.chunks_exact(size).map(|sample| number(sample, &info)).collect();
        // If the last of several channels is opacity, transparent cells keep their colours.
        let alpha = info.alpha.filter(|alpha| info.channels == 1 || alpha + 1 < info.channels);
        let transparent = alpha.is_some_and(|alpha| numbers[alpha].with_plain_zero() == 0.0);
        let nodata = info.nodata.is_some_and(|nodata| numbers.iter().all(|number| *number == nodata));
        let is_zero = info.alpha.is_some() && pixel.iter().all(|byte| *byte == 0);
        !transparent && !is_zero && !nodata && !numbers.iter().any(|number| number.is_nan())
    });
    let valid = match &pixels.valid {
        Some(mask) => valid.zip(mask).map(|(valid, mask)| valid && *mask).collect(),
        None => valid.collect(),
    };
    Ok((pixels.bytes, valid))
}

fn number(sample: &[u8], info: &RasterInfo) -> Number {
    ValueType::new(info.sample, 1).first_number(Value::from_bytes(sample))
}

/// Returns the pixels of a tree, painted leaf by leaf; VOID pixels are zeros.
fn cells_of(file: &Goblin) -> (Vec<u8>, Vec<bool>) {
    let form = file.header().form;
    let [width, height, _] = file.header().extent.map(|cells| cells as usize);
    let size = form.width();
    let mut bytes = vec![0; width * height * size];
    let mut valid = vec![false; width * height];
    let mut pending = vec![(Code::root(form.dimension), file.root().unwrap())];
    while let Some((code, subtree)) = pending.pop() {
        match subtree {
            Child::Void => {}
            Child::Inner { node, .. } => {
                let children = children(file, &node).into_iter().enumerate();
                pending.extend(children.map(|(i, child)| (code.child(i), child)));
            }
            Child::Leaf(value) => {
                let side = 1 << (file.depth() - code.level());
                let [x, y, _] = code.cell().map(|cell| cell as usize * side);
                assert!(x < width && y < height, "a cell outside of the raster has a value");
                for row in y..(y + side).min(height) {
                    let row = row * width + x..row * width + (x + side).min(width);
                    valid[row.clone()].fill(true);
                    let cells = bytes[row.start * size..row.end * size].chunks_exact_mut(size);
                    cells.for_each(|cell| cell.copy_from_slice(&value.to_bytes()[..size]));
                }
            }
        }
    }
    (bytes, valid)
}

fn open(path: &Path) -> Goblin {
    Goblin::open(path, &spinney::OpenOptions::new()).unwrap()
}

/// Maximum pixel count of tested images: larger ones take long and show nothing new.
const LARGEST: u64 = 10_000_000;

/// Builds a tree from a file and compares all pixels. Returns `false` if the file cannot be read at
/// all, or is too large.
fn comes_back(path: &Path, directory: &Path, memory: Option<u64>) -> bool {
    let opened = |bands: &Option<Vec<Band>>| {
        let raster = raster::open(path, &RasterOptions::default())?;
        match bands {
            Some(bands) => raster::select(raster, bands),
            None => Ok(raster),
        }
    };
    let Ok(first) = opened(&None) else { return false };
    if first.info().width.saturating_mul(first.info().height) > LARGEST {
        return false;
    }
    let bands = raster::value_type(path, first.info()).is_err().then(|| vec![Band::Number(1)]);
    let page = (first.info().pages > 1).then_some(0);
    if bands.is_some() {
        let refused = plan(&[path.to_path_buf()], &with(ImportOptions::new(), |it| it.page = page))
            .err()
            .map(|error| error.to_string());
        assert!(refused.is_some_and(|error| error.contains("--band")), "{}", path.display());
    }
    let target = directory.join("t.goblin");
    let options = with(ImportOptions::new(), |it| {
        it.bands = bands.clone();
        it.page = page;
        it.memory = memory;
    });
    let import = plan(&[path.to_path_buf()], &options).unwrap();
    let (value, metadata) = (import.value_type(), import.options().metadata.clone());
    let built = import.build(Output::create(&target).unwrap(), &());
    let Ok((mut bytes, valid)) = opened(&bands).and_then(|mut raster| pixels_of(&mut *raster)) else {
        assert!(
            built.is_err() && std::fs::read_dir(directory).unwrap().next().is_none(),
            "{}",
            path.display()
        );
        return false;
    };
    built.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let pixels = bytes.chunks_exact_mut(value.size()).zip(&valid).filter(|(_, valid)| !**valid);
    pixels.for_each(|(pixel, _)| pixel.fill(0));
    let file = open(&target);
    assert_eq!(file.header().form, TreeType::new(Dimension::Quad, value));
    let expected = spinney::Metadata { counts: file.metadata().counts.clone(), ..metadata };
    // As text, in which NaN equals itself.
    assert_eq!(format!("{:?}", file.metadata()), format!("{expected:?}"));
    let (found, found_valid) = cells_of(&file);
    assert!(found_valid == valid, "{}: VOID differs", path.display());
    assert!(found == bytes, "{}: samples differ", path.display());
    std::fs::remove_file(&target).unwrap();
    true
}

#[test]
fn every_pixel_of_every_file_round_trips() {
    let Some(directory) = shared_data().map(|directory| directory.join("raster")) else { return };
    let temp = tempfile::tempdir().unwrap();
    let table = std::fs::read_to_string(directory.join("expected.tsv")).unwrap();
    let mut count = 0;
    for line in table.lines().skip(1) {
        let file = line.split('\t').next().unwrap();
        count += usize::from(comes_back(&directory.join(file), temp.path(), None));
    }
    assert!(count > 300, "{count}");
}

#[test]
fn wide_rasters_need_little_memory() {
    let Some(directory) = shared_data() else { return };
    let temp = tempfile::tempdir().unwrap();
    // In strips 4320 pixels wide: bands exceed 8 MiB.
    let path = directory.join("raster/large/relief_4320x2160_i16.tif");
    assert!(comes_back(&path, temp.path(), Some(8 << 20)));
}

/// Writes a grey 16-bit image.
fn write_grey_image(directory: &Path, name: &str, [width, height]: [u32; 2]) -> PathBuf {
    let path = directory.join(name);
    let file = std::fs::File::create(&path).unwrap();
    let samples: Vec<u16> = (0..width * height).map(|i| (i % width / 9 + i / width / 7) as u16).collect();
    let mut encoder = tiff::encoder::TiffEncoder::new(file).unwrap();
    encoder.write_image::<tiff::encoder::colortype::Gray16>(width, height, &samples).unwrap();
    path
}

#[test]
fn options_overrule_the_file() {
    let temp = tempfile::tempdir().unwrap();
    let path = write_grey_image(temp.path(), "p.tif", [300, 200]);
    let options = with(ImportOptions::new(), |it| {
        it.nodata = Some(7.0.into());
        it.depth = Some(12);
        it.crs = Some(Crs::epsg(3857));
        it.transform = Some([2.0, 0.0, 10.0, 0.0, -2.0, 20.0]);
        it.rule = Some(spinney::Rule::Max);
    });
    let import = plan(std::slice::from_ref(&path), &options).unwrap();
    let text: String =
        import.description().iter().map(|(heading, text)| format!("{heading}: {text}\n")).collect();
    for expected in ["300 x 200", "u16", "EPSG:3857", "2, 0, 10, 0, -2, 20", "nodata: 7", "max", "12 levels"]
    {
        assert!(text.contains(expected), "{text}");
    }
    let target = temp.path().join("t.goblin");
    import.build(Output::create(&target).unwrap(), &()).unwrap();
    let file = open(&target);
    assert_eq!(file.header().form, quad(SampleType::U16, 1));
    assert_eq!(file.depth(), 12);
    assert_eq!(file.metadata().frame.crs, Some(Crs::epsg(3857)));
    assert_eq!(file.metadata().frame.affine(), [2.0, 0.0, 10.0, 0.0, -2.0, 20.0]);
    assert_eq!(file.metadata().nodata, Some(7.0.into()));
    assert_eq!(file.metadata().provenance.len(), 2);
    let (_, valid) = cells_of(&file);
    assert!(!valid[63] && valid[0] && valid[62] && valid[72]);

    let refused = |options: ImportOptions| plan(std::slice::from_ref(&path), &options).err();
    let is_invalid = |error: Option<Error>| matches!(error, Some(Error::Invalid { .. }));
    assert!(is_invalid(refused(with(options.clone(), |it| it.depth = Some(8)))));
    assert!(is_invalid(refused(with(options.clone(), |it| it.depth = Some(30)))));
    assert!(is_invalid(refused(with(options.clone(), |it| it.transform = Some([0.0; 6])))));
    assert!(is_invalid(refused(with(options.clone(), |it| it.bands = Some(vec![2.into()])))));
    assert!(is_invalid(plan(&[], &options).err()));
    // A value that the samples cannot have is ignored as nodata.
    let import =
        plan(std::slice::from_ref(&path), &with(options.clone(), |it| it.nodata = Some((-1.0).into())))
            .unwrap();
    assert_eq!(import.options().metadata.nodata, None);
    assert!(import.description().iter().any(|(_, text)| text.contains("u16 cannot hold -1")));
}
