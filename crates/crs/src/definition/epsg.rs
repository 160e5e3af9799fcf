//! Coordinate reference systems by their EPSG codes.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::registry::{COMPOUND, FEET, GEOCENTRIC, GRADS, OTHER_LENGTHS, Ranges, US_FEET, WITH_HEIGHTS};

/// EPSG codes of a coordinate reference system: that of a horizontal, three-dimensional or compound
/// system, and that of a vertical system if the first one has no heights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Epsg {
    /// Code of the horizontal system, or of the whole system.
    pub horizontal: u32,
    /// Code of the vertical system.
    pub vertical: Option<u32>,
}

impl Epsg {
    /// Returns the system with a code.
    pub const fn new(number: u32) -> Epsg {
        Epsg { horizontal: number, vertical: None }
    }

    /// Parses `4326` or `4326+5773`.
    pub(super) fn parse_numbers(text: &str) -> Option<Epsg> {
        let number = |text: &str| {
            let digits = text.bytes().all(|byte| byte.is_ascii_digit());
            text.parse().ok().filter(|number| digits && *number > 0)
        };
        let (horizontal, vertical) = match text.split_once('+') {
            Some((horizontal, vertical)) => (horizontal, Some(number(vertical)?)),
            None => (text, None),
        };
        Some(Epsg { horizontal: number(horizontal)?, vertical })
    }

    /// Splits a compound system that has its own code into its horizontal and vertical components.
    pub(crate) fn in_parts(self) -> Epsg {
        let find = |number| COMPOUND.binary_search_by_key(&number, |(number, ..)| *number).ok();
        match u16::try_from(self.horizontal).ok().and_then(find).map(|index| COMPOUND[index]) {
            Some((_, horizontal, vertical)) if self.vertical.is_none() => {
                Epsg { horizontal: horizontal.into(), vertical: Some(vertical.into()) }
            }
            _ => self,
        }
    }

    /// Returns the code of the horizontal system: of a system with ellipsoidal heights, that of the
    /// same datum without heights.
    pub(crate) fn plane(self) -> u32 {
        let horizontal = self.in_parts().horizontal;
        let find = |number| WITH_HEIGHTS.binary_search_by_key(&number, |(number, _)| *number).ok();
        let index = u16::try_from(horizontal).ok().and_then(find);
        index.map_or(horizontal, |index| WITH_HEIGHTS[index].1.into())
    }

    /// Whether the horizontal axes are angles: longitude and latitude.
    pub(super) fn is_geographic(self) -> bool {
        let is = |number| is_geographic(number) && !is_in(number, GEOCENTRIC);
        u16::try_from(self.in_parts().horizontal).is_ok_and(is)
    }

    /// Returns the unit of the horizontal axes, or `None` if it is a rare one.
    pub(super) fn unit(self) -> Option<&'static str> {
        let Ok(number) = u16::try_from(self.in_parts().horizontal) else { return None };
        let is_in = |ranges: Ranges| is_in(number, ranges);
        if self.is_geographic() {
            (!is_in(GRADS)).then_some("degrees")
        } else if is_in(FEET) {
            Some("ft")
        } else if is_in(US_FEET) {
            Some("us-ft")
        } else {
            (!is_in(OTHER_LENGTHS)).then_some("m")
        }
    }
}

impl fmt::Display for Epsg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "EPSG:{}", self.horizontal)?;
        self.vertical.map_or(Ok(()), |vertical| write!(f, "+{vertical}"))
    }
}

/// Whether ranges contain a code.
fn is_in(number: u16, ranges: Ranges) -> bool {
    ranges
        .iter()
        .any(|&(first, last, step)| (first..=last).contains(&number) && (number - first).is_multiple_of(step))
}

/// Whether an EPSG code is that of a geographic system (longitude and latitude). All other systems
/// of rasters are projected. GeoTIFF uses different keys for the two.
pub(super) fn is_geographic(code: u16) -> bool {
    GEOGRAPHIC.iter().any(|&(first, last)| (first..=last).contains(&code))
}

