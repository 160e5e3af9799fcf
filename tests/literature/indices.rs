//! Tyukachev's indices of sets and of boundaries: which boundary components of two surfaces a set
//! operation selects.

use std::path::{Path, PathBuf};

use spinney::brep::{Faces as _, MassProperties};
use spinney::raw::brep::boundary_classes;
use spinney::raw::brep::surface_intersection::{LineKind, surface_intersection};
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::{CombineOperation, ExactModel, SetOperation};

use crate::common::command::{complaint, stdout};
use crate::common::{QUAD, assert_same, byte, cells_of, combined, made, seen, set_operation, view_of_cells};

/// The sets on both sides of the boundaries with each index, 1 to 5. Corrects a misprint: index 3
/// has the complement, where the paper says the intersection, and two pairs.
const PAIRS: [&[[u8; 2]]; 5] = [&[[0, 1]], &[[0, 2]], &[[0, 3], [1, 2]], &[[1, 3]], &[[2, 3]]];

/// Cells of the four sets in index order: A consists of the sets 0 and 1, or 3; B of 0 and 2, or 5;
/// and each operation has the sets whose bits its number has.
#[test]
fn item_55_operations_are_numbered_by_their_sets() {
    let cells = |sets: u8| {
        view_of_cells(&made(QUAD, [2, 2, 1], |[x, y, _]| (sets >> (x + 2 * y) & 1 == 1).then(|| byte(1))))
    };
    let (a, b) = (cells(0b0011), cells(0b0101));
    for number in 0..16 {
        let operation = CombineOperation::set(set_operation(number));
        let found = combined(vec![a.clone(), b.clone()], operation, [2, 2, 1]).filled_with(byte(1)).unwrap();
        assert_same(&cells_of(&found, [2, 2, 1]), &seen(&cells(number)), &number.to_string());
    }
}

#[test]
fn item_56_indices_of_boundaries() {
    let mut pairs: Vec<(u8, [u8; 2])> =
        (1..).zip(PAIRS).flat_map(|(index, pairs)| pairs.iter().map(move |pair| (index, *pair))).collect();
    pairs.sort_unstable();
    for operation in SetOperation::ALL {
        let mut found: Vec<_> =
            boundary_classes(operation).iter().map(|part| (part.index(), part.sets)).collect();
        found.sort_unstable();
        assert_eq!(found, pairs);
    }
}

/// The theorem: the result has the boundaries between sets of which exactly one belongs to it.
#[test]
fn item_57_the_theorem_of_indices() {
    for operation in SetOperation::ALL {
        let has = |set: u8| operation.index() >> set & 1 == 1;
        for part in boundary_classes(operation) {
            let [back, front] = part.sets;
            assert_eq!(part.is_taken(), has(back) != has(front), "{operation}: {}", part.name);
            assert_eq!(part.is_turned(), !has(back) && has(front), "{operation}: {}", part.name);
        }
    }
    let indices = |operation: SetOperation| {
        let parts = boundary_classes(operation).into_iter();
        let mut taken: Vec<_> =
            parts.filter(|part| part.is_taken()).map(|part| (part.index(), part.sets)).collect();
        taken.sort_unstable();
        taken
    };
    // The paper's rows of the intersection and of the symmetric difference. For index 3, the
    // intersection has the faces with equal orientation, and the difference none.
    assert_eq!(indices(SetOperation::Intersection), [(1, [0, 1]), (2, [0, 2]), (3, [0, 3])]);
    assert_eq!(
        indices(SetOperation::SymmetricDifference),
        [(1, [0, 1]), (2, [0, 2]), (4, [1, 3]), (5, [2, 3])]
    );
    // The empty set and the whole space have no boundary, not even in single points.
    assert!(indices(SetOperation::Empty).is_empty() && indices(SetOperation::Everything).is_empty());
}

/// Two solids with all kinds of boundary components, whose areas identify which of them a result
/// has.
const A: &str = "block(0,0,0, 4,4,4)";
const B: &str = "union(block(2,1,0, 7,3,3), block(-2,1,1, 0,2,2))";

