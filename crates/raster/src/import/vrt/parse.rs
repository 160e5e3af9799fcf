//! Parser of virtual rasters' XML.

use std::collections::HashMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::ahead::PixelMapping;
use super::super::bands::{BandInfo, common_type};
use super::super::lazy::{Lazy, MAX_POOL, Pool};
use super::super::plan::MAX_OPEN;
use super::super::validity::{as_stored, sample_bytes};
use super::super::xml::XmlElement;
use super::super::{Raster, RasterInfo, RasterOptions, gdal, sidecar, worldfile};
use super::{Band, Missing, Nesting, Plane, Source, Vrt, order, unsupported};
use crate::index::stat;
use spinney_base::io::{gdal_url, listed_path, url_of};
use spinney_base::space::Region;
use spinney_base::value::{DataKind, SampleType};
use spinney_base::{Error, Result};

/// Maximum number of pixels per side, as in GDAL.
const MAX_PIXELS: u64 = i32::MAX as u64;
/// Number of pixels of a band that may always be empty. Larger rasters need sources that cover a
/// minimum share of them.
const MAX_EMPTY: u64 = 1 << 32;
const MAX_EMPTY_PER_PIXEL: u64 = 1 << 16;
/// Maximum number of bands, as in TIFF.
const MAX_BANDS: usize = 65535;
/// Maximum pixels per side for a pixel of a source.
const MAX_REPEATED: f64 = 1000.0;
/// Maximum distance of rectangles from whole pixels.
const TOLERANCE: f64 = 0.01;

/// State of the parser.
struct Reader<'a> {
    path: &'a Path,
    size: [u64; 2],
    nesting: Nesting,
    /// Options to open sources.
    options: RasterOptions,
    pool: Arc<Pool>,
    /// Opened sources by path, and their own number of sources, including themselves.
    known: HashMap<PathBuf, (Lazy, u64)>,
}

/// Reads a file, and the headers of its sources.
pub(super) fn read(path: &Path, options: &RasterOptions) -> Result<Vrt> {
    let file = options.access.input(path)?;
    let length = file.len();
    options.check_memory(path, "the XML of the virtual raster", length)?;
    if let Some(recorder) = &options.recorder {
        let found = file.stat(path)?;
        recorder.record_virtual(path, found.map_or_else(|| stat(path, &options.access), Ok)?);
    }
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes).map_err(Error::io(path, "read"))?;
    let text = String::from_utf8(bytes)
        .map_err(|_| Error::corrupt(path, "the whole file", "bytes that are not UTF-8", "XML in UTF-8"))?;
    let Some(root) = XmlElement::document(&text).named("VRTDataset").next() else {
        return Err(Error::corrupt(
            path,
            "the whole file",
            "no such element, or not its end",
            "<VRTDataset>...</VRTDataset>",
        ));
    };
    let side = |name: &str| match root.attribute(name).map(|text| text.trim().parse::<u64>()) {
        Some(Ok(side @ 1..=MAX_PIXELS)) => Ok(side),
        found => {
            let found = found.map_or("nothing".into(), |_| root.attribute(name).unwrap_or_default());
            Err(Error::corrupt(path, name, found, format!("1 to {MAX_PIXELS}")))
        }
    };
    let nesting = options.nesting.inside(path)?;
    // Nested virtual rasters keep few files open, since these multiply.
    let (most, files) = if options.nesting.depth == 0 { (MAX_OPEN, MAX_POOL) } else { (2, 2) };
    let mut reader = Reader {
        path,
        size: [side("rasterXSize")?, side("rasterYSize")?],
        options: RasterOptions {
            memory: options.memory / most as u64,
            nesting: nesting.clone(),
            access: options.access.clone(),
            recorder: options.recorder.clone(),
            ..RasterOptions::default()
        },
        nesting,
        pool: Pool::new(files, options.memory),
        known: HashMap::new(),
    };
    reader.vrt(&root)
}

