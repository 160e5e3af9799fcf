//! Raster metadata, from files through trees to files.

use std::path::{Path, PathBuf};

use spinney::export::{Detail, WindowRequest, export_window};
use spinney::import::raster::{ImportOptions, plan};
use spinney::raw::export::image::Format;
use spinney::raw::import::raster::{self, Pixels, RasterInfo};
use spinney::raw::space::ControlPoint;
use spinney::raw::value::Mask;
use spinney::{Bounds, DataKind, Output, Region};

use crate::common::tiff_file::{Ifd, Values, file};
use crate::common::with;

const XML: &str = "<GDALMetadata>
  <Item name=\"A\">x &amp;amp; y &amp;lt;z&amp;gt;</Item>
  <Item name=\"AREA_OR_POINT\">Area</Item>
  <Item name=\"Q\" domain=\"MYDOM\">1</Item>
  <Item name=\"doc\" domain=\"xml:FOO\">&amp;lt;a x=&amp;quot;1&amp;quot;/&amp;gt;</Item>
  <Item name=\"NBITS\" domain=\"IMAGE_STRUCTURE\">7</Item>
  <Item name=\"wave\" sample=\"0\">550 nm</Item>
  <Item name=\"STATISTICS_MEAN\" sample=\"0\">17</Item>
  <Item name=\"OFFSET\" sample=\"0\" role=\"offset\">1</Item>
  <Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.10000000000000001</Item>
  <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">m</Item>
  <Item name=\"DESCRIPTION\" sample=\"0\" role=\"description\">near &amp;lt;infrared&amp;gt;</Item>
  <Item name=\"k\" sample=\"1\" domain=\"BD\">v</Item>
  <Item name=\"UNITTYPE\" sample=\"1\" role=\"unittype\">°C</Item>
  <Item name=\"WILD\" sample=\"9\">nowhere</Item>
</GDALMetadata>";

/// A tree built from an image, and the metadata of images exported from it.
struct Trip {
    directory: tempfile::TempDir,
    tree: spinney::Dataset,
}