/// Areas of their boundary components, in the order of [`boundary_classes`]. All subset sums
/// differ.
const AREAS: [f64; 6] = [85.0, 6.0, 45.0, 22.0, 4.0, 1.0];
/// Volumes of the sets.
const VOLUMES: [f64; 3] = [12.0, 52.0, 20.0];

fn bodies(directory: &Path) -> [String; 2] {
    [("a", A), ("b", B)].map(|(name, text)| {
        let [csg, model] = ["csg", "goblin"]
            .map(|ending| directory.join(name).with_extension(ending).to_str().unwrap().to_string());
        std::fs::write(&csg, text).unwrap();
        stdout(&["build", "-q", &csg, "-o", &model, "--brep", "--snap", "0.5"]);
        model
    })
}

/// All sixteen results have exactly the faces that the table lists.
#[test]
fn item_57_faces_of_all_sixteen_operations() {
    let directory = tempfile::tempdir().unwrap();
    let [a, b] = bodies(directory.path());
    for operation in 0..16u8 {
        let path: PathBuf = directory.path().join(format!("{operation}.goblin"));
        let out = path.to_str().unwrap();
        let printed = stdout(&["combine", "-q", &operation.to_string(), &a, &b, "-o", out, "--explain"]);
        let parts = boundary_classes(set_operation(operation));
        for part in &parts {
            let line = printed.lines().find(|line| line.contains(part.name)).unwrap();
            let taken = match (part.is_taken(), part.is_turned()) {
                (false, _) => "no",
                (_, false) => "yes",
                (_, true) => "reversed",
            };
            assert!(line.trim().starts_with(&part.index().to_string()) && line.ends_with(taken), "{line}");
        }
        let model = ExactModel::open(&path, &Default::default()).unwrap();
        let found = MassProperties::of(&model, &()).unwrap();
        let taken = parts.iter().zip(AREAS).filter(|(part, _)| part.is_taken()).map(|(_, area)| area);
        assert!((found.area - taken.sum::<f64>()).abs() < 1e-9, "operation {operation}");
        assert_eq!(model.is_unbounded(), operation >= 8);
        if operation < 8 {
            let inside = (0..3).filter(|set| operation >> set & 1 == 1).map(|set: usize| VOLUMES[set]);
            assert!((found.volume - inside.sum::<f64>()).abs() < 1e-9, "operation {operation}");
        }
    }
}

#[test]
fn item_57_what_cannot_be_explained() {
    let directory = tempfile::tempdir().unwrap();
    let [a, b] = bodies(directory.path());
    let out = directory.path().join("out.goblin");
    let out = out.to_str().unwrap();
    let message = complaint(&["combine", "or", &a, &b, &a, "-o", out, "--explain"], 1);
    assert!(message.contains("got 3 models, expected 2"), "{message}");
    let cells = directory.path().join("cells.goblin");
    let cells = cells.to_str().unwrap();
    stdout(&["build", "-q", &a, "-o", cells, "--cells", "8"]);
    let message = complaint(&["combine", "or", cells, cells, "-o", out, "--explain"], 1);
    assert!(message.contains("exact models"), "{message}");
}

fn open(path: &str) -> ExactModel {
    ExactModel::open(Path::new(path), &Default::default()).unwrap()
}

fn exact(directory: &Path, name: &str, text: &str) -> String {
    let [csg, model] = ["csg", "goblin"]
        .map(|ending| directory.join(name).with_extension(ending).to_str().unwrap().to_string());
    std::fs::write(&csg, text).unwrap();
    stdout(&["build", "-q", &csg, "-o", &model, "--brep", "--snap", "0.125", "--deviation", "0.1"]);
    model
}

