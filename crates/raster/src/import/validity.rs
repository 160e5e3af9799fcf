//! Detection of VOID pixels by their samples: opacity, nodata and NaN.

use super::{Pixels, RasterInfo, Transparent};
use spinney_base::value::{Number, SampleType, ValueType};
use spinney_references::PixelRule;

/// Detects VOID pixels by their samples.
pub(crate) struct Validity {
    sample: SampleType,
    channels: usize,
    rule: PixelRule,
}

impl Validity {
    /// By opacity only; nodata and NaN are left to the caller.
    pub(crate) fn by_opacity(info: &RasterInfo) -> Validity {
        let RasterInfo { sample, channels, alpha, transparent, .. } = *info;
        // Whether a pixel of zeros, with neither colour nor opacity, is VOID.
        let zeros = alpha.is_some() && transparent == Transparent::Masked;
        let opacity = alpha.filter(|_| transparent == Transparent::Void).map(|alpha| alpha as u16);
        Validity { sample, channels, rule: PixelRule { opacity, zeros, ..PixelRule::default() } }
    }

    /// By opacity, the nodata number and NaN.
    pub(crate) fn by_all(info: &RasterInfo) -> Validity {
        let nodata = info.nodata.and_then(|number| sample_bytes(number, info.sample));
        let nodata = nodata.map(|sample| sample.repeat(info.channels));
        let by_opacity = Validity::by_opacity(info);
        Validity { rule: PixelRule { nodata, nan: info.sample.is_float(), ..by_opacity.rule }, ..by_opacity }
    }

    /// The rule, without the type of pixels.
    pub(crate) fn rule(&self) -> &PixelRule {
        &self.rule
    }

    /// Combines the flags with the validity of the samples. Afterwards flags are absent only if no
    /// pixel is VOID.
    pub(super) fn apply(&self, pixels: &mut Pixels) {
        self.rule.apply((self.sample, self.channels), &pixels.bytes, &mut pixels.valid);
    }
}

/// A number as a little-endian sample, rounded in floating-point types; `None` if an integer type
/// cannot hold it.
pub(super) fn sample_bytes(number: Number, sample: SampleType) -> Option<Vec<u8>> {
    let fits = sample.is_float() || sample.can_hold(number);
    let value = ValueType::new(sample, 1).nearest_numbers(|_| number);
    fits.then(|| value.to_bytes()[..sample.size()].to_vec())
}

/// The number as samples of a type store it, rounded in floating-point types; `None` if an integer
/// type cannot hold it.
pub(crate) fn as_stored(number: Number, sample: SampleType) -> Option<Number> {
    match sample {
        SampleType::F32 => Some(sample.nearest(number)),
        // NaN is not equal to itself, but is a valid nodata number.
        SampleType::F64 => Some(number.to_f64().into()),
        _ => sample_bytes(number, sample).map(|_| number),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flags(info: &RasterInfo, bytes: Vec<u8>, valid: Option<Vec<bool>>) -> Option<Vec<bool>> {
        let mut pixels = Pixels { bytes, valid };
        Validity::by_all(info).apply(&mut pixels);
        pixels.valid
    }

    #[test]
    fn opacity_nodata_nan_and_masks_make_pixels_invalid() {
        let grey = RasterInfo::plain([2, 1], SampleType::U8, 1);
        assert_eq!(flags(&grey, vec![0, 7], None), None);
        let nodata = RasterInfo { nodata: Some(7.into()), ..grey.clone() };
        assert_eq!(flags(&nodata, vec![0, 7], None), Some(vec![true, false]));
        assert_eq!(flags(&nodata, vec![0, 8], None), None);
        assert_eq!(flags(&nodata, vec![0, 7], Some(vec![false, true])), Some(vec![false, false]));
        let impossible = RasterInfo { nodata: Some((-1).into()), ..grey };
        assert_eq!(flags(&impossible, vec![0, 255], None), None);
        let alpha = RasterInfo { alpha: Some(1), ..RasterInfo::plain([2, 1], SampleType::U16, 2) };
        assert_eq!(flags(&alpha, vec![0, 0, 0, 1, 1, 1, 0, 0], None), Some(vec![true, false]));
        let float = RasterInfo::plain([3, 1], SampleType::F32, 1);
        let bytes = [0.0, f32::NAN, 1.0].iter().flat_map(|number| number.to_le_bytes()).collect();
        assert_eq!(flags(&float, bytes, None), Some(vec![true, false, true]));
        let float_alpha = RasterInfo { alpha: Some(0), ..float };
        let bytes = [0.0, -0.0, f32::MIN_POSITIVE].iter().flat_map(|number| number.to_le_bytes()).collect();
        assert_eq!(flags(&float_alpha, bytes, None), Some(vec![false, false, true]));
    }
}
