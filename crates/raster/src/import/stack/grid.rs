//! The grid of a stack: its finest cells, and the width of each image's pixels in these.

use super::InputImage;
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame};

/// Maximum distance of an image's corners from the grid, in the finest cells.
const TOLERANCE: f64 = 0.01;
/// Maximum width of a pixel in the finest cells.
const MOST: f64 = (1 << 24) as f64;
/// Maximum number of cells per side of a pixel.
const MAX_REPEATED: u64 = 1000;

/// Pixel size and position of an image on the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct GridAlignment {
    /// Levels that trees of such cells have less than trees of the finest cells.
    pub(super) levels: u8,
    /// Width of a pixel in such cells; 0 if the image is on another grid and is warped.
    pub(super) repeat: u64,
    /// Such cells of the grid before the first pixel.
    pub(super) offset: [u64; 2],
}

/// The finest cells of all images.
pub(super) struct Grid {
    pub(super) frame: Frame,
    /// Union of the extents of all images.
    pub(super) extent: [u64; 2],
    /// One per image.
    pub(super) alignments: Vec<GridAlignment>,
}

impl Grid {
    /// Computes the grid of images, or `None` without images. Images on other grids are rejected
    /// unless they may be warped.
    pub(super) fn of(images: &[InputImage], warp: bool) -> Result<Option<Grid>> {
        let Some(first) = images.first() else { return Ok(None) };
        // Cell sizes in different coordinate systems cannot be compared.
        let in_system = |image: &&InputImage| !warp || is_same_system(first, image);
        let area = |image: &&InputImage| {
            let [a, b, _, d, e, _] = image.info.frame.affine();
            (a * e - b * d).abs()
        };
        let finest = images.iter().filter(in_system).min_by(|a, b| area(a).total_cmp(&area(b)));
        let finest = finest.unwrap_or(first);
        let may_warp =
            |image: &InputImage| warp && [finest, image].iter().all(|image| image.info.frame.crs.is_some());
        // Only rasters on the grid determine its first cell.
        let (mut first, mut found) = ([i64::MAX; 2], Vec::new());
        for image in images {
            let on_grid = match on_grid(finest, image) {
                Err(error) if !may_warp(image) => return Err(error),
                found => found.ok(),
            };
            if let Some((_, corner)) = on_grid {
                first = [0, 1].map(|axis| first[axis].min(corner[axis]));
            }
            found.push(on_grid);
        }
        let origin = [first[0] as f64, first[1] as f64, 0.0];
        let mut grid =
            Grid { frame: finest.info.frame.shifted(origin), extent: [0, 0], alignments: Vec::new() };
        for (image, on_grid) in images.iter().zip(found) {
            let Some((factor, corner)) = on_grid else {
                // At least as fine as its pixels.
                let wide = if is_same_system(finest, image) { area(&image) / area(&finest) } else { 1.0 };
                let levels = wide.sqrt().log2().floor().clamp(0.0, 24.0);
                grid.alignments.push(GridAlignment { levels: levels as u8, repeat: 0, offset: [0; 2] });
                continue;
            };
            let sides = [image.info.width, image.info.height];
            let offset = [0, 1].map(|axis| corner[axis].abs_diff(first[axis]));
            for axis in 0..2 {
                let end = sides[axis].saturating_mul(factor).saturating_add(offset[axis]);
                grid.extent[axis] = grid.extent[axis].max(end);
            }
            // The largest cells that divide both pixels and offset.
            let levels = (factor | offset[0] | offset[1]).trailing_zeros();
            let repeat = factor >> levels;
            if repeat > MAX_REPEATED {
                let found = format!(
                    "pixels of {factor} x {factor} of its cells, the first one at its cell {corner:?}"
                );
                return Err(refused(image, found, finest));
            }
            let offset = offset.map(|cells| cells >> levels);
            grid.alignments.push(GridAlignment { levels: levels as u8, repeat, offset });
        }
        Ok(Some(grid))
    }
}

fn is_same_system(a: &InputImage, b: &InputImage) -> bool {
    match (&a.info.frame.crs, &b.info.frame.crs) {
        (None, None) => true,
        (Some(a), Some(b)) => a.is_same(b),
        _ => false,
    }
}

fn refused(image: &InputImage, found: String, finest: &InputImage) -> Error {
    let expected = format!(
        "pixels as large as those of {}, or an integer multiple (odd part at most {MAX_REPEATED}), that begin at a corner of one of \
         its cells; --resampling warps other images to the grid",
        finest.path.display()
    );
    Error::invalid(format!("grid of {}", image.path.display()), found, expected)
}

/// Width of a raster's pixels in cells of the finest raster, and the cell of its corner.
fn on_grid(finest: &InputImage, image: &InputImage) -> Result<(u64, [i64; 2])> {
    let (a, b) = (&finest.info, &image.info);
    let [here, there] = [finest, image].map(|image| image.path.display().to_string());
    Crs::check_same((&here, a.frame.crs.as_ref()), (&there, b.frame.crs.as_ref()))?;
    if a.frame.is_identity() && b.frame.is_identity() {
        // Rasters without georeferencing must have the same size.
        if [a.width, a.height] == [b.width, b.height] {
            return Ok((1, [0; 2]));
        }
        let found = format!("{} x {} pixels without georeferencing", b.width, b.height);
        let expected =
            format!("{} x {}, the size of {here}; or a world file next to each", a.width, a.height);
        return Err(Error::invalid(format!("size of {there}"), found, expected));
    }
    let (width, height) = (b.width as f64, b.height as f64);
    let cell_at = |x, y| a.frame.to_cells(b.frame.to_world([x, y, 0.0]));
    let (Some(corner), Some(right), Some(below)) =
        (cell_at(0.0, 0.0), cell_at(width, 0.0), cell_at(0.0, height))
    else {
        return Err(refused(image, "a map that is not invertible".into(), finest));
    };
    let factor = ((right[0] - corner[0]) / width).round();
    let [x, y] = [corner[0].round(), corner[1].round()];
    let expected = [[x, y], [x + factor * width, y], [x, y + factor * height]];
    let fits = [corner, right, below].iter().zip(expected).all(|(found, expected)| {
        found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= TOLERANCE)
    });
    if fits && (1.0..=MOST).contains(&factor) && [x, y].iter().all(|cell| cell.abs() <= MOST * MOST) {
        return Ok((factor as u64, [x as i64, y as i64]));
    }
    let [dx, dy] = [(right[0] - corner[0]) / width, (below[1] - corner[1]) / height];
    let found =
        format!("pixels of {dx} x {dy} of its cells, the first one at its cell {}, {}", corner[0], corner[1]);
    Err(refused(image, found, finest))
}
