//! Surfaces of exact models for viewpoints: closed, fine where the eye is near, and within a number
//! of faces.

use spinney::brep::{Faces, SurfaceDetail, Viewpoint};
use spinney::raw::brep::FaceList;
use spinney::{Error, ExactModel};

use super::exact_levels::{
    boxes_that_touch, built_model, by_part, check_surface, grid, materials_around_a_cavity, unit,
    with_levels_of,
};
use crate::common::Random;
use crate::common::exact::bumpy_torus;

/// Returns a viewpoint in or near the model's box that sees everything, at any error.
fn somewhere(model: &ExactModel, random: &mut Random) -> Viewpoint {
    let side = f64::from(1u32 << model.grid().bits);
    let at = [0; 3].map(|_| side * (3.0 * unit(random) - 1.0));
    let eye = [0, 1, 2].map(|axis| (at[axis] + model.grid().origin[axis] as f64) * model.grid().width());
    let tolerance = 10f64.powf(-5.0 + 4.0 * unit(random));
    Viewpoint { eye, tolerance, half_spaces: Vec::new(), faces: u64::MAX }
}

/// Returns the minimum and maximum world coordinates of faces.
fn world_box(faces: &dyn Faces) -> [[f64; 3]; 2] {
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    faces
        .each(&mut |face| {
            for point in face.points {
                let at = faces.grid().to_world(*point);
                bounds[0] = [0, 1, 2].map(|axis| bounds[0][axis].min(at[axis]));
                bounds[1] = [0, 1, 2].map(|axis| bounds[1][axis].max(at[axis]));
            }
            Ok(())
        })
        .unwrap();
    bounds
}

fn distance(eye: [f64; 3], [low, high]: [[f64; 3]; 2]) -> f64 {
    let gaps = [0, 1, 2].map(|axis| (low[axis] - eye[axis]).max(eye[axis] - high[axis]).max(0.0));
    gaps.iter().map(|gap| gap * gap).sum::<f64>().sqrt()
}

/// Checks the surfaces for random viewpoints; returns how many have clusters of several errors.
fn check_views(list: &FaceList, count: usize) -> usize {
    let model = with_levels_of(list);
    let (exact, coarsest) = (by_part(&model), model.levels()[0].faces);
    let mut random = Random(11);
    let mut has_several = 0;
    for number in 0..count {
        let mut view = somewhere(&model, &mut random);
        match number % 3 {
            0 => (),
            1 => view.faces = coarsest + random.next() % model.len(),
            _ => {
                let normal = [0; 3].map(|_| unit(&mut random) - 0.5);
                let through = somewhere(&model, &mut random).eye;
                let constant = -(0..3).map(|axis| normal[axis] * through[axis]).sum::<f64>();
                view.half_spaces = vec![[normal[0], normal[1], normal[2], constant]];
            }
        }
        let surface = model.at_view(&view).unwrap();
        check_surface(&exact, &surface, &format!("{view:?}"));
        assert!(surface.len() <= view.faces);
        let clusters = surface.by_cluster().unwrap();
        let mut errors: Vec<f64> = clusters.iter().map(|cluster| cluster.error()).collect();
        errors.dedup();
        has_several += usize::from(errors.len() > 1);
        if number % 3 > 0 {
            continue;
        }
        for cluster in &clusters {
            // (The faces that a cluster replaces are nearer by at most its error, or further.)
            let seen = distance(view.eye, world_box(cluster)) + cluster.error();
            let bound = view.tolerance * seen.max(model.grid().width());
            assert!(cluster.error() <= bound * (1.0 + 1e-9), "{view:?}: {}, not {bound}", cluster.error());
        }
    }
    has_several
}

#[test]
fn surfaces_for_viewpoints_are_closed_and_as_fine_as_seen() {
    let has_several = check_views(&bumpy_torus(160, 100, grid(16)), 90);
    assert!(has_several > 20, "{has_several} surfaces of several levels");
}

#[test]
fn objects_stay_closed_for_viewpoints() {
    let has_several = check_views(&boxes_that_touch(), 90);
    assert!(has_several > 20, "{has_several} surfaces of several levels");
}

#[test]
fn materials_and_cavities_stay_closed_for_viewpoints() {
    check_views(&materials_around_a_cavity(), 30);
}

