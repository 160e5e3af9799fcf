//! Independent readers of mesh files, and properties that every closed mesh has.

use std::collections::HashMap;

/// A mesh as stored in a file.
#[derive(Default)]
pub struct Read {
    pub points: Vec<[f64; 3]>,
    pub faces: Vec<Vec<usize>>,
    /// Numbers that follow each face's vertex list.
    pub extra_numbers: Vec<Vec<u16>>,
}

fn numbers<const N: usize>(bytes: &mut &[u8]) -> [u8; N] {
    let (first, rest) = bytes.split_first_chunk().expect("more bytes");
    *bytes = rest;
    *first
}

pub fn read_ply(mut bytes: &[u8]) -> Read {
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|window| window == end).expect("a header") + end.len();
    let header = std::str::from_utf8(&bytes[..at]).unwrap();
    bytes = &bytes[at..];
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"), "{header}");
    let count = |name: &str| -> usize {
        let line = header.lines().find_map(|line| line.strip_prefix(name)).expect(name);
        line.trim().parse().unwrap()
    };
    let double = header.contains("property double x\nproperty double y\nproperty double z\n");
    assert!(double || header.contains("property float x\nproperty float y\nproperty float z\n"));
    let list = "property list uchar int vertex_indices\n";
    let (_, after) = header.split_once(list).expect("the list");
    let types: Vec<&str> = after.lines().filter_map(|line| line.strip_prefix("property ")).collect();
    let mut read = Read::default();
    for _ in 0..count("element vertex") {
        read.points.push([(); 3].map(|()| {
            if double {
                f64::from_le_bytes(numbers(&mut bytes))
            } else {
                f32::from_le_bytes(numbers(&mut bytes)).into()
            }
        }));
    }
    for _ in 0..count("element face") {
        let [corners] = numbers(&mut bytes);
        let index = |_| i32::from_le_bytes(numbers(&mut bytes)) as usize;
        read.faces.push((0..corners).map(index).collect());
        let extra_numbers = types.iter().map(|kind| match kind.split_once(' ').unwrap().0 {
            "uchar" => numbers::<1>(&mut bytes)[0].into(),
            _ => u16::from_le_bytes(numbers(&mut bytes)),
        });
        read.extra_numbers.push(extra_numbers.collect());
    }
    assert!(bytes.is_empty());
    read
}

pub fn read_obj(bytes: &[u8]) -> Read {
    let mut read = Read::default();
    for line in std::str::from_utf8(bytes).unwrap().lines() {
        let words: Vec<&str> = line.split(' ').collect();
        match words[0] {
            "v" => read.points.push([1, 2, 3].map(|i| words[i].parse().unwrap())),
            "f" => {
                read.faces.push(words[1..].iter().map(|word| word.parse::<usize>().unwrap() - 1).collect())
            }
            _ => assert_eq!(words[0], "#"),
        }
    }
    read
}

pub fn read_off(bytes: &[u8]) -> Read {
    let mut read = Read::default();
    let mut lines = std::str::from_utf8(bytes).unwrap().lines();
    assert_eq!([lines.next(), lines.next()], [Some("OFF"), Some("# made by spinney")]);
    let counts: Vec<usize> = lines.next().unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
    for _ in 0..counts[0] {
        let point: Vec<f64> = lines.next().unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
        read.points.push(point.try_into().unwrap());
    }
    for _ in 0..counts[1] {
        let face: Vec<usize> = lines.next().unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
        read.faces.push(face[1..=face[0]].to_vec());
        read.extra_numbers.push(face[face[0] + 1..].iter().map(|channel| *channel as u16).collect());
    }
    assert_eq!(lines.next(), None);
    read
}

