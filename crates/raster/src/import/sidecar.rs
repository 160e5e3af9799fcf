//! Sidecars: GDAL's `.aux.xml` files with metadata that does not fit the image file.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::xml::XmlElement;
use super::{Pixels, Raster, RasterInfo, SourceWindows, gdal, worldfile};
use spinney_base::io::{FileAccess, sibling_path, sidecar_of};
use spinney_base::space::Region;
use spinney_base::value::{DataKind, Number, Palette};
use spinney_base::{Error, Result};
use spinney_crs::{ControlPoint, ControlPoints, Crs, Frame, Transformation};

/// Maximum size of a sidecar in bytes; the same limit as for a tree's metadata.
const MAX_BYTES: u64 = 16 << 20;

/// A raster with properties from other sources than its file.
pub(super) struct DescribedRaster {
    pub(super) raster: Box<dyn Raster>,
    pub(super) info: RasterInfo,
}

impl Raster for DescribedRaster {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        self.raster.path()
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.raster.read(region, pixels)
    }

    fn choose(&mut self, channels: &[usize]) -> bool {
        let chosen = self.raster.choose(channels);
        if chosen {
            self.info = self.info.of_channels(channels);
        }
        chosen
    }

    fn separate_channels(&self, channels: &[usize]) -> Option<Box<dyn Raster>> {
        let raster = self.raster.separate_channels(channels)?;
        Some(Box::new(DescribedRaster { raster, info: self.info.of_channels(channels) }))
    }

    fn has_separate_channels(&self) -> bool {
        self.raster.has_separate_channels()
    }

    fn reads_anywhere(&self) -> bool {
        self.raster.reads_anywhere()
    }

    fn prefetch(&mut self, regions: &[Region]) -> Result<usize> {
        self.raster.prefetch(regions)
    }

    fn forget_properties(&mut self) {
        self.info.forget();
        self.raster.forget_properties();
    }

    fn source_windows(&self) -> SourceWindows {
        self.raster.source_windows()
    }
}

/// Adds the properties from a sidecar, if there is one, and from a world file. Those of a sidecar
/// take precedence over the file's own, as in GDAL, which writes sidecars for read-only files.
/// Georeferencing is an exception: it is read from a sidecar or world file only if the file has
/// none.
pub(super) fn describe(
    raster: Box<dyn Raster>,
    has_sidecar: bool,
    access: &FileAccess,
) -> Result<Box<dyn Raster>> {
    let mut info = raster.info().clone();
    if has_sidecar {
        apply_sidecar(sibling_path(raster.path(), sidecar_of), access, &mut info)?;
    }
    worldfile::complete_frame(raster.path(), access, &mut info.frame)?;
    Ok(Box::new(DescribedRaster { raster, info }))
}

/// Applies a sidecar, if it exists.
fn apply_sidecar(path: PathBuf, access: &FileAccess, info: &mut RasterInfo) -> Result<()> {
    let Some(file) = access.find_companion(&path)? else { return Ok(()) };
    let mut bytes = Vec::new();
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(Error::io(&path, "read"))?;
    let found = if bytes.len() as u64 > MAX_BYTES { "more than 16 MiB" } else { "no such element" };
    let text = String::from_utf8_lossy(&bytes);
    let root = XmlElement::document(&text).named("PAMDataset").next();
    let Some(root) = root.filter(|_| bytes.len() as u64 <= MAX_BYTES) else {
        let expected =
            "GDAL's metadata in XML, <PAMDataset>; to read the image without it, move the file away";
        return Err(Error::corrupt(path, "sidecar", found, expected));
    };
    apply(&path, &root, info)
}

fn apply(path: &Path, root: &XmlElement<'_>, info: &mut RasterInfo) -> Result<()> {
    let own = (info.frame.clone(), info.nodata);
    let mut found = Vec::new();
    for element in root.children() {
        match element.name {
            "SRS" => match &own.0.crs {
                None => info.frame.crs = worldfile::crs(path, &element.text())?,
                Some(own) => {
                    if let Ok(Some(other)) = worldfile::crs(path, &element.text())
                        && is_another(own, &other)
                    {
                        found.push(format!("another coordinate system ({other}), which is not used"));
                    }
                }
            },
            "GeoTransform" if own.0.is_identity() => {
                info.frame.matrix = geo_transform(path, &element.text())?.matrix;
            }
            "GeoTransform" => {
                let size = [info.width, info.height];
                if geo_transform(path, &element.text()).is_ok_and(|other| differs(&own.0, &other, size)) {
                    let text: String = element.text().trim().chars().take(200).collect();
                    found.push(format!("another geotransform ({text}), which is not used"));
                }
            }
            "Metadata" => apply_metadata(&element, None, info),
            "GCPList" => {
                info.control_points = control_points(path, &element)?.or(info.control_points.take());
            }
            "PAMRasterBand" => {
                let number = element.attribute("band").and_then(|number| number.parse::<usize>().ok());
                if let Some(channel) = number.and_then(|number| number.checked_sub(1))
                    && channel < info.channels
                {
                    apply_band(&element, channel, info);
                    // (A value and its name.)
                    let tables = element.named("GDALRasterAttributeTable");
                    if tables.map(|table| table.named("FieldDefn").count()).any(|columns| columns > 2) {
                        let text = "a raster attribute table, of which only the names of classes are kept";
                        found.push(text.into());
                    }
                }
            }
            _ => {}
        }
    }
    if let (Some(own), Some(other)) = (own.1, info.nodata)
        && own != other
    {
        found.push(format!("the nodata number {other}, which replaces {own} of the file"));
    }
    if !found.is_empty() {
        let name = path.file_name().unwrap_or_default().display();
        let remarks =
            info.remark.take().into_iter().chain(found.iter().map(|found| format!("{name} has {found}")));
        info.remark = Some(remarks.collect::<Vec<_>>().join("; "));
    }
    Ok(())
}

