//! Rules for pixels that are VOID, and painting of the others.

use serde::{Deserialize, Serialize};
use spinney_base::value::SampleType;

/// Which pixels are VOID by their samples.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PixelRule {
    /// Bytes of the pixel that means VOID.
    pub nodata: Option<Vec<u8>>,
    /// Whether a pixel with a NaN is VOID.
    pub nan: bool,
    /// Channel whose zero makes a pixel VOID.
    pub opacity: Option<u16>,
    /// Whether a pixel of zeros is VOID.
    pub zeros: bool,
    /// Channel of the source, from 0, whose zeros make pixels VOID, and which is not one of theirs.
    pub hidden_opacity: Option<u16>,
    /// Whether the source's mask has no effect.
    pub ignores_mask: bool,
}

impl PixelRule {
    /// Whether no pixel is VOID by its samples.
    pub(crate) fn is_none(&self) -> bool {
        self.nodata.is_none() && !self.nan && self.opacity.is_none() && !self.zeros
    }

    /// Combines the flags of pixels of `channels` samples with the rule. Afterwards flags are
    /// absent only if no pixel is VOID.
    pub fn apply(
        &self,
        (sample, channels): (SampleType, usize),
        bytes: &[u8],
        valid: &mut Option<Vec<bool>>,
    ) {
        if self.is_none() {
            return;
        }
        let found = bytes.chunks_exact(channels * sample.size()).map(|pixel| !self.is_void(sample, pixel));
        match valid {
            Some(flags) => flags.iter_mut().zip(found).for_each(|(flag, valid)| *flag &= valid),
            None if found.clone().all(|valid| valid) => {}
            none => *none = Some(found.collect()),
        }
    }

    fn is_void(&self, sample: SampleType, pixel: &[u8]) -> bool {
        let size = sample.size();
        self.opacity.is_some_and(|channel| is_zero(sample, &pixel[usize::from(channel) * size..][..size]))
            || self.zeros && pixel.iter().all(|byte| *byte == 0)
            || self.nodata.as_ref().is_some_and(|nodata| nodata == pixel)
            || self.nan && pixel.chunks_exact(size).any(|bytes| is_nan(sample, bytes))
    }
}

fn is_zero(sample: SampleType, bytes: &[u8]) -> bool {
    let (last, rest) = bytes.split_last().expect("samples have bytes");
    // Minus zero is zero too.
    let sign = if sample.is_float() { 0x80 } else { 0 };
    last & !sign == 0 && rest.iter().all(|byte| *byte == 0)
}

fn is_nan(sample: SampleType, bytes: &[u8]) -> bool {
    match sample {
        SampleType::F32 => f32::from_le_bytes(bytes.try_into().expect("four bytes")).is_nan(),
        SampleType::F64 => f64::from_le_bytes(bytes.try_into().expect("eight bytes")).is_nan(),
        _ => false,
    }
}

/// Combines the flags of pixels with a channel of opacity: pixels of opacity 0 are VOID.
pub(crate) fn apply_opacity(sample: SampleType, opacity: &[u8], valid: &mut Option<Vec<bool>>) {
    let rule = PixelRule { opacity: Some(0), ..PixelRule::default() };
    rule.apply((sample, 1), opacity, valid);
}

