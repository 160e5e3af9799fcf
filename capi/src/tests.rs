//! Every function and every status code, called as from a C program.
#![allow(clippy::undocumented_unsafe_blocks)] // the tests check these very rules

mod layers;

use std::ffi::{CStr, CString, c_int, c_void};
use std::path::Path;
use std::ptr::{null, null_mut};

use engine::{Bounds, Dataset, Number};

use crate::spinney_status::*;
use crate::*;

fn fixture(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/v1").join(name).display().to_string()
}

/// Opens a view of a file.
fn open_with(path: &str, steps: &[&str], flags: u32) -> Result<*mut spinney_dataset, spinney_status> {
    let path = CString::new(path).unwrap();
    let steps: Vec<CString> = steps.iter().map(|step| CString::new(*step).unwrap()).collect();
    let pointers: Vec<_> = steps.iter().map(|step| step.as_ptr()).collect();
    let mut dataset = null_mut();
    match unsafe { spinney_open(path.as_ptr(), pointers.as_ptr(), pointers.len(), flags, &mut dataset) } {
        SPINNEY_OK => Ok(dataset),
        status => Err(status),
    }
}

fn open(name: &str) -> *mut spinney_dataset {
    open_with(&fixture(name), &[], 0).unwrap()
}

fn error() -> String {
    unsafe { CStr::from_ptr(spinney_error()) }.to_str().unwrap().into()
}

fn describe(dataset: *const spinney_dataset) -> spinney_info {
    let mut info = std::mem::MaybeUninit::<spinney_info>::uninit();
    let status = unsafe { spinney_describe(dataset, info.as_mut_ptr(), size_of::<spinney_info>()) };
    assert_eq!(status, SPINNEY_OK);
    unsafe { info.assume_init() }
}

fn cells(start: [u64; 3], size: [u64; 3]) -> spinney_box {
    spinney_box { start, size }
}

/// Returns the library's own result.
fn expected(dataset: &Dataset, level: u8, bounds: &Bounds, fill: f64) -> (Vec<u8>, Vec<u8>) {
    let cells = bounds.volume() as usize;
    let (mut samples, mut valid) = (vec![7; cells * dataset.header().form.width()], vec![true; cells]);
    dataset.window(level, bounds, fill, &mut samples, Some(&mut valid)).unwrap();
    (samples, valid.into_iter().map(u8::from).collect())
}

#[test]
fn results_are_those_of_the_library() {
    for name in ["classes.goblin", "elevation.goblin", "rgb.goblin", "ball.goblin", "history.autumn"] {
        for flags in [0, SPINNEY_POSITIONED] {
            let dataset = open_with(&fixture(name), &[], flags).unwrap();
            let library = engine::open(fixture(name)).unwrap();
            let info = describe(dataset);
            assert_eq!((info.depth, info.size), (library.depth().into(), library.header().extent));
            assert_eq!(info.is_autumnal, name.ends_with("autumn"));
            for level in [info.depth, info.depth / 2, 0] {
                let mut size = [0; 3];
                assert_eq!(unsafe { spinney_level_size(dataset, level, &mut size) }, SPINNEY_OK);
                assert_eq!(size, library.extent_at(level as u8).max);
                // A box slightly larger than the level.
                let z = if info.axes == 3 { size[2] + 1 } else { 1 };
                let part = cells([1, 0, 0], [size[0] + 2, size[1], z]);
                let bounds = Bounds { min: [1, 0, 0], max: [size[0] + 3, size[1], z] };
                let (expected, present) = expected(&library, level as u8, &bounds, 9.0);
                let (mut samples, mut valid) = (vec![0; expected.len()], vec![0; present.len()]);
                let (bytes, flags) = (samples.len(), valid.len());
                let (to, flag) = (samples.as_mut_ptr(), valid.as_mut_ptr());
                let read = unsafe { spinney_read(dataset, level, &part, 9.0, to.cast(), bytes, flag, flags) };
                assert_eq!(read, SPINNEY_OK, "{}", error());
                assert_eq!((&samples, &valid), (&expected, &present));
                samples.fill(1);
                let read =
                    unsafe { spinney_read(dataset, level, &part, 9.0, to.cast(), bytes, null_mut(), 0) };
                assert_eq!((read, &samples), (SPINNEY_OK, &expected));
            }
            unsafe { spinney_close(dataset) };
        }
    }
}

