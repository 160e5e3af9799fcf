use std::path::Path;

use crate::attribute::{PointAttribute, ordered, to_f64};
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

/// Attributes, points (positions and attribute numbers), remarks.
type Found = (Vec<PointAttribute>, Vec<([f64; 3], Vec<i64>)>, Vec<String>);

/// Reads a file with these bytes, twice.
fn read(name: &str, bytes: &[u8]) -> Result<Found> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    assert!(super::is_point_table(&path));
    let mut table = super::open(&path)?;
    let attributes = table.points.attributes().to_vec();
    let mut all = || -> Result<Vec<_>> {
        let mut numbers = vec![0; attributes.len()];
        let mut found = Vec::new();
        while let Some(position) = table.points.next(&mut numbers)? {
            found.push((position, numbers.clone()));
        }
        table.points.rewind()?;
        Ok(found)
    };
    let found = all()?;
    assert_eq!(all()?, found);
    Ok((attributes, found, table.remarks))
}

fn names(attributes: &[PointAttribute]) -> Vec<(&str, SampleType)> {
    attributes.iter().map(|attribute| (attribute.name.as_str(), attribute.sample)).collect()
}

fn npy(dictionary: &str, body: &[u8]) -> Vec<u8> {
    let length = (dictionary.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], dictionary.as_bytes(), body].concat()
}

const TEXT: &str = "ply\nformat ascii 1.0\ncomment scan\nelement marker 2\nproperty list uchar int ids\n\
    element vertex 2\nproperty float x\nproperty float y\nproperty list uchar float w\nproperty double Z\n\
    property uchar red\nproperty float quality\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
    3 7 8 9\n0\n1.5 -2 2 0.5 0.5 1e3 255 0.25\n0 0 0 -1e-3 0 -1\n3 0 1 1\n";

#[test]
fn vertices_of_ply_are_points() {
    let (attributes, points, remarks) = read("a.ply", TEXT.as_bytes()).unwrap();
    assert_eq!(names(&attributes), [("red", SampleType::U8), ("quality", SampleType::F32)]);
    let quality = |number: f32| ordered(SampleType::F32, &number.to_le_bytes());
    let expected =
        [([1.5, -2.0, 1e3], vec![255, quality(0.25)]), ([0.0, 0.0, -1e-3], vec![0, quality(-1.0)])];
    assert_eq!(points, expected);
    assert!(remarks[0].contains("2 marker, 1 face") && remarks[1].contains(": w"), "{remarks:?}");
    // Binary, in both byte orders.
    for is_big in [false, true] {
        let order = if is_big { "big" } else { "little" };
        let mut bytes = format!(
            "ply\nformat binary_{order}_endian 1.0\nelement vertex 2\nproperty double x\nproperty double y\n\
             property short class\nend_header\n"
        )
        .into_bytes();
        for (position, class) in [([0.5, 3.0], -2i16), ([1e9, -1.0], 300)] {
            for number in position {
                bytes.extend(if is_big { f64::to_be_bytes(number) } else { f64::to_le_bytes(number) });
            }
            bytes.extend(if is_big { class.to_be_bytes() } else { class.to_le_bytes() });
        }
        let (attributes, points, remarks) = read("b.ply", &bytes).unwrap();
        assert_eq!(names(&attributes), [("class", SampleType::I16)]);
        assert_eq!(points, [([0.5, 3.0, 0.0], vec![-2]), ([1e9, -1.0, 0.0], vec![300])]);
        assert!(remarks.is_empty());
        assert!(matches!(read("b.ply", &bytes[..bytes.len() - 1]), Err(Error::Corrupt { .. })));
    }
}

#[test]
fn records_and_rows_of_numpy_are_points() {
    let dictionary = "{'descr': [('t', '>f8'), ('x', '<f4'), ('', '|V4'), ('y', '<i8'), ('z', '>i2'), ('ok', '|b1')], \
        'fortran_order': False, 'shape': (2,), }\n";
    let record = |t: f64, x: f32, y: i64, z: i16, ok: u8| {
        let parts: [&[u8]; 6] =
            [&t.to_be_bytes(), &x.to_le_bytes(), &[9; 4], &y.to_le_bytes(), &z.to_be_bytes(), &[ok]];
        parts.concat()
    };
    let body = [record(-0.5, 1.25, -7, 300, 1), record(1e300, 0.0, 1 << 40, -1, 0)].concat();
    let (attributes, points, _) = read("a.npy", &npy(dictionary, &body)).unwrap();
    assert_eq!(names(&attributes), [("t", SampleType::F64), ("ok", SampleType::U8)]);
    assert_eq!(
        points.iter().map(|(position, _)| *position).collect::<Vec<_>>(),
        [[1.25, -7.0, 300.0], [0.0, (1u64 << 40) as f64, -1.0]]
    );
    let times: Vec<f64> = points.iter().map(|(_, numbers)| to_f64(SampleType::F64, numbers[0])).collect();
    assert_eq!((times, points[0].1[1], points[1].1[1]), (vec![-0.5, 1e300], 1, 0));
    // Arrays of rows.
    let rows = |width: usize| {
        npy(
            &format!("{{'descr': '<f8', 'fortran_order': False, 'shape': (2, {width}), }}"),
            &vec![0; 16 * width],
        )
    };
    for (width, expected) in [(2, vec![]), (3, vec![]), (5, vec!["column_3", "column_4"])] {
        let (attributes, points, _) = read("a.npy", &rows(width)).unwrap();
        assert_eq!(names(&attributes).iter().map(|(name, _)| *name).collect::<Vec<_>>(), expected);
        assert_eq!(points.len(), 2);
    }
}

