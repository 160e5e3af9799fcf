//! Exact models built from meshes in memory through the C interface, and their sections.
#![allow(clippy::undocumented_unsafe_blocks)] // the tests check these very rules

use std::ffi::{CStr, CString, c_char};
use std::path::{Path, PathBuf};
use std::ptr::{null, null_mut};

use engine::ExactModel;
use engine::brep::{CuttingPlane, FaceBuffer, Faces, MassProperties};
use tempfile::TempDir;

use crate::tests::open_model;
use crate::*;
use spinney_status::{SPINNEY_INVALID, SPINNEY_OK};

const NO_RING: spinney_ring = spinney_ring { polygon: 9, end: 9, area: 9.0 };

/// Vertices of a box from the origin. x changes fastest.
fn corners_of(size: [f64; 3]) -> Vec<[f64; 3]> {
    (0..8)
        .map(|corner| [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { size[axis] } else { 0.0 }))
        .collect()
}

/// Sides of a box.
const SIDES: [[u32; 4]; 6] =
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

/// Returns the sides as triangles.
fn triangles() -> Vec<u32> {
    SIDES.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]).collect()
}

/// Returns the struct that describes a mesh's arrays.
fn mesh_of(vertices: &[[f64; 3]], corners: &[u32]) -> spinney_mesh {
    let mut mesh: spinney_mesh = unsafe { std::mem::zeroed() };
    (mesh.vertices, mesh.vertex_count) = (vertices.as_ptr().cast(), vertices.len());
    (mesh.corners, mesh.corner_count, mesh.corner_size) = (corners.as_ptr().cast(), corners.len(), 4);
    mesh
}

fn usual() -> spinney_mesh_options {
    unsafe { std::mem::zeroed() }
}

/// A directory for one output file.
struct OutputFile {
    _directory: TempDir,
    path: PathBuf,
    name: CString,
}

impl OutputFile {
    fn new() -> OutputFile {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("made.goblin");
        let name = CString::new(path.to_str().unwrap()).unwrap();
        OutputFile { _directory: directory, path, name }
    }

    fn build(
        &self,
        meshes: &[spinney_mesh],
        options: &spinney_mesh_options,
    ) -> Result<spinney_mesh_report, String> {
        let mut report = unsafe { std::mem::zeroed() };
        let (mesh_size, options_size) = (size_of::<spinney_mesh>(), size_of::<spinney_mesh_options>());
        let done = unsafe {
            let (first, count, path) = (meshes.as_ptr(), meshes.len(), self.name.as_ptr());
            let report_size = size_of::<spinney_mesh_report>();
            spinney_model_build(
                first,
                count,
                mesh_size,
                options,
                options_size,
                path,
                &mut report,
                report_size,
            )
        };
        match done {
            SPINNEY_OK => Ok(report),
            other => {
                assert_eq!(other, SPINNEY_INVALID);
                Err(unsafe { CStr::from_ptr(spinney_error()) }.to_str().unwrap().into())
            }
        }
    }

    fn is_empty(&self) -> bool {
        self.path.parent().unwrap().read_dir().unwrap().next().is_none()
    }
}

fn library(path: &Path) -> ExactModel {
    ExactModel::open(path, &Default::default()).unwrap()
}

fn volume(path: &Path) -> f64 {
    MassProperties::of(&library(path), &()).unwrap().volume
}