impl Trip {
    fn of(image: &[u8], sidecar: Option<&str>, options: &ImportOptions) -> (RasterInfo, Trip) {
        let directory = tempfile::tempdir().unwrap();
        let [from, tree] = ["in.tif", "t.goblin"].map(|name| directory.path().join(name));
        std::fs::write(&from, image).unwrap();
        if let Some(xml) = sidecar {
            std::fs::write(directory.path().join("in.tif.aux.xml"), xml).unwrap();
        }
        let import = plan(&[from], options).unwrap();
        let info = import.info().clone();
        import.build(Output::create(&tree).unwrap(), &()).unwrap();
        let tree = spinney::open(&tree).unwrap();
        (info, Trip { directory, tree })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn write(&self, path: &Path, bounds: Bounds, detail: Detail) -> RasterInfo {
        let request = WindowRequest::new(bounds, detail);
        export_window(&self.tree, &request, Output::create(path).unwrap(), Format::Tiff, &()).unwrap();
        raster::open(path, &Default::default()).unwrap().info().clone()
    }

    /// Returns the metadata of a window at a level.
    fn window(&self, min: [u64; 3], max: [u64; 3], level: u8) -> RasterInfo {
        self.write(&self.path("out.tif"), Bounds { min, max }, Detail::Level(level))
    }
}

/// Compares all metadata that does not depend on the window.
fn assert_same(found: &RasterInfo, expected: &RasterInfo) {
    assert_eq!(found.band_names, expected.band_names);
    assert_eq!(found.units, expected.units);
    assert_eq!(found.scale_offset, expected.scale_offset);
    assert_eq!(found.class_names, expected.class_names);
    assert_eq!(found.palette, expected.palette);
    assert_eq!(found.nodata, expected.nodata);
    let tags = |info: &RasterInfo| with(info.tags.clone(), |tags| drop(tags.remove("AREA_OR_POINT")));
    assert_eq!(tags(found), tags(expected));
    assert_eq!(found.scoped_tags, expected.scoped_tags);
}

#[test]
fn scales_units_names_and_tags_come_through() {
    let image = Ifd::grey(8, 4, (0..64).collect()).short(277, &[2]).short(258, &[8, 8]);
    let image = image.tag(42112, Values::Text(XML)).tag(305, Values::Text("a program"));
    let (info, trip) = Trip::of(&file(&[image]), None, &ImportOptions::new());
    assert_eq!(info.band_names, ["near <infrared>", ""]);
    assert_eq!(info.units, ["m", "°C"]);
    assert_eq!(info.scale_offset, [(0.1, 1.0), (1.0, 0.0)]);
    assert_eq!(info.tags["A"], "x & y <z>");
    assert_eq!(info.tags["TIFFTAG_SOFTWARE"], "a program");
    let scopes: Vec<String> = info.scoped_tags.iter().map(|tags| format!("{tags:?}")).collect();
    assert_eq!(scopes.len(), 4, "{scopes:?}");
    assert!(!scopes.concat().contains("STATISTICS") && !scopes.concat().contains("nowhere"), "{scopes:?}");
    assert_same(&trip.window([0; 3], [8, 4, 1], 3), &info);
    assert_same(&trip.window([4, 0, 0], [8, 4, 1], 1), &info);
    assert!(!trip.path("out.tif.aux.xml").exists());
}

#[test]
fn nodata_of_one_band_is_missing_there_alone() {
    // The first pixel has nodata in red, the last one in all bands.
    let pixels = vec![0, 50, 60, 10, 26, 36, 30, 0, 90, 0, 0, 0];
    let image = Ifd::grey(4, 1, pixels.clone()).short(277, &[3]).short(258, &[8; 3]).short(262, &[2]);
    let image = image.tag(42113, Values::Text("0"));
    let (_, trip) = Trip::of(&file(std::slice::from_ref(&image)), None, &ImportOptions::new());
    assert_eq!(trip.tree.header().form.value.mask, Mask::Missing([0; 8]));
    let read = |detail| {
        let path = trip.path("out.tif");
        let info = trip.write(&path, Bounds { min: [0; 3], max: [4, 1, 1] }, detail);
        let mut raster = raster::open(&path, &Default::default()).unwrap();
        let mut found = Pixels::default();
        raster.read(Region::new(0, 0, info.width, info.height), &mut found).unwrap();
        assert_eq!(info.nodata, Some(0.0.into()));
        found.bytes
    };
    assert_eq!(read(Detail::Level(2)), pixels);
    assert_eq!(read(Detail::Level(1)), [10, 38, 48, 30, 0, 90]);
    assert_eq!(read(Detail::Level(0)), [20, 38, 62]);
    // Averages over areas that differ from the cells.
    assert_eq!(read(Detail::Size(3, 1)), [10, 44, 54, 20, 26, 63, 30, 0, 90]);
    let cells: Vec<u64> =
        trip.tree.statistics(None, &()).unwrap().channels.iter().map(|channel| channel.cells).collect();
    assert_eq!(cells, [2, 2, 3]);
    // With an opacity band, or with only one band, no sample is missing.
    let with_opacity = image.short(277, &[4]).short(258, &[8; 4]).short(338, &[2]);
    let (_, trip) = Trip::of(&file(&[with_opacity.short(256, &[3])]), None, &ImportOptions::new());
    assert_eq!(trip.tree.header().form.value.mask, Mask::Alpha);
}

#[test]
fn chosen_bands_have_their_own() {
    let image = Ifd::grey(8, 4, (0..64).collect()).short(277, &[2]).short(258, &[8, 8]);
    let options = with(ImportOptions::new(), |it| it.bands = Some(vec![2.into()]));
    let (_, trip) = Trip::of(&file(&[image.tag(42112, Values::Text(XML))]), None, &options);
    let found = trip.window([0; 3], [8, 4, 1], 3);
    assert_eq!(
        (found.units.as_slice(), found.scale_offset.as_slice()),
        (&["°C".to_string()][..], &[(1.0, 0.0)][..])
    );
    let scopes: Vec<_> =
        found.scoped_tags.keys().map(|scope| (scope.channel, scope.domain.as_str())).collect();
    assert_eq!(scopes, [(None, "MYDOM"), (None, "xml:FOO"), (Some(0), "BD")]);
}

#[test]
fn names_of_values_go_into_a_sidecar() {
    let sidecar = "<PAMDataset><PAMRasterBand band=\"1\"><NoDataValue>9</NoDataValue><UnitType>class</UnitType>
        <CategoryNames><Category>sea</Category><Category/><Category>wood &amp; heath</Category></CategoryNames>
        </PAMRasterBand></PAMDataset>";
    let image = file(&[Ifd::grey(4, 4, [0, 2, 9, 0].repeat(4))]);
    let (info, trip) = Trip::of(&image, Some(sidecar), &ImportOptions::new());
    assert_eq!(
        info.class_names,
        [(0.into(), "sea".into()), (1.into(), "".into()), (2.into(), "wood & heath".into())]
    );
    assert_eq!((info.nodata, info.units[0].as_str()), (Some(9.into()), "class"));
    assert_eq!(trip.tree.header().kind, DataKind::Categorical);
    assert_same(&trip.window([0; 3], [4, 4, 1], 2), &info);
    assert_same(&trip.window([0; 3], [2, 2, 1], 1), &info);
    assert!(trip.path("out.tif.aux.xml").exists());
    // An image without names replaces the file, and does not inherit names from its sidecar.
    let (_, other) = Trip::of(&file(&[Ifd::grey(4, 4, vec![3; 16])]), None, &ImportOptions::new());
    let found = other.write(&trip.path("out.tif"), Bounds { min: [0; 3], max: [4, 4, 1] }, Detail::Level(2));
    assert!(found.class_names.is_empty() && !trip.path("out.tif.aux.xml").exists());
}

#[test]
fn control_points_move_and_scale_with_the_raster() {
    let tie_points = [[0.0, 0.0, 0.0, 10.0, 50.0, 3.0], [8.0, 2.5, 0.0, 11.0, 49.0, 0.0]].concat();
    let keys = [[1, 1, 0, 2], [1024, 0, 1, 2], [2048, 0, 1, 4326]].concat();
    let image = Ifd::grey(8, 4, (0..32).collect()).tag(33922, Values::Double(tie_points));
    let (info, trip) = Trip::of(&file(&[image.short(34735, &keys)]), None, &ImportOptions::new());
    let points = [
        ControlPoint { cell: [0.0, 0.0], world: [10.0, 50.0, 3.0] },
        ControlPoint { cell: [8.0, 2.5], world: [11.0, 49.0, 0.0] },
    ];
    assert_eq!(info.control_points.as_ref().unwrap().points, points);
    let whole = trip.window([0; 3], [8, 4, 1], 3);
    assert_eq!(whole.control_points, info.control_points);
    assert_eq!(whole.control_points.unwrap().crs, Some(spinney::Crs::epsg(4326)));
    let at = |info: RasterInfo| {
        info.control_points.unwrap().points.iter().map(|point| point.cell).collect::<Vec<_>>()
    };
    assert_eq!(at(trip.window([2, 2, 0], [6, 4, 1], 3)), [[-2.0, -2.0], [6.0, 0.5]]);
    assert_eq!(at(trip.window([4, 0, 0], [8, 4, 1], 2)), [[-2.0, 0.0], [2.0, 1.25]]);
    let bounds = Bounds { min: [0; 3], max: [8, 4, 1] };
    assert_eq!(at(trip.write(&trip.path("out.tif"), bounds, Detail::Size(16, 4))), [[0.0, 0.0], [16.0, 2.5]]);
    // For a view, coordinates follow its cells.
    let steps = ["window=2,1,4,3", "mirror=x"].map(|step| step.parse().unwrap());
    let view = trip.tree.view(&steps).unwrap();
    let cells: Vec<_> =
        view.metadata().control_points.as_ref().unwrap().points.iter().map(|point| point.cell).collect();
    assert_eq!(cells, [[6.0, -1.0], [-2.0, 1.5]]);
}

#[test]
fn other_files_are_rejected_as_sidecars() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.tif");
    std::fs::write(&path, file(&[Ifd::grey(1, 1, vec![1])])).unwrap();
    let sidecar = directory.path().join("a.tif.aux.xml");
    for bytes in [&b""[..], b"<html></html>", b"<PAMDataset>", &[0xff; 100], &vec![b' '; (16 << 20) + 1]] {
        std::fs::write(&sidecar, bytes).unwrap();
        let error = raster::open(&path, &Default::default()).err().unwrap().to_string();
        assert!(error.contains("a.tif.aux.xml") && error.contains("<PAMDataset>"), "{error}");
    }
    std::fs::write(&sidecar, "<PAMDataset/>").unwrap();
    assert!(raster::open(&path, &Default::default()).is_ok());
}
