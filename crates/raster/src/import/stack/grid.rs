//! The grid of a stack: the finest cells, and how many of them a pixel of each picture is wide.

use super::Picture;
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame};

/// Largest distance of a picture's corners from where the grid has them, in the finest cells.
const TOLERANCE: f64 = 0.01;
/// The finest cells that a pixel may be wide.
const MOST: f64 = (1 << 24) as f64;
/// Cells that a pixel may become along a side.
const MAX_REPEATED: u64 = 1000;

/// Width of a picture's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// Levels that trees of such cells have less than those of the finest.
    pub(super) levels: u8,
    /// Such cells that a pixel is wide; 0 if the picture lies on another grid and is warped.
    pub(super) repeat: u64,
}

/// The finest cells of all pictures.
pub(super) struct Grid {
    pub(super) frame: Frame,
    /// Cells of all pictures together.
    pub(super) extent: [u64; 2],
    /// For each picture.
    pub(super) places: Vec<Place>,
}

impl Grid {
    /// The grid of pictures; nothing if there are none. Those that do not lie on it are refused, unless they may be warped.
    pub(super) fn of(pictures: &[Picture], warp: bool) -> Result<Option<Grid>> {
        let Some(first) = pictures.first() else { return Ok(None) };
        // (Cells of other systems are as large as anything.)
        let in_system = |picture: &&Picture| !warp || is_same_system(first, picture);
        let area = |picture: &&Picture| {
            let [a, b, _, d, e, _] = picture.info.frame.affine();
            (a * e - b * d).abs()
        };
        let finest = pictures.iter().filter(in_system).min_by(|a, b| area(a).total_cmp(&area(b)));
        let finest = finest.unwrap_or(first);
        let mut grid = Grid { frame: finest.info.frame.clone(), extent: [0, 0], places: Vec::new() };
        for picture in pictures {
            let can_warp = warp && [finest, picture].iter().all(|picture| picture.info.frame.crs.is_some());
            let place = match factor(finest, picture) {
                Ok(factor) => {
                    for (extent, side) in
                        grid.extent.iter_mut().zip([picture.info.width, picture.info.height])
                    {
                        *extent = (*extent).max(side.saturating_mul(factor));
                    }
                    let levels = factor.trailing_zeros();
                    Place { levels: levels as u8, repeat: factor >> levels }
                }
                Err(_) if can_warp => {
                    // As fine as its pixels, or finer.
                    let wide =
                        if is_same_system(finest, picture) { area(&picture) / area(&finest) } else { 1.0 };
                    let levels = wide.sqrt().log2().floor().clamp(0.0, 24.0);
                    Place { levels: levels as u8, repeat: 0 }
                }
                Err(error) => return Err(error),
            };
            grid.places.push(place);
        }
        Ok(Some(grid))
    }
}

fn is_same_system(a: &Picture, b: &Picture) -> bool {
    match (&a.info.frame.crs, &b.info.frame.crs) {
        (None, None) => true,
        (Some(a), Some(b)) => a.is_same(b),
        _ => false,
    }
}

fn refused(picture: &Picture, found: String, finest: &Picture) -> Error {
    let expected = format!(
        "pixels as large as those of {}, or a whole number of times (the odd part at most {MAX_REPEATED}), from the same corner; \
         --resampling warps others to the grid",
        finest.path.display()
    );
    Error::invalid(format!("grid of {}", picture.path.display()), found, expected)
}

/// How many cells of the finest picture a pixel of another is wide.
fn factor(finest: &Picture, picture: &Picture) -> Result<u64> {
    let (a, b) = (&finest.info, &picture.info);
    let [here, there] = [finest, picture].map(|picture| picture.path.display().to_string());
    Crs::check_same((&here, a.frame.crs.as_ref()), (&there, b.frame.crs.as_ref()))?;
    if a.frame.is_identity() && b.frame.is_identity() {
        // Where nothing tells, sizes do not either.
        if [a.width, a.height] == [b.width, b.height] {
            return Ok(1);
        }
        let found = format!("{} x {} pixels without a place in the world", b.width, b.height);
        let expected = format!(
            "{} x {}, as {here} has; or say with a world file beside each where it lies",
            a.width, a.height
        );
        return Err(Error::invalid(format!("size of {there}"), found, expected));
    }
    let (width, height) = (b.width as f64, b.height as f64);
    let place = |x, y| a.frame.to_cells(b.frame.to_world([x, y, 0.0]));
    let (Some(corner), Some(right), Some(below)) = (place(0.0, 0.0), place(width, 0.0), place(0.0, height))
    else {
        return Err(refused(picture, "a map without an inverse".into(), finest));
    };
    let factor = ((right[0] - corner[0]) / width).round();
    let expected = [[0.0, 0.0], [factor * width, 0.0], [0.0, factor * height]];
    let fits = [corner, right, below].iter().zip(expected).all(|(found, expected)| {
        found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= TOLERANCE)
    });
    if fits && (1.0..=MOST).contains(&factor) {
        let factor = factor as u64;
        if factor >> factor.trailing_zeros() > MAX_REPEATED {
            let found = format!("pixels of {factor} x {factor} of its cells");
            return Err(refused(picture, found, finest));
        }
        return Ok(factor);
    }
    let [dx, dy] = [(right[0] - corner[0]) / width, (below[1] - corner[1]) / height];
    let found = format!("pixels of {dx} x {dy} of its cells, from its cell {}, {} on", corner[0], corner[1]);
    Err(refused(picture, found, finest))
}
