//! Importers: files of other formats, which are read, and built if they are small.

use std::path::Path;

use spinney::import::mesh::{ExactOptions, Resolution, SolidOptions, plan_models};
use spinney::import::raster::{ImportOptions, plan};
use spinney::import::volume::VolumeOptions;
use spinney::raw::dataset;
use spinney::raw::import::cells::CellList;
use spinney::raw::import::mesh;
use spinney::raw::import::raster::{self, Order, Pixels, RasterOptions};
use spinney::raw::store::goblin::Goblin;
use spinney::{Error, ExactModel, OpenOptions, Output, Region, Result};

use super::files::in_file;

/// Memory limit of importers in bytes.
const MEMORY: u64 = 4 << 20;
/// Maximum bytes of samples that are read at once.
const MAX_BYTES: u64 = 1 << 20;
/// Maximum number of cells of rasters that are built.
const MAX_CELLS: u64 = 1 << 14;
/// Maximum number of faces of models that are built.
const MAX_FACES: u32 = 200;

/// A target for each image format, with the same code: the first bytes determine the format.
macro_rules! images {
    ($($name:ident $file:literal),*) => {
        $(#[doc = concat!("An image, as a file with the name `", $file, "`.")]
        pub fn $name(bytes: &[u8]) {
            in_file($file, bytes, read_image);
        })*
    };
}

images!(
    tiff "a.tif", png "a.png", exr "a.exr", jpeg "a.jpg", webp "a.webp", chain_code "a.chain", bmp "a.bmp", gif "a.gif", hdr "a.hdr", pnm "a.pgm",
    qoi "a.qoi", tga "a.tga"
);

/// The name of an SRTM tile and its first bytes; the rest, to the length of such files, is zeros.
pub fn hgt(bytes: &[u8]) {
    const LENGTH: u64 = 1201 * 1201 * 2;
    let (name, bytes) = bytes.split_at_checked(11).unwrap_or((b"N46E008.hgt", bytes));
    let name = String::from_utf8_lossy(name).replace(['/', '\0'], "_");
    let name = if Path::new(&name).file_name().is_some() { name } else { "N46E008.hgt".into() };
    in_file(&name, bytes, |path| {
        std::fs::File::options().write(true).open(path).and_then(|file| file.set_len(LENGTH)).unwrap();
        read_image(path);
        std::fs::remove_file(path).unwrap();
    });
}

/// A grey pixel.
const GREY_PIXEL: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\0\0\0\0:~\x9bU\0\0\0\nIDATx\x9cc`\x07\0\0\x09\0\x08 #\xc3\x8c\0\0\0\0IEND\xaeB`\x82";

/// GDAL's sidecar file of an image.
pub fn sidecar(bytes: &[u8]) {
    in_file("c.png.aux.xml", bytes, |_| in_file("c.png", GREY_PIXEL, read_image));
}

/// A world file of an image.
pub fn world_file(bytes: &[u8]) {
    in_file("b.pgw", bytes, |_| in_file("b.png", GREY_PIXEL, read_image));
}

/// GDAL's virtual raster, with an image that may be its source.
pub fn vrt(bytes: &[u8]) {
    in_file("d.png", GREY_PIXEL, |_| in_file("d.vrt", bytes, read_image));
}

/// Reads an image, and builds it if it is small: the built tree must be valid.
fn read_image(path: &Path) {
    let Ok(is_small) = read_pixels(path) else { return };
    if !is_small {
        return;
    }
    let mut options = ImportOptions::new();
    options.memory = Some(2 * MEMORY);
    let built = path.with_extension("goblin");
    let import = plan(&[path.to_path_buf()], &options);
    if import.and_then(|import| import.build(Output::create(&built)?, &())).is_ok() {
        check_built(&built);
    }
}