/// Whether two coordinate systems are both supported and differ.
fn is_another(own: &Crs, other: &Crs) -> bool {
    Transformation::new(own, other, true).is_ok_and(|between| !between.is_identity())
}

/// Maximum difference of equal frames, in cells: other programs write fewer digits.
const SAME_PLACE: f64 = 0.01;

/// Whether two frames place a corner of a raster of this size differently.
fn differs(own: &Frame, other: &Frame, [width, height]: [u64; 2]) -> bool {
    let [width, height] = [width as f64, height as f64];
    [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]].into_iter().any(|[x, y]| {
        let found = own.to_cells(other.to_world([x, y, 0.0]));
        found.is_none_or(|found| (found[0] - x).abs().max((found[1] - y).abs()) > SAME_PLACE)
    })
}

fn apply_band(band: &XmlElement<'_>, channel: usize, info: &mut RasterInfo) {
    // Properties of a single channel are those of the raster.
    let several = info.channels > 1;
    let mut nodata = None;
    for element in band.children() {
        match element.name {
            "Description" => info.band_names[channel] = element.text(),
            "ColorInterp" => gdal::set_colour_role(info, channel, element.text()),
            "UnitType" => info.units[channel] = element.text(),
            "Scale" => gdal::set_number(&mut info.scale_offset[channel].0, &element.text()),
            "Offset" => gdal::set_number(&mut info.scale_offset[channel].1, &element.text()),
            "NoDataValue" => nodata = gdal::nodata(&element.text(), info.sample),
            "CategoryNames" => class_names(info, channel, categories(&element)),
            "GDALRasterAttributeTable" => {
                let named = if several { &info.bands_mut()[channel].class_names } else { &info.class_names };
                if named.is_empty() {
                    class_names(info, channel, gdal::class_names(&element));
                }
            }
            "ColorTable" => match palette(&element) {
                // Palettes are for classes, as in image files that have one.
                Some(palette) if !several => {
                    (info.palette, info.kind) = (Some(palette), Some(DataKind::Categorical));
                }
                palette if several => info.bands_mut()[channel].palette = palette,
                _ => {}
            },
            "Metadata" => apply_metadata(&element, Some(channel), info),
            _ => {}
        }
    }
    if several && nodata.is_some() {
        info.bands_mut()[channel].nodata = nodata;
    }
    // Of several channels the first one counts, since a raster has one nodata number.
    if channel == 0 || info.nodata.is_none() {
        info.nodata = nodata.or(info.nodata);
    }
}

/// Stores the names of a channel's values. The raster gets them as well if no earlier channel has
/// names.
fn class_names(info: &mut RasterInfo, channel: usize, names: Vec<(Number, String)>) {
    if info.channels > 1 && !names.is_empty() {
        info.bands_mut()[channel].class_names = names.clone();
    }
    gdal::take_class_names(info, channel, names);
}

pub(super) fn apply_metadata(metadata: &XmlElement<'_>, channel: Option<usize>, info: &mut RasterInfo) {
    let domain = metadata.attribute("domain").unwrap_or_default();
    if metadata.attribute("format").is_some_and(|format| format == "xml") {
        // The content is an XML document, named as in a TIFF file.
        gdal::put_tag(info, channel, &domain, "doc".into(), metadata.content.trim().into());
        return;
    }
    for item in metadata.named("MDI") {
        if let Some(name) = item.attribute("key") {
            gdal::put_tag(info, channel, &domain, name, item.text());
        }
    }
}

/// Names of the values from 0 on; names in gaps are empty.
pub(super) fn categories(list: &XmlElement<'_>) -> Vec<(Number, String)> {
    let names = list.named("Category").map(|name| name.text());
    (0u64..).map(Number::from).zip(names).collect()
}