/// Blocks that were passed to `take`.
struct BlockSink {
    blocks: Vec<(spinney_box, Vec<u8>, Vec<u8>)>,
    width: usize,
    limit: usize,
}

unsafe extern "C" fn take(user: *mut c_void, block: *const spinney_block) -> c_int {
    let (sink, block) = unsafe { (&mut *user.cast::<BlockSink>(), &*block) };
    let count = block.cells.size.iter().product::<u64>() as usize;
    let (samples, valid) = unsafe {
        let samples = std::slice::from_raw_parts(block.samples.cast::<u8>(), count * sink.width);
        (samples.to_vec(), std::slice::from_raw_parts(block.valid, count).to_vec())
    };
    sink.blocks.push((block.cells, samples, valid));
    c_int::from(sink.blocks.len() == sink.limit)
}

#[test]
fn blocks_are_all_of_a_box() {
    let dataset = open_with(&fixture("elevation.goblin"), &["scale=3"], 0).unwrap();
    let library =
        engine::open(fixture("elevation.goblin")).unwrap().view(&["scale=3".parse().unwrap()]).unwrap();
    let info = describe(dataset);
    let part = cells([5, 7, 0], [600, 300, 1]);
    let user = |sink: &mut BlockSink| std::ptr::from_mut(sink).cast();
    let mut sink = BlockSink { blocks: Vec::new(), width: info.cell_size as usize, limit: usize::MAX };
    let read = unsafe { spinney_read_blocks(dataset, info.depth, &part, 0.0, Some(take), user(&mut sink)) };
    assert_eq!(read, SPINNEY_OK, "{}", error());
    assert_eq!(sink.blocks.len(), 3 * 2);
    for (cells, samples, valid) in &sink.blocks {
        let max = std::array::from_fn(|axis| cells.start[axis] + cells.size[axis]);
        let bounds = Bounds { min: cells.start, max };
        assert_eq!((samples.clone(), valid.clone()), expected(&library, info.depth as u8, &bounds, 0.0));
    }
    assert_eq!(
        sink.blocks.iter().map(|(cells, ..)| cells.size.iter().product::<u64>()).sum::<u64>(),
        180_000
    );
    let mut sink = BlockSink { blocks: Vec::new(), width: info.cell_size as usize, limit: 2 };
    let read = unsafe { spinney_read_blocks(dataset, info.depth, &part, 0.0, Some(take), user(&mut sink)) };
    assert_eq!((read, sink.blocks.len()), (SPINNEY_STOPPED, 2));
    let read = unsafe { spinney_read_blocks(dataset, info.depth, &part, 0.0, None, null_mut()) };
    assert_eq!(read, SPINNEY_INVALID);
    unsafe { spinney_close(dataset) };
}

