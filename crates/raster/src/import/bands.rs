//! Selection of a raster's channels.

use std::convert::Infallible;
use std::fmt::{self, Display};
use std::path::Path;
use std::str::FromStr;

use super::{Pixels, Raster, RasterInfo, SourceWindows};
use serde::{Deserialize, Serialize};
use spinney_base::space::Region;
use spinney_base::value::{DataKind, Number, Palette, SampleType, ValueType};
use spinney_base::{Error, Result};
use spinney_container::{ScopedTags, TagScope};

/// A requested channel.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Band {
    /// By number, from 1.
    Number(usize),
    /// By name: the whole name, or its section before a comma.
    Name(String),
}

impl From<usize> for Band {
    fn from(number: usize) -> Band {
        Band::Number(number)
    }
}

impl FromStr for Band {
    type Err = Infallible;

    fn from_str(text: &str) -> std::result::Result<Band, Infallible> {
        Ok(text.parse().map_or_else(|_| Band::Name(text.into()), Band::Number))
    }
}

impl Display for Band {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Band::Number(number) => number.fmt(f),
            Band::Name(name) => name.fmt(f),
        }
    }
}

/// Properties of a single channel, in files whose channels differ in them.
#[derive(Clone, Debug, PartialEq)]
pub struct BandInfo {
    /// Type of its samples if it is selected alone.
    pub sample: SampleType,
    /// The number that marks missing samples.
    pub nodata: Option<Number>,
    /// Colours of its values.
    pub palette: Option<Palette>,
    /// Names of its values.
    pub class_names: Vec<(Number, String)>,
}

impl RasterInfo {
    /// The properties of each channel, for modification.
    pub(super) fn bands_mut(&mut self) -> &mut [BandInfo] {
        if self.bands.is_empty() {
            let alike = BandInfo {
                sample: self.sample,
                nodata: self.nodata,
                palette: self.palette.clone().filter(|_| self.channels == 1),
                class_names: Vec::new(),
            };
            self.bands = vec![alike; self.channels];
            if let Some(band) = self.bands.get_mut(self.class_channel) {
                band.class_names = self.class_names.clone();
            }
        }
        &mut self.bands
    }

    /// Finds a requested channel; returns its index from 0.
    ///
    /// # Errors
    /// If there is none, or several have this name.
    pub(super) fn channel_of(&self, path: &Path, band: &Band) -> Result<usize> {
        let named = |is: &dyn Fn(&str) -> bool| -> Vec<usize> {
            let names = self.band_names.iter().enumerate();
            names.filter(|(_, name)| !name.is_empty() && is(name)).map(|(channel, _)| channel).collect()
        };
        let name = band.to_string();
        let mut found = match band {
            Band::Number(number) if (1..=self.channels).contains(number) => return Ok(number - 1),
            _ => named(&|other| other.trim() == name),
        };
        if found.is_empty() {
            found = named(&|other| short_name(other) == name);
        }
        let expected = |what: &str| format!("{what} of {}: {}", path.display(), self.listed_bands());
        match found[..] {
            [channel] => Ok(channel),
            [] => Err(Error::invalid("bands", name, expected("a band"))),
            _ => Err(Error::invalid(
                "bands",
                format!("{name}, which is the name of several bands"),
                expected("a band number"),
            )),
        }
    }

    /// Lists the bands by number and name, as many as fit a message.
    fn listed_bands(&self) -> String {
        const LISTED: usize = 16;
        let name = |(i, name): (usize, &String)| match name.as_str() {
            "" => (i + 1).to_string(),
            name => format!("{} ({name})", i + 1),
        };
        let mut bands: Vec<String> = self.band_names.iter().enumerate().take(LISTED).map(name).collect();
        if self.channels > bands.len() {
            bands.push(format!("... {}", self.channels));
        }
        bands.join(", ")
    }

