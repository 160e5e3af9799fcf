//! Tests of LAS and LAZ import and export.

use std::path::{Path, PathBuf};

use las::{Version, raw};

use super::format::{MAX_FORMAT, describe_extra, record_bytes};
use super::{LasFiles, LasReader};
use crate::attribute::PointAttribute;
use crate::export::{PointFormat, export_points};
use crate::import::{PointImportOptions, plan_files};
use crate::query::{PointCondition, Relation, Selection};
use crate::source::{PointSource, bounds_of};
use crate::store::PointTree;
use crate::tests::random;
use spinney_base::Result;
use spinney_base::io::Output;
use spinney_base::value::SampleType;

/// Returns records of a format with random bytes, at nearby positions.
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

/// Returns a LAS file of records with described extra bytes.
pub(crate) fn las_bytes(format: u8, rows: &[u8], extra: &[PointAttribute], scale: f64) -> Vec<u8> {
    let size =
        record_bytes(format).unwrap() + extra.iter().map(|attribute| attribute.sample.size()).sum::<usize>();
    let version = Version::new(1, if format >= 6 { 4 } else { 3 });
    let count = rows.len() / size;
    let bounds = bounds_of(rows, size).unwrap_or([[0; 3]; 2]);
    let [least, most] = bounds.map(|position| position.map(|step| f64::from(step) * scale + 5.0));
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

fn tree_of(paths: &[PathBuf], directory: &Path) -> Result<PointTree> {
    let path = directory.join("p.goblin");
    let mut options = PointImportOptions::default();
    options.build.leaf_size = 100;
    let import = plan_files(paths, &mut |_| Ok(Vec::new()), &options)?;
    import.build(Output::create(&path)?, &())?;
    PointTree::open(&path, &Default::default())
}

/// Returns the records of a file, sorted as bytes.
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
    let directory = tempfile::tempdir().unwrap();
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
            let path = directory.path().join("in.las");
            std::fs::write(&path, las_bytes(format, &records(format, more, 1500), extra, 0.01)).unwrap();
            let before = sorted_records(&path).unwrap();
            let tree = tree_of(std::slice::from_ref(&path), directory.path()).unwrap();
            assert_eq!(tree.verify(&()).unwrap(), []);
            for (name, kind) in [("out.las", PointFormat::Las), ("out.laz", PointFormat::Laz)] {
                let out = directory.path().join(name);
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
fn headers_with_wrong_bounds_are_tolerated() {
    let directory = tempfile::tempdir().unwrap();
    let rows = records(1, 0, 300);
    let mut bytes = las_bytes(1, &rows, &[], 0.01);
    // The maximum of x.
    bytes[179..187].copy_from_slice(&5.0f64.to_le_bytes());
    let path = directory.path().join("in.las");
    std::fs::write(&path, bytes).unwrap();
    let tree = tree_of(&[path], directory.path()).unwrap();
    assert_eq!(tree.len(), 300);
    assert_eq!(tree.verify(&()).unwrap(), []);
}

#[test]
fn several_files_have_all_attributes_on_the_finest_grid() {
    let directory = tempfile::tempdir().unwrap();
    let paths = ["a.las", "b.las"].map(|name| directory.path().join(name));
    std::fs::write(&paths[0], las_bytes(1, &records(1, 0, 40), &[], 0.01)).unwrap();
    std::fs::write(&paths[1], las_bytes(2, &records(2, 0, 60), &[], 0.02)).unwrap();
    let files = LasFiles::open(&paths, None).unwrap();
    // The grid unit of the second file is twice that of the first; attributes and tags differ.
    assert!(files.remarks().iter().all(|(_, text)| !text.contains("moved")));
    let tree = tree_of(&paths, directory.path()).unwrap();
    assert_eq!((tree.len(), tree.grid().scale), (100, [0.01; 3]));
    let names: Vec<&str> = tree.attributes().iter().map(|attribute| attribute.name.as_str()).collect();
    assert!(names.contains(&"gps_time") && names.contains(&"blue"), "{names:?}");
    let position = |path: &Path| {
        let mut reader = LasReader::open(path).unwrap();
        let mut rows = Vec::new();
        reader.read(&mut rows, 1).unwrap();
        let position = crate::attribute::position_of(&rows);
        let schema = reader.schema();
        std::array::from_fn(|axis| f64::from(position[axis]) * schema.scale[axis] + schema.offset[axis])
    };
    for path in &paths {
        let nearest = tree.nearest(&[position(path)], 1, 1.0, 1 << 20, &()).unwrap();
        assert!(nearest[0][0].distance < 1e-9);
    }
}

#[test]
fn corrupt_files_are_errors_or_end() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("in.las");
    std::fs::write(&path, las_bytes(3, &records(3, 0, 2000), &[], 0.01)).unwrap();
    let tree = tree_of(std::slice::from_ref(&path), directory.path()).unwrap();
    let packed = directory.path().join("in.laz");
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
            let mut corrupted = bytes.clone();
            match round % 4 {
                0 => corrupted.truncate(random() as usize % bytes.len()),
                // The header, variable-length records and the offset of the chunk table; otherwise
                // the table itself.
                1 | 2 => corrupted[random() as usize % (start + 8)] = random() as u8,
                _ => {
                    let end = bytes.len() - 1 - random() as usize % 12;
                    corrupted[end] = random() as u8;
                }
            }
            std::fs::write(&path, &corrupted).unwrap();
            // Whatever the outcome, reading ends, and takes no more memory than the file has bytes.
            if let Ok(mut reader) = LasReader::open(&path) {
                let mut rows = Vec::new();
                while reader.read(&mut rows, 1000).is_ok_and(|count| count > 0) && rows.len() < 1 << 22 {}
            }
        }
    }
}