#[test]
fn views_are_what_is_read() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("noise.goblin");
    let form =
        engine::TreeType::new(engine::Dimension::Quad, engine::ValueType::new(engine::SampleType::U8, 1));
    let cell =
        |[x, y, _]: [u32; 3]| Some(engine::Value::from([((x * 31) ^ (y * 57) ^ ((x * y) >> 3)) as u8]));
    let tree = engine::tree::MemTree::from_cells(form, 8, engine::Rule::Mean, &cell);
    let options = engine::BuildOptions::new(engine::DataKind::Continuous, 8);
    let output = engine::Output::create(&path).unwrap();
    engine::raw::store::build_tree(&tree, [256, 256, 1], &options, output, &()).unwrap();
    let dataset = open_with(path.to_str().unwrap(), &[], 0).unwrap();
    let mut view = spinney_view { samples: null(), row_stride: 0, layer_stride: 0 };
    for (level, start, size) in
        [(8, [3, 5, 0], [70, 30, 1]), (8, [0; 3], [256, 256, 1]), (5, [7, 7, 0], [1, 9, 1])]
    {
        let part = cells(start, size);
        assert_eq!(unsafe { spinney_view_of(dataset, level, &part, &mut view) }, SPINNEY_OK, "{}", error());
        let mut samples = vec![0u8; (size[0] * size[1]) as usize];
        let bytes = samples.len();
        let to = samples.as_mut_ptr().cast();
        let read = unsafe { spinney_read(dataset, level, &part, 0.0, to, bytes, null_mut(), 0) };
        assert_eq!(read, SPINNEY_OK);
        for (row, samples) in samples.chunks_exact(size[0] as usize).enumerate() {
            let stored = unsafe {
                let first = view.samples.cast::<u8>().add(row * view.row_stride);
                std::slice::from_raw_parts(first, samples.len())
            };
            assert_eq!(stored, samples);
        }
    }
    let view_of =
        |level, part: *const _, view: *mut _| unsafe { spinney_view_of(dataset, level, part, view) };
    assert_eq!(view_of(8, &cells([200, 0, 0], [90, 3, 1]), &mut view), SPINNEY_UNSUPPORTED);
    assert_eq!(view_of(9, &cells([0; 3], [1; 3]), &mut view), SPINNEY_INVALID);
    assert_eq!(view_of(8, null(), &mut view), SPINNEY_INVALID);
    assert_eq!(view_of(8, &cells([0; 3], [1; 3]), null_mut()), SPINNEY_INVALID);
    unsafe { spinney_close(dataset) };
    let positioned = open_with(path.to_str().unwrap(), &[], SPINNEY_POSITIONED).unwrap();
    let viewed = unsafe { spinney_view_of(positioned, 8, &cells([0; 3], [9, 9, 1]), &mut view) };
    assert_eq!(viewed, SPINNEY_UNSUPPORTED);
    unsafe { spinney_close(positioned) };
}

#[test]
fn points_statistics_classes_and_histograms_agree() {
    let dataset = open("classes.goblin");
    let library = engine::open(fixture("classes.goblin")).unwrap();
    let info = describe(dataset);
    let positions: Vec<[u64; 3]> = (0..40).map(|i| [i * 3, i * 2, 0]).chain([[u64::MAX, 5, 0]]).collect();
    let (mut samples, mut valid) = (vec![0.0; positions.len()], vec![9; positions.len()]);
    let status = unsafe {
        let (to, flag) = (samples.as_mut_ptr(), valid.as_mut_ptr());
        spinney_points(dataset, info.depth, positions.as_ptr(), positions.len(), to, flag)
    };
    assert_eq!(status, SPINNEY_OK, "{}", error());
    for ((place, sample), valid) in positions.iter().zip(&samples).zip(valid) {
        let mut value = [Number::default(); 4];
        let is_there = library.point(*place, info.depth as u8, &mut value).unwrap();
        assert_eq!((valid, sample.is_nan()), (is_there.into(), !is_there), "{place:?}");
        assert!(!is_there || value[0] == *sample);
    }
    let mut found = spinney_statistics::default();
    let part = cells([3, 3, 0], [30, 20, 1]);
    for (part, bounds) in
        [(null(), None), (std::ptr::from_ref(&part), Some(Bounds { min: [3, 3, 0], max: [33, 23, 1] }))]
    {
        assert_eq!(unsafe { spinney_statistics_of(dataset, part, &mut found) }, SPINNEY_OK);
        let expected = library.statistics(bounds, &()).unwrap();
        assert_eq!((found.cells, found.void_cells), (expected.cells, expected.void_cells));
        assert_eq!(found.channels[0].mean, expected.channels[0].mean);
        assert!(found.channels[1].mean.is_nan());
        let (mut values, mut counts, mut count) = (vec![0.0; 99], vec![0; 99], 0);
        let status = unsafe {
            spinney_classes(dataset, part, values.as_mut_ptr(), counts.as_mut_ptr(), 99, &mut count)
        };
        assert_eq!((status, count as u64), (SPINNEY_OK, found.classes));
        let classes: Vec<_> = values.into_iter().zip(counts).take(count).collect();
        assert!(
            classes
                .iter()
                .copied()
                .eq(expected.classes.iter().map(|(class, cells)| (class.to_f64(), *cells)))
        );
        // A capacity below the class count.
        let mut one = (0.0, 0);
        let status = unsafe { spinney_classes(dataset, part, &mut one.0, &mut one.1, 1, &mut count) };
        assert_eq!((status, count, one), (SPINNEY_OK, classes.len(), classes[0]));
    }
    let mut bins = [0; 5];
    let status = unsafe { spinney_histogram(dataset, null(), 0.0, 5.0, bins.as_mut_ptr(), 5) };
    assert_eq!(status, SPINNEY_OK);
    assert_eq!(bins[..], library.histogram(&library.header().extent_bounds(), 0.0, 5.0, 5, &()).unwrap());
    unsafe { spinney_close(dataset) };
}

