//! A fictitious island: heights from value noise, land cover from heights.
//!
//! It uses only additions, multiplications, divisions and square roots, which IEEE 754 rounds in
//! the same way everywhere: the files are the same on every machine.

/// Columns.
pub(crate) const WIDTH: usize = 256;
/// Rows.
pub(crate) const HEIGHT: usize = 200;
/// Metres per pixel.
pub(crate) const PIXEL: f64 = 50.0;

/// A kind of land cover.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)] // the names say it
pub(crate) enum Cover {
    /// Open sea, which was not surveyed: no data.
    Unknown = 0,
    ShallowSea = 1,
    Beach = 2,
    Meadow = 3,
    Forest = 4,
    Rock = 5,
    Snow = 6,
    Lake = 7,
}

/// Names by value.
pub(crate) const NAMES: [&str; 8] =
    ["not surveyed", "shallow sea", "beach", "meadow", "forest", "rock", "snow", "lake"];

/// Colours by value.
pub(crate) const COLOURS: [[u8; 4]; 8] = [
    [18, 48, 84, 0],
    [74, 142, 178, 255],
    [232, 214, 160, 255],
    [150, 184, 92, 255],
    [58, 110, 62, 255],
    [140, 130, 122, 255],
    [246, 248, 250, 255],
    [44, 96, 150, 255],
];

/// The island, row by row from the north.
pub(crate) struct Island {
    /// Metres above sea level; negative below.
    pub(crate) height: Vec<f64>,
    /// Land cover.
    pub(crate) cover: Vec<Cover>,
}

/// Returns a number from 0 to 1 for a point of an integer grid.
fn corner(x: i64, y: i64, seed: u64) -> f64 {
    let mut z = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
        ^ seed;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ (z >> 31)) as u32 as f64 / u32::MAX as f64
}

/// Value noise: random numbers at integer coordinates, smooth in between.
fn noise(x: f64, y: f64, seed: u64) -> f64 {
    let (x0, y0) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (ease(x - x0), ease(y - y0));
    let at = |dx: i64, dy: i64| corner(x0 as i64 + dx, y0 as i64 + dy, seed);
    let north = at(0, 0) + (at(1, 0) - at(0, 0)) * u;
    let south = at(0, 1) + (at(1, 1) - at(0, 1)) * u;
    north + (south - north) * v
}

/// Noise of several sizes.
fn layered(x: f64, y: f64, seed: u64, layers: u32) -> f64 {
    let (mut sum, mut most, mut weight, mut scale) = (0.0, 0.0, 1.0, 1.0);
    for layer in 0..layers {
        sum += weight * noise(x * scale, y * scale, seed + layer as u64);
        most += weight;
        weight *= 0.5;
        scale *= 2.0;
    }
    sum / most
}

/// Returns the height at a point, in metres.
fn height(column: f64, row: f64) -> f64 {
    let (x, y) = (column / WIDTH as f64, row / HEIGHT as f64);
    // Two overlapping hills, broken by noise.
    let hill = |cx: f64, cy: f64, rx: f64, ry: f64| {
        let (dx, dy) = ((x - cx) / rx, (y - cy) / ry);
        1.0 - (dx * dx + dy * dy).sqrt()
    };
    let land = hill(0.42, 0.46, 0.44, 0.46).max(hill(0.66, 0.6, 0.34, 0.36));
    let rough = layered(x * 6.0, y * 4.7, 11, 6) - 0.5;
    let ridge = 1.0 - 2.0 * (layered(x * 7.0, y * 5.5, 77, 5) - 0.5).abs();
    let base = land + 1.1 * rough - 0.12;
    let steep = base.max(0.0);
    base * 420.0 + steep * steep * ridge * ridge * 2300.0
}

