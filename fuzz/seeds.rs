//! Generates the seeds in `fuzz/corpus/`: small files of every kind, the same bytes every time.

use std::fs;
use std::path::{Path, PathBuf};

use spinney::{Bounds, BuildOptions, FileView, Crs, DataKind, Dimension, Frame, Metadata, Output, Result, Rule, SampleType, TreeType, Value, ValueType, WriteOptions};
use spinney::raw::export::image::{ImageSpec, create, format_of};
use spinney::raw::export::vector::{AttributeType, AttributeValue, GeometryKind, VectorLayer, VectorWriter};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::lines::{LineBuildOptions, LinesInMemory};
use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::raw::ops::add_layer;
use spinney::raw::store::autumnal::{CompactOptions, Keep, compact};
use spinney::raw::store::{Packing, build_tree, depth_for};
use spinney::tree::MemTree;
use spinney_fuzz::targets::indexes::small_index;
use spinney_fuzz::targets::seal;

use reference::Cut;

#[path = "../tests/common/brep_file.rs"]
#[allow(unreachable_pub)]
mod brep_file;
#[path = "../tests/common/line_features.rs"]
mod line_features;
#[path = "../tests/common/reference.rs"]
mod reference;
#[path = "../tests/common/tiff_file.rs"]
#[allow(dead_code)] // only used by tests
mod tiff_file;

/// Returns the type of a quadtree or octree of values with `channels` samples of a type.
const fn form(dimension: Dimension, sample: SampleType, channels: u8) -> TreeType {
    TreeType::new(dimension, ValueType::new(sample, channels))
}

const QUAD: TreeType = form(Dimension::Quad, SampleType::U8, 1);
const OCT: TreeType = form(Dimension::Oct, SampleType::U8, 1);

/// Returns a tree with much detail and some VOID cells.
fn tree(form: TreeType, size: [u64; 3], rule: Rule) -> MemTree {
    MemTree::from_cells(form, depth_for(size), rule, &|[x, y, z]| {
        let inside = [x, y, z].into_iter().zip(size).all(|(cell, end)| u64::from(cell) < end);
        let number = (x * 5 / 7 + y * y / 6 + 3 * z) % 9;
        (inside && number != 4)
            .then(|| form.value.nearest(|channel| f64::from(number) * 3.0 + channel as f64))
    })
}

fn main() -> Result<()> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let put = |target: &str, name: &str, bytes: &[u8]| {
        let directory = root.join("corpus").join(target);
        fs::create_dir_all(&directory).unwrap();
        fs::write(directory.join(name), bytes).unwrap();
    };
    let directory = tempfile::tempdir().unwrap();
    let project = root.join("..");
    goblins(&put, &project, directory.path())?;
    put("index_sections", "small", &small_index().input());
    put("goblin_read", "index", &small_index().bytes);
    autumnals(&put, &project, directory.path())?;
    layers(&put, directory.path())?;
    images(&put, &project, directory.path())?;
    meshes(&put);
    gltf(&put);
    features(&put, directory.path())?;
    models(&put, directory.path())?;
    line_trees(&put, directory.path())?;
    text_formats(&put);
    Ok(())
}

type Put<'a> = &'a dyn Fn(&str, &str, &[u8]);

fn build(
    path: &Path,
    form: TreeType,
    size: [u64; 3],
    (rule, kind): (Rule, DataKind),
    share: bool,
) -> Result<Vec<u8>> {
    let options = BuildOptions::new(kind, depth_for(size)).rule(rule).share(share);
    let _ = fs::remove_file(path);
    build_tree(&tree(form, size, rule), size, &options, Output::create(path)?, &())?;
    Ok(fs::read(path).unwrap())
}

fn goblins(put: Put<'_>, project: &Path, directory: &Path) -> Result<()> {
    put("goblin_read", "classic", &fs::read(project.join("fixtures/v1/classic.goblin")).unwrap());
    let path = directory.join("t.goblin");
    let continuous = (Rule::Mean, DataKind::Continuous);
    put("goblin_read", "octree", &build(&path, OCT, [5, 4, 6], continuous, false)?);
    let floats = form(Dimension::Quad, SampleType::F32, 2);
    put("goblin_read", "floats", &build(&path, floats, [6, 7, 1], continuous, false)?);
    // Packed segments of each model: names, numbers (with bits, several channels, quantized floats)
    // and solids.
    let colours = form(Dimension::Quad, SampleType::U8, 3);
    let rounded = form(Dimension::Quad, SampleType::F32, 1);
    for (name, form, size, (rule, kind)) in [
        ("packed_names", QUAD, [40, 30, 1], (Rule::Majority, DataKind::Categorical)),
        ("packed_numbers", colours, [33, 40, 1], continuous),
        ("packed_floats", rounded, [40, 40, 1], continuous),
        ("packed_octree", OCT, [20, 17, 9], continuous),
        ("packed_solid", OCT, [20, 17, 9], (Rule::Occupancy, DataKind::Continuous)),
    ] {
        let options = BuildOptions::new(kind, depth_for(size)).rule(rule);
        let options = options.packing(Packing::packed());
        fs::remove_file(&path).unwrap();
        build_tree(&tree(form, size, rule), size, &options, Output::create(&path)?, &())?;
        put("goblin_read", name, &fs::read(&path).unwrap());
    }
    for (name, form, size, (rule, kind)) in [
        ("cuts", QUAD, [9, 14, 1], continuous),
        ("cuts_of_classes", QUAD, [12, 9, 1], (Rule::Majority, DataKind::Categorical)),
        ("cuts_of_octree", OCT, [6, 7, 5], (Rule::Max, DataKind::Continuous)),
    ] {
        put(
            "goblin_read",
            name,
            &reference::goblin(&tree(form, size, rule), size, (rule, kind), Cut::EVERYWHERE),
        );
    }
    Ok(())
}

