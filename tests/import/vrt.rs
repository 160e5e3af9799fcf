//! GDAL's virtual rasters, against a naive model and against GDAL.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::Command;

use spinney::raw::import::raster::{self, Band, Order, Pixels, Raster};
use spinney::{Crs, Region, SampleType, ValueType};

use crate::common::Random;
use crate::common::tiff_file::{Ifd, file};

const TYPES: [(SampleType, &str, u16, u16); 5] = [
    (SampleType::U8, "Byte", 8, 1),
    (SampleType::U16, "UInt16", 16, 1),
    (SampleType::I16, "Int16", 16, 2),
    (SampleType::I32, "Int32", 32, 2),
    (SampleType::F32, "Float32", 32, 3),
];

/// Returns samples as numbers.
fn numbers(sample: SampleType, bytes: &[u8]) -> Vec<f64> {
    let mut numbers = Vec::new();
    ValueType::new(sample, 1).push_numbers(0, bytes, &mut numbers);
    numbers
}

/// A file of random small numbers that all types can represent.
struct Input {
    name: String,
    size: [i64; 2],
    /// Index of its type.
    kind: usize,
    bands: Vec<Vec<f64>>,
}

impl Input {
    fn random(random: &mut Random, directory: &Path, number: usize) -> Input {
        let mut below = |bound| random.below(bound);
        let size = [1 + below(12) as i64, 1 + below(12) as i64];
        let area = (size[0] * size[1]) as usize;
        let (kind, count) = (below(5) as usize, 1 + below(3) as usize);
        let is_png = below(4) == 0;
        let (kind, count) = if is_png { (0, 1) } else { (kind, count) };
        let bands: Vec<Vec<f64>> = (0..count).map(|_| (0..area).map(|_| below(6) as f64).collect()).collect();
        let (sample, _, bits, format) = TYPES[kind];
        let value = ValueType::new(sample, 1);
        let mut bytes = Vec::new();
        for number in (0..area).flat_map(|i| bands.iter().map(move |band| band[i])) {
            bytes.extend(&value.nearest(|_| number).to_bytes()[..sample.size()]);
        }
        let name = format!("{number}.{}", if is_png { "png" } else { "tif" });
        if is_png {
            let out = fs::File::create(directory.join(&name)).unwrap();
            let mut encoder = png::Encoder::new(out, size[0] as u32, size[1] as u32);
            encoder.set_color(png::ColorType::Grayscale);
            encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
        } else {
            let each = |value| vec![value; count];
            let ifd = Ifd::grey(size[0] as u16, size[1] as u16, bytes).short(258, &each(bits));
            let ifd = ifd.short(339, &each(format)).short(277, &[count as u16]);
            let ifd = if count > 1 { ifd.short(338, &vec![0; count - 1]) } else { ifd };
            fs::write(directory.join(&name), file(&[ifd])).unwrap();
        }
        Input { name, size, kind, bands }
    }
}

/// The XML of a random virtual raster, and the samples of each band; `None` where no source
/// provides one.
struct Virtual {
    xml: String,
    size: [i64; 2],
    types: Vec<SampleType>,
    holes: Vec<f64>,
    bands: Vec<Vec<Option<f64>>>,
}