#[test]
fn boxes_have_their_volumes() {
    let (output, vertices, corners) = (OutputFile::new(), corners_of([2.0, 3.0, 4.0]), triangles());
    let mesh = mesh_of(&vertices, &corners);
    let report = output.build(&[mesh], &usual()).unwrap();
    assert_eq!((report.read, report.faces, report.displacement), (12, 12, 0.0));
    assert_eq!(volume(&output.path), 24.0);
    let made = library(&output.path);
    assert_eq!((made.parts(), made.metadata().provenance.len()), (&["mesh".to_owned()][..], 1));
    // 64-bit indices, polygons, and options.
    let wide: Vec<u64> = corners.iter().map(|corner| (*corner).into()).collect();
    let mut wide_mesh = spinney_mesh { corners: wide.as_ptr().cast(), corner_size: 8, ..mesh };
    let name = CString::new("a box").unwrap();
    wide_mesh.name = name.as_ptr();
    let [unit, crs] = ["mm", "EPSG:25832"].map(|text| CString::new(text).unwrap());
    let options = spinney_mesh_options { snap: 0.5, unit: unit.as_ptr(), crs: crs.as_ptr(), ..usual() };
    assert_eq!(output.build(&[wide_mesh], &options).unwrap().step, 0.5);
    let made = library(&output.path);
    assert_eq!((volume(&output.path), made.parts()), (24.0, &["a box".to_owned()][..]));
    assert!(made.crs().is_some());
    let ends: Vec<u64> = (1..=6).map(|side| 4 * side).collect();
    let mut sides = mesh_of(&vertices, SIDES.as_flattened());
    (sides.ring_ends, sides.ring_count) = (ends.as_ptr(), ends.len());
    assert_eq!(output.build(&[sides], &usual()).unwrap().faces, 6);
    assert_eq!(volume(&output.path), 24.0);
}

/// A block of 8 x 8 x 4 with a tunnel of 2 x 2 along z, whose ends are holes.
fn frame() -> (Vec<[f64; 3]>, Vec<u32>, Vec<u64>, Vec<u64>) {
    let mut vertices = corners_of([8.0, 8.0, 4.0]);
    vertices.extend(corners_of([2.0, 2.0, 4.0]).iter().map(|[x, y, z]| [x + 3.0, y + 3.0, *z]));
    let inner = |side: [u32; 4]| side.map(|corner| corner + 8);
    let back = |[a, b, c, d]: [u32; 4]| [d, c, b, a];
    let mut rings = vec![SIDES[0], back(inner(SIDES[0])), SIDES[1], back(inner(SIDES[1]))];
    rings.extend_from_slice(&SIDES[2..]);
    rings.extend(SIDES[2..].iter().map(|side| back(inner(*side))));
    let ring_ends = (1..=12).map(|ring| 4 * ring).collect();
    (vertices, rings.as_flattened().to_vec(), ring_ends, vec![2, 4, 5, 6, 7, 8, 9, 10, 11, 12])
}