    /// The properties of some channels, in this order.
    ///
    /// Opacity that is not among them is dropped.
    pub(crate) fn of_channels(&self, chosen: &[usize]) -> RasterInfo {
        if chosen.iter().copied().eq(0..self.channels) {
            return self.clone();
        }
        let place = |channel: usize| chosen.iter().position(|other| *other == channel);
        let class_channel = place(self.class_channel);
        // There may be many channels, so properties of the others are not copied.
        let mut info = RasterInfo {
            width: self.width,
            height: self.height,
            sample: self.sample,
            stored_sample: self.stored_sample.clone(),
            channels: chosen.len(),
            alpha: self.alpha.and_then(place),
            transparent: self.transparent,
            bands: pick(&self.bands, chosen),
            frame: self.frame.clone(),
            nodata: self.nodata,
            palette: self.palette.clone(),
            colour_roles: pick(&self.colour_roles, chosen),
            class_names: class_channel.map_or(Vec::new(), |_| self.class_names.clone()),
            class_channel: class_channel.unwrap_or(0),
            band_names: pick(&self.band_names, chosen),
            scale_offset: pick(&self.scale_offset, chosen),
            units: pick(&self.units, chosen),
            kind: self.kind,
            layout: self.layout.clone(),
            tags: self.tags.clone(),
            scoped_tags: pick_tags(&self.scoped_tags, chosen),
            control_points: self.control_points.clone(),
            remark: self.remark.clone(),
            pages: self.pages,
            order: self.order,
        };
        info.take_from_bands();
        info
    }

    /// Derives raster properties from those of the channels: a type that holds all samples, the
    /// first nodata number, the first names of values, and the palette of a single channel.
    pub(super) fn take_from_bands(&mut self) {
        if self.bands.is_empty() {
            return;
        }
        let sample = common_type(self.bands.iter().map(|band| band.sample));
        if sample != self.sample {
            (self.sample, self.stored_sample) = (sample, sample.name().into());
        }
        self.nodata = self.bands.iter().find_map(|band| band.nodata);
        if let Some(channel) = self.bands.iter().position(|band| !band.class_names.is_empty()) {
            (self.class_channel, self.class_names) = (channel, self.bands[channel].class_names.clone());
        }
        if let [band] = &self.bands[..] {
            self.palette = band.palette.clone();
            // Palettes are for classes.
            self.kind = self.palette.as_ref().map(|_| DataKind::Categorical).or(self.kind);
        }
    }
}

/// The section before a comma in a band name: "B4" of "B4, central wavelength 665 nm".
pub(super) fn short_name(name: &str) -> &str {
    name.split(',').next().unwrap_or_default().trim()
}

/// The smallest type that holds the samples of all these types without loss.
pub(super) fn common_type(types: impl Iterator<Item = SampleType>) -> SampleType {
    use SampleType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    let holds = |wide: SampleType, narrow: SampleType| {
        wide == narrow
            || match wide {
                U8 | I8 => false,
                U16 => narrow == U8,
                I16 => matches!(narrow, U8 | I8),
                U32 => matches!(narrow, U8 | U16),
                I32 | F32 => matches!(narrow, U8 | I8 | U16 | I16),
                U64 => matches!(narrow, U8 | U16 | U32),
                I64 => !matches!(narrow, U64 | F32 | F64),
                F64 => !matches!(narrow, U64 | I64),
            }
    };
    let join = |a: SampleType, b: SampleType| {
        let all = [U8, I8, U16, I16, U32, I32, F32, F64, U64, I64];
        all.into_iter().find(|wide| holds(*wide, a) && holds(*wide, b)).unwrap_or(F64)
    };
    types.reduce(join).unwrap_or(U8)
}

/// A raster with some channels of another one.
struct Bands {
    raster: Box<dyn Raster>,
    /// Channels of the raster, from 0.
    chosen: Vec<usize>,
    info: RasterInfo,
    /// Samples of all channels in the last read.
    all: Vec<u8>,
}

