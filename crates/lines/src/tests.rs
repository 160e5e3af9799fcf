//! Trees of lines, compared with a search of all lines in memory.

use crate::geometry::{FRACTION, FixedPosition, between, ends, meet, meets_box, square_distance};
use crate::source::{LineFeature, LinesInMemory};
use crate::store::LineTree;
use crate::{
    LineAttribute, LineBuildOptions, LineBuildSummary, LineCrossing, LineValue, NearLine, ValueKind, build,
};
use spinney_base::Result;
use spinney_base::io::Output;
use spinney_base::space::Dimension;
use spinney_container::Metadata;
use std::collections::BTreeSet;

/// Pseudo-random numbers with a fixed seed.
pub(crate) fn random(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let mixed = state ^ state >> 29;
        (mixed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 16) % below
    }
}

fn attributes() -> Vec<LineAttribute> {
    [
        ("name", ValueKind::Text),
        ("lanes", ValueKind::Integer),
        ("width", ValueKind::Number),
        ("toll", ValueKind::Mixed),
    ]
    .map(|(name, kind)| LineAttribute { name: name.into(), kind })
    .to_vec()
}

const BOTH: [Dimension; 2] = [Dimension::Quad, Dimension::Oct];

/// Position with a z of its own in three axes. (Equal positions in x and y have equal ones.)
fn raised(dimension: Dimension, [x, y]: [i32; 2]) -> [i32; 3] {
    let z = if dimension == Dimension::Oct { (x.wrapping_mul(31) ^ y.wrapping_mul(17)) % 5000 } else { 0 };
    [x, y, z]
}

fn raised_line(dimension: Dimension, line: Vec<[i32; 2]>) -> Vec<[i32; 3]> {
    line.into_iter().map(|at| raised(dimension, at)).collect()
}

/// Features of all kinds: random walks, long lines, equal lines, points, lines along axes and
/// across the middle, several lines, none.
fn features(dimension: Dimension, count: usize, seed: u64) -> Vec<LineFeature> {
    let mut random = random(seed);
    let side = 1 << 16;
    (0..count)
        .map(|number| {
            let mut at = || random(side) as i32 - 20_000;
            let lines = match number % 8 {
                0..=2 => {
                    let mut here = [at(), at()];
                    let walk = (0..12).map(|_| {
                        here = [0, 1].map(|axis| (here[axis] + at() % 50).clamp(-20_000, 45_535));
                        here
                    });
                    vec![walk.collect()]
                }
                3 => vec![vec![[at(), at()], [at(), at()]]],
                4 => vec![vec![[5, 5], [5, 900], [5, 900]], vec![[5, 5], [-700, 5]]],
                5 => vec![vec![[12_768, at()], [12_768, at()], [at(), 12_768]]],
                6 if number % 16 == 6 => vec![],
                _ => (0..3).map(|_| vec![[at() / 64, at() / 64], [at() / 64, at() / 64]]).collect(),
            };
            let values = vec![
                if number % 5 == 0 {
                    LineValue::None
                } else {
                    LineValue::Text(format!("road {}", number % 7))
                },
                LineValue::Integer(number as i64 * 3 - 100),
                LineValue::Number(number as f64 / 3.0),
                match number % 4 {
                    0 => LineValue::Boolean(number % 8 == 0),
                    1 => LineValue::Json("[1]".into()),
                    2 => LineValue::Number(f64::NAN),
                    _ => LineValue::Integer(i64::MIN),
                },
            ];
            let lines = lines.into_iter().map(|line| raised_line(dimension, line)).collect();
            LineFeature { lines, values }
        })
        .collect()
}

fn bytes_of(
    dimension: Dimension,
    features: &[LineFeature],
    options: &LineBuildOptions,
) -> Result<(Vec<u8>, LineBuildSummary)> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("l.goblin");
    let mut source = LinesInMemory::new(dimension, attributes(), features.to_vec());
    let built = build(&mut source, options, &Metadata::default(), Output::create(&path)?, &())?;
    Ok((std::fs::read(&path).unwrap(), built))
}