#[test]
fn metadata_are_a_document() {
    let dataset = open("classes.goblin");
    let text = unsafe { CStr::from_ptr(spinney_metadata(dataset)) }.to_str().unwrap();
    let document: serde_json::Value = serde_json::from_str(text).unwrap();
    assert!(document["bands"].is_array() && document["palette"].is_array(), "{text}");
    unsafe { spinney_close(dataset) };
    assert!(unsafe { spinney_metadata(null()) }.is_null());
}

#[test]
fn a_dataset_of_commits_moves_on() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("h.autumn");
    std::fs::copy(fixture("history.autumn"), &path).unwrap();
    let path = path.to_str().unwrap();
    let (newest, first) =
        (open_with(path, &[], 0).unwrap(), open_with(&format!("{path}@1"), &[], 0).unwrap());
    let before = describe(newest).commit;
    assert_eq!(describe(first).commit, 1);
    let region = engine::edit::FillRegion::Box(Bounds { min: [0; 3], max: [1, 1, 1] });
    let fill = engine::edit::Edit::Fill(region, Some(vec![77.into()]));
    engine::edit::edit(path.as_ref(), [Ok(fill)], Default::default(), 1 << 20, &()).unwrap();
    let mut newer = false;
    assert_eq!(unsafe { spinney_refresh(newest, &mut newer) }, SPINNEY_OK);
    assert!(newer && describe(newest).commit == before + 1);
    assert_eq!(unsafe { spinney_refresh(newest, null_mut()) }, SPINNEY_OK);
    assert_eq!(unsafe { spinney_check_unchanged(newest) }, SPINNEY_OK);
    std::fs::OpenOptions::new().write(true).open(path).unwrap().set_len(9000).unwrap();
    assert_eq!(unsafe { spinney_check_unchanged(newest) }, SPINNEY_CHANGED);
    unsafe {
        spinney_close(newest);
        spinney_close(first);
        spinney_close(null_mut());
    }
}