#[test]
fn sections_are_those_of_the_library() {
    let output = OutputFile::new();
    let (vertices, corners, ring_ends, face_ends) = frame();
    let mut mesh = mesh_of(&vertices, &corners);
    (mesh.ring_ends, mesh.ring_count) = (ring_ends.as_ptr(), ring_ends.len());
    (mesh.face_ends, mesh.face_count) = (face_ends.as_ptr(), face_ends.len());
    assert_eq!(output.build(&[mesh], &usual()).unwrap().faces, 10);
    assert_eq!(volume(&output.path), (64.0 - 4.0) * 4.0);
    let (library, model) = (library(&output.path), open_model(output.path.to_str().unwrap(), 0).unwrap());
    let size = size_of::<spinney_ring>();
    // Through the tunnel and along it, next to it, across both, and outside of the block.
    let planes = [
        ([0.0, 0.0, 1.0], [0.0, 0.0, 2.0], 60.0, 2),
        ([1.0, 0.0, 0.0], [4.0, 9.0, 9.0], 24.0, 2),
        ([0.0, -2.0, 0.0], [0.0, 1.0, 0.0], 32.0, 1),
        ([1.0, 1.0, 1.0], [3.0, 3.0, 3.0], f64::NAN, 1),
        ([0.0, 0.0, 1.0], [0.0, 0.0, 4.5], 0.0, 0),
    ];
    for (normal, point, area, count) in planes {
        let (mut rings, mut points) = ([NO_RING; 9], [9.0; 300]);
        let (mut ring_count, mut point_count) = (9, 9);
        let mut cut = |ring_capacity: usize, point_capacity: usize| unsafe {
            spinney_model_section(
                model,
                point.as_ptr(),
                normal.as_ptr(),
                if ring_capacity == 0 { null_mut() } else { rings.as_mut_ptr() },
                ring_capacity,
                size,
                &mut ring_count,
                if point_capacity == 0 { null_mut() } else { points.as_mut_ptr() },
                point_capacity,
                &mut point_count,
            )
        };
        assert_eq!([cut(0, 0), cut(1, 1), cut(9, 100)], [SPINNEY_OK; 3]);
        let distance = (0..3).map(|axis| normal[axis] * point[axis]).sum();
        let expected = library.section(&CuttingPlane { normal, distance }, &()).unwrap();
        let expected_rings: Vec<_> = expected.iter().flat_map(|polygon| &polygon.rings).collect();
        assert_eq!((ring_count, expected_rings.len()), (count, count));
        let mut first = 0;
        for (ring, expected) in rings.iter().zip(&expected_rings) {
            let end = ring.end as usize;
            assert_eq!(points[3 * first..3 * end], *expected.as_flattened());
            first = end;
        }
        assert_eq!((point_count, rings[count].end, points[3 * first]), (first, 9, 9.0));
        let sum: f64 = rings[..count].iter().map(|ring| ring.area).sum();
        let total: f64 = expected.iter().map(|polygon| polygon.area).sum();
        assert!((sum - total).abs() < 1e-12 && (area.is_nan() || (sum - area).abs() < 1e-12), "{sum} {area}");
        let holes = rings[..count].iter().filter(|ring| ring.area == 0.0).count();
        assert_eq!(holes, count - expected.len());
    }
    let (up, mut counts) = ([0.0, 0.0, 1.0], [0; 2]);
    let [rings, points] = &mut counts;
    let mut refused = |point: *const f64, normal: *const f64, size: usize| unsafe {
        let done =
            spinney_model_section(model, point, normal, null_mut(), 0, size, rings, null_mut(), 0, points);
        assert_eq!(done, SPINNEY_INVALID);
    };
    refused(null(), up.as_ptr(), size);
    refused(up.as_ptr(), null(), size);
    refused(up.as_ptr(), [0.0; 3].as_ptr(), size);
    refused([f64::NAN; 3].as_ptr(), up.as_ptr(), size);
    refused(up.as_ptr(), up.as_ptr(), size - 1);
    unsafe { spinney_model_close(model) };
}

#[test]
fn parts_and_colours_are_kept() {
    let (output, vertices, corners) = (OutputFile::new(), corners_of([2.0, 3.0, 4.0]), triangles());
    let colours: Vec<[u8; 3]> = (0..8).map(|vertex| [vertex, 10 * vertex, 200]).collect();
    let parts: Vec<u32> = (0..12).map(|triangle| u32::from(triangle >= 4)).collect();
    let strings =
        ["ends", "walls", "{\"attributes\": {\"height\": 4}}"].map(|text| CString::new(text).unwrap());
    let names = [strings[0].as_ptr(), strings[1].as_ptr()];
    let attributes = [null(), strings[2].as_ptr()];
    let mut mesh = mesh_of(&vertices, &corners);
    mesh.colours = colours.as_ptr().cast();
    mesh.parts = parts.as_ptr();
    (mesh.part_names, mesh.part_attributes, mesh.part_count) = (names.as_ptr(), attributes.as_ptr(), 2);
    output.build(&[mesh], &usual()).unwrap();
    let made = library(&output.path);
    assert_eq!(made.parts(), ["ends", "walls"]);
    assert_eq!(made.part_attributes(0).unwrap(), None);
    assert_eq!(made.part_attributes(1).unwrap().as_deref(), Some("{\"attributes\":{\"height\":4}}"));
    let mut buffer = FaceBuffer::default();
    for number in 0..12 {
        made.face(number, &mut buffer).unwrap();
        let face = buffer.face();
        assert_eq!(face.part, u32::from(number >= 4));
        for (point, colour) in face.points.iter().zip(face.colours) {
            let point = made.grid().to_world(*point);
            let vertex = vertices.iter().position(|vertex| *vertex == point).unwrap();
            assert_eq!(*colour, colours[vertex]);
        }
    }
}