#[test]
fn layers_beyond_the_end_of_the_file_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let [plain, packed] = ["in.las", "in.laz"].map(|name| directory.path().join(name));
    for format in [6, 7, 8] {
        std::fs::write(&plain, las_bytes(format, &records(format, 3, 1500), &[], 0.01)).unwrap();
        let tree = tree_of(std::slice::from_ref(&plain), directory.path()).unwrap();
        let output = Output::create(&packed).unwrap();
        export_points(&tree, &Selection::default(), None, output, PointFormat::Laz, &()).unwrap();
        let good = std::fs::read(&packed).unwrap();
        let start = u32::from_le_bytes(good[96..100].try_into().unwrap()) as usize;
        let size = usize::from(u16::from_le_bytes(good[105..107].try_into().unwrap()));
        // The size of the first layer, of the last one, and more points than the chunks contain.
        let last = start + 8 + size + 4 + 4 * (9 - 1);
        for (at, words) in [(start + 8 + size + 4, "layers of"), (last, "layers of"), (249, "no chunk for")] {
            let mut bytes = good.clone();
            bytes[at..at + 4].fill(0xff);
            std::fs::write(&packed, &bytes).unwrap();
            let error = tree_of(std::slice::from_ref(&packed), directory.path()).err().unwrap().to_string();
            assert!(error.contains(words), "{format}, {at}: {error}");
        }
    }
}

/// Writes all points of a tree.
fn written(tree: &PointTree, path: &Path, format: PointFormat) {
    export_points(tree, &Selection::default(), None, Output::create(path).unwrap(), format, &()).unwrap();
}

/// Returns the numbers of an attribute, sorted.
fn numbers(path: &Path, name: &str) -> Vec<i64> {
    let mut reader = LasReader::open(path).unwrap();
    let mut rows = Vec::new();
    while reader.read(&mut rows, 1000).unwrap() > 0 {}
    let layout = &reader.schema().layout;
    let attribute = layout.position(name).unwrap_or_else(|| panic!("no {name} in {:?}", layout.attributes));
    let mut numbers = layout.numbers(attribute, rows.chunks_exact(layout.size));
    numbers.sort_unstable();
    numbers
}