fn autumnals(put: Put<'_>, project: &Path, directory: &Path) -> Result<()> {
    let history = fs::read(project.join("fixtures/v1/history.autumn")).unwrap();
    let path = directory.join("t.autumn");
    let small = build(&path, OCT, [5, 4, 3], (Rule::Mean, DataKind::Continuous), true)?;
    let floats = form(Dimension::Quad, SampleType::F64, 1);
    build(&path, floats, [6, 7, 1], (Rule::Mean, DataKind::Continuous), false)?;
    let region = FillRegion::Box(Bounds { min: [1, 1, 0], max: [4, 3, 1] });
    edit(&path, [Ok(Edit::Fill(region, Some(vec![0.25.into()])))], Note::default(), 1 << 20, &())?;
    let floats = fs::read(&path).unwrap();
    // Large enough for pointers and zones; stripes, so that many subtrees are equal.
    let stripes = |[x, _, _]: [u32; 3]| Some(Value::from([(x % 2) as u8]));
    // So large that pointers lead to records with pointers; few details, so that it stays small.
    let few =
        |[x, y, z]: [u32; 3]| (x != 5 || y > 2).then(|| Value::from([u8::from(x > 250 && y == 3 && z < 2)]));
    let few_in_space =
        |[x, y, z]: [u32; 3]| Some(Value::from([u8::from(x == 3 && y < 2) + u8::from(x > 61 && z == 40)]));
    // No equal subtrees, so that there are dense blocks.
    let much = |[x, y, _]: [u32; 3]| (x != 3).then(|| Value::from([(x * 31 + y * 47) as u8]));
    let categorical = (Rule::Majority, DataKind::Categorical);
    let mut files = vec![("history", history), ("octree", small), ("floats", floats)];
    for (name, form, (rule, kind), size, share, cell) in [
        ("zones", QUAD, categorical, [128, 100, 1], true, &stripes as &dyn Fn([u32; 3]) -> Option<Value>),
        ("levels", QUAD, (Rule::Mean, DataKind::Continuous), [512, 512, 1], false, &few),
        ("levels_of_octree", OCT, categorical, [64, 64, 64], false, &few_in_space),
        ("dense", QUAD, categorical, [16, 16, 1], false, &much),
    ] {
        let tree = MemTree::from_cells(form, depth_for(size), rule, cell);
        let options = BuildOptions::new(kind, depth_for(size)).rule(rule).share(share);
        fs::remove_file(&path).unwrap();
        build_tree(&tree, size, &options, Output::create(&path)?, &())?;
        files.push((name, fs::read(&path).unwrap()));
    }
    // The last two with a packed history, which is all but one value.
    for (name, from) in [("packed_octree", files.len() - 2), ("packed_classes", files.len() - 1)] {
        fs::write(&path, &files[from].1).unwrap();
        let region = FillRegion::Box(Bounds { min: [0; 3], max: [64; 3] });
        edit(&path, [Ok(Edit::Fill(region, Some(vec![9.0.into()])))], Note::default(), 1 << 20, &())?;
        let to = directory.join("packed.autumn");
        let options = CompactOptions::new(&Keep::Last(2), 1 << 20).pack(true);
        compact(&path, &options, Output::create(&to)?, &())?;
        files.push((name, fs::read(&to).unwrap()));
        fs::remove_file(to).unwrap();
    }
    for (name, file) in files {
        let packed = seal::packed(&file);
        assert!(packed.len() < 4000, "{name}: {} bytes", packed.len());
        put("autumnal_read", name, &packed);
        let script: [u8; 8] = *b"\x81\x02\x03\x05\x03\0\0\x01";
        let script = [&script[..], &packed].concat();
        put("autumnal_edit", name, &script);
        put("autumnal_file", name, &script);
    }
    Ok(())
}

