//! Random files, compared with the `tobj` crate.

use std::fmt::Write;

use super::super::model_file::ModelFile;
use super::open;

/// Small deterministic random number generator (xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }
}

/// Face: the name of its part, and the points and colours of its corners.
type Face = (String, Vec<[f64; 3]>, Vec<[u8; 3]>);

/// File that both readers support: colours at all vertices or none, objects without groups.
fn random_text(random: &mut Random) -> String {
    let (is_coloured, has_objects) = (random.below(2) == 0, random.below(2) == 0);
    let (mut text, mut vertices) = (String::from("vt 0 0\nvn 0 0 1\n"), 0u64);
    for _ in 0..1 + random.below(30) {
        if vertices < 4 || random.below(3) == 0 {
            // (Points are distinct, so that faces keep all corners.)
            for _ in 0..3 {
                vertices += 1;
                write!(text, "v {vertices} {}e-3 -.{}", random.below(1 << 40), random.below(1000)).unwrap();
                if is_coloured {
                    write!(text, " {} 1 .25", random.below(100) as f64 / 99.0).unwrap();
                }
                text.push('\n');
            }
        }
        if has_objects && random.below(4) == 0 {
            writeln!(text, "o part {}", random.below(3)).unwrap();
        }
        let (first, corners) = (random.below(vertices), (3 + random.below(5)).min(vertices));
        let form = random.below(4);
        text.push('f');
        for corner in 0..corners {
            let vertex = ((first + corner) % vertices + 1) as i64;
            match form {
                0 => write!(text, " {vertex}").unwrap(),
                1 => write!(text, " {}", vertex - vertices as i64 - 1).unwrap(),
                2 => write!(text, " {vertex}/1/-1").unwrap(),
                _ => write!(text, "\t{vertex}//1").unwrap(),
            }
        }
        text.push_str(if random.below(2) == 0 { "\n" } else { " \r\n" });
    }
    text
}

fn by_tobj(text: &str) -> Vec<Face> {
    let options = tobj::LoadOptions { triangulate: false, single_index: false, ..Default::default() };
    let no_materials = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials).unwrap();
    let mut range = super::ColourRange::default();
    models.iter().flat_map(|model| &model.mesh.vertex_color).for_each(|number| range.add(*number));
    let mut faces = Vec::new();
    for model in models {
        let mesh = model.mesh;
        let (points, _) = mesh.positions.as_chunks::<3>();
        let (colours, _) = mesh.vertex_color.as_chunks::<3>();
        let mut indices = mesh.indices.as_slice();
        // Without arities, all faces are triangles.
        let arities = match mesh.face_arities.is_empty() {
            true => vec![3; indices.len() / 3],
            false => mesh.face_arities,
        };
        let name = if model.name == "unnamed_object" { "mesh".into() } else { model.name };
        for arity in arities {
            let face;
            (face, indices) = indices.split_at(arity as usize);
            let points = face.iter().map(|index| points[*index as usize]).collect();
            let colour = |index: &u32| colours.get(*index as usize);
            let colours = face.iter().filter_map(colour).map(|colour| range.colour(*colour));
            faces.push((name.clone(), points, colours.collect()));
        }
    }
    faces
}

fn by_open(text: &str, memory: u64) -> Vec<Face> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.obj");
    std::fs::write(&path, text).unwrap();
    let mut model = open(ModelFile::open(&path, &Default::default()).unwrap(), memory).unwrap();
    let parts = model.info().parts.clone();
    let mut faces = Vec::new();
    let mut keep = |face: &super::MeshFace<'_>| {
        faces.push((parts[face.part as usize].clone(), face.points.to_vec(), face.colours.to_vec()));
        Ok(())
    };
    model.faces(&mut keep).unwrap();
    faces
}

#[test]
fn faces_are_those_of_tobj() {
    let mut random = Random(0x5eed);
    for _ in 0..200 {
        let text = random_text(&mut random);
        let expected = by_tobj(&text);
        assert!(!expected.is_empty());
        assert!(by_open(&text, 1 << 20) == expected, "{text}");
    }
}

#[test]
fn tables_on_disk_have_the_same_faces() {
    let mut text = String::new();
    for at in 0..60_000u64 {
        writeln!(text, "v {at} {} {}", at * 7919 % 60_000, at % 3).unwrap();
    }
    for at in 0..200_000u64 {
        let corner = |step: u64| (at * step) % 59_000 + 1;
        writeln!(text, "f {} {} {}", corner(1), corner(7) + 500, corner(131) + 1000).unwrap();
    }
    let [memory, disk] = [1 << 30, 1].map(|memory| by_open(&text, memory));
    assert!(memory == disk && memory.len() > 190_000, "{}", memory.len());
}

#[test]
fn colours_have_one_range_in_a_file() {
    let text = |colours: [&str; 3]| {
        let [a, b, c] = colours;
        format!("v 0 0 0 {a}\nv 1 0 0 {b}\nv 0 1 0 {c}\nf 1 2 3\n")
    };
    let colours = |own| by_open(&text(own), 1 << 20).remove(0).2;
    assert_eq!(colours(["0.2 0 1", "1 1 1", "0 0 0"]), [[51, 0, 255], [255; 3], [0; 3]]);
    assert_eq!(colours(["1 0 0", "1 1 1", "0 128 255"]), [[1, 0, 0], [1; 3], [0, 128, 255]]);
    assert_eq!(colours(["1.01 0 0", "1 1 1", "0 0.5 1"]), [[255, 0, 0], [255; 3], [0, 128, 255]]);
}