/// After splitting, the section's segments are edges of both solids, which are complete and
/// unchanged.
#[test]
fn item_63_sections_are_edges_of_both() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [a2, b2, rest] = ["a2.goblin", "b2.goblin", "rest.goblin"].map(name);
    let pairs = [
        // Three edges of each pass through faces of the other.
        (A, "block(3,2,1, 9,8,7)", true),
        // A rod through a face, far from its edges: an island, and a hole around it.
        (A, "block(1,1,2, 2,3,9)", true),
        // Coincident walls of both orientations, and a hole that the section does not enclose.
        ("difference(block(0,0,0, 8,8,4), block(2,3,-1, 6,5,5))", B, true),
        ("difference(block(0,0,0, 8,8,4), block(2,3,-1, 6,5,5))", "block(4,-1,1, 5,9,9)", true),
        // Off-grid vertices.
        (A, "rotate(1,2,3, 40, block(1,1,1, 5,4,6))", false),
        ("rotate(3,1,2, 70, block(0,0,0, 4,4,4))", "cylinder(1,1,-3, 2,1,7, 1)", false),
    ];
    for (one, other, is_on_grid) in pairs {
        let (a, b) = (exact(directory.path(), "a", one), exact(directory.path(), "b", other));
        stdout(&["section", "-q", &a, &b, "--split", &a2, "--split-other", &b2]);
        let found = surface_intersection(&open(&a), &open(&b), 64 << 20, &()).unwrap();
        assert!(!found.lines.is_empty());
        for (before, after) in [(&a, &a2), (&b, &b2)] {
            let (before_model, model) = (open(before), open(after));
            assert_eq!(model.verify(64 << 20, &()).unwrap(), vec![], "{one} {other}");
            assert!(model.len() > before_model.len() && model.parts() == before_model.parts());
            let [was, is] = [&before_model, &model].map(|model| MassProperties::of(model, &()).unwrap());
            if is_on_grid {
                assert_eq!((was.volume, was.area), (is.volume, is.area), "{one} {other}");
            } else {
                assert!((was.volume - is.volume).abs() < 1e-9 * was.volume, "{one} {other}");
            }
            // The same solid, exactly.
            stdout(&["combine", "-q", "xor", before, after, "-o", &rest]);
            assert_eq!(open(&rest).len(), 0, "{one} {other}");
            let topology = Topology::of(&model, &TopologyOptions::default(), &()).unwrap();
            assert!(topology.is_closed());
            let was = Topology::of(&before_model, &TopologyOptions::default(), &()).unwrap();
            assert_eq!(topology.euler().genus, was.euler().genus);
            let crossings = found.lines.iter().filter(|line| line.kind == LineKind::Crossing);
            for ends in crossings.flat_map(|line| line.points.windows(2)).filter(|_| is_on_grid) {
                let [from, to] = [ends[0], ends[1]].map(|end| model.grid().snap(end).unwrap());
                let is_edge = topology.vertices_at(from).any(|vertex| {
                    topology.neighbours_of_vertex(vertex).any(|next| topology.point(next) == to)
                });
                assert!(is_edge, "{one} {other}: {from:?} to {to:?} is no edge");
            }
        }
        if !is_on_grid {
            continue;
        }
        // Splitting again changes nothing.
        let a3 = name("a3.goblin");
        stdout(&["section", "-q", &a2, &b2, "--split", &a3]);
        assert_eq!(open(&a3).len(), open(&a2).len(), "{one} {other}");
    }
}

#[test]
fn item_63_what_cannot_be_divided() {
    let directory = tempfile::tempdir().unwrap();
    let [a, b] = bodies(directory.path());
    let out = directory.path().join("out.goblin");
    let out = out.to_str().unwrap();
    let message = complaint(&["section", &a, "z=1", "--split", out], 1);
    assert!(message.contains("only with another model"), "{message}");
    let message = complaint(&["section", &a, &b, "--split", out, "--split-other", out], 1);
    assert!(message.contains("two outputs"), "{message}");
    let message = complaint(&["section", &a, &b, "--split", &b], 1);
    assert!(message.contains("is an input"), "{message}");
    assert!(complaint(&["section", &a, &b], 2).contains("--output"));
}