/// Makes the island.
pub(crate) fn make() -> Island {
    // Rounded to an eighth of a metre: this gives small files, and sums that are exact in any
    // order.
    let height: Vec<f64> = (0..WIDTH * HEIGHT)
        .map(|i| (height((i % WIDTH) as f64 + 0.5, (i / WIDTH) as f64 + 0.5) * 8.0).round() / 8.0)
        .collect();
    let sea = reached_from_border(&height);
    let cover = (0..WIDTH * HEIGHT).map(|i| cover(i, &height, &sea)).collect();
    Island { height, cover }
}

/// Returns which cells below zero are connected to the raster's border: the sea. Inland hollows are
/// lakes.
fn reached_from_border(height: &[f64]) -> Vec<bool> {
    let mut reached = vec![false; height.len()];
    let on_border = |i: &usize| {
        let (x, y) = (i % WIDTH, i / WIDTH);
        x == 0 || y == 0 || x == WIDTH - 1 || y == HEIGHT - 1
    };
    let mut pending: Vec<usize> = (0..height.len()).filter(on_border).collect();
    while let Some(i) = pending.pop() {
        if reached[i] || height[i] > 0.0 {
            continue;
        }
        reached[i] = true;
        let (x, y) = (i % WIDTH, i / WIDTH);
        pending.extend((x > 0).then(|| i - 1));
        pending.extend((x < WIDTH - 1).then_some(i + 1));
        pending.extend((y > 0).then(|| i - WIDTH));
        pending.extend((y < HEIGHT - 1).then_some(i + WIDTH));
    }
    reached
}

fn cover(i: usize, height: &[f64], sea: &[bool]) -> Cover {
    let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
    let wobble = layered(x / 20.0, y / 20.0, 5, 4) - 0.5;
    match height[i] {
        depth if sea[i] => {
            if depth < -90.0 + 40.0 * wobble {
                Cover::Unknown
            } else {
                Cover::ShallowSea
            }
        }
        h if h <= 0.0 => Cover::Lake,
        h if h < 12.0 + 30.0 * wobble => Cover::Beach,
        h if h > 1010.0 + 300.0 * wobble => Cover::Snow,
        h if h > 620.0 + 500.0 * wobble => Cover::Rock,
        h if layered(x / 30.0, y / 30.0, 31, 4) > 0.44 + h / 2600.0 => Cover::Forest,
        _ => Cover::Meadow,
    }
}

impl Island {
    /// Returns the surveyed heights: metres, `None` in the sea.
    pub(crate) fn elevation(&self) -> Vec<Option<f32>> {
        let surveyed = |i: usize| !matches!(self.cover[i], Cover::Unknown | Cover::ShallowSea);
        // (`max` may return either of 0 and -0; adding zero makes both 0.)
        (0..self.height.len())
            .map(|i| surveyed(i).then_some((self.height[i].max(0.0) + 0.0) as f32))
            .collect()
    }

    /// Returns land cover as colours, lit from the north-west.
    pub(crate) fn image(&self) -> Vec<[u8; 3]> {
        let at = |x: usize, y: usize| self.height[y.min(HEIGHT - 1) * WIDTH + x.min(WIDTH - 1)].max(0.0);
        (0..self.height.len())
            .map(|i| {
                let (x, y) = (i % WIDTH, i / WIDTH);
                let dx = (at(x + 1, y) - at(x.saturating_sub(1), y)) / (2.0 * PIXEL);
                let dy = (at(x, y + 1) - at(x, y.saturating_sub(1))) / (2.0 * PIXEL);
                let light = (1.0 + 0.6 * dx + 0.6 * dy) / (1.0 + 0.4 * (dx * dx + dy * dy)).sqrt();
                let light = light.clamp(0.35, 1.45);
                let deep = (self.height[i].min(0.0) / -400.0).min(1.0);
                let [r, g, b, _] = COLOURS[self.cover[i] as usize];
                [r, g, b].map(|c| (c as f64 * light * (1.0 - 0.4 * deep)).clamp(0.0, 255.0) as u8)
            })
            .collect()
    }
}