#[test]
fn what_is_no_body_is_refused_closed_or_repaired() {
    let (output, vertices, corners) = (OutputFile::new(), corners_of([2.0, 2.0, 2.0]), triangles());
    let open = mesh_of(&vertices, &corners[..30]);
    let message = output.build(&[open], &usual()).unwrap_err();
    assert!(
        message.starts_with("mesh: the surface is open") && message.contains("a boundary of 4 edges from"),
        "{message}"
    );
    assert!(output.is_empty());
    let report = output.build(&[open], &spinney_mesh_options { close: true, ..usual() }).unwrap();
    assert_eq!((report.closed_boundaries, report.closing_triangles, volume(&output.path)), (1, 2, 8.0));
    // Several meshes with names; each is a part.
    let adjacent: Vec<[f64; 3]> = vertices.iter().map(|[x, y, z]| [x + 1.0, *y, *z]).collect();
    let names = ["left", "right"].map(|name| CString::new(name).unwrap());
    let left = spinney_mesh { name: names[0].as_ptr(), ..mesh_of(&vertices, &corners) };
    let right = spinney_mesh { name: names[1].as_ptr(), ..mesh_of(&adjacent, &corners) };
    std::fs::remove_file(&output.path).unwrap();
    let message = output.build(&[left, right], &usual()).unwrap_err();
    assert!(message.contains("intersects itself") && message.contains("of left and right"), "{message}");
    assert!(output.is_empty());
    let repair = spinney_mesh_options { repair: true, ..usual() };
    let report = output.build(&[left, right], &repair).unwrap();
    assert_eq!((report.volume_before, report.volume, volume(&output.path)), (16.0, 12.0, 12.0));
    assert_eq!(library(&output.path).parts(), ["left", "right"]);
    let odd = spinney_mesh_options { inside: SPINNEY_INSIDE_ODD, ..repair };
    let report = output.build(&[left, right], &odd).unwrap();
    assert_eq!((report.volume, report.cells_volume), (8.0, 12.0));
    // Inside out.
    let turned: Vec<u32> = corners.iter().rev().copied().collect();
    let report = output.build(&[mesh_of(&vertices, &turned)], &repair).unwrap();
    assert_eq!((report.turned_bodies, volume(&output.path)), (1, 8.0));
}