/// Files of several layers of different types, depths and cells.
fn layers(put: Put<'_>, directory: &Path) -> Result<()> {
    let continuous = (Rule::Mean, DataKind::Continuous);
    let pairs = form(Dimension::Quad, SampleType::U16, 2);
    for (name, first, second, size) in
        [("quadtrees", QUAD, pairs, [13, 10, 1]), ("octrees", OCT, OCT, [5, 4, 6])]
    {
        let other = directory.join("other.goblin");
        build(&other, second, size, (Rule::Max, DataKind::Continuous), false)?;
        for extension in ["goblin", "autumn"] {
            let path = directory.join(format!("layers.{extension}"));
            build(&path, first, size, continuous, false)?;
            for layer in ["b", "c"] {
                add_layer(
                    &path,
                    layer,
                    &FileView::of(&other),
                    Note::default(),
                    WriteOptions::new(1 << 20),
                    &(),
                )?;
            }
            let file = fs::read(&path).unwrap();
            match extension {
                "goblin" => put("goblin_layers", name, &file),
                _ => put("autumnal_layers", name, &seal::packed(&file)),
            }
        }
    }
    Ok(())
}

fn images(put: Put<'_>, project: &Path, directory: &Path) -> Result<()> {
    let samples: Vec<u8> = (0..=255).map(|byte: u8| byte / 3 * 2).collect();
    for (target, name, file, sample, channels) in [
        ("png", "rgb", "a.png", SampleType::U8, 3),
        ("png", "deep", "a.png", SampleType::U16, 1),
        ("tiff", "rgb", "a.tif", SampleType::U8, 3),
        ("tiff", "floats", "a.tif", SampleType::F32, 1),
        ("exr", "floats", "a.exr", SampleType::F32, 1),
        ("exr", "rgb", "a.exr", SampleType::F32, 3),
    ] {
        let path = directory.join(file);
        let (width, height) = (5, 4);
        let value = ValueType::new(sample, channels);
        let spec = ImageSpec {
            width,
            height,
            value,
            alpha: false,
            void: false,
            metadata: Metadata {
                frame: Frame::planar([2.0, 0.0, 10.0, 0.0, -2.0, 20.0]),
                ..Metadata::default()
            },
        };
        let mut writer = create(Output::create(&path)?, format_of(&path).unwrap(), &spec)?;
        writer.write_rows(&samples[..(width * height) as usize * value.size()], None)?;
        writer.finish()?;
        put(target, name, &fs::read(&path).unwrap());
    }
    use tiff_file::{Ifd, Values};
    let chunk = |byte| vec![byte; 256];
    let tiles = Ifd::grey(20, 17, vec![])
        .short(322, &[16])
        .short(323, &[16])
        .tag(33550, Values::Double(vec![10.0, 10.0, 0.0]))
        .tag(33922, Values::Double(vec![0.0, 0.0, 0.0, 5.0, 6.0, 0.0]))
        .tag(42113, Values::Text("7"))
        .chunks(&[chunk(7), chunk(2), vec![], chunk(4)]);
    let packbits =
        Ifd::grey(9, 3, vec![0xfc, 0x12, 0x04, 1, 2, 3, 4, 5, 0xfc, 9]).short(258, &[4]).short(259, &[32773]);
    put("tiff", "tiles", &tiff_file::file(&[tiles]));
    put("tiff", "packbits", &tiff_file::file(&[packbits]));
    let made = project.join("tests/import/images");
    for (target, name) in [
        ("png", "adam7.png"),
        ("png", "adam7_grey2.png"),
        ("jpeg", "cmyk.jpg"),
        ("jpeg", "grey.jpg"),
        ("jpeg", "rgb.jpg"),
        ("jpeg", "progressive.jpg"),
        ("webp", "alpha.webp"),
        ("webp", "lossless.webp"),
        ("webp", "lossy.webp"),
    ] {
        put(target, name.split('.').next().unwrap(), &fs::read(made.join(name)).unwrap());
    }
    for (target, name) in [
        ("bmp", "bits.bmp"),
        ("bmp", "palette.bmp"),
        ("bmp", "rgb.bmp"),
        ("gif", "frames.gif"),
        ("gif", "interlaced.gif"),
        ("pnm", "bits.pbm"),
        ("pnm", "deep.pgm"),
        ("pnm", "rgb.ppm"),
        ("qoi", "rgba.qoi"),
        ("tga", "gray_alpha.tga"),
        ("tga", "palette.tga"),
        ("tga", "rgba.tga"),
    ] {
        put(target, name.split('.').next().unwrap(), &fs::read(made.join("whole").join(name)).unwrap());
    }
    put("pnm", "text", b"P2 # gray\n3 1\n15\n0 15 7\n");
    put("pnm", "pam", b"P7\nWIDTH 1\nHEIGHT 1\nDEPTH 2\nMAXVAL 100\nTUPLTYPE GRAYSCALE_ALPHA\nENDHDR\n\x05\x32");
    put("hdr", "flat", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 1 +X 2\n\x01\x82\x03\x80\x04\x85\x06\x7f");
    put("hgt", "tile", b"N46E008.hgt\x01\x02\x80\0\x03\x04");
    let sidecar = "<PAMDataset><SRS>EPSG:4326</SRS><GeoTransform>1,2,0,3,0,-2</GeoTransform>\
        <GCPList Projection=\"EPSG:2056\"><GCP Pixel=\"1\" Line=\"2\" X=\"3\" Y=\"4\" Z=\"5\"/></GCPList>\
        <Metadata domain=\"D\"><MDI key=\"a &amp; b\">&#65;</MDI></Metadata>\
        <PAMRasterBand band=\"1\"><Description>d</Description><NoDataValue>-1e3</NoDataValue><UnitType>m</UnitType>\
        <Offset>1</Offset><Scale>2</Scale><CategoryNames><Category>s</Category><Category/></CategoryNames>\
        <ColorTable><Entry c1=\"1\" c2=\"2\" c3=\"3\" c4=\"4\"/></ColorTable><GDALRasterAttributeTable>\
        <FieldDefn><Usage>5</Usage></FieldDefn><FieldDefn><Usage>2</Usage></FieldDefn><Row><F>1</F><F>n</F></Row>\
        </GDALRasterAttributeTable></PAMRasterBand></PAMDataset>";
    put("sidecar", "all", sidecar.as_bytes());
    let vrt = "<VRTDataset rasterXSize=\"3\" rasterYSize=\"2\"><SRS>EPSG:4326</SRS>\
        <GeoTransform>1,2,0,3,0,-2</GeoTransform><Metadata><MDI key=\"a\">b</MDI></Metadata>\
        <VRTRasterBand dataType=\"Byte\" band=\"1\"><Description>d</Description><NoDataValue>9</NoDataValue>\
        <ColorInterp>Gray</ColorInterp><SimpleSource><SourceFilename relativeToVRT=\"1\">d.png</SourceFilename>\
        <SourceBand>1</SourceBand><SrcRect xOff=\"0\" yOff=\"0\" xSize=\"1\" ySize=\"1\"/>\
        <DstRect xOff=\"1\" yOff=\"0\" xSize=\"2\" ySize=\"2\"/></SimpleSource><ComplexSource>\
        <SourceFilename relativeToVRT=\"1\">d.png</SourceFilename><NODATA>1</NODATA>\
        <SrcRect xOff=\"0\" yOff=\"0\" xSize=\"1\" ySize=\"1\"/>\
        <DstRect xOff=\"0\" yOff=\"0\" xSize=\"1\" ySize=\"1\"/></ComplexSource></VRTRasterBand>\
        <VRTRasterBand dataType=\"Float32\" band=\"2\"><CategoryNames><Category>s</Category></CategoryNames>\
        <ColorTable><Entry c1=\"1\" c2=\"2\" c3=\"3\"/></ColorTable></VRTRasterBand></VRTDataset>";
    put("vrt", "all", vrt.as_bytes());
    let head = "size 9 7\ntype i16\nnodata -1\ntransform 10 0 500 0 -10 900\npoints\ncrs EPSG:32632\npalette #000000ff #10203040\nname 1 \"A \\\"wood\\\"\"\n";
    let cracks = "region 1 0 0\n333000111222\nhole 1 1\n0321\nregion 5 1 1\n3012\npart 2 2\n3012\nend 2\n";
    let cells = "region 1 0 0\n66002244\nhole 1 0\n7531\nregion -3 1 1\nline 7 8 6\n4435\nend 3\n";
    put("chain_code", "cracks", format!("freeman-chain-code 1\ndirections 4\n{head}{cracks}").as_bytes());
    put("chain_code", "cells", format!("freeman-chain-code 1\ndirections 8\n{head}{cells}").as_bytes());
    put("world_file", "turned", b"0.5\n0.1\n-0.1\n-0.25\n10.25\n49.875\n");
    Ok(())
}

fn features(put: Put<'_>, directory: &Path) -> Result<()> {
    let geometries = [
        r#"{"type":"Polygon","coordinates":[[[0,0],[9,0],[9,9],[0,0]],[[4,1],[5,1],[5,2],[4,1]]]}"#,
        r#"{"type":"MultiLineString","coordinates":[[[1,2,3],[4,5.5e1]],[]]}"#,
        r#"{"type":"GeometryCollection","geometries":[{"type":"MultiPoint","coordinates":[[1,2]]}]}"#,
        "null",
    ];
    let feature = |(index, geometry): (usize, &&str)| {
        let properties = format!(r#"{{"n":{index},"t":"\u00fc\n","x":[1,{{"a":null}}],"b":true,"f":-1.5}}"#);
        format!(r#"{{"type":"Feature","id":"{index}","properties":{properties},"geometry":{geometry}}}"#)
    };
    let all: Vec<String> = geometries.iter().enumerate().map(feature).collect();
    let crs = r#""crs":{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::25832"}}"#;
    let collection = format!(r#"{{"type":"FeatureCollection","features":[{}],{crs}}}"#, all.join(",\n"));
    put("geojson", "collection", collection.as_bytes());
    put("geojson", "sequence", format!("\u{1e}{}\n", all.join("\n\u{1e}")).as_bytes());
    let rows = "n;t;the_geom\r\n1;\"a \"\"b\"\"\";\"SRID=25832;MULTIPOLYGON Z (((0 0 1,9 0 1,9 9 1)),EMPTY)\"\r\n\
        007;;0101000020E8640000000000000000F03F0000000000000040\r\n";
    put("feature_table", "text", rows.as_bytes());
    put("feature_table", "points", b"lon,lat,name\n1,2.5,a\n,,\n");
    // (The GeoPackage in the corpus was made by hand, with pages of 512 bytes: those of the writer
    // are larger than the fuzzer's maximum.)
    for (ending, target) in [("fgb", "flatgeobuf"), ("shp", "shapefile")] {
        let layer = VectorLayer {
            name: "n".into(),
            kind: Some(GeometryKind::Polygon),
            is_multi: false,
            has_z: false,
            attributes: vec![("a".into(), AttributeType::Number), ("t".into(), AttributeType::Text)],
            crs: Some(Crs::epsg(25832)),
            bounds: [[0.0, 0.0], [9.0, 9.0]],
        };
        let path = directory.join(format!("a.{ending}"));
        let mut writer = VectorWriter::create(Output::create(&path)?, ending.parse()?, layer)?;
        let ring = |at: f64| vec![[at, 1.0, 0.0], [at + 5.0, 1.0, 0.0], [at, 6.0, 0.0], [at, 1.0, 0.0]];
        let hole = vec![[1.0, 2.0, 0.0], [1.0, 3.0, 0.0], [2.0, 2.0, 0.0], [1.0, 2.0, 0.0]];
        writer.write(&[ring(0.0), hole], &[AttributeValue::Number(0.5), AttributeValue::Text("t")])?;
        writer.write(&[ring(9.0)], &[AttributeValue::None, AttributeValue::None])?;
        writer.finish(&())?;
        put(target, "polygons", &fs::read(&path).unwrap());
    }
    // (As long as the only shape of the target: one row.)
    let mut table = fs::read(directory.join("a.dbf")).unwrap();
    table[4] = 1;
    put("shapefile_table", "row", &table);
    Ok(())
}

/// Vertices of a cube, and its sides seen from outside.
const CORNERS: [[u8; 3]; 8] =
    [[0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0], [0, 0, 2], [2, 0, 2], [0, 2, 2], [2, 2, 2]];
const SIDES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

fn meshes(put: Put<'_>) {
    let lines = |start: &str, corner: &dyn Fn([u8; 3]) -> String, side: &dyn Fn([usize; 4]) -> String| {
        let corners: String = CORNERS.into_iter().map(corner).collect();
        format!("{start}{corners}{}", SIDES.into_iter().map(side).collect::<String>())
    };
    let words = |numbers: &[usize]| numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
    let point = |[x, y, z]: [u8; 3]| format!("{x} {y} {z}\n");
    let off = lines("OFF\n8 6 0\n", &point, &|side| format!("4 {}\n", words(&side)));
    put("off", "cube", off.as_bytes());
    let coloured =
        off.replacen("OFF", "COFF", 1).replace(" 0\n", " 0 255 0 0\n").replace(" 2\n", " 2 1 2 3\n");
    put("off", "colours", coloured.as_bytes());
    let head = |format: &str, colours: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n{colours}\
             element face 6\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let ply = lines(&head("ascii", ""), &point, &|side| format!("4 {}\n", words(&side)));
    put("ply", "text", ply.as_bytes());
    let mut binary =
        head("binary_little_endian", "property uchar red\nproperty uchar green\nproperty uchar blue\n")
            .into_bytes();
    for corner in CORNERS {
        corner.iter().for_each(|number| binary.extend(f32::from(*number).to_le_bytes()));
        binary.extend([1, 2, 3]);
    }
    for side in SIDES {
        binary.push(4);
        side.iter().for_each(|corner| binary.extend((*corner as i32).to_le_bytes()));
    }
    put("ply", "binary", &binary);
    let obj = lines("o cube\nusemtl red\n", &|[x, y, z]| format!("v {x} {y} {z}\n"), &|side| {
        format!("f {}\n", words(&side.map(|corner| corner + 1)))
    });
    put("obj", "cube", obj.as_bytes());
    put("obj", "turned", b"g a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf -4//1 -2//1 -3//1\nf 1 2 4\nf 1 4 3\ng b\nf 2 3 4\n");
    let mut facets = Vec::new();
    for [a, b, c, d] in SIDES {
        facets.extend([[a, b, c], [a, c, d]]);
    }
    let mut text = String::from("solid cube\n");
    let mut stl = vec![0; 80];
    stl.extend((facets.len() as u32).to_le_bytes());
    for facet in facets {
        text += "facet normal 0 0 0\nouter loop\n";
        stl.extend([0; 12]);
        for corner in facet {
            let [x, y, z] = CORNERS[corner];
            text += &format!("vertex {x} {y} {z}\n");
            CORNERS[corner].iter().for_each(|number| stl.extend(f32::from(*number).to_le_bytes()));
        }
        text += "endloop\nendfacet\n";
        stl.extend([0; 2]);
    }
    put("stl", "text", (text + "endsolid cube\n").as_bytes());
    put("stl", "binary", &stl);
    let sides: Vec<String> = SIDES.iter().map(|side| format!("[{side:?}]")).collect();
    let city = |kind: &str, boundaries: &str| {
        format!(
            "{{\"type\":\"CityJSON\",\"version\":\"2.0\",\"transform\":{{\"scale\":[0.5,0.5,0.5],\"translate\":[0,0,0]}},\
             \"CityObjects\":{{\"b\":{{\"type\":\"Building\",\"geometry\":[{{\"type\":\"{kind}\",\"lod\":\"2\",\"boundaries\":\
             {boundaries}}}]}}}},\"metadata\":{{\"referenceSystem\":\"https://www.opengis.net/def/crs/EPSG/0/7415\"}},\
             \"vertices\":{CORNERS:?}}}"
        )
    };
    put("cityjson", "solid", city("Solid", &format!("[[{}]]", sides.join(","))).as_bytes());
    put("cityjson", "surface", city("MultiSurface", &format!("[{}]", sides.join(","))).as_bytes());
    let sequence = "{\"type\":\"CityJSON\",\"version\":\"2.0\",\"transform\":{\"scale\":[1,1,1],\"translate\":[0,0,0]},\
                    \"CityObjects\":{},\"vertices\":[]}\n{\"type\":\"CityJSONFeature\",\"id\":\"f\",\"CityObjects\":{\"f\":{\"type\":\
                    \"Building\",\"geometry\":[{\"type\":\"MultiSurface\",\"lod\":\"1\",\"boundaries\":[[[0,1,2]],[[0,2,1]]]}]}},\
                    \"vertices\":[[0,0,0],[4,0,0],[0,4,1]]}\n";
    put("cityjson", "sequence", sequence.as_bytes());
}

/// A cube under two nodes: one in a hierarchy, one mirrored with two instances.
fn gltf(put: Put<'_>) {
    let head = "{\"asset\":{\"version\":\"2.0\"},\"scenes\":[{\"nodes\":[0,1]}],\
         \"nodes\":[{\"children\":[2]},{\"mesh\":0,\"scale\":[-1,1,1],\
         \"extensions\":{\"EXT_mesh_gpu_instancing\":{\"attributes\":{\"TRANSLATION\":2}}}},\
         {\"mesh\":0,\"name\":\"cube\",\"translation\":[0,4,0]}],\
         \"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}],\
         \"accessors\":[{\"bufferView\":0,\"componentType\":5121,\"count\":8,\"type\":\"VEC3\",\
         \"sparse\":{\"count\":1,\"indices\":{\"bufferView\":1,\"componentType\":5121,\
         \"byteOffset\":2},\"values\":{\"bufferView\":0,\"byteOffset\":24}}},{\"bufferView\":1,\
         \"componentType\":5121,\"count\":36,\"type\":\"SCALAR\"},{\"bufferView\":2,\
         \"componentType\":5126,\"count\":2,\"type\":\"VEC3\"}],\"bufferViews\":[{\"buffer\":0,\
         \"byteLength\":32,\"byteStride\":4},{\"buffer\":0,\"byteOffset\":32,\"byteLength\":36},\
         {\"buffer\":0,\"byteOffset\":68,\"byteLength\":24}],\"buffers\":[{\"byteLength\":92";
    let mut bytes: Vec<u8> = CORNERS.iter().flat_map(|[x, y, z]| [*x, *y, *z, 0]).collect();
    bytes.extend(SIDES.iter().flat_map(|[a, b, c, d]| [a, b, c, a, c, d]).map(|corner| *corner as u8));
    bytes.extend([0f32, 0.0, 0.0, 4.0, 0.0, 0.0].iter().flat_map(|number| number.to_le_bytes()));
    let mut json = format!("{head}}}]}}").into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = |bytes: &[u8]| (bytes.len() as u32).to_le_bytes();
    let whole = (28 + json.len() as u32 + bytes.len() as u32).to_le_bytes();
    let start = [&b"glTF\x02\0\0\0"[..], &whole, &length(&json), b"JSON", &json].concat();
    put("gltf", "binary", &[&start[..], &length(&bytes), b"BIN\0", &bytes].concat());
    let base64 = "AAAAAAIAAAAAAgAAAgIAAAAAAgACAAIAAAICAAICAgAABAYABgIBAwcBBwUAAQUABQQCBg\
                  cCBwMAAgMAAwEEBQcEBwYAAAAAAAAAAAAAAAAAAIBAAAAAAAAAAAA=";
    put("gltf", "embedded", format!("{head},\"uri\":\"data:;base64,{base64}\"}}]}}").as_bytes());
}

/// Exact models of a few grid units, so that there are cells of all kinds and few of them.
fn models(put: Put<'_>, directory: &Path) -> Result<()> {
    let (mesh, path) = (directory.join("mesh.off"), directory.join("model.goblin"));
    let tetrahedron = "OFF\n4 4 0\n0 0 0\n3 0 0\n0 3 0\n0 0 3\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
    // A slanted beam and a separate box.
    let bodies = "COFF\n12 10 0\n0 0 0 1 2 3\n6 0 2 1 2 3\n0 4 1 1 2 3\n1 1 7 1 2 3\n\
        5 5 5 9 9 9\n7 5 5 9 9 9\n7 7 5 9 9 9\n5 7 5 9 9 9\n5 5 7 9 9 9\n7 5 7 9 9 9\n7 7 7 9 9 9\n5 7 7 9 9 9\n\
        3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n4 4 7 6 5\n4 8 9 10 11\n4 4 5 9 8\n4 5 6 10 9\n4 6 7 11 10\n4 7 4 8 11\n";
    for (name, text) in [("tetrahedron", tetrahedron), ("bodies", bodies)] {
        fs::write(&mesh, text).unwrap();
        let mut options = ExactOptions::new();
        (options.snap, options.leaf_size) = (Some(1.0), 3);
        import_exact(open_all(std::slice::from_ref(&mesh), 1 << 20)?, &options, Output::create(&path)?, &())?;
        let mut file = brep_file::BrepFile::of(&fs::read(&path).unwrap());
        put("model_read", name, &file.bytes());
        file = file.cut_everywhere();
        put("model_read", &format!("{name}_cut"), &file.bytes());
        fs::remove_file(&path).unwrap();
    }
    put("model_read", "packed", include_bytes!("../fixtures/v1/crossing_packed.goblin"));
    Ok(())
}

/// Line trees of a few segments: with all kinds of values, in leaves and inner nodes, and empty
/// ones.
fn line_trees(put: Put<'_>, directory: &Path) -> Result<()> {
    let path = directory.join("lines.goblin");
    let (plane, space) = (Dimension::Quad, Dimension::Oct);
    for (name, dimension, count) in [("some", plane, 12), ("space", space, 12), ("none", plane, 0)] {
        let (attributes, features) = line_features::some(dimension, count);
        let options = LineBuildOptions { leaf_size: 4, ..LineBuildOptions::default() };
        let mut source = LinesInMemory::new(dimension, attributes, features);
        spinney::lines::build(&mut source, &options, &Metadata::default(), Output::create(&path)?, &())?;
        put("lines_read", name, &fs::read(&path).unwrap());
        fs::remove_file(&path).unwrap();
    }
    Ok(())
}

fn text_formats(put: Put<'_>) {
    for (name, text) in [
        ("numbers", "EPSG:2056+5773"),
        (
            "wkt1",
            "PROJCS[\"a\",GEOGCS[\"WGS 84\",DATUM[\"d\",SPHEROID[\"s\",6378137,298.25]],UNIT[\"degree\",0.017]],\
            PROJECTION[\"Mercator_1SP\"],PARAMETER[\"scale_factor\",1],UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"3395\"]]",
        ),
        (
            "wkt2",
            "GEOGCRS[\"b\",DATUM[\"d\",ELLIPSOID[\"e\",6378137,298.25,LENGTHUNIT[\"metre\",1]]],CS[ellipsoidal,2],\
            AXIS[\"lat\",north],AXIS[\"lon\",east],ANGLEUNIT[\"degree\",0.0174],ID[\"EPSG\",4326]]",
        ),
        (
            "projjson",
            "{\"type\":\"GeographicCRS\",\"name\":\"c\",\"datum\":{\"type\":\"GeodeticReferenceFrame\",\
            \"name\":\"d\"},\"id\":{\"authority\":\"EPSG\",\"code\":4258}}",
        ),
    ] {
        put("crs_text", name, text.as_bytes());
    }
    put("step_text", "turns", b"rotate=30\nscale=2,3\ntranslate=0.5,1\nmirror=x\n");
    put(
        "step_text",
        "turns_in_space",
        b"rotate=30,1,2,3@4,5,6\naxes=+y,-x,+z\naffine=1,0,2,0,1,3\ntranspose\n",
    );
    put("step_text", "boxes", b"window=1,2,3,4\nwindow=0,0,5,5,in=world\ncrop\ndepth=4\n");
    put("step_text", "nodes", b"subtree=/03\nembed=/2\ntree-depth=5\nlike=a.goblin\n");
    put(
        "step_text",
        "calculations",
        b"calc=where(b1>2,b1/2,-b1),type=u8\nreduce=median\nscale=2\ncalc=abs(b1)\n",
    );
    for (name, text) in [
        ("index", "'(b1-2)/(b1+2)'"),
        ("conditions", "where(b1>=2 and not b1==3|!(b1<1.5e0),min(b1,7),\"b1\"),type=i16"),
        ("reductions", "median(b1,2,b1*3)+mean(b1,1)-max(b1)*count(b1,0/0)/sqrt(abs(-b1)),type=f64"),
        ("reduction", "median,type=u8"),
        ("files", "a.red+b1,a=\"x, y.goblin\",type=u16"),
    ] {
        put("calculation_text", name, text.as_bytes());
    }
    put("df_text", "classic", b"\x18GG1G13331G3312GG31331G3222G11221G221G1211");
    put("df_text", "octree", b"\x11M(VFV1)FM[7]VVVVVVFF0");
    put("df_text", "colours", b"\x12G[1,2,3][4,5,6]WB");
    put("df_text", "floats", b"\x1eG[0.5][-1e300]W[0]");
    for (name, text) in [
        ("classic", "bintree:alternating:xy:3:u8:8x8 GGG1GGG133GG31G321GGGG3G13GG322G1GG12G12GG21G2G1G21"),
        ("lines", "bintree:adaptive:xy:29:u8:536870912x1 XXYYYYYYYYYYYYYYYYYYYYYYYYYYYYYBWWWWWWWWWWWWWWWWWWWWWWWWWWWWWYWWW"),
        ("volume", "bintree:adaptive:xyz:2:f32x2+missing=-1:4x4x2 ZXY[0.5,-1]V[NaN,-0]V"),
    ] {
        put("bintree_text", name, text.as_bytes());
    }
    put("cells", "text", b"1,2,3\n0 0 void\n7;7;200\n");
    let array = |descr: &str, shape: &str, samples: &[u8]| {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
        let length = (header.len() as u16).to_le_bytes();
        [&b"\x93NUMPY\x01\0"[..], &length, header.as_bytes(), samples].concat()
    };
    let cells: Vec<u8> = [1i16, 2, 3, 4, 5, 6].iter().flat_map(|number| number.to_le_bytes()).collect();
    put("cells", "array", &array("<i2", "(2, 3)", &cells));
    let numbers: Vec<u8> = (0..60).flat_map(|number| (number as f32 * 0.5 - 7.0).to_be_bytes()).collect();
    let head = "NRRD0005\n# x\ntype: int16\ndimension: 3\nspace: left-posterior-superior\nsizes: 3 2 2\nspace directions: (0.5,0,0) (0,0,-2) (0,1,0.25)\n\
        space origin: (-1,2,3.5)\nspace units: \"mm\" \"mm\" \"mm\"\ncenters: cell cell cell\nkinds: domain domain domain\nsample units: HU\nkey:=a\\nb\n\
        endian: big\nencoding: raw\nbyte skip: -1\n\n";
    let counted: Vec<u8> = (0..24).collect();
    put("nrrd", "raw", &[head.as_bytes(), b"xyz", &counted].concat());
    let head = "NRRD0001\ntype: float\ndimension: 4\nsizes: 2 3 1 1\nspacings: nan 0.5 1 2\naxis mins: nan 1 2 3\nencoding: gzip\nendian: little\n\n";
    // (Uncompressed bytes, in a block of a compressed stream.)
    let (start, end) = (b"\x1f\x8b\x08\0\0\0\0\0\0\xff\x01\x18\0\xe7\xff", b"\x96\xa6\x95\x82\x18\0\0\0");
    put("nrrd", "gzip", &[head.as_bytes(), start, &counted, end].concat());
    put("npy", "floats", &array(">f4", "(3, 4, 5)", &numbers));
    put("npy", "halves", &array("<f2", "(2, 3, 4, 2)", &numbers[..96]));
    put("npy", "longs", &array("<i8", "(2, 3, 1)", &[&[0; 40][..], &5u64.to_le_bytes()].concat()));
}
