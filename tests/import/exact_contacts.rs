//! Objects that overlap or touch.

use std::collections::BTreeMap;
use std::path::Path;

use spinney::brep::Grid;
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::{ContactKind, FaceList, ObjectContact, object_contacts};
use spinney::raw::import::mesh::{ModelContact, model_contacts};
use spinney::{Error, ExactModel, OpenOptions, Output};

use crate::common::exact::{cuboid, push, turned};
use crate::common::{Random, shared_data};

type Block = [[i32; 3]; 2];

fn grid() -> Grid {
    Grid { bits: 6, origin: [0; 3], step: 0.5, divisor: 1.0 }
}

/// Returns boxes, each an object.
fn boxes(blocks: &[Block]) -> FaceList {
    let mut list = FaceList::new(grid(), Vec::new());
    for (part, [low, high]) in (0..).zip(blocks) {
        cuboid(*low, *high).iter().for_each(|rings| push(&mut list, rings, part, None));
    }
    list
}

fn contacts(faces: FaceList, most: usize) -> (Vec<ObjectContact>, Vec<u32>) {
    let mut found = Vec::new();
    let open = object_contacts(faces, Path::new("boxes"), 64 << 20, &(), &mut |contact| {
        found.push(*contact);
        Ok(found.len() < most)
    });
    (found, open.unwrap())
}

/// Returns the intersection of two boxes, if any.
fn common([low, high]: &Block, [other_low, other_high]: &Block) -> Option<Block> {
    let least = [0, 1, 2].map(|axis| low[axis].max(other_low[axis]));
    let most = [0, 1, 2].map(|axis| high[axis].min(other_high[axis]));
    (0..3).all(|axis| least[axis] <= most[axis]).then_some([least, most])
}

/// Returns the contact kind of two boxes, and the size of their intersection in grid units.
fn expected(one: &Block, other: &Block) -> Option<(ContactKind, i32, i32)> {
    let [low, high] = common(one, other)?;
    let sides = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    let mut wide: Vec<i32> = sides.into_iter().filter(|side| *side > 0).collect();
    if wide.len() == 3 {
        let kind = match ([low, high] == *one, [low, high] == *other) {
            (true, true) => ContactKind::Equal,
            (true, false) => ContactKind::Within,
            (false, true) => ContactKind::Contains,
            (false, false) => ContactKind::Overlap,
        };
        return Some((kind, wide.drain(..).product(), 0));
    }
    let area = if wide.len() == 2 { wide[0] * wide[1] } else { 0 };
    Some((ContactKind::Touch, 0, area))
}

/// Random boxes have the contacts that their sides imply.
#[test]
fn boxes_meet_as_their_sides_say() {
    let mut random = Random(5);
    let mut blocks: Vec<Block> = (0..60)
        .map(|_| {
            let low = [0; 3].map(|_| random.below(24) as i32 * 2);
            [low, low.map(|at| at + 2 + random.below(7) as i32 * 2)]
        })
        .collect();
    blocks.extend([blocks[7], [[0; 3], [62; 3]]]);
    let (found, open) = contacts(boxes(&blocks), usize::MAX);
    let mut kinds: BTreeMap<&str, u32> = BTreeMap::new();
    let mut next = found.iter();
    for one in 0..blocks.len() {
        for other in one + 1..blocks.len() {
            let Some((kind, volume, area)) = expected(&blocks[one], &blocks[other]) else { continue };
            let contact = next.next().unwrap();
            assert_eq!((contact.parts, contact.kind), ([one as u32, other as u32], kind));
            assert_eq!(contact.volume, f64::from(volume) / 8.0, "{contact:?}");
            assert_eq!(contact.area, f64::from(area) / 4.0, "{contact:?}");
            let [low, high] = common(&blocks[one], &blocks[other]).unwrap();
            for (axis, at) in contact.place.into_iter().enumerate() {
                assert!((f64::from(low[axis])..=f64::from(high[axis])).contains(&(2.0 * at)), "{contact:?}");
            }
            *kinds.entry(kind.name()).or_default() += 1;
        }
    }
    assert_eq!((next.len(), open), (0, vec![]));
    assert_eq!(
        kinds.keys().copied().collect::<Vec<_>>(),
        ["contains", "equal", "overlap", "touch", "within"]
    );
    // The search stops at the limit, and fails with too little memory.
    assert_eq!(contacts(boxes(&blocks), 3).0, found[..3]);
    let error = object_contacts(boxes(&blocks), Path::new("boxes"), 1 << 10, &(), &mut |_| Ok(true));
    assert!(matches!(error, Err(Error::TooLarge { .. })), "{error:?}");
}