/// Colours of the values from 0 on; `None` if there are none, or more than 2^16.
pub(super) fn palette(table: &XmlElement<'_>) -> Option<Palette> {
    const MOST: usize = 1 << 16;
    let level = |entry: &XmlElement<'_>, name: &str| entry.attribute(name)?.trim().parse::<u8>().ok();
    let colour = |entry: XmlElement<'_>| {
        let channel = |name| level(&entry, name).unwrap_or(0);
        [channel("c1"), channel("c2"), channel("c3"), level(&entry, "c4").unwrap_or(u8::MAX)]
    };
    let colours: Vec<_> = table.named("Entry").take(MOST + 1).map(colour).collect();
    (1..=MOST).contains(&colours.len()).then_some(Palette { colours })
}

/// Parses the frame from GDAL's six numbers, in the order c, a, b, f, d, e.
pub(super) fn geo_transform(path: &Path, text: &str) -> Result<Frame> {
    let numbers: Vec<f64> = text.split(',').map_while(|word| word.trim().parse().ok()).collect();
    let frame = <[f64; 6]>::try_from(numbers).map(|[c, a, b, f, d, e]| Frame::planar([a, b, c, d, e, f]));
    frame
        .ok()
        .filter(|frame| {
            frame.affine().iter().all(|number| number.is_finite()) && frame.to_cells([0.0; 3]).is_some()
        })
        .ok_or_else(|| {
            Error::corrupt(path, "GeoTransform", "other numbers or text", "six numbers of an invertible map")
        })
}