fn tree_of(dimension: Dimension, features: &[LineFeature], leaf_size: usize) -> LineTree {
    let options = LineBuildOptions { leaf_size, ..LineBuildOptions::default() };
    LineTree::from_bytes(bytes_of(dimension, features, &options).unwrap().0).unwrap()
}

fn fixed(position: [f64; 3]) -> FixedPosition {
    position.map(|number| (number * FRACTION as f64).round() as i64)
}

/// Position in two axes.
fn flat([x, y]: [f64; 2]) -> [f64; 3] {
    [x, y, 0.0]
}

fn segments(feature: &LineFeature) -> impl Iterator<Item = [[i32; 3]; 2]> {
    feature.lines.iter().flat_map(|line| line.windows(2).map(|pair| [pair[0], pair[1]]))
}

#[test]
fn features_are_read_as_written() {
    let cases = [(0, 10), (1, 1), (7, 1), (500, 1), (500, 40), (9000, 1000), (500, 65_536)];
    for (dimension, (count, leaf_size)) in BOTH.into_iter().flat_map(|own| cases.map(|case| (own, case))) {
        let features = features(dimension, count, 3);
        let tree = tree_of(dimension, &features, leaf_size);
        assert_eq!(tree.len(), count as u64);
        assert_eq!(
            tree.segments(),
            features.iter().map(|feature| segments(feature).count() as u64).sum::<u64>()
        );
        let mut found = Vec::new();
        tree.features(&mut (0..u64::MAX), &mut |number, feature| {
            assert_eq!(number, found.len() as u64);
            found.push(feature.clone());
            Ok(())
        })
        .unwrap();
        // NaN is not equal to itself.
        assert_eq!(format!("{found:?}"), format!("{features:?}"));
        assert_eq!(tree.verify(1 << 20, &()).unwrap(), [], "{count} {leaf_size}");
        let mut some = Vec::new();
        let wanted = [0, 3, 4, 400, 10_000];
        tree.features(&mut wanted.into_iter(), &mut |number, _| {
            some.push(number);
            Ok(())
        })
        .unwrap();
        assert_eq!(some, wanted.into_iter().filter(|number| *number < count as u64).collect::<Vec<_>>());
    }
}

#[test]
fn windows_contain_the_features_that_intersect_them() {
    for dimension in BOTH {
        let features = features(dimension, 800, 9);
        let tree = tree_of(dimension, &features, 16);
        let mut random = random(4);
        for query in 0..300 {
            let mut at = |middle: f64| {
                random(70_000) as f64 - middle + if query % 3 == 0 { 0.0 } else { random(8) as f64 / 8.0 }
            };
            let corner = [at(22_000.0), at(22_000.0), at(35_000.0) / 7.0];
            let side = [3.0, 100.0, 20_000.0, 0.0, 0.25][query % 5];
            let height = if query % 7 == 0 { f64::INFINITY } else { 1000.0 };
            let window = [corner, [corner[0] + side, corner[1] + side, corner[2] + height]];
            let mut limits = window.map(fixed);
            limits.iter_mut().for_each(|corner| match dimension {
                Dimension::Quad => corner[2] = 0,
                Dimension::Oct => corner[2] = corner[2].min(1 << 50),
            });
            let expected = (0..)
                .zip(&features)
                .filter(|(_, feature)| segments(feature).any(|segment| meets_box(ends(segment), limits)));
            assert_eq!(
                tree.window(window, &()).unwrap(),
                expected.map(|(number, _)| number).collect::<Vec<u64>>()
            );
        }
        assert_eq!(tree.window([[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]], &()).unwrap().len(), 750);
        assert!(tree.window([[5.0; 3], [4.0; 3]], &()).unwrap().is_empty());
        assert!(tree.window([[f64::NAN; 3], [4.0; 3]], &()).is_err());
    }
}

