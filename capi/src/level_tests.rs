//! Levels of detail of exact models through the C interface, compared with the library.
#![allow(clippy::undocumented_unsafe_blocks)] // the tests check these very rules

use std::collections::HashMap;
use std::ffi::CString;
use std::ptr::{null, null_mut};

use engine::brep::{Face, Faces, Grid, SurfaceDetail, add_levels};
use engine::raw::brep::{ModelBuilder, Triangulated};
use engine::{Codec, ExactModel, Metadata, Output};
use tempfile::TempDir;

use crate::tests::open_model;
use crate::*;
use spinney_status::{SPINNEY_INVALID, SPINNEY_OK, SPINNEY_UNSUPPORTED};

const COLOUR: [u8; 3] = [9, 80, 200];
const DETAIL_SIZE: usize = size_of::<spinney_detail>();
const TRIANGLES_SIZE: usize = size_of::<spinney_triangles>();

/// A coloured torus with levels, in a file.
fn torus() -> (TempDir, ExactModel, CString) {
    let (n, m) = (64, 40);
    let at = |i: i32, j: i32| {
        let [u, v] =
            [(i, n), (j, m)].map(|(at, of)| f64::from(at % of) / f64::from(of) * std::f64::consts::TAU);
        let wide = 3.0 + v.cos();
        [wide * u.cos(), wide * u.sin(), v.sin()].map(|at| ((at + 4.2) * 7000.0) as i32)
    };
    let grid = Grid { bits: 16, origin: [-100, 0, 5], step: 1.0, divisor: 1000.0 };
    let directory = tempfile::tempdir().unwrap();
    let [plain, path] = ["plain.goblin", "levels.goblin"].map(|name| directory.path().join(name));
    let mut builder = ModelBuilder::new(Output::create(&plain).unwrap(), grid, 64 << 20).unwrap();
    let squares = (0..n).flat_map(|i| (0..m).map(move |j| (i, j)));
    let triangles = squares.flat_map(|(i, j)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    });
    for (number, points) in (0..).zip(triangles) {
        let (ring_ends, colours) = (&[3][..], &[COLOUR; 3][..]);
        builder.push(&Face { number, points: &points, ring_ends, colours, part: 0, source: number }).unwrap();
    }
    builder.part("torus", None).unwrap();
    builder.finish(&mut Metadata::default(), &()).unwrap();
    let model = ExactModel::open(&plain, &Default::default()).unwrap();
    let output = (Output::create(&path).unwrap(), Codec::Plain);
    add_levels(&model, output, 64 << 20, &()).unwrap();
    let model = ExactModel::open(&path, &Default::default()).unwrap();
    (directory, model, CString::new(path.to_str().unwrap()).unwrap())
}

fn whole() -> spinney_detail {
    unsafe { std::mem::zeroed() }
}

/// Arrays of triangles, with what the call reports about them.
struct Surface {
    vertices: Vec<[f64; 3]>,
    corners: Vec<[u32; 3]>,
    parts: Vec<u32>,
    colours: Vec<[u8; 9]>,
    reported: spinney_triangles,
}

/// Requests the counts, then the arrays.
fn surface(model: *const spinney_model, detail: &spinney_detail) -> Result<Surface, spinney_status> {
    let mut triangles: spinney_triangles = unsafe { std::mem::zeroed() };
    let request = |triangles: &mut spinney_triangles| match unsafe {
        spinney_model_triangles(model, detail, DETAIL_SIZE, triangles, TRIANGLES_SIZE)
    } {
        SPINNEY_OK => Ok(()),
        status => Err(status),
    };
    request(&mut triangles)?;
    let (vertices, count) = (triangles.vertex_count, triangles.triangle_count);
    let mut found = Surface {
        vertices: vec![[f64::NAN; 3]; vertices],
        corners: vec![[u32::MAX; 3]; count],
        parts: vec![9; count],
        colours: vec![[1; 9]; count],
        reported: triangles,
    };
    found.reported.vertices = found.vertices.as_mut_ptr().cast();
    found.reported.corners = found.corners.as_mut_ptr().cast();
    (found.reported.parts, found.reported.colours) =
        (found.parts.as_mut_ptr(), found.colours.as_mut_ptr().cast());
    (found.reported.vertex_capacity, found.reported.triangle_capacity) = (vertices, count);
    request(&mut found.reported)?;
    assert_eq!((found.reported.vertex_count, found.reported.triangle_count), (vertices, count));
    Ok(found)
}