/// Selects bands of a raster, in this order.
///
/// Opacity that is not selected is dropped: pixels that are VOID by it become ordinary ones.
///
/// # Errors
/// If there is no such band, or none is selected.
pub fn select(raster: Box<dyn Raster>, bands: &[Band]) -> Result<Box<dyn Raster>> {
    let info = raster.info();
    if bands.is_empty() {
        let expected = format!("bands of {}: {}", raster.path().display(), info.listed_bands());
        return Err(Error::invalid("bands", "none", expected));
    }
    let chosen = bands.iter().map(|band| info.channel_of(raster.path(), band));
    let chosen = chosen.collect::<Result<Vec<_>>>()?;
    Ok(select_channels(raster, &chosen))
}

/// Selects existing channels of a raster, by index from 0.
pub(super) fn select_channels(mut raster: Box<dyn Raster>, chosen: &[usize]) -> Box<dyn Raster> {
    if chosen.iter().copied().eq(0..raster.info().channels) || raster.choose(chosen) {
        return raster;
    }
    // Avoid reading the other channels if the format allows it. Repeated channels are read once.
    let mut once = Vec::new();
    chosen.iter().for_each(|channel| {
        if !once.contains(channel) {
            once.push(*channel);
        }
    });
    let mut chosen = chosen.to_vec();
    if once.len() < chosen.len() && raster.choose(&once) {
        chosen.iter_mut().for_each(|channel| {
            *channel = once.iter().position(|other| other == channel).unwrap_or_default();
        });
    }
    // All channels are read in their common type.
    let info = RasterInfo { sample: raster.info().sample, ..raster.info().of_channels(&chosen) };
    Box::new(Bands { raster, chosen, info, all: Vec::new() })
}

/// The items of the selected channels; empty if there is not one item per channel.
fn pick<T: Clone>(items: &[T], chosen: &[usize]) -> Vec<T> {
    chosen.iter().filter_map(|channel| items.get(*channel).cloned()).collect()
}

/// The tags of the image and of the selected channels.
fn pick_tags(tags: &ScopedTags, chosen: &[usize]) -> ScopedTags {
    let of = |channel: Option<u16>| {
        let first = TagScope { channel, domain: String::new() };
        tags.range(first..).take_while(move |(scope, _)| scope.channel == channel)
    };
    let mut picked: ScopedTags = of(None).map(|(scope, tags)| (scope.clone(), tags.clone())).collect();
    for (place, channel) in chosen.iter().enumerate() {
        let (Ok(place), Ok(channel)) = (u16::try_from(place), u16::try_from(*channel)) else { continue };
        picked.extend(of(Some(channel)).map(|(scope, tags)| {
            (TagScope { channel: Some(place), domain: scope.domain.clone() }, tags.clone())
        }));
    }
    picked
}

/// Returns the value type of a tree with all channels of a raster.
///
/// # Errors
/// If trees do not support such values; the message lists the available bands.
pub fn value_type(path: &Path, info: &RasterInfo) -> Result<ValueType> {
    let channels = u8::try_from(info.channels).unwrap_or(u8::MAX);
    let value = ValueType::new(info.sample, channels);
    if value.is_supported() {
        return Ok(value);
    }
    let found = format!("a value of {} bands of type {}", info.channels, info.sample.name());
    let bands = info.listed_bands();
    let advice = format!(
        "make a layer of each with --stack, or select some with --band, such as --band 1, from {bands}"
    );
    Err(Error::unsupported(path, found, advice))
}

impl Raster for Bands {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn reads_anywhere(&self) -> bool {
        self.raster.reads_anywhere()
    }

    fn source_windows(&self) -> SourceWindows {
        Err("a selection of bands of a raster that is not a TIFF file, or of one of them twice".into())
    }

    fn prefetch(&mut self, regions: &[Region]) -> Result<usize> {
        self.raster.prefetch(regions)
    }