/// Reads pixels of the upper left corner; returns whether there are few others.
fn read_pixels(path: &Path) -> Result<bool> {
    let mut options = RasterOptions::new();
    options.memory = MEMORY;
    let mut raster = raster::open(path, &options)?;
    let info = raster.info().clone();
    let pixel = info.channels as u64 * info.sample.size() as u64;
    let width = if info.order == Order::Bands { info.width } else { info.width.min(64) };
    let most_rows = MAX_BYTES / width.saturating_mul(pixel).max(1);
    if most_rows == 0 {
        return Ok(false);
    }
    let mut pixels = Pixels::default();
    raster.read(Region::new(0, 0, width, info.height.min(64).min(most_rows)), &mut pixels)?;
    assert_eq!(pixels.bytes.len() as u64, width * info.height.min(64).min(most_rows) * pixel);
    Ok(info.width.saturating_mul(info.height) <= MAX_CELLS)
}

/// Asserts that a built tree is valid.
fn check_built(path: &Path) {
    let tree = dataset::open(path, &OpenOptions::new()).unwrap();
    assert_eq!(tree.verify(1 << 20, &()).unwrap(), []);
}

/// A target for each mesh format; the file's name selects the format if the bytes do not.
macro_rules! meshes {
    ($($name:ident $file:literal),*) => {
        $(#[doc = concat!("A mesh, as a file with the name `", $file, "`.")]
        pub fn $name(bytes: &[u8]) {
            in_file($file, bytes, |path| drop(read_mesh(path)));
        })*
    };
}

meshes!(obj "a.obj", ply "a.ply", stl "a.stl", off "a.off", gltf "a.glb", cityjson "a.json");

/// Reads a model twice, and builds cells and an exact model from it if it has few faces: the
/// results must be valid.
fn read_mesh(path: &Path) -> Result<()> {
    let mut model = mesh::open(path, MEMORY)?;
    let mut count = || {
        let (mut faces, mut corners) = (0u32, 0);
        model.faces(&mut |face| {
            faces += 1;
            corners += face.points.len();
            if faces > 10 * MAX_FACES { Err(Error::Interrupted) } else { Ok(()) }
        })?;
        Ok::<_, Error>((faces, corners))
    };
    let (faces, corners) = count()?;
    assert_eq!(count()?, (faces, corners), "the second read differs");
    if faces > MAX_FACES {
        return Ok(());
    }
    let mut options = SolidOptions::new();
    options.resolution = Resolution::Cells(16);
    options.memory = 2 * MEMORY;
    let built = path.with_extension("goblin");
    if plan_models(vec![model], &options).and_then(|plan| plan.build(Output::create(&built)?, &())).is_ok() {
        check_built(&built);
    }
    let mut options = ExactOptions::new();
    (options.close, options.memory) = (faces % 2 == 0, 2 * MEMORY);
    spinney::import::mesh::import_exact(
        vec![mesh::open(path, MEMORY)?],
        &options,
        Output::create(&built)?,
        &(),
    )?;
    let model = ExactModel::open(&built, &OpenOptions::new())?;
    assert_eq!(model.verify(16 << 20, &()).unwrap(), []);
    super::models::fast_queries(&model).unwrap();
    Ok(())
}

/// Cells with values, in the text format or as a NumPy array, for a quadtree of bytes.
pub fn cells(bytes: &[u8]) {
    thread_local! {
        static TREE: Goblin = Goblin::from_bytes(super::text_formats::CLASSIC.to_vec()).unwrap();
    }
    in_file("cells", bytes, |path| {
        TREE.with(|tree| {
            if let Ok(list) = CellList::open(path, tree.header()) {
                list.take_while(Result::is_ok).for_each(drop);
            }
        });
    });
}

/// A volume: an array of three dimensions, built if it is small.
pub fn npy(bytes: &[u8]) {
    volume_file("a.npy", bytes);
}

/// A volume with a text header, whose samples are decompressed.
pub fn nrrd(bytes: &[u8]) {
    volume_file("a.nrrd", bytes);
}

fn volume_file(name: &str, bytes: &[u8]) {
    in_file(name, bytes, |path| {
        let mut options = VolumeOptions::new();
        options.memory = Some(2 * MEMORY);
        let built = path.with_extension("goblin");
        // (A planned import has all its samples in the file, and so is small.)
        let import = spinney::import::volume::plan(path, &options);
        if import.and_then(|import| import.build(Output::create(&built)?, &())).is_ok() {
            check_built(&built);
        }
    });
}