#[test]
fn what_makes_no_sense_is_a_code_with_a_text() {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = directory.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let whole = std::fs::read(fixture("classes.goblin")).unwrap();
    let missing = directory.path().join("missing.goblin");
    for (path, steps, flags, status, says) in [
        (missing.to_str().unwrap(), vec![], 0, SPINNEY_NOT_FOUND, "missing.goblin"),
        (directory.path().to_str().unwrap(), vec![], 0, SPINNEY_IO, ""),
        (&file("half.goblin", &whole[..whole.len() / 2]), vec![], 0, SPINNEY_CORRUPT, "half.goblin"),
        (
            &file("text.goblin", b"no tree at all, but long enough to be one, as far as one sees"),
            vec![],
            0,
            SPINNEY_CORRUPT,
            "text",
        ),
        (&fixture("history.autumn@99"), vec![], 0, SPINNEY_INVALID, "99"),
        (&fixture("classes.goblin"), vec!["fold=3"], 0, SPINNEY_INVALID, "fold"),
        (&fixture("classes.goblin"), vec![], 6, SPINNEY_INVALID, "flags 6"),
    ] {
        assert_eq!(open_with(path, &steps, flags).unwrap_err(), status, "{path}: {}", error());
        assert!(error().contains(says), "{}", error());
    }
    let mut place = null_mut();
    assert_eq!(unsafe { spinney_open(null(), null(), 0, 0, &mut place) }, SPINNEY_INVALID);
    assert_eq!(unsafe { spinney_open(c"x".as_ptr(), null(), 0, 0, null_mut()) }, SPINNEY_INVALID);
    assert_eq!(unsafe { spinney_open(c"x".as_ptr(), null(), 1, 0, &mut place) }, SPINNEY_INVALID);
    assert!(place.is_null());

    let dataset = open("classes.goblin");
    let info = describe(dataset);
    let mut samples = [5u8; 16];
    let to = samples.as_mut_ptr();
    let part = cells([0; 3], [4, 4, 1]);
    let read = |dataset: *const _, level, part: *const _, to: *mut u8, size, valid: *mut u8, flags| unsafe {
        spinney_read(dataset, level, part, 0.0, to.cast(), size, valid, flags)
    };
    for (what, status) in [
        ("no dataset", read(null(), 0, &part, to, 16, null_mut(), 0)),
        ("no box", read(dataset, 0, null(), to, 16, null_mut(), 0)),
        ("no buffer", read(dataset, 0, &part, null_mut(), 16, null_mut(), 0)),
        ("too small", read(dataset, 0, &part, to, 15, null_mut(), 0)),
        ("too large", read(dataset, 0, &part, to, 17, null_mut(), 0)),
        ("no buffer for flags", read(dataset, 0, &part, to, 16, null_mut(), 16)),
        ("too few flags", read(dataset, 0, &part, to, 16, to, 3)),
        ("too deep", read(dataset, info.depth + 1, &part, to, 16, null_mut(), 0)),
        ("much too deep", read(dataset, u32::MAX, &part, to, 16, null_mut(), 0)),
        ("a box that goes round", read(dataset, 0, &cells([u64::MAX; 3], [1; 3]), to, 16, null_mut(), 0)),
        ("a huge box", read(dataset, 0, &cells([0; 3], [1 << 39; 3]), to, 16, null_mut(), 0)),
        ("no positions", unsafe { spinney_points(dataset, 0, null(), 3, null_mut(), null_mut()) }),
        ("very many positions", unsafe {
            spinney_points(dataset, 0, null(), usize::MAX, null_mut(), null_mut())
        }),
        ("no statistics", unsafe { spinney_statistics_of(dataset, null(), null_mut()) }),
        ("no count", unsafe { spinney_classes(dataset, null(), null_mut(), null_mut(), 0, null_mut()) }),
        ("no bins", unsafe { spinney_histogram(dataset, null(), 0.0, 1.0, null_mut(), 0) }),
        ("no range", unsafe { spinney_histogram(dataset, null(), 1.0, 1.0, &mut 0, 1) }),
        ("no number", unsafe { spinney_histogram(dataset, null(), f64::NAN, 1.0, &mut 0, 1) }),
        ("no size", unsafe { spinney_level_size(dataset, 0, null_mut()) }),
        ("another structure", unsafe { spinney_describe(dataset, &mut { info }, 8) }),
        ("no structure", unsafe { spinney_describe(dataset, null_mut(), size_of::<spinney_info>()) }),
        ("nothing to refresh", unsafe { spinney_refresh(null_mut(), null_mut()) }),
        ("nothing to check", unsafe { spinney_check_unchanged(null()) }),
    ] {
        assert_eq!(status, SPINNEY_INVALID, "{what}: {}", error());
    }
    assert_eq!(samples, [5; 16]);
    unsafe { spinney_close(dataset) };
    assert_eq!(guarded(|| panic!("on purpose")), SPINNEY_INTERNAL);
    assert!(error().contains("on purpose"));
    assert!(!unsafe { CStr::from_ptr(spinney_version()) }.is_empty());
    spinney_set_cache_memory(1 << 20);
    assert_eq!(engine::FileAccess::default().unpacked().limit(), 1 << 20);
}