#[test]
fn scan_angles_of_old_and_new_formats_are_joined() {
    let directory = tempfile::tempdir().unwrap();
    let [old, new, out] = ["old.las", "new.las", "out.las"].map(|name| directory.path().join(name));
    let (mut a, mut b) = (records(1, 0, 2), records(6, 0, 2));
    a.chunks_exact_mut(28).zip([-90i8, 30]).for_each(|(row, rank)| row[16] = rank as u8);
    b.chunks_exact_mut(30)
        .zip([15_000i16, -7])
        .for_each(|(row, angle)| row[18..20].copy_from_slice(&angle.to_le_bytes()));
    std::fs::write(&old, las_bytes(1, &a, &[], 0.01)).unwrap();
    std::fs::write(&new, las_bytes(6, &b, &[], 0.01)).unwrap();
    for paths in [[old.clone(), new.clone()], [new.clone(), old.clone()]] {
        let files = LasFiles::open(&paths, None).unwrap();
        assert!(files.remarks().iter().any(|(path, text)| *path == old && text.contains("scan_angle")));
        let tree = tree_of(&paths, directory.path()).unwrap();
        assert!(tree.attributes().iter().all(|attribute| attribute.name != "scan_angle_rank"));
        written(&tree, &out, PointFormat::Las);
        assert_eq!(numbers(&out, "scan_angle"), [-15_000, -7, 5_000, 15_000]);
    }
    // Old formats alone stay unchanged.
    let tree = tree_of(std::slice::from_ref(&old), directory.path()).unwrap();
    written(&tree, &out, PointFormat::Las);
    assert_eq!(numbers(&out, "scan_angle_rank"), [-90, 30]);
}

#[test]
fn extra_dimensions_named_like_others_are_kept() {
    let directory = tempfile::tempdir().unwrap();
    let [path, out] = ["in.las", "out.las"].map(|name| directory.path().join(name));
    let extra =
        ["intensity", "x", "intensity", "other"].map(|name| PointAttribute::new(name, SampleType::U16));
    let mut rows = records(0, 8, 3);
    for (number, row) in rows.chunks_exact_mut(28).enumerate() {
        let put = |row: &mut [u8], at: usize, number: usize| {
            row[at..at + 2].copy_from_slice(&(number as u16).to_le_bytes());
        };
        put(row, 12, 100 + number);
        (0..4).for_each(|extra| put(row, 20 + 2 * extra, 1000 * (extra + 1) + number));
    }
    std::fs::write(&path, las_bytes(0, &rows, &extra, 0.01)).unwrap();
    let remarks = LasFiles::open(std::slice::from_ref(&path), None).unwrap().remarks();
    assert_eq!(remarks.len(), 3, "{remarks:?}");
    let tree = tree_of(std::slice::from_ref(&path), directory.path()).unwrap();
    written(&tree, &out, PointFormat::Las);
    for path in [path, out] {
        for (name, first) in [
            ("intensity", 100),
            ("extra_intensity", 1000),
            ("extra_x", 2000),
            ("extra_intensity_2", 3000),
            ("other", 4000),
        ] {
            assert_eq!(numbers(&path, name), [first, first + 1, first + 2], "{name}");
        }
    }
}

#[test]
fn no_data_of_extra_bytes_is_no_value() {
    let directory = tempfile::tempdir().unwrap();
    let [path, out, csv] = ["in.las", "out.laz", "out.csv"].map(|name| directory.path().join(name));
    for sample in [SampleType::I16, SampleType::U8, SampleType::F32, SampleType::F64, SampleType::U64] {
        for scale_offset in [None, Some((0.5, 1.0))] {
            let of = |number: u8| match sample {
                SampleType::F32 => f32::from(number).to_le_bytes().to_vec(),
                SampleType::F64 => f64::from(number).to_le_bytes().to_vec(),
                _ => [vec![number], vec![0; sample.size() - 1]].concat(),
            };
            let no_data = Some(crate::attribute::ordered(sample, &of(99)));
            let extra = PointAttribute { no_data, scale_offset, ..PointAttribute::new("height", sample) };
            let mut rows = records(6, sample.size(), 4);
            for (row, number) in rows.chunks_exact_mut(30 + sample.size()).zip([8, 99, 12, 99]) {
                row[30..].copy_from_slice(&of(number));
            }
            std::fs::write(&path, las_bytes(6, &rows, std::slice::from_ref(&extra), 0.01)).unwrap();
            let tree = tree_of(std::slice::from_ref(&path), directory.path()).unwrap();
            assert_eq!(tree.verify(&()).unwrap(), []);
            let index = tree.attributes().len() - 1;
            assert_eq!(tree.attributes()[index], extra);
            let found = tree.statistics(&Selection::default(), &()).unwrap().columns[3 + index].unwrap();
            let (scale, offset) = scale_offset.unwrap_or((1.0, 0.0));
            let expected = [8.0, 12.0, 10.0].map(|number| number * scale + offset);
            assert_eq!((found.count, [found.min, found.max, found.mean]), (2, expected), "{sample:?}");
            for (relation, count) in [(Relation::Greater, 2), (Relation::Unequal, 2)] {
                let condition = PointCondition { attribute: index, relation, number: -1.0 };
                let selection = Selection { conditions: vec![condition], ..Selection::default() };
                assert_eq!(tree.count(&selection, &()).unwrap(), count);
            }
            written(&tree, &out, PointFormat::Laz);
            assert_eq!(LasReader::open(&out).unwrap().schema().layout.attributes.last(), Some(&extra));
            assert!(sorted_records(&out).unwrap() == sorted_records(&path).unwrap());
            written(&tree, &csv, PointFormat::Csv);
            let lines = std::fs::read_to_string(&csv).unwrap();
            assert_eq!(lines.lines().filter(|line| line.ends_with(',')).count(), 2, "{lines}");
        }
    }
}

