//! LAS and LAZ in and out.

use std::path::{Path, PathBuf};

use las::{Version, raw};

use super::format::{MAX_FORMAT, describe_extra, record_bytes};
use super::{LasFiles, LasReader};
use crate::attribute::PointAttribute;
use crate::export::{PointFormat, export_points};
use crate::import::{PointImportOptions, plan_files};
use crate::query::Selection;
use crate::source::{PointSource, bounds_of};
use crate::store::PointTree;
use crate::tests::random;
use spinney_base::Result;
use spinney_base::io::Output;
use spinney_base::value::SampleType;

/// Records of a format with random bytes, at places that are near each other.
pub(crate) fn records(format: u8, more: usize, count: usize) -> Vec<u8> {
    let size = record_bytes(format).unwrap() + more;
    let mut random = random(u64::from(format) + 1);
    let mut rows: Vec<u8> = (0..count * size).map(|_| random() as u8).collect();
    for row in rows.chunks_exact_mut(size) {
        for axis in 0..3 {
            let step = (random() % 5000) as i32 - 1000;
            row[4 * axis..4 * axis + 4].copy_from_slice(&step.to_le_bytes());
        }
    }
    rows
}

/// A LAS file of records, with extra bytes that are described.
pub(crate) fn las_bytes(format: u8, rows: &[u8], extra: &[PointAttribute], scale: f64) -> Vec<u8> {
    let size =
        record_bytes(format).unwrap() + extra.iter().map(|attribute| attribute.sample.size()).sum::<usize>();
    let version = Version::new(1, if format >= 6 { 4 } else { 3 });
    let count = rows.len() / size;
    let bounds = bounds_of(rows, size).unwrap_or([[0; 3]; 2]);
    let [least, most] = bounds.map(|place| place.map(|step| f64::from(step) * scale + 5.0));
    let descriptors: Vec<u8> = extra.iter().flat_map(describe_extra).collect();
    let record = raw::Vlr {
        user_id: *b"LASF_Spec\0\0\0\0\0\0\0",
        record_id: 4,
        record_length_after_header: raw::vlr::RecordLength::Vlr(descriptors.len() as u16),
        data: descriptors,
        ..raw::Vlr::default()
    };
    let records = if extra.is_empty() { 0 } else { 54 + record.data.len() as u32 };
    let mut header = raw::Header {
        version,
        header_size: version.header_size(),
        offset_to_point_data: u32::from(version.header_size()) + records,
        number_of_variable_length_records: u32::from(records > 0),
        point_data_record_format: format,
        point_data_record_length: size as u16,
        number_of_point_records: if format < 6 { count as u32 } else { 0 },
        file_source_id: 7,
        guid: [9; 16],
        ..raw::Header::default()
    };
    header.system_identifier[..4].copy_from_slice(b"scan");
    (header.x_scale_factor, header.y_scale_factor, header.z_scale_factor) = (scale, scale, scale);
    (header.x_offset, header.y_offset, header.z_offset) = (5.0, 5.0, 5.0);
    [header.min_x, header.min_y, header.min_z] = least;
    [header.max_x, header.max_y, header.max_z] = most;
    if format >= 6 {
        header.large_file = Some(raw::header::LargeFile {
            number_of_point_records: count as u64,
            number_of_points_by_return: [0; 15],
        });
    }
    let mut bytes = Vec::new();
    header.write_to(&mut bytes).unwrap();
    if records > 0 {
        record.write_to(&mut bytes).unwrap();
    }
    bytes.extend_from_slice(rows);
    bytes
}

fn tree_of(paths: &[PathBuf], folder: &Path) -> Result<PointTree> {
    let path = folder.join("p.goblin");
    let mut options = PointImportOptions::default();
    options.build.leaf_size = 100;
    let import = plan_files(paths, &mut |_| Ok(Vec::new()), &options)?;
    import.build(Output::create(&path)?, &())?;
    PointTree::open(&path, &Default::default())
}

/// The records of a file, in the order of their bytes.
fn sorted_records(path: &Path) -> Result<Vec<Vec<u8>>> {
    let mut reader = LasReader::open(path)?;
    let mut rows = Vec::new();
    while reader.read(&mut rows, 77)? > 0 {}
    let mut rows: Vec<Vec<u8>> = rows.chunks_exact(reader.schema().layout.size).map(<[u8]>::to_vec).collect();
    rows.sort();
    Ok(rows)
}

#[test]
fn records_of_all_formats_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let extra = [
        PointAttribute::new("amplitude", SampleType::F32),
        PointAttribute {
            scale_offset: Some((0.5, 3.0)),
            description: "of the echo".into(),
            ..PointAttribute::new("width", SampleType::I16)
        },
    ];
    for format in 0..=MAX_FORMAT {
        for extra in [&[][..], &extra] {
            let more = extra.iter().map(|attribute| attribute.sample.size()).sum();
            let path = folder.path().join("in.las");
            std::fs::write(&path, las_bytes(format, &records(format, more, 1500), extra, 0.01)).unwrap();
            let before = sorted_records(&path).unwrap();
            let tree = tree_of(std::slice::from_ref(&path), folder.path()).unwrap();
            assert_eq!(tree.verify(&()).unwrap(), []);
            for (name, kind) in [("out.las", PointFormat::Las), ("out.laz", PointFormat::Laz)] {
                let out = folder.path().join(name);
                let written = export_points(
                    &tree,
                    &Selection::default(),
                    None,
                    Output::create(&out).unwrap(),
                    kind,
                    &(),
                )
                .unwrap();
                assert_eq!(written, 1500);
                assert!(sorted_records(&out).unwrap() == before, "{format} {name}");
                let (found, expected) = (LasReader::open(&out).unwrap(), LasReader::open(&path).unwrap());
                let (found, expected) = (found.schema(), expected.schema());
                assert_eq!(
                    (found.scale, found.offset, found.bounds),
                    (expected.scale, expected.offset, expected.bounds)
                );
                assert_eq!(found.layout, expected.layout);
                let tag = |key: &str| found.tags.get(&format!("las.{key}")).map(String::as_str);
                assert_eq!((tag("system_identifier"), tag("file_source_id")), (Some("scan"), Some("7")));
            }
        }
    }
}

