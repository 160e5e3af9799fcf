//! Distinguishable colours for the classes of string attributes, also for colour-blind readers.

use std::collections::BTreeSet;

use spinney_base::value::Palette;

/// Colours in class order. The first are those of Okabe and Ito without black. Each of the others
/// maximizes the distance to all before it, and to black and white, in normal vision and in
/// simulated red and green blindness. Distances are in Oklab; the simulations are those of Machado,
/// Oliveira and Fernandes (2009).
#[rustfmt::skip]
const COLOURS: [[u8; 3]; 32] = [
    [0, 114, 178], [230, 159, 0], [0, 158, 115], [204, 121, 167], [86, 180, 233], [213, 94, 0], [240, 228, 66], [105, 45, 45],
    [0, 0, 255], [75, 30, 150], [105, 225, 180], [135, 120, 255], [165, 45, 105], [150, 75, 0], [165, 210, 255], [15, 75, 195],
    [165, 255, 165], [150, 180, 135], [120, 0, 105], [240, 195, 120], [195, 30, 150], [165, 240, 225], [105, 90, 225], [90, 135, 210],
    [255, 45, 105], [180, 180, 195], [210, 30, 75], [0, 165, 195], [225, 195, 0], [210, 135, 45], [135, 45, 0], [120, 150, 255],
];

/// Maximum number of colours in a palette, including that of 0.
const MOST: usize = 1 << 16;

/// Channel range of colours after the table, which excludes near-black and near-white. The number
/// of levels is a prime.
const LEAST: u64 = 40;
const LEVELS: u64 = 191;

/// Returns distinct colours for the classes 1 to `classes`; `None` if there are none, or too many
/// for a palette.
pub(super) fn palette(classes: usize) -> Option<Palette> {
    if classes == 0 || classes >= MOST {
        return None;
    }
    let table = COLOURS.iter().copied().collect::<BTreeSet<[u8; 3]>>();
    // The stride is coprime to the number of colours, so it visits each of them once.
    let step = |number: u64| number.wrapping_mul(2_654_435_761) % LEVELS.pow(3);
    let channel = |code: u64, channel_index: u32| (LEAST + code / LEVELS.pow(channel_index) % LEVELS) as u8;
    let others = (1..).map(step).map(|code| [0, 1, 2].map(|channel_index| channel(code, channel_index)));
    let others = others.filter(|colour| !table.contains(colour));
    let colours = COLOURS.into_iter().chain(others).take(classes);
    let opaque = colours.map(|[red, green, blue]| [red, green, blue, 255]);
    Some(Palette { colours: std::iter::once([0; 4]).chain(opaque).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    type Matrix = [[f64; 3]; 3];
    const NORMAL: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    const NO_RED: Matrix =
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]];
    const NO_GREEN: Matrix =
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]];
    const CONES: Matrix = [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ];
    const OKLAB: Matrix = [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ];

    fn times(matrix: &Matrix, of: [f64; 3]) -> [f64; 3] {
        matrix.map(|row| (0..3).map(|axis| row[axis] * of[axis]).sum())
    }

    /// Converts a colour to Oklab, as perceived with a type of vision.
    fn seen(by: &Matrix, colour: [u8; 3]) -> [f64; 3] {
        let linear = colour.map(|sample| match f64::from(sample) / 255.0 {
            sample if sample <= 0.04045 => sample / 12.92,
            sample => ((sample + 0.055) / 1.055).powf(2.4),
        });
        let linear = times(by, linear).map(|sample| sample.clamp(0.0, 1.0));
        times(&OKLAB, times(&CONES, linear).map(f64::cbrt))
    }

    #[test]
    fn colours_are_distinct_for_all_colour_vision() {
        for (by, of) in [(&NORMAL, "all"), (&NO_RED, "no red"), (&NO_GREEN, "no green")] {
            let seen: Vec<[f64; 3]> = COLOURS.map(|colour| seen(by, colour)).to_vec();
            for (count, least) in [(7, 0.075), (16, 0.07), (32, 0.055)] {
                for (number, one) in seen[..count].iter().enumerate() {
                    for other in &seen[..number] {
                        let distance =
                            (0..3).map(|axis| (one[axis] - other[axis]).powi(2)).sum::<f64>().sqrt();
                        assert!(distance > least, "{of}: {number} of {count}: {distance}");
                    }
                }
            }
        }
    }

    #[test]
    fn each_class_has_a_colour_of_its_own() {
        assert_eq!((palette(0), palette(MOST)), (None, None));
        let most = palette(MOST - 1).unwrap().colours;
        assert_eq!((most.len(), most[0]), (MOST, [0; 4]));
        assert_eq!(most.iter().collect::<BTreeSet<_>>().len(), MOST);
        // A small palette is a prefix of a large one.
        assert_eq!(palette(40).unwrap().colours[..], most[..41]);
    }
}