impl Reader<'_> {
    fn refuse<T>(&self, found: impl Into<String>) -> Result<T> {
        Err(unsupported(self.path, found))
    }

    fn vrt(&mut self, root: &XmlElement<'_>) -> Result<Vrt> {
        if let Some(class) = root.attribute("subClass") {
            return self.refuse(format!("a virtual raster of class {class}"));
        }
        let elements: Vec<XmlElement<'_>> = root.named("VRTRasterBand").take(MAX_BANDS + 1).collect();
        if elements.is_empty() || elements.len() > MAX_BANDS {
            let found = format!("{} bands", elements.len());
            return Err(Error::corrupt(self.path, "VRTDataset", found, format!("1 to {MAX_BANDS} bands")));
        }
        let types = elements.iter().map(|band| self.sample(band)).collect::<Result<Vec<_>>>()?;
        let mut info = RasterInfo::plain(
            self.size,
            common_type(types.iter().map(|(sample, _)| *sample)),
            elements.len(),
        );
        if types.iter().all(|(_, name)| *name == types[0].1) {
            info.stored_sample = types[0].1.to_lowercase();
        }
        let plain = |(sample, _): &(SampleType, String)| BandInfo {
            sample: *sample,
            nodata: None,
            palette: None,
            class_names: Vec::new(),
        };
        info.bands = types.iter().map(plain).collect();
        for element in root.children() {
            match element.name {
                "SRS" => info.frame.crs = worldfile::crs(self.path, &element.text())?,
                "GeoTransform" => {
                    info.frame.matrix = sidecar::geo_transform(self.path, &element.text())?.matrix
                }
                "GCPList" => info.control_points = sidecar::control_points(self.path, &element)?,
                "Metadata" => sidecar::apply_metadata(&element, None, &mut info),
                "VRTRasterBand" | "OverviewList" | "BlockXSize" | "BlockYSize" => {}
                "MaskBand" => return self.refuse("a mask of its own (<MaskBand>)"),
                name => return self.refuse(format!("<{name}> in <VRTDataset>")),
            }
        }
        let mut bands = Vec::with_capacity(elements.len());
        for (channel, element) in elements.iter().enumerate() {
            bands.push(self.band(element, channel, &mut info)?);
        }
        self.check_area(&bands)?;
        info.take_from_bands();
        info.order = order(&bands);
        let sources: usize = bands.iter().map(|band| band.sources.len()).sum();
        info.layout = format!("virtual raster (VRT) of {} files, {sources} sources", self.known.len());
        let path = self.path.to_path_buf();
        Ok(Vrt { path, bands, info, part: Default::default(), plane: Plane::default() })
    }

    /// The type of a band's samples, and its name in GDAL.
    fn sample(&self, band: &XmlElement<'_>) -> Result<(SampleType, String)> {
        let name = band.attribute("dataType").unwrap_or_else(|| "Byte".into());
        let sample = match name.as_str() {
            "Byte" => SampleType::U8,
            "UInt16" => SampleType::U16,
            "Int8" => SampleType::I8,
            "Int16" => SampleType::I16,
            "UInt32" => SampleType::U32,
            "Int32" => SampleType::I32,
            "Float16" | "Float32" => SampleType::F32,
            "UInt64" => SampleType::U64,
            "Int64" => SampleType::I64,
            "Float64" => SampleType::F64,
            _ => return self.refuse(format!("samples of type {name}")),
        };
        Ok((sample, name))
    }

    /// Rejects a raster whose sources cover only a tiny share of it.
    fn check_area(&self, bands: &[Band]) -> Result<()> {
        let area = self.size[0] * self.size[1];
        let made: u64 = bands
            .iter()
            .flat_map(|band| &band.sources)
            .fold(0, |sum: u64, source| sum.saturating_add(source.region.area()));
        if area <= made.saturating_mul(MAX_EMPTY_PER_PIXEL).max(MAX_EMPTY) {
            return Ok(());
        }
        let [width, height] = self.size;
        self.refuse(format!("a raster of {width} x {height} pixels, of which sources cover at most {made},"))
    }

    fn band(&mut self, band: &XmlElement<'_>, channel: usize, info: &mut RasterInfo) -> Result<Band> {
        let number = channel + 1;
        if let Some(class) = band.attribute("subClass").filter(|class| class != "VRTSourcedRasterBand") {
            return self.refuse(format!("band {number} of class {class}"));
        }
        if let Some(said) = band.attribute("band").filter(|said| said.trim() != number.to_string()) {
            return Err(Error::corrupt(
                self.path,
                format!("band {number}"),
                format!("the number {said}"),
                "numbers in order",
            ));
        }
        let sample = info.bands[channel].sample;
        let (mut sources, mut nodata, mut hidden) = (Vec::new(), None, false);
        for element in band.children() {
            match element.name {
                "SimpleSource" | "ComplexSource" => sources.extend(self.source(&element, number, sample)?),
                "Description" => info.band_names[channel] = element.text(),
                "ColorInterp" => gdal::set_colour_role(info, channel, element.text()),
                "UnitType" => info.units[channel] = element.text(),
                "Scale" => gdal::set_number(&mut info.scale_offset[channel].0, &element.text()),
                "Offset" => gdal::set_number(&mut info.scale_offset[channel].1, &element.text()),
                "NoDataValue" => {
                    nodata =
                        gdal::nodata(&element.text(), sample).and_then(|number| as_stored(number, sample))
                }
                "HideNoDataValue" => {
                    hidden = matches!(element.text().trim(), "1" | "true" | "TRUE" | "yes" | "YES")
                }
                "CategoryNames" => info.bands[channel].class_names = sidecar::categories(&element),
                "GDALRasterAttributeTable" if info.bands[channel].class_names.is_empty() => {
                    info.bands[channel].class_names = gdal::class_names(&element);
                }
                "ColorTable" => info.bands[channel].palette = sidecar::palette(&element),
                "Metadata" => sidecar::apply_metadata(&element, Some(channel), info),
                "GDALRasterAttributeTable" | "Histograms" | "Overview" | "BlockXSize" | "BlockYSize" => {}
                "MaskBand" => return self.refuse(format!("a mask (<MaskBand>) of band {number}")),
                name => return self.refuse(format!("<{name}> in band {number}")),
            }
        }
        info.bands[channel].nodata = nodata.filter(|_| !hidden);
        if info.bands[channel].palette.is_some() && info.channels == 1 {
            info.kind = Some(DataKind::Categorical);
        }
        let hole = nodata.and_then(|number| sample_bytes(number, sample)).unwrap_or(vec![0; sample.size()]);
        Ok(Band { sample, hole, sources })
    }

    /// Parses a source of a band; `None` if none of its pixels is in the raster.
    fn source(
        &mut self,
        element: &XmlElement<'_>,
        band: usize,
        sample: SampleType,
    ) -> Result<Option<Source>> {
        let of = |what: &str| format!("<{what}> in a source of band {band}");
        let (mut file, mut channel, mut from, mut to, mut nodata) = (None, 1, None, None, None);
        for child in element.children() {
            let text = || child.text().trim().to_string();
            match child.name {
                "SourceFilename" => {
                    let relative = child.attribute("relativeToVRT").is_some_and(|text| text.trim() == "1");
                    file = Some((child.text(), relative));
                }
                "SourceBand" => {
                    channel = match text().parse() {
                        Ok(number) => number,
                        Err(_) => return self.refuse(format!("{} ({})", of("SourceBand"), text())),
                    }
                }
                "SrcRect" => from = Some(self.rectangle(&child)?),
                "DstRect" => to = Some(self.rectangle(&child)?),
                "SourceProperties" => {}
                "NODATA" if element.name == "ComplexSource" => nodata = Some(text()),
                "ScaleRatio" if text().parse() == Ok(1.0) => {}
                "ScaleOffset" if text().parse() == Ok(0.0) => {}
                name => return self.refuse(of(name)),
            }
        }
        let Some((name, relative)) = file.filter(|(name, _)| !name.is_empty()) else {
            return Err(Error::corrupt(
                self.path,
                format!("a source of band {band}"),
                "no file",
                "<SourceFilename>",
            ));
        };
        let path = match gdal_url(&name) {
            Some(url) => url.into(),
            None if name.starts_with("/vsi") || name.contains(['"', '<']) => {
                return self.refuse(format!("a source {name}, which is not a file,"));
            }
            // (A remote one must not select files of this machine.)
            None if relative || url_of(self.path).is_some() => listed_path(self.path, &name)?,
            None => name.into(),
        };
        let mut raster = self.open(&path)?;
        let info = raster.info();
        if !(1..=info.channels).contains(&channel) {
            let expected = format!("1 to {}, the bands of {}", info.channels, raster.path().display());
            return Err(Error::corrupt(self.path, of("SourceBand"), channel.to_string(), expected));
        }
        let [width, height] = [info.width, info.height];
        let from = from.unwrap_or([0.0, 0.0, width as f64, height as f64]);
        let to = to.unwrap_or([0.0, 0.0, self.size[0] as f64, self.size[1] as f64]);
        raster.choose(&[channel - 1]);
        let found = raster.info().sample;
        if common_type([found, sample].into_iter()) != sample {
            let path = raster.path().display();
            return self.refuse(format!(
                "a source of {} samples ({path}) in band {band} of {}",
                found.name(),
                sample.name()
            ));
        }
        let missing = match nodata.map(|text| gdal::nodata(&text, found)) {
            Some(Some(number)) if number.is_nan() => Missing::Nan,
            Some(Some(number)) => sample_bytes(number, found).map_or(Missing::None, Missing::Sample),
            Some(None) => return self.refuse(of("NODATA")),
            None => Missing::None,
        };
        let axes = [(0, width), (1, height)].map(|(axis, side)| {
            along(from[axis], from[axis + 2], to[axis], to[axis + 2], side, self.size[axis])
        });
        let [Ok(x), Ok(y)] = axes else {
            let found = axes.into_iter().find_map(std::result::Result::err).unwrap_or("a rectangle");
            return self
                .refuse(format!("{found} (SrcRect {from:?}, DstRect {to:?}) in a source of band {band}"));
        };
        let resampling = element.attribute("resampling").unwrap_or_default().to_lowercase();
        if [x.factor, y.factor] != [1, 1] && !["", "nearest", "near"].contains(&&*resampling) {
            return self.refuse(format!("{resampling} resampling in a source of band {band}"));
        }
        let region = Region::new(x.first, y.first, x.length, y.length);
        let mapping = PixelMapping { origin: [x.origin, y.origin], factor: [x.factor, y.factor] };
        Ok((!region.is_empty()).then_some(Source { raster, region, mapping, missing }))
    }

    fn rectangle(&self, element: &XmlElement<'_>) -> Result<[f64; 4]> {
        let number =
            |name: &str| element.attribute(name)?.trim().parse::<f64>().ok().filter(|n| n.abs() < 1e12);
        let numbers = ["xOff", "yOff", "xSize", "ySize"].map(number);
        if let [Some(x), Some(y), Some(width), Some(height)] = numbers {
            return Ok([x, y, width, height]);
        }
        let expected = "numbers xOff, yOff, xSize and ySize";
        Err(Error::corrupt(self.path, element.name, format!("{numbers:?}"), expected))
    }

    /// Opens a file as a source; its header is read once.
    fn open(&mut self, path: &Path) -> Result<Lazy> {
        if let Some((raster, sources)) = self.known.get(path) {
            self.nesting.spend(self.path, *sources)?;
            return Ok(raster.another());
        }
        let before = self.nesting.left();
        self.nesting.spend(self.path, 1)?;
        self.options.access.check_external(self.path, path)?;
        let mut raster = Lazy::open(path, &self.options, &self.pool)?;
        raster.forget_properties();
        let sources = before.saturating_sub(self.nesting.left());
        let another = raster.another();
        self.known.insert(path.to_path_buf(), (raster, sources));
        Ok(another)
    }
}