pub fn read_stl(bytes: &[u8]) -> Read {
    assert!(!bytes.starts_with(b"solid"));
    let count = u32::from_le_bytes(bytes[80..84].try_into().unwrap());
    assert_eq!(bytes.len(), 84 + 50 * count as usize);
    let mut read = Read::default();
    let mut known = HashMap::new();
    for triangle in bytes[84..].chunks_exact(50) {
        let number = |i: usize| f32::from_le_bytes(triangle[4 * i..][..4].try_into().unwrap());
        let point = |i: usize| [0, 1, 2].map(|axis| number(3 * i + axis));
        let normal = point(0).map(f64::from);
        let corners = [1, 2, 3].map(|i| {
            let point = point(i);
            *known.entry(point.map(f32::to_bits)).or_insert_with(|| {
                read.points.push(point.map(f64::from));
                read.points.len() - 1
            })
        });
        let [a, b, c] = corners.map(|corner| read.points[corner]);
        let found = cross(minus(b, a), minus(c, a));
        let length = dot(found, found).sqrt();
        assert!((dot(found, normal) - length).abs() < 1e-3 * length, "{normal:?}");
        read.faces.push(corners.to_vec());
    }
    read
}

pub fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] - b[i])
}

pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

impl Read {
    /// Checks that each edge is used equally often in both directions, and that all points are
    /// distinct and used.
    pub fn check_closed(&self, what: &str) {
        let mut edges = HashMap::new();
        let mut used = vec![false; self.points.len()];
        for face in &self.faces {
            assert!(face.len() >= 3, "{what}");
            for (i, from) in face.iter().enumerate() {
                let to = face[(i + 1) % face.len()];
                assert_ne!(*from, to, "{what}");
                used[to] = true;
                *edges.entry((*from.min(&to), *from.max(&to))).or_insert(0) +=
                    if *from < to { 1 } else { -1 };
            }
        }
        let open = edges.values().filter(|balance| **balance != 0).count();
        assert_eq!(open, 0, "{what}: {open} of {} edges are open", edges.len());
        assert!(used.iter().all(|used| *used), "{what}");
        let mut positions: Vec<_> = self.points.iter().map(|point| point.map(f64::to_bits)).collect();
        positions.sort_unstable();
        positions.dedup();
        assert_eq!(positions.len(), self.points.len(), "{what}: points twice");
    }

    /// Checks that the surface is a manifold, with points identified by position: each edge has two
    /// faces that use it in opposite directions, and the faces around a point form one fan.
    pub fn check_manifold(&self, what: &str) {
        self.check_closed(what);
        let mut edges: HashMap<[usize; 2], usize> = HashMap::new();
        // For each vertex of a face: the previous vertex and the next one.
        let mut around: Vec<HashMap<usize, usize>> = vec![HashMap::new(); self.points.len()];
        for face in &self.faces {
            for (i, at) in face.iter().enumerate() {
                let (before, after) = (face[(i + face.len() - 1) % face.len()], face[(i + 1) % face.len()]);
                *edges.entry([*at.min(&after), *at.max(&after)]).or_default() += 1;
                assert!(
                    around[*at].insert(before, after).is_none(),
                    "{what}: an edge twice in one direction"
                );
            }
        }
        let several = edges.values().filter(|faces| **faces != 2).count();
        assert_eq!(several, 0, "{what}: of {} edges have other than two faces", edges.len());
        for fan in around.iter().filter(|fan| !fan.is_empty()) {
            let first = *fan.keys().next().unwrap();
            let length = std::iter::successors(fan.get(&first), |at| fan.get(at)).position(|at| *at == first);
            assert_eq!(length, Some(fan.len() - 1), "{what}: several fans at a point");
        }
    }

    pub fn triangles(&self) -> impl Iterator<Item = [[f64; 3]; 3]> {
        self.faces.iter().flat_map(move |face| {
            (1..face.len() - 1).map(move |i| [face[0], face[i], face[i + 1]].map(|i| self.points[i]))
        })
    }

    pub fn volume(&self) -> f64 {
        // Coordinates in cells are integers, so the sums are exact.
        self.triangles().map(|[a, b, c]| dot(a, cross(b, c))).sum::<f64>() / 6.0
    }

    /// Area of the faces per axis and direction.
    pub fn areas(&self) -> [f64; 6] {
        let mut areas = [0.0; 6];
        for [a, b, c] in self.triangles() {
            let normal = cross(minus(b, a), minus(c, a));
            for axis in 0..3 {
                areas[2 * axis + usize::from(normal[axis] > 0.0)] += normal[axis].abs() / 2.0;
            }
        }
        areas
    }
}