    fn path(&self) -> &Path {
        self.raster.path()
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        // All channels are read to `self.all`, the selected ones copied to the caller's buffer.
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

    #[test]
    fn channels_are_picked_in_order() {
        let mut info = RasterInfo::plain([2, 2], SampleType::U16, 3);
        info.band_names = ["a", "b", "c"].map(String::from).to_vec();
        info.alpha = Some(2);
        let scope = |channel| TagScope { channel, domain: "D".into() };
        info.scoped_tags = [None, Some(1), Some(2)].map(|channel| (scope(channel), [].into())).into();
        let fake = || Box::new(Fake::new(info.clone(), (0..24).collect()));
        let mut picked = select(fake(), &[3.into(), Band::Name("a".into())]).unwrap();
        assert_eq!((picked.info().channels, picked.info().alpha), (2, Some(0)));
        assert_eq!(picked.info().band_names, ["c", "a"]);
        assert!(picked.info().scoped_tags.keys().eq(&[scope(None), scope(Some(0))]));
        let mut pixels = Pixels::default();
        picked.read(Region::new(0, 1, 2, 1), &mut pixels).unwrap();
        assert_eq!(pixels.bytes, [16, 17, 12, 13, 22, 23, 18, 19]);
        for wrong in ["", "0", "1,4", "d", "1,"] {
            let wrong: Vec<Band> = wrong.split_terminator(',').map(|word| word.parse().unwrap()).collect();
            let wrong =
                if wrong.len() == 1 { [wrong, vec![Band::Name(String::new())]].concat() } else { wrong };
            assert!(matches!(select(fake(), &wrong), Err(Error::Invalid { .. })), "{wrong:?}");
        }
    }

    #[test]
    fn bands_are_selected_by_name() {
        let mut info = RasterInfo::plain([2, 2], SampleType::U16, 5);
        info.band_names = ["B4, red", "B4", "665", "B5, x", "B5, y"].map(String::from).to_vec();
        let channel = |text: &str| info.channel_of(Path::new("x.tif"), &text.parse().unwrap());
        for (text, expected) in [("1", 0), ("B4", 1), ("B4, red", 0), ("665", 2), ("B5, y", 4)] {
            assert_eq!(channel(text).unwrap(), expected, "{text}");
        }
        for text in ["0", "6", "B5", "b4", "", "red"] {
            let message = channel(text).unwrap_err().to_string();
            assert!(message.contains("x.tif: 1 (B4, red), 2 (B4)"), "{message}");
        }
    }

    #[test]
    fn selected_bands_keep_their_properties() {
        let mut info = RasterInfo { nodata: Some(1.into()), ..RasterInfo::plain([2, 2], SampleType::U8, 3) };
        let bands = info.bands_mut();
        (bands[1].sample, bands[2].sample, bands[2].nodata) =
            (SampleType::U16, SampleType::I16, Some((-5).into()));
        bands[1].palette = Some(Palette { colours: vec![[1; 4]] });
        let of = |chosen: &[usize]| info.of_channels(chosen);
        assert_eq!(
            (of(&[2]).sample, of(&[2]).nodata, of(&[2]).kind),
            (SampleType::I16, Some((-5).into()), None)
        );
        assert_eq!((of(&[1]).nodata, of(&[1]).kind), (Some(1.into()), Some(DataKind::Categorical)));
        assert_eq!((of(&[2, 1]).sample, of(&[2, 1]).nodata), (SampleType::I32, Some((-5).into())));
        assert_eq!((of(&[1, 0]).sample, of(&[1, 0]).palette), (SampleType::U16, None));
        assert_eq!(common_type([SampleType::U32, SampleType::I16].into_iter()), SampleType::F64);
        assert_eq!(common_type([SampleType::U16, SampleType::F32].into_iter()), SampleType::F32);
    }

    #[test]
    fn too_many_bands_are_listed() {
        let mut info = RasterInfo::plain([2, 2], SampleType::I16, 3);
        info.band_names[1] = "near infrared".into();
        let message = value_type(Path::new("x.tif"), &info).unwrap_err().to_string();
        assert!(
            message.contains("--band")
                && message.contains("--stack")
                && message.contains("1, 2 (near infrared), 3"),
            "{message}"
        );
        info.channels = 300;
        info.band_names = vec![String::new(); 300];
        let message = value_type(Path::new("x.tif"), &info).unwrap_err().to_string();
        assert!(message.contains("16, ... 300"), "{message}");
        info.channels = 1;
        assert_eq!(value_type(Path::new("x.tif"), &info).unwrap().to_string(), "i16");
    }
}