#[test]
fn threads_read_one_dataset_at_once() {
    struct Shared(*mut spinney_dataset);
    // SAFETY: this is what the test checks: any number of threads may read a dataset.
    unsafe impl Sync for Shared {}
    let dataset = Shared(open("elevation.goblin"));
    let library = engine::open(fixture("elevation.goblin")).unwrap();
    let info = describe(dataset.0);
    std::thread::scope(|scope| {
        for thread in 0..8u64 {
            let (dataset, library) = (&dataset, &library);
            scope.spawn(move || {
                for i in 0..50 {
                    let start = [(thread * 7 + i) % 60, (i * 3) % 40, 0];
                    let bounds = Bounds { min: start, max: [start[0] + 33, start[1] + 21, 1] };
                    let (expected, _) = expected(library, info.depth as u8, &bounds, 0.0);
                    let mut samples = vec![0; expected.len()];
                    let (to, size, part) = (samples.as_mut_ptr(), samples.len(), cells(start, [33, 21, 1]));
                    let read = unsafe {
                        spinney_read(dataset.0, info.depth, &part, 0.0, to.cast(), size, null_mut(), 0)
                    };
                    assert_eq!((read, samples), (SPINNEY_OK, expected));
                    // Each thread has an error of its own.
                    let wrong = cells(start, [1; 3]);
                    let read = unsafe {
                        spinney_read(
                            dataset.0,
                            info.depth,
                            &wrong,
                            0.0,
                            to.cast(),
                            thread as usize + 90,
                            null_mut(),
                            0,
                        )
                    };
                    assert_eq!(read, SPINNEY_INVALID);
                    assert!(error().contains(&(thread + 90).to_string()), "{}", error());
                }
            });
        }
    });
    unsafe { spinney_close(dataset.0) };
}

pub(crate) fn open_model(name: &str, flags: u32) -> Result<*mut spinney_model, spinney_status> {
    let path = CString::new(fixture(name)).unwrap();
    let mut model = null_mut();
    match unsafe { spinney_model_open(path.as_ptr(), flags, &mut model) } {
        SPINNEY_OK => Ok(model),
        status => Err(status),
    }
}

#[test]
fn exact_models_have_the_results_of_the_library() {
    use engine::ExactModel;
    use engine::brep::{Faces, Location, MassProperties};
    let library = ExactModel::open(fixture("chapel.goblin").as_ref(), &Default::default()).unwrap();
    for flags in [0, SPINNEY_POSITIONED] {
        let model = open_model("chapel.goblin", flags).unwrap();
        let mut info = std::mem::MaybeUninit::<spinney_model_info>::uninit();
        let size = size_of::<spinney_model_info>();
        assert_eq!(unsafe { spinney_model_describe(model, info.as_mut_ptr(), size) }, SPINNEY_OK);
        let info = unsafe { info.assume_init() };
        assert_eq!((info.faces, info.parts, info.depth, info.bits, info.step), (187, 2, 12, 12, 0.01));
        assert_eq!((info.nodes, info.origin), (library.nodes().total(), library.grid().to_world([0; 3])));
        let mut bounds = [0.0; 6];
        assert_eq!(unsafe { spinney_model_bounds(model, &mut bounds) }, SPINNEY_OK);
        assert_eq!(bounds.as_slice(), library.bounds().unwrap().as_flattened());
        let mut mass = std::mem::MaybeUninit::<spinney_mass>::uninit();
        let size = size_of::<spinney_mass>();
        assert_eq!(unsafe { spinney_model_measure(model, mass.as_mut_ptr(), size) }, SPINNEY_OK);
        let (mass, expected) = (unsafe { mass.assume_init() }, MassProperties::of(&library, &()).unwrap());
        assert_eq!(
            (mass.volume, mass.area, Some(mass.centre)),
            (expected.volume, expected.area, expected.centre)
        );
        assert!(mass.has_centre && mass.inertia.as_slice() == expected.inertia.as_flattened());
        assert_eq!(mass.second_moments.as_slice(), expected.second_moments.as_flattened());
        let [x, y, z] = info.origin;
        let points: Vec<[f64; 3]> = (0..5000)
            .map(|i| [x + f64::from(i % 29), y + f64::from(i / 29 % 22) + 0.5, z + f64::from(i / 638) * 1.9])
            .collect();
        let (mut positions, mut distances) = (vec![9i8; points.len()], vec![0.0; points.len()]);
        let (from, count) = (points.as_flattened().as_ptr(), points.len());
        let done = unsafe { spinney_model_locate(model, from, count, positions.as_mut_ptr(), count) };
        assert_eq!(done, SPINNEY_OK);
        let done = unsafe { spinney_model_distance(model, from, count, distances.as_mut_ptr(), count) };
        assert_eq!(done, SPINNEY_OK);
        for ((point, place), distance) in points.iter().zip(&positions).zip(&distances) {
            let expected = match library.locate(*point).unwrap() {
                Location::Inside => SPINNEY_INSIDE,
                Location::Outside => SPINNEY_OUTSIDE,
                Location::Boundary => SPINNEY_BOUNDARY,
            };
            assert_eq!(*place, expected, "{point:?}");
            assert_eq!(*distance, library.signed_distance(*point).unwrap(), "{point:?}");
        }
        assert!([-1, 0, 1].iter().all(|place| positions.contains(place)));
        let ray = |origin: [f64; 3], direction: [f64; 3]| {
            let mut hit = std::mem::MaybeUninit::<spinney_hit>::uninit();
            let size = size_of::<spinney_hit>();
            let done = unsafe {
                spinney_model_ray(model, origin.as_ptr(), direction.as_ptr(), hit.as_mut_ptr(), size)
            };
            (done == SPINNEY_OK).then(|| unsafe { hit.assume_init() })
        };
        let hit = ray([x + 6.0, y + 5.0, z + 50.0], [0.0, 0.0, -2.0]).unwrap();
        assert!(hit.is_hit && hit.is_entry && hit.face < 187);
        assert_eq!((hit.distance, hit.point), (18.0, [x + 6.0, y + 5.0, z + 14.0]));
        assert!(!ray([x, y, z + 50.0], [0.0, 0.0, 1.0]).unwrap().is_hit);
        assert!(ray([x; 3], [0.0; 3]).is_none() && ray([f64::NAN; 3], [1.0; 3]).is_none());
        assert_eq!(unsafe { spinney_model_check_unchanged(model) }, SPINNEY_OK);
        unsafe { spinney_model_close(model) };
    }
}