#[test]
fn crossings_equal_those_of_a_full_scan() {
    for dimension in BOTH {
        let features = features(dimension, 600, 5);
        let tree = tree_of(dimension, &features, 8);
        let mut random = random(6);
        let mut count = 0;
        for query in 0..100usize {
            let mut at = || random(66_000) as i32 - 20_000;
            let line: Vec<[i32; 3]> = match query {
                0 => vec![[5, -100, -3], [5, 2000, 9]],
                1 => vec![[12_768, 0, 0], [12_768, 0, 0]],
                2 => vec![],
                // Lines of features, which they meet in their vertices.
                _ if query % 4 == 0 => features[query].lines.first().cloned().unwrap_or_default(),
                _ => (0..2 + query % 3).map(|_| raised(dimension, [at(), at()])).collect(),
            };
            let line: Vec<[f64; 3]> = line.into_iter().map(|at| at.map(f64::from)).collect();
            let mut limits: Vec<FixedPosition> = line.iter().copied().map(fixed).collect();
            if dimension == Dimension::Quad {
                limits.iter_mut().for_each(|at| at[2] = 0);
            }
            for within in [0.0, 400.5] {
                let mut expected = Vec::new();
                for (number, segment) in limits.windows(2).enumerate() {
                    let segment = [segment[0], segment[1]];
                    for (feature, own) in (0u64..).zip(&features) {
                        let mut vertex = 0u32;
                        for line in &own.lines {
                            for pair in line.windows(2) {
                                let own = ends([pair[0], pair[1]]);
                                let limit = (within * FRACTION as f64).powi(2);
                                if meet(own, segment) || within > 0.0 && between(segment, own).0 <= limit {
                                    expected.push((number, feature, vertex));
                                }
                                vertex += 1;
                            }
                            vertex += 1;
                        }
                    }
                }
                let found = tree.crossings(std::slice::from_ref(&line), within, &()).unwrap();
                let found_keys: Vec<_> =
                    found.iter().map(|found| (found.segment, found.feature, found.vertex)).collect();
                assert_eq!(found_keys, expected, "{line:?}");
                count += found.len();
                // Positions are on the line, and as far from the tree's segment as they say.
                for crossing in &found {
                    let at = fixed(crossing.position);
                    let [a, b] = [limits[crossing.segment], limits[crossing.segment + 1]];
                    assert!(square_distance([a, b], at).sqrt() < 4.0, "{crossing:?}");
                    let own = vertices(&features[crossing.feature as usize]);
                    let vertex = crossing.vertex as usize;
                    let away = square_distance(ends([own[vertex], own[vertex + 1]]), at).sqrt();
                    assert!((away - crossing.distance * FRACTION as f64).abs() < 4.0, "{crossing:?}");
                }
            }
        }
        assert!(count > 2000, "{count}");
        let all = tree.crossings(&[vec![[0.0; 3], [1e300, -1e300, 1e300]]], 1e300, &()).unwrap();
        assert_eq!(all.len() as u64, tree.segments());
        for within in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(tree.crossings(&[], within, &()).is_err());
        }
    }
}

fn vertices(feature: &LineFeature) -> Vec<[i32; 3]> {
    feature.lines.iter().flatten().copied().collect()
}

