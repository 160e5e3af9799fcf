//! Detection of VOID pixels by their samples: opacity, nodata and NaN.

use super::{Pixels, RasterInfo, Transparent};
use spinney_base::value::{Number, SampleType, ValueType};

/// Detects VOID pixels by their samples.
pub(super) struct Validity {
    sample: SampleType,
    channels: usize,
    alpha: Option<usize>,
    /// Whether a pixel of zeros, with neither colour nor opacity, is VOID.
    zero: bool,
    /// A pixel with the nodata number in all channels.
    nodata: Option<Vec<u8>>,
    /// Whether a NaN sample makes a pixel VOID.
    nan: bool,
}

impl Validity {
    /// By opacity only; nodata and NaN are left to the caller.
    pub(super) fn by_opacity(info: &RasterInfo) -> Validity {
        let RasterInfo { sample, channels, alpha, transparent, .. } = *info;
        let zero = alpha.is_some() && transparent == Transparent::Masked;
        let alpha = alpha.filter(|_| transparent == Transparent::Void);
        Validity { sample, channels, alpha, zero, nodata: None, nan: false }
    }

    /// By opacity, the nodata number and NaN.
    pub(super) fn by_all(info: &RasterInfo) -> Validity {
        let nodata = info.nodata.and_then(|number| sample_bytes(number, info.sample));
        let nodata = nodata.map(|sample| sample.repeat(info.channels));
        Validity { nodata, nan: info.sample.is_float(), ..Validity::by_opacity(info) }
    }

    /// Combines the flags with the validity of the samples. Afterwards flags are absent only if no
    /// pixel is VOID.
    pub(super) fn apply(&self, pixels: &mut Pixels) {
        if self.alpha.is_none() && !self.zero && self.nodata.is_none() && !self.nan {
            return;
        }
        let size = self.channels * self.sample.size();
        let found = pixels.bytes.chunks_exact(size).map(|pixel| !self.is_void(pixel));
        match &mut pixels.valid {
            Some(flags) => flags.iter_mut().zip(found).for_each(|(flag, valid)| *flag &= valid),
            None if found.clone().all(|valid| valid) => {}
            none => *none = Some(found.collect()),
        }
    }

    fn is_void(&self, pixel: &[u8]) -> bool {
        let size = self.sample.size();
        self.alpha.is_some_and(|alpha| self.is_zero(&pixel[alpha * size..][..size]))
            || self.zero && pixel.iter().all(|byte| *byte == 0)
            || self.nodata.as_ref().is_some_and(|nodata| nodata == pixel)
            || self.nan && pixel.chunks_exact(size).any(|sample| self.is_nan(sample))
    }

    fn is_zero(&self, sample: &[u8]) -> bool {
        let (last, rest) = sample.split_last().expect("samples have bytes");
        // Minus zero is zero too.
        let sign = if self.sample.is_float() { 0x80 } else { 0 };
        last & !sign == 0 && rest.iter().all(|byte| *byte == 0)
    }

    fn is_nan(&self, sample: &[u8]) -> bool {
        match self.sample {
            SampleType::F32 => f32::from_le_bytes(sample.try_into().expect("four bytes")).is_nan(),
            SampleType::F64 => f64::from_le_bytes(sample.try_into().expect("eight bytes")).is_nan(),
            _ => false,
        }
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