#[test]
fn colours_of_8_bits_have_16_in_las() {
    let directory = tempfile::tempdir().unwrap();
    let [path, out] = ["in.ply", "out.las"].map(|name| directory.path().join(name));
    for (kind, expected) in [("uchar", [0, 16_448, 65_535]), ("ushort", [0, 64, 255])] {
        let header =
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
        let colours = ["red", "green", "blue"].map(|name| format!("property {kind} {name}\n")).concat();
        let rows = "0 0 0 0 64 255 -90\n1 1 1 64 255 0 0\n2 2 2 255 0 64 30\n";
        let angle = "property char scan_angle_rank\n";
        std::fs::write(&path, format!("{header}{colours}{angle}end_header\n{rows}")).unwrap();
        let tree = tree_of(std::slice::from_ref(&path), directory.path()).unwrap();
        written(&tree, &out, PointFormat::Las);
        for name in ["red", "green", "blue"] {
            assert_eq!(numbers(&out, name), expected, "{kind} {name}");
        }
        assert_eq!(numbers(&out, "scan_angle"), [-15_000, 0, 5_000]);
        // The WKT bit, which readers expect in formats 6 and above, even without a coordinate
        // system.
        let bytes = std::fs::read(&out).unwrap();
        assert!(bytes[104] >= 6 && bytes[6] & 0x10 != 0, "format {}", bytes[104]);
    }
}

#[test]
fn points_packed_without_chunks_are_read() {
    use laz::record::{RecordCompressor as _, SequentialPointRecordCompressor};
    let directory = tempfile::tempdir().unwrap();
    let [plain, packed] = ["in.las", "in.laz"].map(|name| directory.path().join(name));
    for format in [0, 1, 3] {
        let rows = records(format, 0, 500);
        let size = record_bytes(format).unwrap();
        let bytes = las_bytes(format, &rows, &[], 0.01);
        std::fs::write(&plain, &bytes).unwrap();
        let items = laz::LazItemRecordBuilder::default_for_point_format_id(format, 0).unwrap();
        let mut compressor = SequentialPointRecordCompressor::new(std::io::Cursor::new(Vec::new()));
        compressor.set_fields_from(&items).unwrap();
        rows.chunks_exact(size).for_each(|row| compressor.compress_next(row).unwrap());
        compressor.done().unwrap();
        let mut record = Vec::new();
        laz::LazVlr::from_laz_items(items).write_to(&mut record).unwrap();
        record[..2].copy_from_slice(&1u16.to_le_bytes());
        let vlr = raw::Vlr {
            user_id: *b"laszip encoded\0\0",
            record_id: 22204,
            record_length_after_header: raw::vlr::RecordLength::Vlr(record.len() as u16),
            data: record,
            ..raw::Vlr::default()
        };
        let start = u32::from_le_bytes(bytes[96..100].try_into().unwrap());
        let mut made = bytes[..start as usize].to_vec();
        made[96..100].copy_from_slice(&(start + 54 + vlr.data.len() as u32).to_le_bytes());
        made[100..104].copy_from_slice(&1u32.to_le_bytes());
        made[104] |= 0x80;
        vlr.write_to(&mut made).unwrap();
        made.extend(compressor.into_inner().into_inner());
        std::fs::write(&packed, &made).unwrap();
        assert!(sorted_records(&packed).unwrap() == sorted_records(&plain).unwrap(), "{format}");
        for end in [made.len() / 2, made.len() - 40] {
            std::fs::write(&packed, &made[..end]).unwrap();
            assert!(sorted_records(&packed).is_err());
        }
    }
}