#[test]
fn surfaces_are_coarse_far_away_and_where_nothing_is_seen() {
    let model = with_levels_of(&bumpy_torus(160, 100, grid(16)));
    let levels = model.levels();
    let [low, high] = world_box(&model);
    let eye = [low[0] - 5.0, (low[1] + high[1]) / 2.0, (low[2] + high[2]) / 2.0];
    let tolerance = levels[1].error * model.grid().width() / 20.0;
    let view = Viewpoint { eye, tolerance, half_spaces: Vec::new(), faces: u64::MAX };
    let near = model.at_view(&view).unwrap();
    let far = model.at_view(&Viewpoint { eye: [1e9; 3], ..view.clone() }).unwrap();
    assert_eq!(far.len(), levels[0].faces);
    let unseen = Viewpoint { half_spaces: vec![[0.0, 0.0, 0.0, -1.0]], ..view.clone() };
    assert_eq!(model.at_view(&unseen).unwrap().len(), levels[0].faces);
    let exact = model.at_view(&Viewpoint { tolerance: 0.0, ..view.clone() }).unwrap();
    assert!(exact.is_exact() && exact.len() == model.len());
    assert!(far.len() < near.len() && near.len() < model.len(), "{} faces", near.len());
    // Half of the model is seen.
    let half = Viewpoint { half_spaces: vec![[1.0, 0.0, 0.0, -low[0] - 40.0]], ..view.clone() };
    let half = model.at_view(&half).unwrap();
    assert!(half.len() < near.len(), "{} of {}", half.len(), near.len());
    // A number of faces is used as far as groups allow.
    let few = model.at_view(&Viewpoint { tolerance: 0.0, faces: 4000, ..view.clone() }).unwrap();
    assert!((1000..=4000).contains(&few.len()), "{} faces", few.len());
}

#[test]
fn clusters_are_read_by_their_numbers() {
    let model = with_levels_of(&bumpy_torus(160, 100, grid(16)));
    let faces = |faces: &dyn Faces| {
        let mut found = Vec::new();
        faces
            .each(&mut |face| {
                found.push(face.points.to_vec());
                Ok(())
            })
            .unwrap();
        found.sort();
        found
    };
    for detail in [SurfaceDetail::Faces(9000), SurfaceDetail::Error(0.0), SurfaceDetail::Level(0)] {
        let surface = model.surface(detail, None, &()).unwrap();
        let again = model.of_clusters(surface.numbers()).unwrap();
        assert_eq!(faces(&again), faces(&surface));
        assert_eq!((again.len(), again.error()), (surface.len(), surface.error()));
        let by_cluster = surface.by_cluster().unwrap();
        assert_eq!(by_cluster.iter().flat_map(|cluster| cluster.numbers()).count(), surface.numbers().len());
        let mut all: Vec<_> = by_cluster.iter().flat_map(|cluster| faces(cluster)).collect();
        all.sort();
        assert_eq!(all, faces(&surface));
    }
    let twice = model.of_clusters(&[1, 0, 1]).unwrap();
    assert_eq!(twice.numbers(), [0, 1]);
    assert_eq!(model.of_clusters(&[]).unwrap().len(), 0);
    for number in [1000, 1 << 20, u64::MAX] {
        let error = model.of_clusters(&[0, number]).err().unwrap().to_string();
        assert!(error.contains(&number.to_string()), "{error}");
    }
}

#[test]
fn viewpoints_are_checked() {
    let list = bumpy_torus(60, 40, grid(16));
    let model = with_levels_of(&list);
    let view = Viewpoint { eye: [0.0; 3], tolerance: 0.1, half_spaces: Vec::new(), faces: u64::MAX };
    let invalid = [
        (Viewpoint { tolerance: -1.0, ..view.clone() }, "tolerance"),
        (Viewpoint { tolerance: f64::NAN, ..view.clone() }, "tolerance"),
        (Viewpoint { eye: [0.0, f64::INFINITY, 0.0], ..view.clone() }, "viewpoint"),
        (Viewpoint { half_spaces: vec![[1e300; 4]], ..view.clone() }, "viewpoint"),
        (Viewpoint { faces: 1, ..view.clone() }, "at least"),
    ];
    for (view, expected) in invalid {
        let error = model.at_view(&view).err().unwrap();
        assert!(matches!(error, Error::Invalid { .. }) && error.to_string().contains(expected), "{error}");
    }
    let without = built_model(&list);
    let errors = [without.at_view(&view).err(), without.of_clusters(&[0]).err()];
    assert!(errors.iter().all(|error| error.as_ref().unwrap().to_string().contains("levels -o")));
}