#[test]
fn nearest_lines_equal_those_of_a_full_scan() {
    for (dimension, leaf_size) in [(Dimension::Quad, 4), (Dimension::Oct, 4), (Dimension::Oct, 100)] {
        let features = features(dimension, 250, 11);
        let tree = tree_of(dimension, &features, leaf_size);
        let mut random = random(12);
        let height = if dimension == Dimension::Quad { 0.0 } else { 1.0 };
        let positions: Vec<[f64; 3]> = (0..400)
            .map(|number| {
                let mut at = || random(80_000) as f64 - 30_000.0 + if number % 2 == 0 { 0.5 } else { 0.0 };
                match number % 4 {
                    0 | 1 => [at(), at(), height * at() / 16.0],
                    // Vertices, where many lines have equal distances, and distant points.
                    2 => [5.0, 5.0, f64::from(raised(dimension, [5, 5])[2])],
                    _ => [1e6 + at(), -3e5, height * 7.0],
                }
            })
            .collect();
        for (most, within) in
            [(1, f64::INFINITY), (3, f64::INFINITY), (7, 400.0), (600, f64::INFINITY), (0, 5.0)]
        {
            let found = tree.nearest(&positions, most, within, &()).unwrap();
            for (position, found) in positions.iter().zip(found) {
                let from = fixed(*position);
                let mut all: Vec<(f64, u64)> = (0..)
                    .zip(&features)
                    .filter_map(|(number, feature)| {
                        let squares = segments(feature).map(|segment| square_distance(ends(segment), from));
                        squares.min_by(f64::total_cmp).map(|square| (square, number))
                    })
                    .filter(|(square, _)| *square <= (within * FRACTION as f64).powi(2))
                    .collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                all.truncate(most);
                let distances: Vec<(f64, u64)> =
                    found.iter().map(|near| (near.distance, near.feature)).collect();
                let expected: Vec<(f64, u64)> = all
                    .into_iter()
                    .map(|(square, number)| (square.sqrt() / FRACTION as f64, number))
                    .collect();
                assert_eq!(distances, expected);
                for near in found {
                    let squares = (0..3).map(|axis| (near.position[axis] - position[axis]).powi(2));
                    let away = squares.sum::<f64>().sqrt();
                    assert!((away - near.distance).abs() <= 1e-9 * away.max(1.0), "{near:?}");
                }
            }
        }
    }
    let empty = tree_of(Dimension::Oct, &[], 5);
    assert_eq!(empty.nearest(&[[0.0; 3]], 1, f64::INFINITY, &()).unwrap(), [vec![]]);
    assert!(empty.nearest(&[[f64::NAN; 3]], 1, f64::INFINITY, &()).is_err());
    assert!(empty.nearest(&[[1e300, 0.0, 0.0]], 1, f64::INFINITY, &()).is_err());
}

#[test]
fn equal_lines_are_found_by_their_features() {
    // Features 0 to 999 are equal, each with two equal segments. Another feature is slightly nearer
    // to some points, with a reversed segment.
    let line = |line: &[[i32; 2]]| raised_line(Dimension::Quad, line.to_vec());
    let equal =
        || LineFeature { lines: vec![line(&[[0, 0], [8, 8]]), line(&[[0, 0], [8, 8]])], values: Vec::new() };
    let mut features: Vec<LineFeature> = (0..1000).map(|_| equal()).collect();
    features.push(LineFeature { lines: vec![line(&[[8, 8], [0, 0], [0, 9]])], values: Vec::new() });
    for leaf_size in [7, 4096] {
        let tree = tree_of(Dimension::Quad, &features, leaf_size);
        let found =
            tree.nearest(&[[0.0, 4.0], [9.0, 9.0], [4.0, 3.0]].map(flat), 20, f64::INFINITY, &()).unwrap();
        let numbers = |found: &[NearLine]| found.iter().map(|near| near.feature).collect::<Vec<_>>();
        assert_eq!(numbers(&found[0]), std::iter::once(1000).chain(0..19).collect::<Vec<u64>>());
        for found in &found[1..] {
            assert_eq!(numbers(found), (0..20).collect::<Vec<u64>>());
            assert!(found.iter().all(|near| near.vertex == 0));
        }
        let found = tree.nearest(&[[9.0, 9.0, 0.0]], 2000, f64::INFINITY, &()).unwrap();
        assert_eq!(numbers(&found[0]), (0..1001).collect::<Vec<u64>>());
        let lines = [vec![], vec![[1.0, 3.0]], vec![[3.0, -1.0], [1.0, 1.0]], vec![[-1.0, 5.0], [1.0, 5.0]]];
        let lines = lines.map(|line| line.into_iter().map(flat).collect());
        let found = tree.crossings(&lines, 0.0, &()).unwrap();
        assert_eq!(found.len(), 2001 + 1);
        assert!(
            found[..2001]
                .iter()
                .all(|found| (found.line, found.segment, found.position) == (2, 0, [1.0, 1.0, 0.0]))
        );
        assert_eq!((found[2001].line, found[2001].feature, found[2001].vertex), (3, 1000, 1));
        assert!(tree.crossings(&[vec![[f64::NAN; 3]; 2]], 0.0, &()).is_err());
    }
}