/// Copies the valid pixels of a row, of `size` bytes each, to those that have none yet. Without
/// `flags` all are valid.
pub fn paint(target: &mut [u8], covered: &mut [bool], samples: &[u8], flags: Option<&[bool]>, size: usize) {
    if flags.is_none() && !covered.contains(&true) {
        target.copy_from_slice(samples);
        covered.fill(true);
        return;
    }
    let pixels = target.chunks_exact_mut(size).zip(samples.chunks_exact(size));
    for (at, ((target, sample), covered)) in pixels.zip(covered).enumerate() {
        if !*covered && flags.is_none_or(|flags| flags[at]) {
            target.copy_from_slice(sample);
            *covered = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flags(
        rule: &PixelRule,
        sample: SampleType,
        bytes: &[u8],
        before: Option<Vec<bool>>,
    ) -> Option<Vec<bool>> {
        let mut valid = before;
        let channels = 2;
        rule.apply((sample, channels), bytes, &mut valid);
        valid
    }

    #[test]
    fn rules_find_void_pixels() {
        let none = PixelRule::default();
        let nodata = PixelRule { nodata: Some(vec![7, 7]), ..none.clone() };
        let alpha = PixelRule { opacity: Some(1), ..none.clone() };
        let zero = PixelRule { zeros: true, ..none.clone() };
        let pixels = [7, 7, 7, 0, 0, 7, 0, 0];
        for (rule, expected) in [
            (&none, None),
            (&nodata, Some(vec![false, true, true, true])),
            (&alpha, Some(vec![true, false, true, false])),
            (&zero, Some(vec![true, true, true, false])),
        ] {
            assert_eq!(flags(rule, SampleType::U8, &pixels, None), expected);
        }
        // Pixels that were VOID before still are; without VOID pixels there are no flags.
        let before = Some(vec![false, true, true, true]);
        assert_eq!(flags(&zero, SampleType::U8, &pixels, before), Some(vec![false, true, true, false]));
        assert_eq!(flags(&zero, SampleType::U8, &[1, 0, 0, 1], None), None);
        // A value of another length is never found.
        let long = PixelRule { nodata: Some(vec![7; 3]), ..none };
        assert_eq!(flags(&long, SampleType::U8, &pixels, None), None);
    }

    #[test]
    fn zeros_and_nan_of_floats() {
        let bytes =
            |numbers: &[f32]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
        let pixels = bytes(&[0.0, -0.0, f32::NAN, 1.0, 1.0, f32::MIN_POSITIVE]);
        let of = |rule: PixelRule| flags(&rule, SampleType::F32, &pixels, None);
        let none = PixelRule::default;
        // Minus zero has no opacity, but is no pixel of zero bytes.
        assert_eq!(of(PixelRule { opacity: Some(1), ..none() }), Some(vec![false, true, true]));
        assert_eq!(of(PixelRule { zeros: true, ..none() }), None);
        assert_eq!(of(PixelRule { nan: true, ..none() }), Some(vec![true, false, true]));
        let wide: Vec<u8> = [f64::NAN, 1.0].iter().flat_map(|number| number.to_le_bytes()).collect();
        let rule = PixelRule { nan: true, ..none() };
        assert_eq!(flags(&rule, SampleType::F64, &wide, None), Some(vec![false]));
        // Integers are never NaN, and -128 is not zero.
        assert_eq!(flags(&rule, SampleType::I16, &[0xff; 4], None), None);
        let rule = PixelRule { opacity: Some(0), ..none() };
        assert_eq!(flags(&rule, SampleType::I8, &[0x80, 0, 0, 1], None), Some(vec![true, false]));
    }

    #[test]
    fn opacity_is_combined_with_flags() {
        let mut valid = Some(vec![true, false, true]);
        apply_opacity(SampleType::U16, &[1, 0, 1, 0, 0, 0], &mut valid);
        assert_eq!(valid, Some(vec![true, false, false]));
        let mut valid = None;
        apply_opacity(SampleType::U16, &[1, 0, 0, 1], &mut valid);
        assert_eq!(valid, None);
    }

    #[test]
    fn only_unknown_pixels_are_painted() {
        let (mut target, mut covered) = ([0; 6], [false; 3]);
        paint(&mut target, &mut covered, &[1; 6], Some(&[true, false, false]), 2);
        assert_eq!((target, covered), ([1, 1, 0, 0, 0, 0], [true, false, false]));
        paint(&mut target, &mut covered, &[2; 6], Some(&[true, true, false]), 2);
        assert_eq!((target, covered), ([1, 1, 2, 2, 0, 0], [true, true, false]));
        paint(&mut target, &mut covered, &[3; 6], None, 2);
        assert_eq!((target, covered), ([1, 1, 2, 2, 3, 3], [true; 3]));
        let (mut target, mut covered) = ([0; 2], [false; 2]);
        paint(&mut target, &mut covered, &[4, 5], None, 1);
        assert_eq!((target, covered), ([4, 5], [true; 2]));
    }
}
