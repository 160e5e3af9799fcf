//! PROJ strings of systems of the EPSG registry, as packed by `build.rs`.

/// The packed definitions.
static PACKED: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/definitions"));

/// Returns the PROJ string of a system, or `None` if the list does not have it. Cost: a scan of the
/// list, some microseconds.
pub(crate) fn definition_of(number: u16) -> Option<String> {
    let (counts, rest) = PACKED.split_at(12);
    let [text, definitions, _] =
        [0, 4, 8].map(|at| u32::from_le_bytes([0, 1, 2, 3].map(|byte| counts[at + byte])) as usize);
    let (text, rest) = rest.split_at(text);
    let (numbers, rest) = rest.split_at(2 * definitions);
    let (lengths, words) = rest.split_at(definitions);
    let mut known = 0;
    let place = pairs(numbers).position(|step| {
        known += step;
        known >= number
    })?;
    if known != number {
        return None;
    }
    let before: usize = lengths[..place].iter().map(|length| usize::from(*length)).sum();
    let own = pairs(&words[2 * before..]).take(usize::from(lengths[place]));
    let text = std::str::from_utf8(text).ok()?;
    let all: Vec<&str> = text.lines().collect();
    let own: Option<Vec<&str>> = own.map(|word| all.get(usize::from(word)).copied()).collect();
    own.map(|own| own.join(" "))
}

/// Iterates over consecutive 16-bit numbers.
fn pairs(bytes: &[u8]) -> impl Iterator<Item = u16> {
    bytes.as_chunks::<2>().0.iter().map(|pair| u16::from_le_bytes(*pair))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn definitions_are_those_of_the_list() {
        let strings = include_str!(concat!(env!("OUT_DIR"), "/definitions.txt"));
        let listed: BTreeMap<&str, &str> = strings.lines().filter_map(|line| line.split_once(' ')).collect();
        assert!(listed.len() > 6000, "{}", listed.len());
        for number in 0..=u16::MAX {
            let expected = listed.get(number.to_string().as_str()).copied();
            assert_eq!(definition_of(number).as_deref(), expected, "EPSG:{number}");
        }
        assert_eq!(listed["4326"], "+proj=longlat +datum=WGS84 +no_defs");
    }
}
