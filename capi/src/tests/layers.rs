//! Layers of a file, opened as from a C program.

use std::ffi::{CStr, CString};
use std::ptr::{null, null_mut};

use engine::Bounds;

use super::{cells, describe, error, fixture, open, open_with};
use crate::spinney_status::*;
use crate::*;

/// Opens another layer of a dataset's file.
fn open_layer(
    dataset: *const spinney_dataset,
    layer: &str,
    flags: u32,
) -> Result<*mut spinney_dataset, spinney_status> {
    let layer = CString::new(layer).unwrap();
    let mut opened = null_mut();
    match unsafe { spinney_open_layer(dataset, layer.as_ptr(), flags, &mut opened) } {
        SPINNEY_OK => Ok(opened),
        status => Err(status),
    }
}

/// Returns all cells of a dataset and some beyond its border, and whether each has a value.
fn all_cells(dataset: *const spinney_dataset) -> (Vec<u8>, Vec<u8>) {
    let info = describe(dataset);
    let part = cells([0; 3], [info.size[0] + 3, info.size[1] + 2, 1]);
    let count = (part.size[0] * part.size[1]) as usize;
    let (mut samples, mut valid) = (vec![0; count * info.cell_size as usize], vec![0; count]);
    let (to, bytes) = (samples.as_mut_ptr().cast(), samples.len());
    let read = unsafe { spinney_read(dataset, info.depth, &part, 5.0, to, bytes, valid.as_mut_ptr(), count) };
    assert_eq!(read, SPINNEY_OK, "{}", error());
    (samples, valid)
}

#[test]
fn layers_are_those_of_the_library() {
    for name in ["stack.goblin", "stack.autumn"] {
        let first = open(name);
        let library = engine::open(fixture(name)).unwrap();
        let mut count = 0;
        assert_eq!(unsafe { spinney_layer_count(first, &mut count) }, SPINNEY_OK);
        assert_eq!(count, library.layers().unwrap().len());
        let depth = describe(first).depth;
        let mut opened = Vec::new();
        for (number, layer) in library.layers().unwrap().iter().enumerate() {
            let layer_name = unsafe { CStr::from_ptr(spinney_layer_name(first, number)) }.to_str().unwrap();
            assert_eq!(layer_name, layer.name);
            let by_path = open_with(&format!("{}:{layer_name}", fixture(name)), &[], 0).unwrap();
            let (by_name, by_number) = (
                open_layer(first, layer_name, 0).unwrap(),
                open_layer(first, &number.to_string(), 0).unwrap(),
            );
            let expected = library.layer(layer_name).unwrap();
            let bounds = expected.header().extent;
            let bounds = Bounds { min: [0; 3], max: [bounds[0] + 3, bounds[1] + 2, 1] };
            let expected = super::expected(&expected, expected.depth(), &bounds, 5.0);
            for found in [by_path, by_name, by_number] {
                assert_eq!(describe(found).depth, u32::from(layer.header.depth()));
                assert!(all_cells(found) == expected, "{name}:{layer_name}");
                let text = unsafe { CStr::from_ptr(spinney_metadata(found)) }.to_str().unwrap();
                let document: serde_json::Value = serde_json::from_str(text).unwrap();
                assert_eq!(document["name"], layer_name);
                assert_eq!(
                    document["time"].as_str(),
                    library.layer(layer_name).unwrap().metadata().time.as_deref()
                );
            }
            // Resampled to the first layer's cells: larger cells are repeated.
            let aligned = open_layer(first, layer_name, SPINNEY_ALIGNED).unwrap();
            assert_eq!((describe(aligned).depth, describe(aligned).size), (depth, describe(first).size));
            let shift = depth - describe(by_name).depth;
            let (large, width) = (describe(by_name).size[0] as usize + 3, describe(first).size[0] as usize);
            let size = describe(by_name).cell_size as usize;
            let (samples, valid) = all_cells(aligned);
            for cell in 0..width * describe(first).size[1] as usize {
                let (x, y) = (cell % width, cell / width);
                let (from, to) = ((y >> shift) * large + (x >> shift), y * (width + 3) + x);
                assert_eq!(valid[to], expected.1[from], "{layer_name} {x} {y}");
                assert_eq!(
                    samples[to * size..][..size],
                    expected.0[from * size..][..size],
                    "{layer_name} {x} {y}"
                );
            }
            opened.extend([by_path, by_name, by_number, aligned]);
        }
        assert!(opened.iter().any(|layer| describe(*layer).sample == spinney_sample_type::SPINNEY_U64));
        // The first layer is closed before the others, which share its file. Any layer opens the
        // others.
        unsafe { spinney_close(first) };
        let other = open_layer(opened[2], "height", 0).unwrap();
        assert!(all_cells(other) == all_cells(opened[5]));
        opened.push(other);
        opened.into_iter().for_each(|layer| unsafe { spinney_close(layer) });
    }
}