#[test]
fn exact_models_refuse_what_makes_no_sense() {
    assert_eq!(open_model("missing.goblin", 0).err(), Some(SPINNEY_NOT_FOUND));
    assert!(open_model("ball.goblin", 0).is_err() && !error().is_empty());
    assert!(open_with(&fixture("chapel.goblin"), &[], 0).is_err(), "no cells");
    assert_eq!(open_model("chapel.goblin", 6).err(), Some(SPINNEY_INVALID));
    assert_eq!(unsafe { spinney_model_open(null(), 0, null_mut()) }, SPINNEY_INVALID);
    let model = open_model("chapel.goblin", 0).unwrap();
    let (point, mut place, mut distance) = ([0.0; 3], 5i8, 0.0);
    let mut hit = std::mem::MaybeUninit::<spinney_hit>::uninit();
    unsafe {
        assert_eq!(
            spinney_model_describe(model, null_mut(), size_of::<spinney_model_info>()),
            SPINNEY_INVALID
        );
        assert_eq!(spinney_model_measure(model, null_mut(), 3), SPINNEY_INVALID);
        assert_eq!(spinney_model_bounds(model, null_mut()), SPINNEY_INVALID);
        assert_eq!(spinney_model_bounds(null(), &mut [0.0; 6]), SPINNEY_INVALID);
        assert_eq!(spinney_model_locate(model, point.as_ptr(), 1, &mut place, 2), SPINNEY_INVALID);
        assert_eq!(spinney_model_locate(model, null(), 1, &mut place, 1), SPINNEY_INVALID);
        assert_eq!(spinney_model_locate(model, point.as_ptr(), usize::MAX, &mut place, 1), SPINNEY_INVALID);
        assert_eq!(spinney_model_locate(model, null(), 0, null_mut(), 0), SPINNEY_OK);
        assert_eq!(spinney_model_distance(model, point.as_ptr(), 1, &mut distance, 0), SPINNEY_INVALID);
        let size = size_of::<spinney_hit>();
        assert_eq!(spinney_model_ray(model, null(), point.as_ptr(), hit.as_mut_ptr(), size), SPINNEY_INVALID);
        assert_eq!(place, 5, "nothing is written");
        spinney_model_close(model);
        spinney_model_close(null_mut());
    }
}