#[test]
fn arguments_that_make_no_sense_are_refused() {
    let (output, vertices, corners) = (OutputFile::new(), corners_of([2.0, 2.0, 2.0]), triangles());
    let mesh = mesh_of(&vertices, &corners);
    let refused = |change: &dyn Fn(&mut spinney_mesh), expected: &str| {
        let mut mesh = mesh;
        change(&mut mesh);
        let message = output.build(&[mesh], &usual()).unwrap_err();
        assert!(message.contains(expected), "{message}");
    };
    let (no_utf8, parts) = ([0xffu8, 0], [0u32; 12]);
    let missing: [*const c_char; 1] = [null()];
    refused(&|mesh| mesh.vertices = null(), "vertices: got NULL");
    refused(&|mesh| mesh.vertex_count = 0, "vertices: got none");
    refused(&|mesh| mesh.vertex_count = 7, "corners: got 7, expected vertex indices, 0 to 6");
    refused(&|mesh| mesh.vertex_count = usize::MAX, "vertices: got");
    refused(&|mesh| mesh.corners = null(), "corners: got NULL");
    refused(&|mesh| mesh.corners = mesh.corners.wrapping_byte_add(1), "corners: got 36 at");
    refused(&|mesh| mesh.corner_size = 2, "corner_size: got 2, expected 4 or 8");
    refused(&|mesh| mesh.corner_count = 35, "corners: got 35, expected a multiple of three: triangles");
    refused(&|mesh| mesh.ring_count = 1, "ring_ends: got NULL");
    refused(&|mesh| mesh.part_count = 1, "part_names: got NULL");
    refused(&|mesh| (mesh.part_names, mesh.part_count) = (missing.as_ptr(), 1), "expected a name");
    refused(&|mesh| mesh.name = no_utf8.as_ptr().cast(), "name: got other bytes, expected UTF-8");
    let only = [1; 12];
    refused(&|mesh| mesh.parts = only.as_ptr(), "parts: got 1, expected indices of named parts, 0 to 0");
    assert!(output.is_empty());
    for (options, expected) in [
        (spinney_mesh_options { inside: 3, ..usual() }, "inside: got 3"),
        (spinney_mesh_options { snap: -1.0, ..usual() }, "expected"),
        (spinney_mesh_options { crs: no_utf8.as_ptr().cast(), ..usual() }, "crs: got other bytes"),
    ] {
        let message = output.build(&[mesh], &options).unwrap_err();
        assert!(message.contains(expected), "{message}");
    }
    assert!(output.build(&[], &usual()).unwrap_err().contains("models"));
    let (mesh_size, path) = (size_of::<spinney_mesh>(), output.name.as_ptr());
    let (mesh, none): (*const _, _) = (&spinney_mesh { parts: parts.as_ptr(), ..mesh }, null());
    let mut report: spinney_mesh_report = unsafe { std::mem::zeroed() };
    unsafe {
        let build = |mesh, size, path| spinney_model_build(mesh, 1, size, null(), 0, path, null_mut(), 0);
        assert_eq!(build(mesh, mesh_size - 1, path), SPINNEY_INVALID);
        assert_eq!(build(none, mesh_size, path), SPINNEY_INVALID);
        assert_eq!(build(mesh, mesh_size, null()), SPINNEY_INVALID);
        let done = spinney_model_build(mesh, 1, mesh_size, &usual(), 3, path, null_mut(), 0);
        assert_eq!(done, SPINNEY_INVALID);
        let done = spinney_model_build(mesh, 1, mesh_size, null(), 0, path, &mut report, 3);
        assert_eq!(done, SPINNEY_INVALID);
        assert!(output.is_empty());
        assert_eq!(build(mesh, mesh_size, path), SPINNEY_OK);
    }
    assert_eq!(volume(&output.path), 8.0);
}

/// Changes by a repair are reported, one line each, until the next call that makes a model.
#[test]
fn warnings_are_reported() {
    let warnings = || unsafe { CStr::from_ptr(spinney_warnings()) }.to_str().unwrap().to_owned();
    let (output, sides) = (OutputFile::new(), triangles());
    let one = corners_of([2.0; 3]);
    let other: Vec<[f64; 3]> = one.iter().map(|corner| corner.map(|at| at + 1.0)).collect();
    let meshes = [mesh_of(&one, &sides), mesh_of(&other, &sides)];
    let mut options = usual();
    (options.repair, options.inside) = (true, SPINNEY_INSIDE_ODD);
    let build = |count: usize, options: &spinney_mesh_options| unsafe {
        let (size, sizes) = (size_of::<spinney_mesh>(), size_of::<spinney_mesh_options>());
        spinney_model_build(meshes.as_ptr(), count, size, options, sizes, output.name.as_ptr(), null_mut(), 0)
    };
    assert_eq!((build(2, &options), warnings().lines().count()), (SPINNEY_OK, 1));
    assert!(
        warnings().contains("the volume differs by ") && warnings().contains(" percent from that of cells"),
        "{}",
        warnings()
    );
    assert_eq!(std::thread::spawn(|| unsafe { *spinney_warnings() }).join().unwrap(), 0);
    // Calls that make no model keep the warnings; other calls clear them.
    assert_eq!(unsafe { spinney_model_open(null(), 0, null_mut()) }, SPINNEY_INVALID);
    assert!(!warnings().is_empty());
    assert_eq!((build(1, &usual()), warnings()), (SPINNEY_OK, String::new()));
    assert_eq!((build(2, &options), warnings().is_empty()), (SPINNEY_OK, false));
    assert_eq!((build(0, &options), warnings()), (SPINNEY_INVALID, String::new()));
}