/// Checks a surface against the library's triangles.
fn check(found: &Surface, expected: &dyn Faces) {
    let mut index = 0;
    Triangulated::of(expected)
        .unwrap()
        .each(&mut |face| {
            let points = found.corners[index].map(|corner| found.vertices[corner as usize]);
            let world: Vec<[f64; 3]> =
                face.points.iter().map(|point| expected.grid().to_world(*point)).collect();
            assert_eq!((&points[..], found.parts[index]), (&world[..], face.part));
            let colours = face.colours.as_flattened();
            assert_eq!(&found.colours[index][..colours.len()], colours);
            assert!(found.colours[index][colours.len()..].iter().all(|channel| *channel == 0));
            index += 1;
            Ok(())
        })
        .unwrap();
    assert_eq!(index, found.corners.len());
}

/// Returns whether each edge is used as often in one direction as in the other.
fn is_closed(found: &Surface) -> bool {
    let mut edges: HashMap<[u32; 2], i32> = HashMap::new();
    for [a, b, c] in &found.corners {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry([*from.min(to), *from.max(to)]).or_default() += if from < to { 1 } else { -1 };
        }
    }
    edges.values().all(|surplus| *surplus == 0)
}

#[test]
fn surfaces_at_levels_of_detail_are_those_of_the_library() {
    let (_directory, library, name) = torus();
    let mut model = null_mut();
    assert_eq!(unsafe { spinney_model_open(name.as_ptr(), 0, &mut model) }, SPINNEY_OK);
    let size = size_of::<spinney_detail_level>();
    let (mut levels, mut count) = ([unsafe { std::mem::zeroed::<spinney_detail_level>() }; 64], 0);
    let done = unsafe { spinney_model_levels(model, levels.as_mut_ptr(), 64, size, &mut count) };
    assert_eq!((done, count), (SPINNEY_OK, library.levels().len()));
    assert!(count > 2);
    let width = library.grid().width();
    for (number, (level, expected)) in levels.iter().zip(library.levels()).enumerate() {
        assert_eq!((level.faces, level.bytes), (expected.faces, expected.bytes));
        assert_eq!(level.error, expected.error * width);
        assert_eq!(level.vanished_bodies, expected.vanished);
        assert_eq!(level.vanished_diameter, expected.vanished_diameter * width);
        let detail = spinney_detail { by: SPINNEY_DETAIL_LEVEL, level: number as u32, ..whole() };
        let found = surface(model, &detail).unwrap();
        check(&found, &library.surface(SurfaceDetail::Level(number as u8), None, &()).unwrap());
        assert_eq!((found.corners.len() as u64, found.reported.error), (level.faces, level.error));
        assert!(is_closed(&found) && found.reported.has_colours);
        assert_eq!(found.colours[0], *[COLOUR; 3].as_flattened());
    }
    // An error for which some faces are coarse.
    let most = 1.01 * levels[count - 2].error;
    let error = spinney_detail { by: SPINNEY_DETAIL_ERROR, error: most, ..whole() };
    let found = surface(model, &error).unwrap();
    check(&found, &library.surface(SurfaceDetail::Error(most), None, &()).unwrap());
    assert!(is_closed(&found) && found.reported.error <= most && found.corners.len() < 5120);
    let faces = spinney_detail { by: SPINNEY_DETAIL_FACES, faces: levels[0].faces, ..whole() };
    check(&surface(model, &faces).unwrap(), &library.surface(SurfaceDetail::Level(0), None, &()).unwrap());
    let exact = surface(model, &whole()).unwrap();
    check(&exact, &library);
    assert_eq!(exact.reported.error, 0.0);
    // In a box: of the exact surface, and of a coarse one.
    let [low, high] = library.bounds().unwrap();
    let half = [low, [0, 1, 2].map(|axis| (low[axis] + high[axis]) / 2.0)];
    let bounds = half.as_flattened().as_ptr();
    let near = surface(model, &spinney_detail { bounds, ..whole() }).unwrap();
    check(&near, &library.surface(SurfaceDetail::Exact, Some(half), &()).unwrap());
    assert!((1..5120).contains(&near.corners.len()));
    let near = surface(model, &spinney_detail { bounds, ..error }).unwrap();
    check(&near, &library.surface(SurfaceDetail::Error(most), Some(half), &()).unwrap());
    unsafe { spinney_model_close(model) };
}