#[test]
fn nodes_store_counts_and_lengths() {
    BOTH.into_iter().for_each(check_nodes);
}

fn check_nodes(dimension: Dimension) {
    let features = features(dimension, 700, 21);
    let options = LineBuildOptions { leaf_size: 20, ..LineBuildOptions::default() };
    let (bytes, built) = bytes_of(dimension, &features, &options).unwrap();
    let tree = LineTree::from_bytes(bytes).unwrap();
    let length: f64 = features.iter().flat_map(segments).map(|segment| tree.grid().length(segment)).sum();
    assert!((tree.length().unwrap() - length).abs() < 1e-6 * length);
    assert_eq!(
        (built.features, built.segments, built.length),
        (700, tree.segments(), tree.length().unwrap())
    );
    let levels = tree.levels().unwrap();
    assert_eq!(levels.iter().map(|level| level.segments).sum::<u64>(), tree.segments());
    assert!((levels.iter().map(|level| level.length).sum::<f64>() - length).abs() < 1e-6 * length);
    assert_eq!((levels[0].nodes, levels[0].most_segments), (1, tree.segments()));
    for index in 0..tree.counts().0 {
        let node = tree.node(index).unwrap();
        let mut own = BTreeSet::new();
        let mut count = 0;
        for (number, feature) in features.iter().enumerate() {
            for segment in segments(feature) {
                let code = tree.grid().code(segment).unwrap();
                if node.code.contains(code) {
                    own.insert(number);
                    count += 1;
                }
            }
        }
        assert_eq!((node.segments, node.features), (count, own.len() as u64), "{}", node.code);
        // A node with descendants has too many segments for a leaf.
        let has_children = !tree.children(&node).unwrap().is_empty();
        assert!(!has_children || node.segments > 20);
        let blocks = tree.blocks_of(node.code);
        assert!(has_children || blocks.len() as u64 == node.segments.div_ceil(20));
        assert!(node.code.level() == tree.grid().deepest() || has_children || node.segments <= 20);
    }
}

#[test]
fn bytes_do_not_depend_on_memory_and_threads() {
    let features = features(Dimension::Oct, 4000, 2);
    let options = LineBuildOptions { leaf_size: 50, ..LineBuildOptions::default() };
    let (expected, _) = bytes_of(Dimension::Oct, &features, &options).unwrap();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let little = LineBuildOptions { memory: 1, ..options.clone() };
        let (found, _) = pool.install(|| bytes_of(Dimension::Oct, &features, &little)).unwrap();
        assert!(found == expected, "{threads} threads");
    }
    assert!(bytes_of(Dimension::Oct, &features, &LineBuildOptions { leaf_size: 0, ..options }).is_err());
}

#[test]
fn corruption_is_detected() {
    BOTH.into_iter().for_each(check_corruption);
}

fn check_corruption(dimension: Dimension) {
    let features = features(dimension, 300, 2);
    let options = LineBuildOptions { leaf_size: 20, ..LineBuildOptions::default() };
    let (bytes, _) = bytes_of(dimension, &features, &options).unwrap();
    let mut detected = 0;
    for offset in (0..bytes.len()).step_by(61) {
        let mut corrupted = bytes.clone();
        corrupted[offset] ^= 1 << (offset % 8);
        let Ok(tree) = LineTree::from_bytes(corrupted) else {
            detected += 1;
            continue;
        };
        let findings = tree.verify(1 << 20, &()).unwrap();
        assert!(!findings.is_empty(), "byte {offset}");
        let _ = tree.window([[0.0; 3], [500.0; 3]], &());
        let _ = tree.nearest(&[[0.0; 3]], 1, f64::INFINITY, &());
        detected += 1;
    }
    assert_eq!(detected, bytes.len().div_ceil(61));
    for length in [0, 10, 24, 100, bytes.len() / 2, bytes.len() - 1] {
        assert!(LineTree::from_bytes(bytes[..length].to_vec()).is_err());
    }
}