#[test]
fn headers_that_are_wrong_about_places_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let rows = records(1, 0, 300);
    let mut bytes = las_bytes(1, &rows, &[], 0.01);
    // (The greatest x.)
    bytes[179..187].copy_from_slice(&5.0f64.to_le_bytes());
    let path = folder.path().join("in.las");
    std::fs::write(&path, bytes).unwrap();
    let tree = tree_of(&[path], folder.path()).unwrap();
    assert_eq!(tree.len(), 300);
    assert_eq!(tree.verify(&()).unwrap(), []);
}

#[test]
fn several_files_have_all_attributes_on_the_finest_grid() {
    let folder = tempfile::tempdir().unwrap();
    let paths = ["a.las", "b.las"].map(|name| folder.path().join(name));
    std::fs::write(&paths[0], las_bytes(1, &records(1, 0, 40), &[], 0.01)).unwrap();
    std::fs::write(&paths[1], las_bytes(2, &records(2, 0, 60), &[], 0.02)).unwrap();
    let files = LasFiles::open(&paths).unwrap();
    // (The steps of the second are two of the first; attributes and tags differ.)
    assert!(files.remarks().iter().all(|(_, text)| !text.contains("moved")));
    let tree = tree_of(&paths, folder.path()).unwrap();
    assert_eq!((tree.len(), tree.grid().scale), (100, [0.01; 3]));
    let names: Vec<&str> = tree.attributes().iter().map(|attribute| attribute.name.as_str()).collect();
    assert!(names.contains(&"gps_time") && names.contains(&"blue"), "{names:?}");
    let place = |path: &Path| {
        let mut reader = LasReader::open(path).unwrap();
        let mut rows = Vec::new();
        reader.read(&mut rows, 1).unwrap();
        let place = crate::attribute::place_of(&rows);
        let schema = reader.schema();
        std::array::from_fn(|axis| f64::from(place[axis]) * schema.scale[axis] + schema.offset[axis])
    };
    for path in &paths {
        let nearest = tree.nearest(&[place(path)], 1, 1.0, 1 << 20, &()).unwrap();
        assert!(nearest[0][0].distance < 1e-9);
    }
}

#[test]
fn files_that_lie_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("in.las");
    std::fs::write(&path, las_bytes(3, &records(3, 0, 2000), &[], 0.01)).unwrap();
    let tree = tree_of(std::slice::from_ref(&path), folder.path()).unwrap();
    let packed = folder.path().join("in.laz");
    export_points(
        &tree,
        &Selection::default(),
        None,
        Output::create(&packed).unwrap(),
        PointFormat::Laz,
        &(),
    )
    .unwrap();
    let mut random = random(5);
    for path in [path, packed] {
        let bytes = std::fs::read(&path).unwrap();
        let start = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
        for round in 0..300 {
            let mut damaged = bytes.clone();
            match round % 4 {
                0 => damaged.truncate(random() as usize % bytes.len()),
                // Header, records of variable length, and where the table of chunks is; the table itself.
                1 | 2 => damaged[random() as usize % (start + 8)] = random() as u8,
                _ => {
                    let end = bytes.len() - 1 - random() as usize % 12;
                    damaged[end] = random() as u8;
                }
            }
            std::fs::write(&path, &damaged).unwrap();
            // Whatever comes out, it ends, and takes no more memory than there are bytes.
            if let Ok(mut reader) = LasReader::open(&path) {
                let mut rows = Vec::new();
                while reader.read(&mut rows, 1000).is_ok_and(|count| count > 0) && rows.len() < 1 << 22 {}
            }
        }
    }
}

#[test]
fn layers_are_no_longer_than_their_file() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, packed] = ["in.las", "in.laz"].map(|name| folder.path().join(name));
    for format in [6, 7, 8] {
        std::fs::write(&plain, las_bytes(format, &records(format, 3, 1500), &[], 0.01)).unwrap();
        let tree = tree_of(std::slice::from_ref(&plain), folder.path()).unwrap();
        let output = Output::create(&packed).unwrap();
        export_points(&tree, &Selection::default(), None, output, PointFormat::Laz, &()).unwrap();
        let good = std::fs::read(&packed).unwrap();
        let start = u32::from_le_bytes(good[96..100].try_into().unwrap()) as usize;
        let size = usize::from(u16::from_le_bytes(good[105..107].try_into().unwrap()));
        // The bytes of the first layer, of the last one, and more points than there are chunks for.
        let last = start + 8 + size + 4 + 4 * (9 - 1);
        for (at, words) in [(start + 8 + size + 4, "layers of"), (last, "layers of"), (249, "no chunk for")] {
            let mut bytes = good.clone();
            bytes[at..at + 4].fill(0xff);
            std::fs::write(&packed, &bytes).unwrap();
            let error = tree_of(std::slice::from_ref(&packed), folder.path()).err().unwrap().to_string();
            assert!(error.contains(words), "{format}, {at}: {error}");
        }
    }
}