#[test]
fn buffers_may_be_short_and_invalid_details_are_refused() {
    let (_directory, library, name) = torus();
    let mut model = null_mut();
    assert_eq!(unsafe { spinney_model_open(name.as_ptr(), 0, &mut model) }, SPINNEY_OK);
    let (mut vertices, mut corners) = ([[0.0; 3]; 5], [[9; 3]; 4]);
    let mut triangles: spinney_triangles = unsafe { std::mem::zeroed() };
    (triangles.vertices, triangles.vertex_capacity) = (vertices.as_mut_ptr().cast(), 4);
    (triangles.corners, triangles.triangle_capacity) = (corners.as_mut_ptr().cast(), 3);
    unsafe {
        let request =
            |detail, size, triangles| spinney_model_triangles(model, detail, size, triangles, TRIANGLES_SIZE);
        // (The whole exact surface, without the parts and colours.)
        assert_eq!(request(null(), 0, &mut triangles), SPINNEY_OK);
        assert_eq!((triangles.vertex_count, triangles.triangle_count), (2560, 5120));
        assert_eq!((vertices[4], corners[3]), ([0.0; 3], [9; 3]), "nothing is written after them");
        assert_eq!(corners[0], [0, 1, 2]);
        assert_ne!(vertices[3], [0.0; 3]);
        let wrong = [
            spinney_detail { by: 4, ..whole() },
            spinney_detail { by: SPINNEY_DETAIL_LEVEL, level: 77, ..whole() },
            spinney_detail { by: SPINNEY_DETAIL_LEVEL, level: 1 << 20, ..whole() },
            spinney_detail { by: SPINNEY_DETAIL_ERROR, error: -1.0, ..whole() },
            spinney_detail { by: SPINNEY_DETAIL_ERROR, error: f64::NAN, ..whole() },
            spinney_detail { by: SPINNEY_DETAIL_FACES, faces: 3, ..whole() },
        ];
        for detail in &wrong {
            assert_eq!(request(detail, DETAIL_SIZE, &mut triangles), SPINNEY_INVALID, "{detail:?}");
        }
        assert_eq!(request(&whole(), DETAIL_SIZE - 1, &mut triangles), SPINNEY_INVALID);
        assert_eq!(request(&whole(), DETAIL_SIZE, null_mut()), SPINNEY_INVALID);
        let done = spinney_model_triangles(model, null(), 0, &mut triangles, TRIANGLES_SIZE - 1);
        assert_eq!(done, SPINNEY_INVALID);
        assert_eq!(
            spinney_model_triangles(null(), null(), 0, &mut triangles, TRIANGLES_SIZE),
            SPINNEY_INVALID
        );
        triangles.vertices = null_mut();
        assert_eq!(request(null(), 0, &mut triangles), SPINNEY_INVALID);
        let (size, mut count) = (size_of::<spinney_detail_level>(), 0);
        assert_eq!(spinney_model_levels(model, null_mut(), 0, size, &mut count), SPINNEY_OK);
        assert_eq!(count, library.levels().len());
        assert_eq!(spinney_model_levels(model, null_mut(), 1, size, &mut count), SPINNEY_INVALID);
        assert_eq!(spinney_model_levels(model, null_mut(), 0, size + 1, &mut count), SPINNEY_INVALID);
        assert_eq!(spinney_model_levels(model, null_mut(), 0, size, null_mut()), SPINNEY_INVALID);
        spinney_model_close(model);
        // A file without levels.
        let chapel = open_model("chapel.goblin", 0).unwrap();
        assert_eq!(spinney_model_levels(chapel, null_mut(), 0, size, &mut count), SPINNEY_OK);
        assert_eq!(count, 0);
        let coarse = spinney_detail { by: SPINNEY_DETAIL_ERROR, error: 1.0, ..whole() };
        assert_eq!(surface(chapel, &coarse).err(), Some(SPINNEY_UNSUPPORTED));
        assert!(is_closed(&surface(chapel, &whole()).unwrap()));
        // Exact faces in a box need no levels.
        let bounds = [-1e9, -1e9, -1e9, -1e8, -1e8, -1e8];
        let nowhere = surface(chapel, &spinney_detail { bounds: bounds.as_ptr(), ..whole() }).unwrap();
        assert!(nowhere.corners.is_empty());
        spinney_model_close(chapel);
    }
}