#[test]
fn missing_layers_are_reported() {
    let path = fixture("stack.goblin");
    assert_eq!(open_with(&format!("{path}:depth"), &[], 0), Err(SPINNEY_INVALID));
    assert!(error().contains("`depth`") && error().contains("`height`"), "{}", error());
    let (dataset, alone) = (open("stack.goblin"), open("classes.goblin"));
    for layer in ["depth", "4", "-1", "", "99999999999999999999"] {
        assert_eq!(open_layer(dataset, layer, 0), Err(SPINNEY_INVALID), "{layer}");
        assert!(error().contains("`height`"), "{}", error());
    }
    assert_eq!(open_layer(dataset, "height", 2), Err(SPINNEY_INVALID));
    assert_eq!(open_layer(null(), "height", 0), Err(SPINNEY_INVALID));
    let mut place = null_mut();
    unsafe {
        assert_eq!(spinney_open_layer(dataset, null(), 0, &mut place), SPINNEY_INVALID);
        assert_eq!(spinney_open_layer(dataset, c"0".as_ptr(), 0, null_mut()), SPINNEY_INVALID);
        assert_eq!(spinney_open_layer(dataset, c"\xff".as_ptr(), 0, &mut place), SPINNEY_INVALID);
        assert_eq!(spinney_layer_count(dataset, null_mut()), SPINNEY_INVALID);
        assert_eq!(spinney_layer_count(null(), &mut 0), SPINNEY_INVALID);
        assert!(spinney_layer_name(dataset, 4).is_null() && error().contains("less than 4"), "{}", error());
        assert!(spinney_layer_name(dataset, usize::MAX).is_null() && spinney_layer_name(null(), 0).is_null());
    }
    assert!(place.is_null());
    // A file of one tree, and a view, have one layer.
    let view = open_with(&format!("{path}:height"), &["crop"], 0).unwrap();
    for (dataset, name) in [(alone, ""), (view, "height")] {
        let mut count = 0;
        assert_eq!(unsafe { spinney_layer_count(dataset, &mut count) }, SPINNEY_OK);
        let layer_name = unsafe { CStr::from_ptr(spinney_layer_name(dataset, 0)) };
        assert_eq!((count, layer_name.to_str()), (1, Ok(name)));
    }
    let itself = open_layer(alone, "", 0).unwrap();
    assert!(all_cells(itself) == all_cells(alone));
    assert_eq!(open_layer(view, "cover", 0), Err(SPINNEY_UNSUPPORTED));
    [dataset, alone, view, itself].into_iter().for_each(|dataset| unsafe { spinney_close(dataset) });
}

#[test]
fn layers_refresh_independently() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.autumn");
    std::fs::copy(fixture("stack.autumn"), &path).unwrap();
    let path = path.to_str().unwrap();
    let first = open_with(path, &[], 0).unwrap();
    let layer = open_layer(first, "height", 0).unwrap();
    let before = (describe(layer).commit, all_cells(layer));
    let name = format!("{path}:height");
    let region = engine::edit::FillRegion::Box(Bounds { min: [0; 3], max: [1, 1, 1] });
    let fill = engine::edit::Edit::Fill(region, Some(vec![77.into()]));
    engine::edit::edit(name.as_ref(), [Ok(fill)], Default::default(), 1 << 20, &()).unwrap();
    assert!((describe(layer).commit, all_cells(layer)) == before);
    let mut newer = false;
    assert_eq!(unsafe { spinney_refresh(layer, &mut newer) }, SPINNEY_OK);
    assert!(newer && describe(layer).commit == before.0 + 1 && all_cells(layer) != before.1);
    // A layer has the commit of the dataset that it is opened from.
    let old = open_layer(first, "height", 0).unwrap();
    assert!((describe(old).commit, all_cells(old)) == before);
    [first, layer, old].into_iter().for_each(|dataset| unsafe { spinney_close(dataset) });
}