impl Virtual {
    fn random(random: &mut Random, inputs: &[Input], relative: bool, directory: &Path) -> Virtual {
        let mut below = |bound: u64| random.below(bound) as i64;
        let size = [1 + below(30), 1 + below(30)];
        let mut xml = format!("<VRTDataset rasterXSize=\"{}\" rasterYSize=\"{}\">\n", size[0], size[1]);
        let (mut types, mut holes, mut bands) = (Vec::new(), Vec::new(), Vec::new());
        for number in 1..=1 + below(3) {
            let kind = [0, 3, 4, 4][below(4) as usize];
            let (sample, name, ..) = TYPES[kind];
            writeln!(xml, "  <VRTRasterBand dataType=\"{name}\" band=\"{number}\">").unwrap();
            let nodata = (below(2) == 0).then(|| below(6));
            if let Some(nodata) = nodata {
                writeln!(xml, "    <NoDataValue>{nodata}</NoDataValue>").unwrap();
            }
            let mut band = vec![None; (size[0] * size[1]) as usize];
            for _ in 0..below(6) {
                let input = &inputs[below(inputs.len() as u64) as usize];
                let fits = match TYPES[input.kind].0 {
                    SampleType::U8 => true,
                    SampleType::U16 | SampleType::I16 => kind != 0,
                    SampleType::I32 => kind == 3,
                    _ => kind == 4,
                };
                if !fits {
                    continue;
                }
                let channel = below(input.bands.len() as u64) as usize;
                let from: [i64; 2] = [0, 1].map(|axis| below(input.size[axis] as u64));
                let wide: [i64; 2] = [0, 1].map(|axis| 1 + below((input.size[axis] - from[axis]) as u64));
                let to: [i64; 2] = [0, 1].map(|axis| below(size[axis] as u64 + 4) - 4);
                let factor = [1, 1, 2, 3][below(4) as usize];
                let missing = (below(2) == 0).then(|| below(6));
                let class = if missing.is_some() { "ComplexSource" } else { "SimpleSource" };
                let name = if relative {
                    input.name.clone()
                } else {
                    directory.join(&input.name).display().to_string()
                };
                let rectangle = |name: &str, at: [i64; 2], size: [i64; 2]| {
                    let [x, y, width, height] = [at[0], at[1], size[0], size[1]];
                    format!(
                        "      <{name} xOff=\"{x}\" yOff=\"{y}.0000001\" xSize=\"{width}\" ySize=\"{height}\"/>\n"
                    )
                };
                let flag = u8::from(relative);
                writeln!(
                    xml,
                    "    <{class}>\n      <SourceFilename relativeToVRT=\"{flag}\">{name}</SourceFilename>"
                )
                .unwrap();
                writeln!(xml, "      <SourceBand>{}</SourceBand>", channel + 1).unwrap();
                xml += &rectangle("SrcRect", from, wide);
                xml += &rectangle("DstRect", to, wide.map(|side| side * factor));
                if let Some(missing) = missing {
                    writeln!(xml, "      <NODATA>{missing}</NODATA>").unwrap();
                }
                writeln!(xml, "    </{class}>").unwrap();
                for y in 0..wide[1] * factor {
                    for x in 0..wide[0] * factor {
                        let at = (from[1] + y / factor) * input.size[0] + from[0] + x / factor;
                        let found = input.bands[channel][at as usize];
                        let [x, y] = [to[0] + x, to[1] + y];
                        let inside = (0..size[0]).contains(&x) && (0..size[1]).contains(&y);
                        if inside && missing != Some(found as i64) {
                            band[(y * size[0] + x) as usize] = Some(found);
                        }
                    }
                }
            }
            xml += "  </VRTRasterBand>\n";
            types.push(sample);
            holes.push(nodata.unwrap_or(0) as f64);
            bands.push(band);
        }
        xml += "</VRTDataset>\n";
        Virtual { xml, size, types, holes, bands }
    }

    fn whole(&self) -> Region {
        Region::new(0, 0, self.size[0] as u64, self.size[1] as u64)
    }

    /// Checks the samples of a region, for some of the bands.
    fn check(&self, raster: &mut dyn Raster, chosen: &[usize], region: Region) {
        let mut pixels = Pixels::default();
        raster.read(region, &mut pixels).unwrap();
        let found = numbers(raster.info().sample, &pixels.bytes);
        let (mut expected, mut valid) = (Vec::new(), Vec::new());
        for (y, x) in
            (region.y..region.bottom()).flat_map(|y| (region.x..region.right()).map(move |x| (y, x)))
        {
            let at = (y * self.size[0] as u64 + x) as usize;
            expected.extend(chosen.iter().map(|band| self.bands[*band][at].unwrap_or(self.holes[*band])));
            valid.push(chosen.iter().any(|band| self.bands[*band][at].is_some()));
        }
        assert_eq!(found, expected, "{region:?} {chosen:?}\n{}", self.xml);
        assert_eq!(pixels.valid.unwrap_or_else(|| vec![true; valid.len()]), valid, "{}", self.xml);
    }
}