/// Ranges of codes with geographic and no projected systems, from the EPSG registry. (Codes within
/// them that are neither do not matter here.)
#[rustfmt::skip]
const GEOGRAPHIC: &[(u16, u16)] = &[
    (3819, 3824), (3888, 3889), (3906, 3906), (4001, 4025), (4027, 4036), (4040, 4047), (4052, 4055),
    (4074, 4081), (4120, 4216), (4218, 4388), (4463, 4466), (4469, 4470), (4472, 4472), (4475, 4483),
    (4490, 4490), (4555, 4558), (4600, 4646), (4657, 4765), (4801, 4811), (4813, 4821), (4823, 4824),
    (4883, 5013), (5132, 5132), (5228, 5233), (5245, 5246), (5251, 5252), (5263, 5264), (5323, 5324),
    (5340, 5342), (5353, 5354), (5359, 5360), (5364, 5365), (5370, 5381), (5392, 5393), (5451, 5451),
    (5464, 5464), (5467, 5467), (5488, 5489), (5524, 5527), (5545, 5546), (5560, 5561), (5592, 5593),
    (5681, 5681), (5830, 5830), (5885, 5886), (6134, 6135), (6207, 6207), (6310, 6311), (6318, 6325),
    (6364, 6365), (6667, 6668), (6705, 6706), (6782, 6783), (6881, 6883), (6892, 6894), (6979, 6983),
    (6986, 6990), (7034, 7042), (7072, 7073), (7084, 7088), (7133, 7139), (7372, 7373), (7657, 7686),
    (7797, 7798), (7816, 7816), (7843, 7844), (7880, 7881), (7885, 7886), (7900, 7931), (8042, 8043),
    (8085, 8086), (8231, 8255), (8351, 8351), (8399, 8431), (8449, 8449), (8542, 8545), (8684, 8685),
    (8694, 8818), (8860, 8902), (8906, 8907), (8916, 8949), (8972, 9019), (9053, 9140), (9147, 9148),
    (9152, 9153), (9183, 9184), (9248, 9248), (9251, 9251), (9253, 9253), (9267, 9267), (9293, 9294),
    (9299, 9299), (9308, 9309), (9332, 9333), (9364, 9364), (9372, 9372), (9379, 9384), (9403, 9403),
    (9453, 9453), (9469, 9470), (9474, 9475), (9546, 9547), (9695, 9696), (9701, 9702), (9739, 9739),
    (9754, 9758), (9763, 9763), (9776, 9784), (9866, 9866), (9871, 9871), (9893, 9893), (9939, 9939),
    (9964, 9964), (9969, 9969), (9974, 9974), (9989, 10158), (10175, 10178), (10185, 10185), (10191, 10191),
    (10196, 10196), (10204, 10204), (10209, 10209), (10214, 10214), (10219, 10219), (10224, 10224),
    (10229, 10229), (10237, 10237), (10249, 10249), (10252, 10252), (10256, 10256), (10260, 10260),
    (10265, 10265), (10268, 10268), (10272, 10272), (10277, 10277), (10283, 10284), (10298, 10305),
    (10307, 10312), (10327, 10328), (10345, 10414), (10468, 10468), (10474, 10475), (10570, 10571),
    (10605, 10606), (10623, 10623), (10628, 10628), (10635, 10639), (10670, 10673), (10689, 10690),
    (10724, 10725), (10735, 10739), (10758, 10758), (10761, 10762), (10780, 10785), (10790, 10791),
    (10799, 10800), (10806, 10807), (10830, 10831), (10849, 10849), (10860, 10860), (10874, 10898),
    (10909, 10910), (10940, 10941), (10951, 10968), (11042, 11043), (20033, 20041), (20045, 20046),
];

#[cfg(test)]
mod tests {
    use super::{Epsg, is_geographic};

    #[test]
    fn known_systems() {
        for code in [4326, 4269, 4258, 4267, 4979, 4149, 6318, 7844, 9000] {
            assert!(is_geographic(code), "{code}");
        }
        for code in [3857, 2056, 21781, 25832, 32632, 4087, 4093, 4417, 27700, 5070, 8857] {
            assert!(!is_geographic(code), "{code}");
        }
    }

    #[test]
    fn numbers_are_read_and_shown() {
        for text in ["4326", "4326+5773", "4979"] {
            assert_eq!(Epsg::parse_numbers(text).unwrap().to_string(), format!("EPSG:{text}"));
        }
        for text in ["", "+", "4326+", "+5773", "-1", "+4326", "0", "4326+5773+1", "99999999999"] {
            assert_eq!(Epsg::parse_numbers(text), None, "{text}");
        }
    }

    #[test]
    fn compound_systems_are_their_parts() {
        let parts = Epsg { horizontal: 28992, vertical: Some(5709) };
        assert_eq!(Epsg::new(7415).in_parts(), parts);
        assert_eq!(parts.in_parts(), parts);
        assert_eq!(Epsg::new(4979).in_parts(), Epsg::new(4979));
    }

    #[test]
    fn heights_do_not_change_the_plane() {
        let plane = |number| Epsg::new(number).plane();
        assert_eq!([4979, 4937, 6319, 9518].map(plane), [4326, 4258, 6318, 4326]);
        assert_eq!([4326, 4978, 28992, 7415].map(plane), [4326, 4978, 28992, 28992]);
    }

    #[test]
    fn units_of_the_plane() {
        let unit = |number| Epsg::new(number).unit();
        assert_eq!([4326, 4979, 9518].map(unit), [Some("degrees"); 3]);
        assert_eq!([32628, 3857, 7415, 2853, 6538].map(unit), [Some("m"); 5]);
        assert_eq!([4978, 4936, 7842].map(unit), [Some("m"); 3], "geocentric systems");
        assert_eq!([2263, 26746, 6539].map(unit), [Some("us-ft"); 3]);
        assert_eq!([2222, 2992].map(unit), [Some("ft"); 2]);
        assert_eq!([4807, 24571, 70000].map(unit), [None; 3]);
    }
}