/// Inside-out solids have an inside, cavities do not, and open objects are skipped.
#[test]
fn objects_may_be_flawed() {
    let mut list = FaceList::new(grid(), Vec::new());
    let mut add = |part: u32, low: i32, high: i32, is_turned: bool, sides: usize| {
        let faces = cuboid([low; 3], [high; 3]);
        let faces = if is_turned { turned(faces) } else { faces };
        faces.iter().take(sides).for_each(|rings| push(&mut list, rings, part, None));
    };
    add(0, 0, 20, false, 6);
    add(0, 4, 16, true, 6);
    // In the cavity of the first one, and in its wall, inside out; and an open one.
    add(1, 6, 10, false, 6);
    add(2, 1, 3, true, 6);
    add(3, 2, 12, false, 5);
    let (found, open) = contacts(list, usize::MAX);
    let kinds: Vec<_> = found.iter().map(|contact| (contact.parts, contact.kind, contact.volume)).collect();
    assert_eq!(kinds, [([0, 2], ContactKind::Contains, 1.0)]);
    assert_eq!(open, [3]);
}

fn of_file(path: &Path) -> Vec<ModelContact> {
    let mut found = Vec::new();
    let models = open_all(&[path.to_path_buf()], 64 << 20).unwrap();
    model_contacts(models, &ExactOptions::new(), &(), &mut |contact| {
        found.push(contact.clone());
        Ok(true)
    })
    .unwrap();
    found
}

/// A mesh file's objects and those of the exact model built from it have the same contacts.
#[test]
fn objects_of_files_meet() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let mut text = String::new();
    let mut first = 1;
    for (name, [low, high]) in [("a", [0, 4]), ("b", [4, 9]), ("c", [20, 21])] {
        text += &format!("o {name}\n");
        for rings in cuboid([low; 3], [high; 3]) {
            let ring = &rings[0];
            ring.iter().for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\n"));
            let numbers: Vec<String> = (first..first + ring.len()).map(|number| number.to_string()).collect();
            first += ring.len();
            text += &format!("f {}\n", numbers.join(" "));
        }
    }
    std::fs::write(at("a.obj"), text).unwrap();
    let found = of_file(&at("a.obj"));
    let [ModelContact { names, contact, .. }] = &found[..] else { panic!("{found:?}") };
    assert_eq!((names.join(" "), contact.kind, contact.place), ("a b".into(), ContactKind::Touch, [4.0; 3]));
    let models = open_all(&[at("a.obj")], 64 << 20).unwrap();
    import_exact(models, &ExactOptions::new(), Output::create(&at("a.goblin")).unwrap(), &()).unwrap();
    let model = ExactModel::open(&at("a.goblin"), &OpenOptions::new()).unwrap();
    let mut again = Vec::new();
    let open = model.object_contacts(64 << 20, &(), &mut |contact| {
        again.push(*contact);
        Ok(true)
    });
    assert_eq!((again, open.unwrap()), (vec![*contact], vec![]));
}

/// Contacts of objects with off-grid vertices are exact.
#[test]
fn repaired_objects_meet() {
    let directory = tempfile::tempdir().unwrap();
    let [mesh, path] = ["a.obj", "a.goblin"].map(|name| directory.path().join(name));
    // Two tetrahedra that intersect, and one at a vertex of their intersection.
    let text = "o one\nv 0 0 0\nv 7 0 0\nv 0 7 0\nv 0 0 7\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\nv 1 1 1\nv 9 1 2\nv 2 8 1\nv 1 2 9\n\
                f 5 7 6\nf 5 6 8\nf 5 8 7\nf 6 7 8\no other\nv 10 1 2\nv 10 2 2\nv 10 1 3\nf 6 10 9\nf 6 9 11\nf 6 11 10\nf 9 10 11\n";
    std::fs::write(&mesh, text).unwrap();
    let mut options = ExactOptions::new();
    (options.repair, options.snap) = (true, Some(1.0));
    let models = open_all(&[mesh], 64 << 20).unwrap();
    import_exact(models, &options, Output::create(&path).unwrap(), &()).unwrap();
    let model = ExactModel::open(&path, &OpenOptions::new()).unwrap();
    assert!(model.exact_faces().0 > 0);
    let mut found = Vec::new();
    let open = model.object_contacts(64 << 20, &(), &mut |contact| {
        found.push((contact.kind, contact.area, contact.place));
        Ok(true)
    });
    assert_eq!((found, open.unwrap()), (vec![(ContactKind::Touch, 0.0, [9.0, 1.0, 2.0])], vec![]));
}

/// Buildings of a real file, some of which touch or intersect.
#[test]
fn real_objects_meet() {
    let Some(path) = shared_data().map(|data| data.join("mesh/cityjson/DH_01_subs.city.json")) else {
        return;
    };
    if !path.exists() {
        eprintln!("skipped: {} is not there", path.display());
        return;
    }
    let found = of_file(&path);
    let count = |kind: ContactKind| found.iter().filter(|found| found.contact.kind == kind).count();
    assert_eq!((count(ContactKind::Touch), count(ContactKind::Overlap), found.len()), (4, 1, 5));
    let volume: f64 = found.iter().map(|found| found.contact.volume).sum();
    assert!((0.004..0.005).contains(&volume), "{volume}");
    assert!(found.iter().any(|found| found.contact.area > 20.0));
}