fn open(path: &Path) -> Box<dyn Raster> {
    raster::open(path, &Default::default()).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn any_virtual_raster_is_what_its_sources_make() {
    let mut random = Random(7);
    let directory = tempfile::tempdir().unwrap();
    let inputs: Vec<Input> =
        (0..20).map(|number| Input::random(&mut random, directory.path(), number)).collect();
    let path = directory.path().join("v.vrt");
    for case in 0..150 {
        let model = Virtual::random(&mut random, &inputs, case % 2 == 0, directory.path());
        fs::write(&path, &model.xml).unwrap();
        let count = model.bands.len();
        let all: Vec<usize> = (0..count).collect();
        let mut raster = open(&path);
        model.check(&mut *raster, &all, model.whole());
        for _ in 0..4 {
            let [x, y] = model.size.map(|side| random.below(side as u64));
            let [width, height] =
                [model.size[0] as u64 - x, model.size[1] as u64 - y].map(|most| 1 + random.below(most));
            model.check(&mut *raster, &all, Region::new(x, y, width, height));
        }
        let chosen: Vec<usize> =
            (0..1 + random.below(3)).map(|_| random.below(count as u64) as usize).collect();
        let bands: Vec<Band> = chosen.iter().map(|band| Band::Number(band + 1)).collect();
        let mut raster = raster::select(open(&path), &bands).unwrap();
        if let [band] = chosen[..] {
            assert_eq!(raster.info().sample, model.types[band]);
        }
        model.check(&mut *raster, &chosen, model.whole());
    }
}

#[test]
fn gdal_agrees() {
    if Command::new("gdal_translate").arg("--version").output().is_err() {
        return eprintln!("skipped: there is no gdal_translate");
    }
    let mut random = Random(8);
    let directory = tempfile::tempdir().unwrap();
    let inputs: Vec<Input> =
        (0..20).map(|number| Input::random(&mut random, directory.path(), number)).collect();
    let [path, made] = ["v.vrt", "v.tif"].map(|name| directory.path().join(name));
    for case in 0..40 {
        let model = Virtual::random(&mut random, &inputs, case % 2 == 0, directory.path());
        fs::write(&path, &model.xml).unwrap();
        // Its output has one type: that of the widest band, or of the first.
        for (band, sample) in model.types.iter().enumerate() {
            let number = (band + 1).to_string();
            let status =
                Command::new("gdal_translate").args(["-q", "-b", &number]).arg(&path).arg(&made).output();
            assert!(status.unwrap().status.success());
            let mut found = [Pixels::default(), Pixels::default()];
            let mut theirs = open(&made);
            let mut ours = raster::select(open(&path), &[Band::Number(band + 1)]).unwrap();
            theirs.read(model.whole(), &mut found[0]).unwrap();
            ours.read(model.whole(), &mut found[1]).unwrap();
            assert_eq!((theirs.info().sample, ours.info().sample), (*sample, *sample));
            assert_eq!(theirs.info().nodata, ours.info().nodata);
            assert!(found[0].bytes == found[1].bytes, "band {number}\n{}", model.xml);
        }
    }
}

#[test]
fn metadata_of_virtual_rasters_are_kept() {
    let directory = tempfile::tempdir().unwrap();
    let source = |name: &str, value: u8| {
        let image = Ifd::grey(4, 4, vec![value; 32]).short(258, &[8, 8]).short(277, &[2]);
        fs::write(directory.path().join(name), file(&[image])).unwrap();
    };
    source("a.tif", 5);
    let source = "<SimpleSource><SourceFilename relativeToVRT=\"1\">a.tif</SourceFilename><SourceBand>2</SourceBand></SimpleSource>";
    let xml = format!(
        "<?xml version=\"1.0\"?>\n<VRTDataset rasterXSize=\"4\" rasterYSize=\"4\">
        <SRS dataAxisToSRSAxisMapping=\"1,2\">EPSG:32632</SRS>
        <GeoTransform>300000, 20, 0, 5000000, 0, -20</GeoTransform>
        <Metadata><MDI key=\"AREA_OR_POINT\">Area</MDI><MDI key=\"a\">b</MDI></Metadata>
        <OverviewList resampling=\"nearest\">2 4</OverviewList>
        <VRTRasterBand dataType=\"Byte\" band=\"1\"><Description>B04, red</Description><NoDataValue>0</NoDataValue>
          <ColorInterp>Red</ColorInterp><Scale>0.5</Scale><UnitType>m</UnitType><Metadata><MDI key=\"wave\">665</MDI></Metadata>{source}
        </VRTRasterBand>
        <VRTRasterBand dataType=\"UInt16\" band=\"2\" subClass=\"VRTSourcedRasterBand\"><Description>SCL</Description><NoDataValue>9</NoDataValue>
          <CategoryNames><Category>no</Category><Category>yes</Category></CategoryNames>
          <ColorTable><Entry c1=\"1\" c2=\"2\" c3=\"3\"/></ColorTable>{source}
        </VRTRasterBand></VRTDataset>"
    );
    let path = directory.path().join("v.vrt");
    fs::write(&path, xml).unwrap();
    let raster = open(&path);
    let info = raster.info();
    assert_eq!((info.width, info.height, info.channels, info.sample), (4, 4, 2, SampleType::U16));
    assert_eq!(info.frame.affine(), [20.0, 0.0, 300000.0, 0.0, -20.0, 5000000.0]);
    assert_eq!(info.frame.crs.as_ref().and_then(Crs::numbers), Crs::epsg(32632).numbers());
    assert_eq!((info.tags["a"].as_str(), info.order), ("b", Order::Bands));
    let red = raster::select(open(&path), &[Band::Name("B04".into())]).unwrap();
    let info = red.info();
    assert_eq!((info.sample, info.nodata, info.units[0].as_str()), (SampleType::U8, Some(0.into()), "m"));
    assert_eq!((info.scale_offset[0], info.colour_roles[0].as_str()), ((0.5, 0.0), "Red"));
    assert!(info.class_names.is_empty() && info.palette.is_none() && info.scoped_tags.len() == 1);
    let classes = raster::select(open(&path), &[Band::Name("SCL".into())]).unwrap();
    let info = classes.info();
    assert_eq!((info.sample, info.nodata, info.class_names.len()), (SampleType::U16, Some(9.into()), 2));
    assert_eq!(info.palette.as_ref().unwrap().colours, [[1, 2, 3, 255]]);
}

/// Returns a virtual raster of one band with these elements.
fn of_band(elements: &str) -> String {
    format!(
        "<VRTDataset rasterXSize=\"4\" rasterYSize=\"4\"><VRTRasterBand dataType=\"Byte\" band=\"1\">{elements}</VRTRasterBand></VRTDataset>"
    )
}

/// Returns a source with these elements.
fn source(name: &str, elements: &str) -> String {
    format!("<SourceFilename relativeToVRT=\"1\">{name}</SourceFilename><SourceBand>1</SourceBand>{elements}")
}

#[test]
fn unknown_elements_are_named() {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("a.tif"), file(&[Ifd::grey(4, 4, vec![1; 16])])).unwrap();
    let wide = Ifd::grey(4, 4, vec![1; 32]).short(258, &[16]);
    fs::write(directory.path().join("wide.tif"), file(&[wide])).unwrap();
    let path = directory.path().join("v.vrt");
    let simple =
        |elements: &str| of_band(&format!("<SimpleSource>{}</SimpleSource>", source("a.tif", elements)));
    let complex =
        |elements: &str| of_band(&format!("<ComplexSource>{}</ComplexSource>", source("a.tif", elements)));
    let rectangles = |from: &str, to: &str| {
        let rectangle = |name: &str, [x, y, width, height]: [&str; 4]| {
            format!("<{name} xOff=\"{x}\" yOff=\"{y}\" xSize=\"{width}\" ySize=\"{height}\"/>")
        };
        let four = |text: &str| -> [String; 4] {
            text.split(',').map(String::from).collect::<Vec<_>>().try_into().unwrap()
        };
        let (from, to) = (four(from), four(to));
        let attributes = |words: &[String; 4]| -> String {
            let [x, y, width, height] = words;
            rectangle("RECT", [x, y, width, height])
        };
        simple(&format!(
            "{}{}",
            attributes(&from).replace("RECT", "SrcRect"),
            attributes(&to).replace("RECT", "DstRect")
        ))
    };
    for (xml, expected) in [
        (complex("<LUT>0:0,255:5</LUT>"), "<LUT> in a source of band 1"),
        (complex("<ScaleRatio>2</ScaleRatio>"), "<ScaleRatio>"),
        (complex("<ScaleOffset>0.5</ScaleOffset>"), "<ScaleOffset>"),
        (complex("<UseMaskBand>true</UseMaskBand>"), "<UseMaskBand>"),
        (complex("<NODATA>x</NODATA>"), "<NODATA>"),
        (simple("<OpenOptions><OOI key=\"OVERVIEW_LEVEL\">1</OOI></OpenOptions>"), "<OpenOptions>"),
        (simple("<NODATA>1</NODATA>"), "<NODATA>"),
        (of_band("<KernelFilteredSource/>"), "<KernelFilteredSource> in band 1"),
        (of_band("<AveragedSource/>"), "<AveragedSource>"),
        (of_band("<PixelFunctionType>sum</PixelFunctionType>"), "<PixelFunctionType>"),
        (of_band("<MaskBand/>"), "a mask"),
        (
            of_band("").replace("band=\"1\"", "band=\"1\" subClass=\"VRTDerivedRasterBand\""),
            "VRTDerivedRasterBand",
        ),
        (of_band("").replace("rasterYSize", "subClass=\"VRTWarpedDataset\" rasterYSize"), "VRTWarpedDataset"),
        (of_band("").replace("Byte", "CFloat32"), "CFloat32"),
        (of_band("").replace("<VRTRasterBand", "<MaskBand/><VRTRasterBand"), "<MaskBand>"),
        (of_band("").replace("<VRTRasterBand", "<Group name=\"/\"/><VRTRasterBand"), "<Group>"),
        (of_band("").replace("band=\"1\"", "band=\"2\""), "numbers in order"),
        (of_band("").replace("rasterXSize=\"4\"", "rasterXSize=\"0\""), "rasterXSize"),
        (of_band("").replace("rasterYSize=\"4\"", "rasterYSize=\"99999999999\""), "rasterYSize"),
        ("<VRTDataset rasterXSize=\"4\" rasterYSize=\"4\"></VRTDataset>".into(), "0 bands"),
        ("<VRTDataset rasterXSize=\"4\" rasterYSize=\"4\">".into(), "not its end"),
        (rectangles("0,0,2,2", "0,0,3,3"), "integers from 1 to 1000"),
        (rectangles("0,0,4,4", "0,0,2,2"), "integers from 1 to 1000"),
        (rectangles("0.5,0,2,2", "0,0,2,2"), "fractions"),
        (rectangles("0,0,0,2", "0,0,2,2"), "without pixels"),
        (rectangles("0,0,nan,2", "0,0,2,2"), "SrcRect"),
        (rectangles("0,0,1e300,2", "0,0,2,2"), "SrcRect"),
        (
            rectangles("0,0,2,2", "0,0,4,4").replace("<SimpleSource>", "<SimpleSource resampling=\"cubic\">"),
            "cubic resampling",
        ),
        (of_band("<SimpleSource/>"), "<SourceFilename>"),
        (simple("").replace("a.tif", "gone.tif"), "gone.tif"),
        (simple("").replace("a.tif", "/vsizip/x.zip/a.tif"), "/vsizip"),
        (simple("").replace("a.tif", "/vsicurl/http://x/a.tif"), "http://x/a.tif: a remote file"),
        (simple("").replace("a.tif", "wide.tif"), "a source of u16 samples"),
        (simple("").replace("<SourceBand>1<", "<SourceBand>2<"), "SourceBand"),
        (simple("").replace("<SourceBand>1<", "<SourceBand>mask,1<"), "mask,1"),
        (of_band("<SimpleSource>").replace("</VRTDataset>", ""), "not its end"),
    ] {
        fs::write(&path, &xml).unwrap();
        let error = raster::open(&path, &Default::default()).err().map(|error| error.to_string());
        assert!(error.as_ref().is_some_and(|error| error.contains(expected)), "{expected}: {error:?}\n{xml}");
    }
}

