//! Helpers for tests of mesh readers: files from strings, a reader's whole output, a cube.

use std::path::{Path, PathBuf};

use spinney::raw::import::mesh::{MeshFace, Model, ModelInfo, open};
use spinney::{Error, Result};

/// A sufficient memory limit in bytes.
pub(crate) const ENOUGH: u64 = 64 << 20;

/// A face that outlives its reader's buffers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OwnedFace {
    pub(crate) points: Vec<[f64; 3]>,
    pub(crate) ring_ends: Vec<usize>,
    pub(crate) colours: Vec<[u8; 3]>,
    pub(crate) part: u32,
}

impl OwnedFace {
    fn of(face: &MeshFace<'_>) -> OwnedFace {
        OwnedFace {
            points: face.points.to_vec(),
            ring_ends: face.ring_ends.to_vec(),
            colours: face.colours.to_vec(),
            part: face.part,
        }
    }
}

/// Returns all faces of a model, after checking the invariants of faces.
pub(crate) fn faces(model: &mut dyn Model) -> Result<Vec<OwnedFace>> {
    let info = model.info().clone();
    let mut faces = Vec::new();
    model.faces(&mut |face| {
        check(&info, face);
        faces.push(OwnedFace::of(face));
        Ok(())
    })?;
    Ok(faces)
}

fn check(info: &ModelInfo, face: &MeshFace<'_>) {
    assert!(face.ring_ends.is_sorted() && face.ring_ends[0] >= 3, "{face:?}");
    assert_eq!(face.ring_ends.last(), Some(&face.points.len()));
    assert!((face.part as usize) < info.parts.len(), "{face:?}");
    assert_eq!(face.colours.len(), if info.is_coloured { face.points.len() } else { 0 }, "{face:?}");
    for point in face.points {
        for axis in 0..3 {
            let (least, most) = (info.bounds[0][axis], info.bounds[1][axis]);
            assert!((least..=most).contains(&point[axis]), "{point:?} in {:?}", info.bounds);
        }
    }
}

/// A temporary directory of test files.
pub(crate) struct Files(tempfile::TempDir);

impl Files {
    pub(crate) fn new() -> Files {
        Files(tempfile::tempdir().unwrap())
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    }

    pub(crate) fn open(&self, name: &str, content: impl AsRef<[u8]>) -> Result<Box<dyn Model>> {
        open(&self.write(name, content), ENOUGH)
    }

    pub(crate) fn faces(&self, name: &str, content: impl AsRef<[u8]>) -> Result<Vec<OwnedFace>> {
        let mut model = self.open(name, content)?;
        let first = faces(&mut *model)?;
        assert_eq!(faces(&mut *model)?, first, "{name} read again");
        Ok(first)
    }

    /// Returns the error for a file, which must contain the file's name.
    pub(crate) fn error(&self, name: &str, content: impl AsRef<[u8]>) -> String {
        match self.faces(name, content) {
            Ok(faces) => panic!("{name} was read: {} faces", faces.len()),
            Err(error @ (Error::Corrupt { .. } | Error::Unsupported { .. } | Error::TooLarge { .. })) => {
                let text = error.to_string();
                assert!(text.contains(name), "{text}");
                assert!(text.len() < 1000, "{text}");
                text
            }
            Err(error) => panic!("{name}: {error}"),
        }
    }
}

/// Corners of a cube from 0 to 2, numbered by their bits (x is bit 0).
pub(crate) fn cube_points() -> Vec<[f64; 3]> {
    (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| f64::from(bit * 2))).collect()
}

/// The cube's sides, counterclockwise from outside.
pub(crate) const CUBE: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// The cube as its readers should return it.
pub(crate) fn cube() -> Vec<OwnedFace> {
    let points = cube_points();
    CUBE.iter()
        .map(|side| OwnedFace {
            points: side.iter().map(|i| points[*i]).collect(),
            ring_ends: vec![4],
            colours: Vec::new(),
            part: 0,
        })
        .collect()
}

/// Volume and area of the fans of all faces; valid for faces without holes.
pub(crate) fn volume_and_area(faces: &[OwnedFace]) -> [f64; 2] {
    let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let mut sums = [0.0; 2];
    for face in faces {
        for pair in face.points[1..].windows(2) {
            let normal = cross(sub(pair[0], face.points[0]), sub(pair[1], face.points[0]));
            // The flux along x, as in the table of expected figures. It is the same along every
            // axis only for closed and consistently oriented surfaces.
            sums[0] += (face.points[0][0] + pair[0][0] + pair[1][0]) * normal[0] / 6.0;
            sums[1] += normal.iter().map(|n| n * n).sum::<f64>().sqrt() / 2.0;
        }
    }
    sums
}

/// Returns the directory of meshes outside of the project, if it exists.
pub(crate) fn meshes() -> Option<PathBuf> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/mesh");
    if directory.is_dir() {
        return Some(directory);
    }
    eprintln!("skipped: {} is not there", directory.display());
    None
}

/// Opens and reads every prefix of a file: errors are allowed, panics and endless loops are not.
/// Returns how many were read without an error.
pub(crate) fn read_truncated(name: &str, content: &[u8]) -> usize {
    let files = Files::new();
    let mut read = 0;
    for length in 0..content.len() {
        match files.faces(name, &content[..length]) {
            Ok(_) => read += 1,
            Err(Error::Io { path, doing, cause }) => panic!("{}: {doing}: {cause}", path.display()),
            Err(_) => {}
        }
    }
    read
}
