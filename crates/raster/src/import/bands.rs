//! Choosing channels of a raster.

use std::path::Path;

use super::{Pixels, Raster, RasterInfo};
use spinney_base::space::Region;
use spinney_base::value::ValueType;
use spinney_base::{Error, Result};
use spinney_container::{ScopedTags, TagScope};

/// Some channels of a raster.
struct Bands {
    raster: Box<dyn Raster>,
    /// Channels of the raster, from 0.
    chosen: Vec<usize>,
    info: RasterInfo,
    /// Samples of all channels from the last read.
    all: Vec<u8>,
}

/// The raster of the chosen bands, which count from 1, in this order.
///
/// Opacity that is not chosen is left out: pixels that are VOID by it become ordinary ones.
///
/// # Errors
/// If there is no band of such a number, or none is chosen.
pub fn select(raster: Box<dyn Raster>, bands: &[usize]) -> Result<Box<dyn Raster>> {
    let info = raster.info();
    if bands.is_empty() || bands.iter().any(|band| !(1..=info.channels).contains(band)) {
        let found = bands.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
        let expected = format!("numbers of 1 to {} for {}", info.channels, raster.path().display());
        return Err(Error::invalid("bands", found, expected));
    }
    let chosen: Vec<usize> = bands.iter().map(|band| band - 1).collect();
    if chosen.iter().copied().eq(0..info.channels) {
        return Ok(raster);
    }
    let place = |channel: usize| chosen.iter().position(|other| *other == channel);
    let class_channel = place(info.class_channel);
    let info = RasterInfo {
        channels: chosen.len(),
        alpha: info.alpha.and_then(place),
        class_names: class_channel.map_or(Vec::new(), |_| info.class_names.clone()),
        class_channel: class_channel.unwrap_or(0),
        band_names: pick(&info.band_names, &chosen),
        colour_roles: pick(&info.colour_roles, &chosen),
        scale_offset: pick(&info.scale_offset, &chosen),
        units: pick(&info.units, &chosen),
        scoped_tags: pick_tags(&info.scoped_tags, &chosen),
        ..info.clone()
    };
    Ok(Box::new(Bands { raster, chosen, info, all: Vec::new() }))
}

/// The items of the chosen channels; nothing if there is not one per channel.
fn pick<T: Clone>(items: &[T], chosen: &[usize]) -> Vec<T> {
    chosen.iter().filter_map(|channel| items.get(*channel).cloned()).collect()
}

/// The tags of the picture and of the chosen channels.
fn pick_tags(tags: &ScopedTags, chosen: &[usize]) -> ScopedTags {
    let mut picked: ScopedTags = tags.clone();
    picked.retain(|scope, _| scope.channel.is_none());
    for (scope, tags) in tags {
        let places =
            chosen.iter().zip(0..).filter(|(channel, _)| scope.channel.map(usize::from) == Some(**channel));
        picked.extend(places.map(|(_, place)| {
            (TagScope { channel: Some(place), domain: scope.domain.clone() }, tags.clone())
        }));
    }
    picked
}

/// The type that a tree of all of a raster's channels has.
///
/// # Errors
/// If trees cannot have such values; the message says which bands there are to choose from.
pub fn value_type(path: &Path, info: &RasterInfo) -> Result<ValueType> {
    let channels = u8::try_from(info.channels).unwrap_or(u8::MAX);
    let value = ValueType::new(info.sample, channels);
    if value.is_supported() {
        return Ok(value);
    }
    const LISTED: usize = 16;
    let name = |(i, name): (usize, &String)| match name.as_str() {
        "" => (i + 1).to_string(),
        name => format!("{} ({name})", i + 1),
    };
    let mut bands: Vec<String> = info.band_names.iter().enumerate().take(LISTED).map(name).collect();
    if info.channels > bands.len() {
        bands.push(format!("... {}", info.channels));
    }
    let found = format!("{} bands of {} as one value", info.channels, info.sample.name());
    let advice = format!("choose some with --band, such as --band 1, of {}", bands.join(", "));
    Err(Error::unsupported(path, found, advice))
}

impl Raster for Bands {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        self.raster.path()
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        // The caller's buffer for what is left, our own for all channels.
        std::mem::swap(&mut pixels.bytes, &mut self.all);
        let result = self.raster.read(region, pixels);
        std::mem::swap(&mut pixels.bytes, &mut self.all);
        result?;
        let size = self.info.sample.size();
        let all = self.raster.info().pixel_bytes();
        pixels.bytes.clear();
        pixels.bytes.reserve_exact(region.area() as usize * self.info.pixel_bytes());
        for pixel in self.all.chunks_exact(all) {
            for channel in &self.chosen {
                pixels.bytes.extend_from_slice(&pixel[channel * size..][..size]);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fake::Fake;
    use super::*;
    use spinney_base::value::SampleType;

    #[test]
    fn channels_are_picked_in_order() {
        let mut info = RasterInfo::plain([2, 2], SampleType::U16, 3);
        info.band_names = ["a", "b", "c"].map(String::from).to_vec();
        info.alpha = Some(2);
        let scope = |channel| TagScope { channel, domain: "D".into() };
        info.scoped_tags = [None, Some(1), Some(2)].map(|channel| (scope(channel), [].into())).into();
        let fake = || Box::new(Fake::new(info.clone(), (0..24).collect()));
        let mut picked = select(fake(), &[3, 1]).unwrap();
        assert_eq!((picked.info().channels, picked.info().alpha), (2, Some(0)));
        assert_eq!(picked.info().band_names, ["c", "a"]);
        assert!(picked.info().scoped_tags.keys().eq(&[scope(None), scope(Some(0))]));
        let mut pixels = Pixels::default();
        picked.read(Region::new(0, 1, 2, 1), &mut pixels).unwrap();
        assert_eq!(pixels.bytes, [16, 17, 12, 13, 22, 23, 18, 19]);
        for wrong in [&[][..], &[0], &[1, 4]] {
            assert!(matches!(select(fake(), wrong), Err(Error::Invalid { .. })));
        }
    }

    #[test]
    fn too_many_bands_are_listed() {
        let mut info = RasterInfo::plain([2, 2], SampleType::I16, 3);
        info.band_names[1] = "near infrared".into();
        let message = value_type(Path::new("x.tif"), &info).unwrap_err().to_string();
        assert!(message.contains("--band") && message.contains("1, 2 (near infrared), 3"), "{message}");
        info.channels = 300;
        info.band_names = vec![String::new(); 300];
        let message = value_type(Path::new("x.tif"), &info).unwrap_err().to_string();
        assert!(message.contains("16, ... 300"), "{message}");
        info.channels = 1;
        assert_eq!(value_type(Path::new("x.tif"), &info).unwrap().to_string(), "i16");
    }
}
