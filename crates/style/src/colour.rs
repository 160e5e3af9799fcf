//! Parsing, formatting and conversion of colours.

use std::sync::LazyLock;

/// Default colour of solids.
pub const CLAY: [u8; 3] = [214, 194, 171];

/// Parses `#rgb`, `#rgba`, `#rrggbb` or `#rrggbbaa`.
pub(super) fn parse(text: &str) -> Option<[u8; 4]> {
    let digits =
        text.strip_prefix('#').filter(|digits| digits.bytes().all(|byte| byte.is_ascii_hexdigit()))?;
    let number = u32::from_str_radix(digits, 16).ok()?;
    let nibbles = |shifts: [u32; 3]| shifts.map(|shift| (number >> shift & 15) as u8 * 17);
    let with = |[red, green, blue]: [u8; 3], alpha: u8| [red, green, blue, alpha];
    match digits.len() {
        3 => Some(with(nibbles([8, 4, 0]), 255)),
        4 => Some(with(nibbles([12, 8, 4]), (number & 15) as u8 * 17)),
        6 => Some((number << 8 | 255).to_be_bytes()),
        8 => Some(number.to_be_bytes()),
        _ => None,
    }
}

/// Formats a colour as `#rrggbb`, or `#rrggbbaa` if it is not opaque.
pub(super) fn text([red, green, blue, alpha]: [u8; 4]) -> String {
    let opacity = if alpha == 255 { String::new() } else { format!("{alpha:02x}") };
    format!("#{red:02x}{green:02x}{blue:02x}{opacity}")
}

/// Returns a colour for a class that has none. Hues of consecutive numbers differ by the golden
/// ratio of a turn, which keeps them distinct.
pub fn distinct(number: f64) -> [u8; 3] {
    let hue = (number * 0.618_033_988_75).rem_euclid(1.0) * 6.0;
    [5.0, 3.0, 1.0].map(|shift: f64| {
        let sector = (shift + hue).rem_euclid(6.0);
        (255.0 * (0.85 - 0.5 * sector.min(4.0 - sector).clamp(0.0, 1.0)) + 0.5) as u8
    })
}

/// Converts an sRGB sample, 0 to 1, to linear light (IEC 61966-2-1).
pub fn to_linear(number: f64) -> f64 {
    if number <= 0.04045 { number / 12.92 } else { ((number + 0.055) / 1.055).powf(2.4) }
}

/// Minimum linear light that rounds to each sRGB sample.
static LEAST: LazyLock<[f64; 256]> =
    LazyLock::new(|| std::array::from_fn(|sample| to_linear((sample as f64 - 0.5) / 255.0)));
/// Number of equal parts of the range from 0 to 1 in the look-up table.
const PARTS: usize = 1024;
/// The sample at the start of each part.
static FIRST: LazyLock<[u8; PARTS + 1]> = LazyLock::new(|| {
    std::array::from_fn(|part| {
        let linear = part as f64 / PARTS as f64;
        (LEAST.partition_point(|least| *least <= linear) - 1) as u8
    })
});

/// Converts linear light to the nearest sRGB sample, 0 to 255. Uses a table: computing powers would
/// dominate the cost of a pixel.
pub fn to_srgb(linear: f64) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let mut sample = FIRST[(linear * PARTS as f64) as usize];
    while LEAST.get(usize::from(sample) + 1).is_some_and(|least| *least <= linear) {
        sample += 1;
    }
    sample
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_read_and_written() {
        for (short, long) in [("#f80", "#ff8800"), ("#f808", "#ff880088"), ("#12345678", "#12345678")] {
            assert_eq!(parse(short).map(text).as_deref(), Some(long));
        }
        for wrong in ["", "#", "red", "#12", "#12345", "#1234567", "#123456789", "#gg0000", "#+12345", "#é12"]
        {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn samples_are_those_of_the_nearest_numbers() {
        for sample in 0..=255u8 {
            assert_eq!(to_srgb(to_linear(f64::from(sample) / 255.0)), sample);
        }
        for step in 0..=100_000 {
            let linear = f64::from(step) / 100_000.0;
            let number =
                if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
            assert!((f64::from(to_srgb(linear)) - 255.0 * number).abs() < 0.501, "{linear}");
        }
        assert_eq!([f64::NAN, -1.0, 2.0].map(to_srgb), [0, 0, 255]);
    }

    #[test]
    fn neighbouring_classes_differ() {
        for number in 0..1000 {
            let [a, b] = [number, number + 1].map(|number| distinct(f64::from(number)));
            let distance: i32 = (0..3).map(|i| (i32::from(a[i]) - i32::from(b[i])).abs()).sum();
            assert!(distance > 60, "{number}: {a:?} {b:?}");
        }
        assert_eq!(distinct(f64::NAN), distinct(f64::NAN));
    }
}