pub(super) fn control_points(path: &Path, list: &XmlElement<'_>) -> Result<Option<ControlPoints>> {
    let point = |point: XmlElement<'_>| {
        let number = |name| point.attribute(name).and_then(|text| text.trim().parse::<f64>().ok());
        let numbers =
            [number("Pixel")?, number("Line")?, number("X")?, number("Y")?, number("Z").unwrap_or(0.0)];
        let [column, row, x, y, z] = numbers;
        numbers
            .iter()
            .all(|number| number.is_finite())
            .then_some(ControlPoint { cell: [column, row], world: [x, y, z] })
    };
    let points: Vec<_> = list.named("GCP").filter_map(point).collect();
    let crs = worldfile::crs(path, &list.attribute("Projection").unwrap_or_default())?;
    Ok((!points.is_empty()).then_some(ControlPoints { crs, points }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::value::SampleType;
    use spinney_container::TagScope;

    fn described(xml: &str, channels: usize) -> RasterInfo {
        let mut info = RasterInfo::plain([4, 4], SampleType::I16, channels);
        info.tags.insert("A".into(), "of the file".into());
        apply(Path::new("a.aux.xml"), &XmlElement::document(xml).children().next().unwrap(), &mut info)
            .unwrap();
        info
    }

    #[test]
    fn all_metadata_of_gdal_sidecars_is_read() {
        let info = described(
            "<PAMDataset>
              <GCPList Projection=\"GEOGCS[&quot;WGS 84&quot;,DATUM[&quot;WGS_1984&quot;,AUTHORITY[&quot;EPSG&quot;,&quot;6326&quot;]],AUTHORITY[&quot;EPSG&quot;,&quot;4326&quot;]]\">
                <GCP Id=\"1\" Info=\"\" Pixel=\"0.5\" Line=\"2\" X=\"10\" Y=\"5e1\" Z=\"3\"/><GCP Pixel=\"x\"/>
              </GCPList>
              <Metadata><MDI key=\"A\">of the sidecar</MDI><MDI key=\"b &lt;\">c &amp; d</MDI></Metadata>
              <Metadata domain=\"D\"><MDI key=\"k\">v</MDI></Metadata>
              <Metadata domain=\"IMAGE_STRUCTURE\"><MDI key=\"NBITS\">7</MDI></Metadata>
              <Metadata domain=\"xml:X\" format=\"xml\"> <a>t &amp; u</a> </Metadata>
              <PAMRasterBand band=\"2\">
                <Description>near &lt; infrared</Description><NoDataValue>-9.99900000000000E+03</NoDataValue>
                <UnitType>°C</UnitType><Offset>-273.15</Offset><Scale>0.5</Scale>
                <CategoryNames><Category>sea</Category><Category/><Category>a &amp; b</Category></CategoryNames>
                <Histograms><HistItem><HistMin>0</HistMin></HistItem></Histograms>
                <Metadata><MDI key=\"STATISTICS_MEAN\">1</MDI><MDI key=\"wave\">550</MDI></Metadata>
              </PAMRasterBand>
              <PAMRasterBand band=\"3\"><Description>not there</Description></PAMRasterBand>
            </PAMDataset>",
            2,
        );
        assert_eq!(info.band_names, ["", "near < infrared"]);
        assert_eq!(info.units, ["", "°C"]);
        assert_eq!(info.scale_offset, [(1.0, 0.0), (0.5, -273.15)]);
        assert_eq!(info.nodata, Some((-9999).into()));
        assert_eq!(
            (info.class_names, info.class_channel),
            (vec![(0.into(), "sea".into()), (1.into(), "".into()), (2.into(), "a & b".into())], 1)
        );
        let tags = |pairs: &[(&str, &str)]| -> std::collections::BTreeMap<String, String> {
            pairs.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
        };
        assert_eq!(info.tags, tags(&[("A", "of the sidecar"), ("b <", "c & d")]));
        let scope = |channel, domain: &str| TagScope { channel, domain: domain.into() };
        let scoped = [
            (scope(None, "D"), tags(&[("k", "v")])),
            (scope(None, "xml:X"), tags(&[("doc", "<a>t &amp; u</a>")])),
            (scope(Some(1), ""), tags(&[("wave", "550")])),
        ];
        assert_eq!(info.scoped_tags, scoped.into());
        let points = info.control_points.unwrap();
        assert_eq!(points.points, [ControlPoint { cell: [0.5, 2.0], world: [10.0, 50.0, 3.0] }]);
        assert_eq!(points.crs.as_ref().and_then(Crs::numbers), Crs::epsg(4326).numbers());
    }

    /// A sidecar that contradicts the file is reported, whether it is used or not. One that agrees
    /// in another form is not.
    #[test]
    fn contradictions_are_reported() {
        let sidecar = |crs: &str, place: &str, nodata: &str| {
            let mut info = RasterInfo::plain([4, 4], SampleType::I16, 1);
            info.frame = Frame::planar([10.0, 0.0, 500_000.0, 0.0, -10.0, 5_600_000.0]);
            (info.frame.crs, info.nodata) = (Some(Crs::epsg(25833)), Some((-9999).into()));
            let xml = format!(
                "<PAMDataset><SRS>{crs}</SRS><GeoTransform>{place}</GeoTransform>\
                 <PAMRasterBand band=\"1\"><NoDataValue>{nodata}</NoDataValue></PAMRasterBand></PAMDataset>"
            );
            apply(
                Path::new("f/a.tif.aux.xml"),
                &XmlElement::document(&xml).children().next().unwrap(),
                &mut info,
            )
            .unwrap();
            assert_eq!((info.frame.crs, info.frame.matrix[0][3]), (Some(Crs::epsg(25833)), 500_000.0));
            (info.remark, info.nodata)
        };
        let esri = Crs::epsg(25833).to_esri_wkt().unwrap().replace('"', "&quot;");
        let place = "5.0e5, 1e1, 0, 5.6e6, 0, -1.0000000001e1";
        assert_eq!(sidecar(&esri, place, "-9.999e3"), (None, Some((-9999).into())));
        let (remark, nodata) = sidecar("EPSG:25832", "500005, 10, 0, 5600000, 0, -10", "0");
        assert_eq!(
            remark.unwrap(),
            "a.tif.aux.xml has another coordinate system (EPSG:25832), which is not used; \
             a.tif.aux.xml has another geotransform (500005, 10, 0, 5600000, 0, -10), which is not used; \
             a.tif.aux.xml has the nodata number 0, which replaces -9999 of the file"
        );
        assert_eq!(nodata, Some(0.into()));
    }

    #[test]
    fn colours_and_attribute_tables() {
        let info = described(
            "<PAMDataset><PAMRasterBand band=\"1\">
              <ColorTable><Entry c1=\"1\" c2=\"2\" c3=\"3\" c4=\"255\"/><Entry c1=\"4\" c2=\"5\" c3=\"6\"/></ColorTable>
              <GDALRasterAttributeTable tableType=\"thematic\">
                <FieldDefn index=\"0\"><Name>V</Name><Type>0</Type><Usage>5</Usage></FieldDefn>
                <FieldDefn index=\"1\"><Name>N</Name><Type>2</Type><Usage>2</Usage></FieldDefn>
                <Row index=\"0\"><F>-7</F><F>minus seven</F></Row>
                <Row index=\"1\"><F>18446744073709551615</F><F>most</F></Row>
              </GDALRasterAttributeTable>
            </PAMRasterBand></PAMDataset>",
            1,
        );
        assert_eq!(info.palette, Some(Palette { colours: vec![[1, 2, 3, 255], [4, 5, 6, 255]] }));
        assert_eq!(info.kind, Some(DataKind::Categorical));
        assert_eq!(info.class_names, [((-7).into(), "minus seven".into()), (u64::MAX.into(), "most".into())]);
    }
}