#[test]
fn virtual_rasters_of_each_other_end() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    fs::write(at("a.tif"), file(&[Ifd::grey(4, 4, vec![7; 16])])).unwrap();
    let many = |name: &str, count: usize| {
        of_band(&format!("<SimpleSource>{}</SimpleSource>", source(name, "")).repeat(count))
    };
    let refused = |name: &str| raster::open(&at(name), &Default::default()).err().unwrap().to_string();
    // Itself, once and a thousand times.
    for count in [1, 1000] {
        fs::write(at("self.vrt"), many("self.vrt", count)).unwrap();
        assert!(refused("self.vrt").contains("in itself"));
    }
    // Nested up to the maximum depth, and deeper.
    fs::write(at("0.vrt"), many("a.tif", 1)).unwrap();
    (1..5).for_each(|depth| {
        fs::write(at(&format!("{depth}.vrt")), many(&format!("{}.vrt", depth - 1), 1)).unwrap()
    });
    let mut pixels = Pixels::default();
    open(&at("3.vrt")).read(Region::new(1, 1, 3, 2), &mut pixels).unwrap();
    assert_eq!(pixels.bytes, [7; 6]);
    assert!(refused("4.vrt").contains("more than 4 deep"));
    // Each includes thousands of the previous one: a few files, and a billion sources.
    fs::write(at("1.vrt"), many("0.vrt", 2000)).unwrap();
    fs::write(at("2.vrt"), many("1.vrt", 2000)).unwrap();
    assert!(refused("2.vrt").contains("sources"));
    // A small source in the largest possible raster.
    let empty = many("a.tif", 1).replace("Size=\"4\"", "Size=\"2147483647\"");
    let speck = "<DstRect xOff=\"0\" yOff=\"0\" xSize=\"4\" ySize=\"4\"/></SimpleSource>";
    let from = "<SrcRect xOff=\"0\" yOff=\"0\" xSize=\"4\" ySize=\"4\"/>";
    fs::write(at("empty.vrt"), empty.replace("</SimpleSource>", &format!("{from}{speck}"))).unwrap();
    assert!(
        refused("empty.vrt").contains("2147483647 x 2147483647 pixels, of which sources cover at most 16")
    );
    // The file truncated at every length, and with changed bytes.
    let text = of_band(&format!("<ComplexSource>{}</ComplexSource>", source("a.tif", "<NODATA>1</NODATA>")));
    let mut random = Random(3);
    for length in 0..text.len() {
        fs::write(at("cut.vrt"), &text[..length]).unwrap();
        assert!(raster::open(&at("cut.vrt"), &Default::default()).is_err());
        let mut other = text.clone().into_bytes();
        other[length] = b"<>/\"' 0x\xff"[random.below(9) as usize];
        fs::write(at("cut.vrt"), other).unwrap();
        if let Ok(mut raster) = raster::open(&at("cut.vrt"), &Default::default()) {
            let (width, height) = (raster.info().width, raster.info().height);
            let region = Region::new(0, 0, width.min(8), height.min(8));
            raster.read(region, &mut pixels).unwrap();
        }
    }
}