/// A source along one axis: see [`Source`].
struct Along {
    first: u64,
    length: u64,
    origin: i64,
    factor: u64,
}

/// Maps pixels of a source to those of a band. The error names an unsupported mapping.
fn along(
    from: f64,
    wide: f64,
    to: f64,
    long: f64,
    side: u64,
    size: u64,
) -> std::result::Result<Along, &'static str> {
    let whole = |number: f64| Some(number.round()).filter(|whole| (number - whole).abs() <= TOLERANCE);
    let [Some(from), Some(wide), Some(to), Some(long)] = [from, wide, to, long].map(whole) else {
        return Err("a rectangle with fractions of pixels");
    };
    if wide < 1.0 || long < 1.0 {
        return Err("a rectangle without pixels");
    }
    let factor = long / wide;
    if factor.fract() != 0.0 || !(1.0..=MAX_REPEATED).contains(&factor) {
        return Err("a scaling by other factors than integers from 1 to 1000");
    }
    let [from, wide, to, factor] = [from, wide, to, factor].map(|number| number as i64);
    // Clipped to the pixels of both the source and the band.
    let (start, end) = (from.max(0), (from + wide).min(side as i64));
    let origin = to - from * factor;
    let (first, last) = ((origin + start * factor).max(0), (origin + end * factor).min(size as i64));
    let length = (last - first).max(0) as u64;
    Ok(Along { first: first.max(0) as u64, length, origin, factor: factor as u64 })
}