#[test]
fn integers_of_64_bits_are_exact() {
    use engine::raw::store::build_tree;
    use engine::tree::MemTree;
    use engine::{BuildOptions, DataKind, Metadata, Rule, SampleType, TreeType, Value, ValueType};
    const BASE: u64 = (1 << 63) + 3;
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("u.goblin");
    let form = TreeType::new(engine::Dimension::Quad, ValueType::new(SampleType::U64, 1));
    let number = |x: u64, y: u64| (x != y).then_some(BASE + x / 2 + 4 * (y / 2));
    let cell = |[x, y, _]: [u32; 3]| number(x.into(), y.into()).map(|number| Value::from([number]));
    let tree = MemTree::from_cells(form, 3, Rule::Majority, &cell);
    let nodata = Some(Number::from(u64::MAX - 1));
    let metadata = Metadata { nodata, ..Metadata::default() };
    let options =
        BuildOptions::new(DataKind::Categorical, 3).rule(Rule::Majority).memory(1 << 20).metadata(metadata);
    build_tree(&tree, [8, 8, 1], &options, engine::Output::create(&path).unwrap(), &()).unwrap();
    let dataset = open_with(path.to_str().unwrap(), &[], 0).unwrap();
    let info = describe(dataset);
    assert_eq!((info.sample, info.cell_size), (spinney_sample_type::SPINNEY_U64, 8));
    let place = |number: &mut u64| std::ptr::from_mut(number).cast::<c_void>();
    let mut nodata = 0u64;
    assert_eq!(unsafe { spinney_nodata(dataset, place(&mut nodata), 8) }, SPINNEY_OK);
    assert_eq!(nodata, u64::MAX - 1);
    assert_eq!(unsafe { spinney_nodata(dataset, place(&mut nodata), 4) }, SPINNEY_INVALID);
    // Windows and points.
    let (mut samples, mut valid) = (vec![0u64; 64], vec![9u8; 64]);
    let fill = BASE - 1;
    let read = unsafe {
        let (to, from) = (samples.as_mut_ptr().cast(), std::ptr::from_ref(&fill).cast());
        let all = cells([0; 3], [8, 8, 1]);
        spinney_read_filled(dataset, 3, &all, from, to, 512, valid.as_mut_ptr(), 64)
    };
    assert_eq!(read, SPINNEY_OK, "{}", error());
    let positions: Vec<[u64; 3]> = (0..64).map(|index| [index % 8, index / 8, 0]).collect();
    let (mut found, mut flags) = (vec![7u64; 64], vec![9u8; 64]);
    let status = unsafe {
        let to = found.as_mut_ptr().cast();
        spinney_point_samples(dataset, 3, positions.as_ptr(), 64, to, 512, flags.as_mut_ptr())
    };
    assert_eq!((status, &flags), (SPINNEY_OK, &valid));
    for (index, [x, y, _]) in positions.iter().enumerate() {
        let expected = number(*x, *y);
        assert_eq!((samples[index], valid[index] == 1), (expected.unwrap_or(fill), expected.is_some()));
        assert_eq!(found[index], expected.unwrap_or(0));
    }
    // Extremes and classes.
    let (mut min, mut max) = (0, 0);
    let part = cells([2, 0, 0], [3, 2, 1]);
    let status = unsafe { spinney_extremes(dataset, &part, place(&mut min), place(&mut max), 8) };
    assert_eq!((status, min, max), (SPINNEY_OK, BASE + 1, BASE + 2));
    let (mut values, mut counts, mut count) = (vec![0u64; 20], vec![0; 20], 0);
    let status = unsafe {
        let to = values.as_mut_ptr().cast();
        spinney_class_samples(dataset, null(), to, counts.as_mut_ptr(), 20, &mut count)
    };
    assert_eq!((status, count), (SPINNEY_OK, 16));
    assert_eq!(values[..16], std::array::from_fn::<u64, 16, _>(|index| BASE + index as u64));
    assert_eq!((counts[0], counts[1], counts[5]), (2, 4, 2));
    let wrong =
        unsafe { spinney_point_samples(dataset, 3, positions.as_ptr(), 64, null_mut(), 512, null_mut()) };
    assert_eq!(wrong, SPINNEY_INVALID);
    unsafe { spinney_close(dataset) };
    // The sample type u8 can hold the nodata number.
    let bytes = open("classes.goblin");
    assert_eq!(unsafe { spinney_nodata(bytes, place(&mut nodata), 1) }, SPINNEY_OK);
    unsafe { spinney_close(bytes) };
}
