//! Rays, shells and set operations of exact models through the C interface, compared with the
//! library.
#![allow(clippy::undocumented_unsafe_blocks)] // the tests check these very rules

use std::ffi::CString;
use std::ptr::{null, null_mut};

use engine::ExactModel;
use engine::brep::MassProperties;
use engine::raw::brep::topology::{Topology, TopologyOptions};

use crate::tests::open_model;
use crate::*;
use spinney_status::{SPINNEY_INVALID, SPINNEY_MEMORY, SPINNEY_OK};

const NO_HIT: spinney_hit =
    spinney_hit { distance: 9.0, point: [9.0; 3], face: 9, part: 9, is_entry: true, is_hit: true };
const NO_SHELL: spinney_shell =
    spinney_shell { vertices: 9, edges: 9, faces: 9, inner_rings: 9, boundaries: 9, genus: 9, volume: 9.0 };

fn chapel() -> ExactModel {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/v1/chapel.goblin");
    ExactModel::open(path.as_ref(), &Default::default()).unwrap()
}

#[test]
fn many_rays_are_those_of_the_library() {
    let (library, model) = (chapel(), open_model("chapel.goblin", 0).unwrap());
    let [low, high] = library.bounds().unwrap();
    let size = size_of::<spinney_hit>();
    let (mut origins, mut directions) = (Vec::new(), Vec::new());
    for i in 0..6000 {
        let share = [i % 19, i / 19 % 19, i * 7 % 31].map(|at| f64::from(at) / 19.0);
        let place = [0, 1, 2].map(|axis| low[axis] + (high[axis] - low[axis]) * share[axis]);
        origins.push([place[0], place[1], high[2] + 3.0]);
        directions.push([f64::from(i % 5) - 2.0, f64::from(i % 7) - 3.0, -9.0]);
    }
    let count = origins.len();
    let [from, along] = [&origins, &directions].map(|rows| rows.as_flattened().as_ptr());
    let mut hits = vec![NO_HIT; count];
    let done = unsafe { spinney_model_rays(model, from, along, count, hits.as_mut_ptr(), count, size) };
    assert_eq!(done, SPINNEY_OK);
    let mut met = [0; 2];
    for ((origin, direction), hit) in origins.iter().zip(&directions).zip(&hits) {
        let (found, _) = library.ray(*origin, *direction).unwrap();
        assert_eq!(hit.is_hit, found.is_some());
        if let Some(found) = found {
            assert_eq!((hit.distance, hit.point), (found.share, found.point));
            assert_eq!((hit.face, hit.part, hit.is_entry), (found.face, found.part, found.is_entry));
            met[found.part as usize] += 1;
        }
    }
    assert!(met.iter().all(|met| *met > 100), "{met:?}");
    unsafe {
        let none = spinney_model_rays(model, null(), null(), 0, null_mut(), 0, size);
        assert_eq!(none, SPINNEY_OK);
        let hits = hits.as_mut_ptr();
        assert_eq!(spinney_model_rays(model, from, along, count, hits, count - 1, size), SPINNEY_INVALID);
        assert_eq!(spinney_model_rays(model, from, along, count, hits, count, size - 1), SPINNEY_INVALID);
        assert_eq!(spinney_model_rays(model, null(), along, count, hits, count, size), SPINNEY_INVALID);
        let nowhere = [0.0; 3];
        assert_eq!(spinney_model_rays(model, from, nowhere.as_ptr(), 1, hits, 1, size), SPINNEY_INVALID);
        spinney_model_close(model);
    }
}

#[test]
fn shells_are_those_of_the_library() {
    let (library, model) = (chapel(), open_model("chapel.goblin", 0).unwrap());
    let topology = Topology::of(&library, &TopologyOptions::default(), &()).unwrap();
    let size = size_of::<spinney_shell>();
    let (mut shells, mut count) = ([NO_SHELL; 9], 0);
    unsafe {
        let done = spinney_model_shells(model, 1 << 30, shells.as_mut_ptr(), 9, size, &mut count);
        assert_eq!((done, count), (SPINNEY_OK, topology.shells() as usize));
        let volume: f64 = shells[..count].iter().map(|shell| shell.volume).sum();
        let expected = MassProperties::of(&library, &()).unwrap().volume;
        assert!((volume - expected).abs() < 1e-9 * expected);
        for (shell, expected) in shells.iter().zip(topology.counts_by_shell()) {
            let found = (shell.vertices, shell.edges, shell.faces, shell.inner_rings, shell.boundaries);
            let of = (expected.vertices, expected.edges, expected.faces, expected.rings, expected.boundaries);
            assert_eq!((found, shell.genus), (of, expected.genus().map_or(-1, |genus| genus as i64)));
        }
        assert_eq!(shells[count].faces, 9, "nothing is written after them");
        // A shorter buffer, no buffer, and arguments that are refused.
        let done = spinney_model_shells(model, 1 << 30, shells.as_mut_ptr(), 1, size, &mut count);
        assert_eq!((done, count), (SPINNEY_OK, topology.shells() as usize));
        assert_eq!(spinney_model_shells(model, 1 << 30, null_mut(), 0, size, &mut count), SPINNEY_OK);
        assert_eq!(spinney_model_shells(model, 100, null_mut(), 0, size, &mut count), SPINNEY_MEMORY);
        assert_eq!(spinney_model_shells(model, 1 << 30, null_mut(), 3, size, &mut count), SPINNEY_INVALID);
        assert_eq!(spinney_model_shells(model, 1 << 30, null_mut(), 0, 3, &mut count), SPINNEY_INVALID);
        assert_eq!(spinney_model_shells(model, 1 << 30, null_mut(), 0, size, null_mut()), SPINNEY_INVALID);
        spinney_model_close(model);
    }
}

#[test]
fn models_are_combined() {
    let model = open_model("chapel.goblin", 0).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("made.goblin");
    let name = CString::new(path.to_str().unwrap()).unwrap();
    let both = [model.cast_const(), model.cast_const()];
    let volume = || {
        let made = ExactModel::open(&path, &Default::default()).unwrap();
        MassProperties::of(&made, &()).unwrap().volume
    };
    unsafe {
        let combine =
            |operation| spinney_model_combine(operation, both.as_ptr(), 2, name.as_ptr(), 256 << 20);
        assert_eq!(combine(7), SPINNEY_OK);
        assert_eq!(volume(), MassProperties::of(&chapel(), &()).unwrap().volume);
        assert_eq!(combine(2), SPINNEY_OK);
        assert_eq!(volume(), 0.0);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(combine(16), SPINNEY_INVALID);
        let missing = [model.cast_const(), null()];
        let done = spinney_model_combine(7, missing.as_ptr(), 2, name.as_ptr(), 256 << 20);
        assert_eq!(done, SPINNEY_INVALID);
        assert_eq!(spinney_model_combine(7, both.as_ptr(), 0, name.as_ptr(), 256 << 20), SPINNEY_INVALID);
        assert_eq!(spinney_model_combine(7, null(), 2, name.as_ptr(), 256 << 20), SPINNEY_INVALID);
        assert_eq!(spinney_model_combine(7, both.as_ptr(), 2, null(), 256 << 20), SPINNEY_INVALID);
        assert!(!path.exists());
        spinney_model_close(model);
    }
}