#[test]
fn lines_of_one_vertex_are_refused_and_extreme_lines_are_read() {
    let one = LineFeature { lines: vec![vec![[0; 3]]], values: Vec::new() };
    assert!(
        bytes_of(Dimension::Quad, &[one], &LineBuildOptions::default())
            .unwrap_err()
            .to_string()
            .contains("a line of 1 vertices")
    );
    for dimension in BOTH {
        let [least, most] = [i32::MIN, i32::MAX].map(|end| {
            let z = if dimension == Dimension::Oct { end } else { 0 };
            [end, end, z]
        });
        let far = LineFeature { lines: vec![vec![least, most]], values: Vec::new() };
        let tree = tree_of(dimension, &[far], 5);
        assert_eq!(tree.window([[0.25; 3], [0.5; 3]], &()).unwrap(), [0]);
        assert_eq!(tree.window([[0.25, 0.5, 0.25], [0.3, 0.6, 0.5]], &()).unwrap(), [0u64; 0]);
        let near = tree.nearest(&[[3.0, 1.0, 2.0]], 1, 2.0, &()).unwrap()[0][0];
        assert_eq!((near.distance, near.vertex), (2f64.sqrt(), 0));
    }
}

#[test]
fn values_of_wrong_types_are_reported() {
    let mut features = features(Dimension::Quad, 40, 4);
    features[7].values[1] = LineValue::Text("four".into());
    let findings = tree_of(Dimension::Quad, &features, 10).verify(1 << 20, &()).unwrap();
    let [finding] = &findings[..] else { panic!("{findings:?}") };
    assert!(finding.place == "feature 7" && finding.problem.contains("`lanes`"), "{finding:?}");
}

#[test]
fn queries_in_the_plane_are_those_of_lines_without_heights() {
    let (flat_features, raised_features) =
        (features(Dimension::Quad, 400, 31), features(Dimension::Oct, 400, 31));
    let (plane, space) =
        (tree_of(Dimension::Quad, &flat_features, 10), tree_of(Dimension::Oct, &raised_features, 10));
    let mut random = random(2);
    let mut at = || [random(60_000) as f64 - 20_000.0, random(60_000) as f64 - 20_000.0, f64::NAN];
    let positions: Vec<[f64; 3]> = (0..200).map(|_| at()).collect();
    let lines: Vec<Vec<[f64; 3]>> = (0..40).map(|_| vec![at(), at()]).collect();
    let height = |crossing: &LineCrossing| {
        let own = vertices(&raised_features[crossing.feature as usize]);
        let [a, b] = [0, 1].map(|next| own[crossing.vertex as usize + next].map(f64::from));
        let [x, y] = [0, 1].map(|axis| b[axis] - a[axis]);
        let [to_x, to_y] = [0, 1].map(|axis| crossing.position[axis] - a[axis]);
        a[2] + (x * to_x + y * to_y) / (x * x + y * y) * (b[2] - a[2])
    };
    let numbers = |found: Vec<Vec<NearLine>>| -> Vec<Vec<(u64, f64)>> {
        found
            .into_iter()
            .map(|near| near.into_iter().map(|near| (near.feature, near.distance)).collect())
            .collect()
    };
    let [expected, found] = [&plane, &space].map(|tree| tree.nearest(&positions, 3, 5000.0, &()).unwrap());
    assert_eq!(numbers(found), numbers(expected));
    for within in [0.0, 300.0] {
        let [expected, found] = [&plane, &space].map(|tree| tree.crossings(&lines, within, &()).unwrap());
        assert!(expected.len() > 100);
        for (expected, found) in expected.iter().zip(&found) {
            assert_eq!(
                (expected.feature, expected.vertex, expected.line),
                (found.feature, found.vertex, found.line)
            );
            assert_eq!(expected.distance, found.distance);
            assert_eq!(expected.position[..2], found.position[..2]);
            if within == 0.0 {
                let z = height(found);
                assert!(z.is_nan() || (z - found.position[2]).abs() < 0.1, "{z} {found:?}");
            }
        }
        assert_eq!(expected.len(), found.len());
    }
}