#[test]
fn other_tables_are_refused() {
    let array = |descr: &str, order: &str, shape: &str, length: usize| {
        npy(&format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}}}"), &vec![0; length])
    };
    for (bytes, words) in [
        (array("'<f8'", "True", "(2, 3)", 48), "Fortran"),
        (array("'<f8'", "False", "(6,)", 48), "shape (6)"),
        (array("'<f2'", "False", "(2, 3)", 12), "<f2"),
        (array("'<f8'", "False", "(2, 3)", 47), "file size"),
        (array("'<f8'", "False", "(18446744073709551615, 3)", 48), "bytes"),
        (array("'<f8'", "False", "(2, 1000000000)", 48), "shape"),
        (array("[('x', '<f8'), ('z', '<f8')]", "False", "(1,)", 16), "x and y"),
        (
            array("[('x', '<f8'), ('y', '<f8'), ('a', '|u1'), ('a', '|u1')]", "False", "(1,)", 18),
            "two columns",
        ),
        (array("[('x', '<f8'), ('y', '<f8'), ('', '|V99999999999999999999')]", "False", "(1,)", 16), "|V999"),
        (array("[('x', '<f8'), ('y', '<f8'), ('', '|V18446744073709551615')]", "False", "(1,)", 16), "bytes"),
    ] {
        let error = read("a.npy", &bytes).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
    for (from, to, words) in [
        ("255 0.25", "256 0.25", "256"),
        ("1.5 -2", "x -2", "x"),
        ("vertex 2", "vertex 99999999999", "99999999999"),
        ("property float y", "property float v", "x and y"),
        ("element vertex", "element vertices", "no `element vertex`"),
    ] {
        let error = read("a.ply", TEXT.replace(from, to).as_bytes()).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
    // Any byte at any offset is either read or rejected.
    for at in 0..TEXT.len() {
        for byte in [b' ', b'9', 0xff] {
            let mut bytes = TEXT.as_bytes().to_vec();
            bytes[at] = byte;
            if bytes.starts_with(b"ply\n") {
                let _ = read("a.ply", &bytes);
            }
        }
    }
    assert!(!super::is_point_table(Path::new("a.las")) && super::is_point_table(Path::new("a.PLY")));
}

#[test]
fn points_without_coordinates_are_skipped_and_counted() {
    use crate::source::{GriddedPoints, PointSource as _};
    let head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        property float q\nend_header\n";
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.ply");
    let open = |body: &str| {
        std::fs::write(&path, format!("{head}{body}")).unwrap();
        GriddedPoints::new(super::open(&path).unwrap().points)
    };
    let mut points = open("0 0 0 1\n1 nan 1 2\n2 2 2 -nan(ind)\n3 3 -inf 4\n").unwrap();
    assert_eq!((points.schema().count, points.skipped()), (Some(2), 2));
    assert!(points.remarks()[0].starts_with("2 points"), "{:?}", points.remarks());
    let mut rows = Vec::new();
    assert_eq!((points.read(&mut rows, 1).unwrap(), points.read(&mut rows, 9).unwrap()), (1, 1));
    assert_eq!(points.read(&mut rows, 9).unwrap(), 0);
    let positions: Vec<[i32; 3]> = rows.chunks_exact(16).map(crate::attribute::position_of).collect();
    assert_eq!(positions, [[0; 3], [2; 3]]);
    let numbers = points.schema().layout.numbers(0, rows.chunks_exact(16));
    assert!(to_f64(SampleType::F32, numbers[1]).is_nan() && to_f64(SampleType::F32, numbers[0]) == 1.0);
    let error = open("nan 0 0 1\n".repeat(4).as_str()).err().unwrap().to_string();
    assert!(error.contains("4 points"), "{error}");
}
