//! Trees of lines, compared with a search of all lines in memory.

use crate::geometry::{FRACTION, ends, meet, meets_box, square_distance};
use crate::source::{LineFeature, LinesInMemory};
use crate::store::LineTree;
use crate::{LineAttribute, LineBuildOptions, LineBuildSummary, LineValue, NearLine, ValueKind, build};
use spinney_base::Result;
use spinney_base::io::Output;
use spinney_container::Metadata;
use std::collections::BTreeSet;

/// Pseudo-random numbers with a fixed seed.
fn random(seed: u64) -> impl FnMut(u64) -> u64 {
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

/// Features of all kinds: random walks, long lines, equal lines, points, lines along axes and
/// across the middle, several lines, none.
fn features(count: usize, seed: u64) -> Vec<LineFeature> {
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
            LineFeature { lines, values }
        })
        .collect()
}

fn bytes_of(features: &[LineFeature], options: &LineBuildOptions) -> Result<(Vec<u8>, LineBuildSummary)> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("l.goblin");
    let mut source = LinesInMemory::new(attributes(), features.to_vec());
    let built = build(&mut source, options, &Metadata::default(), Output::create(&path)?, &())?;
    Ok((std::fs::read(&path).unwrap(), built))
}

fn tree_of(features: &[LineFeature], leaf_size: usize) -> LineTree {
    let (bytes, _) =
        bytes_of(features, &LineBuildOptions { leaf_size, ..LineBuildOptions::default() }).unwrap();
    LineTree::from_bytes(bytes).unwrap()
}

fn segments(feature: &LineFeature) -> impl Iterator<Item = [[i32; 2]; 2]> {
    feature.lines.iter().flat_map(|line| line.windows(2).map(|pair| [pair[0], pair[1]]))
}

#[test]
fn features_are_read_as_written() {
    for (count, leaf_size) in [(0, 10), (1, 1), (7, 1), (500, 1), (500, 40), (9000, 1000), (500, 65_536)] {
        let features = features(count, 3);
        let tree = tree_of(&features, leaf_size);
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
    let features = features(800, 9);
    let tree = tree_of(&features, 16);
    let mut random = random(4);
    for query in 0..300 {
        let mut at =
            || random(70_000) as f64 - 22_000.0 + if query % 3 == 0 { 0.0 } else { random(8) as f64 / 8.0 };
        let corner = [at(), at()];
        let side = [3.0, 100.0, 20_000.0, 0.0, 0.25][query % 5];
        let window = [corner, [corner[0] + side, corner[1] + side]];
        let fixed = window.map(|corner| corner.map(|number| (number * FRACTION as f64) as i64));
        let expected = (0..)
            .zip(&features)
            .filter(|(_, feature)| segments(feature).any(|segment| meets_box(ends(segment), fixed)));
        assert_eq!(
            tree.window(window, &()).unwrap(),
            expected.map(|(number, _)| number).collect::<Vec<u64>>()
        );
    }
    assert_eq!(tree.window([[f64::NEG_INFINITY; 2], [f64::INFINITY; 2]], &()).unwrap().len(), 750);
    assert!(tree.window([[5.0; 2], [4.0; 2]], &()).unwrap().is_empty());
    assert!(tree.window([[f64::NAN; 2], [4.0; 2]], &()).is_err());
}

#[test]
fn boxes_intersect_lines_that_have_a_point_inside() {
    // Compared with Liang-Barsky clipping in floating point. For small coordinates, the tolerance
    // is below the gap between touching and missing.
    let mut random = random(8);
    for _ in 0..20_000 {
        let mut position = || [random(7) as i64, random(7) as i64];
        let (line, low, high) = ([position(), position()], position(), position());
        let [low, high] = crate::geometry::box_of([low, high]);
        let mut shares = [0f64, 1.0];
        // Range of the line's parameter within the box, by clipping.
        let mut is_met = true;
        for axis in 0..2 {
            let along = line[1][axis] - line[0][axis];
            let (to_low, to_high) = (low[axis] - line[0][axis], high[axis] - line[0][axis]);
            if along == 0 {
                is_met &= to_low <= 0 && to_high >= 0;
            } else {
                let (first, last) = (to_low as f64 / along as f64, to_high as f64 / along as f64);
                shares = [shares[0].max(first.min(last)), shares[1].min(first.max(last))];
            }
        }
        is_met &= shares[0] <= shares[1] + 1e-12;
        assert_eq!(meets_box(line, [low, high]), is_met, "{line:?} {low:?} {high:?}");
    }
}

#[test]
fn crossings_equal_those_of_a_full_scan() {
    let features = features(600, 5);
    let tree = tree_of(&features, 8);
    let mut random = random(6);
    for query in 0..100 {
        let mut at = || random(66_000) as f64 - 20_000.0;
        let line: Vec<[f64; 2]> = match query {
            0 => vec![[5.0, -100.0], [5.0, 2000.0]],
            1 => vec![[12_768.0, 0.0], [12_768.0, 0.0]],
            2 => vec![],
            _ => (0..2 + query % 3).map(|_| [at(), at()]).collect(),
        };
        let fixed: Vec<[i64; 2]> =
            line.iter().map(|position| position.map(|number| number as i64 * FRACTION)).collect();
        let mut expected = Vec::new();
        for (number, segment) in fixed.windows(2).enumerate() {
            for (feature, own) in (0u64..).zip(&features) {
                let mut vertex = 0u32;
                for line in &own.lines {
                    for pair in line.windows(2) {
                        if meet(ends([pair[0], pair[1]]), [segment[0], segment[1]]) {
                            expected.push((number, feature, vertex));
                        }
                        vertex += 1;
                    }
                    vertex += 1;
                }
            }
        }
        let found = tree.crossings(std::slice::from_ref(&line), &()).unwrap();
        let found_keys: Vec<_> =
            found.iter().map(|found| (found.segment, found.feature, found.vertex)).collect();
        assert_eq!(found_keys, expected, "{line:?}");
        // Intersection points are on both lines.
        for crossing in &found {
            let at = crossing.position.map(|number| (number * FRACTION as f64).round() as i64);
            let [a, b] = [fixed[crossing.segment], fixed[crossing.segment + 1]];
            assert!(square_distance([a, b], at).sqrt() < 4.0, "{crossing:?}");
            let own = vertices(&features[crossing.feature as usize]);
            let vertex = crossing.vertex as usize;
            assert!(square_distance(ends([own[vertex], own[vertex + 1]]), at).sqrt() < 4.0, "{crossing:?}");
        }
    }
}

fn vertices(feature: &LineFeature) -> Vec<[i32; 2]> {
    feature.lines.iter().flatten().copied().collect()
}

#[test]
fn nearest_lines_equal_those_of_a_full_scan() {
    let features = features(500, 11);
    for leaf_size in [4, 100] {
        let tree = tree_of(&features, leaf_size);
        let mut random = random(12);
        let positions: Vec<[f64; 2]> = (0..400)
            .map(|number| {
                let mut at = || random(80_000) as f64 - 30_000.0 + if number % 2 == 0 { 0.5 } else { 0.0 };
                match number % 4 {
                    0 | 1 => [at(), at()],
                    // Vertices, where many lines have equal distances, and distant points.
                    2 => [5.0, 5.0],
                    _ => [1e6 + at(), -3e5],
                }
            })
            .collect();
        for (most, within) in
            [(1, f64::INFINITY), (3, f64::INFINITY), (7, 400.0), (600, f64::INFINITY), (0, 5.0)]
        {
            let found = tree.nearest(&positions, most, within, &()).unwrap();
            for (position, found) in positions.iter().zip(found) {
                let from = position.map(|number| (number * FRACTION as f64) as i64);
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
                    let away = (near.position[0] - position[0]).hypot(near.position[1] - position[1]);
                    assert!((away - near.distance).abs() <= 1e-9 * away.max(1.0), "{near:?}");
                }
            }
        }
    }
    let empty = tree_of(&[], 5);
    assert_eq!(empty.nearest(&[[0.0; 2]], 1, f64::INFINITY, &()).unwrap(), [vec![]]);
    assert!(empty.nearest(&[[f64::NAN; 2]], 1, f64::INFINITY, &()).is_err());
    assert!(empty.nearest(&[[1e300, 0.0]], 1, f64::INFINITY, &()).is_err());
}

#[test]
fn equal_lines_are_found_by_their_features() {
    // Features 0 to 999 are equal, each with two equal segments. Another feature is slightly nearer
    // to some points, with a reversed segment.
    let equal =
        || LineFeature { lines: vec![vec![[0, 0], [8, 8]], vec![[0, 0], [8, 8]]], values: Vec::new() };
    let mut features: Vec<LineFeature> = (0..1000).map(|_| equal()).collect();
    features.push(LineFeature { lines: vec![vec![[8, 8], [0, 0], [0, 9]]], values: Vec::new() });
    for leaf_size in [7, 4096] {
        let tree = tree_of(&features, leaf_size);
        let found = tree.nearest(&[[0.0, 4.0], [9.0, 9.0], [4.0, 3.0]], 20, f64::INFINITY, &()).unwrap();
        let numbers = |found: &[NearLine]| found.iter().map(|near| near.feature).collect::<Vec<_>>();
        assert_eq!(numbers(&found[0]), std::iter::once(1000).chain(0..19).collect::<Vec<u64>>());
        for found in &found[1..] {
            assert_eq!(numbers(found), (0..20).collect::<Vec<u64>>());
            assert!(found.iter().all(|near| near.vertex == 0));
        }
        let found = tree.nearest(&[[9.0, 9.0]], 2000, f64::INFINITY, &()).unwrap();
        assert_eq!(numbers(&found[0]), (0..1001).collect::<Vec<u64>>());
        let lines = [vec![], vec![[1.0, 3.0]], vec![[3.0, -1.0], [1.0, 1.0]], vec![[-1.0, 5.0], [1.0, 5.0]]];
        let found = tree.crossings(&lines, &()).unwrap();
        assert_eq!(found.len(), 2001 + 1);
        assert!(
            found[..2001].iter().all(|found| (found.line, found.segment, found.position) == (2, 0, [1.0; 2]))
        );
        assert_eq!((found[2001].line, found[2001].feature, found[2001].vertex), (3, 1000, 1));
        assert!(tree.crossings(&[vec![[f64::NAN; 2]; 2]], &()).is_err());
    }
}

#[test]
fn nodes_store_counts_and_lengths() {
    let features = features(700, 21);
    let (bytes, built) =
        bytes_of(&features, &LineBuildOptions { leaf_size: 20, ..LineBuildOptions::default() }).unwrap();
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
    let features = features(4000, 2);
    let options = LineBuildOptions { leaf_size: 50, ..LineBuildOptions::default() };
    let (expected, _) = bytes_of(&features, &options).unwrap();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let little = LineBuildOptions { memory: 1, ..options.clone() };
        let (found, _) = pool.install(|| bytes_of(&features, &little)).unwrap();
        assert!(found == expected, "{threads} threads");
    }
    assert!(bytes_of(&features, &LineBuildOptions { leaf_size: 0, ..options }).is_err());
}

#[test]
fn corruption_is_detected() {
    let features = features(300, 2);
    let (bytes, _) =
        bytes_of(&features, &LineBuildOptions { leaf_size: 20, ..LineBuildOptions::default() }).unwrap();
    let mut detected = 0;
    for offset in (0..bytes.len()).step_by(31) {
        let mut corrupted = bytes.clone();
        corrupted[offset] ^= 1 << (offset % 8);
        let Ok(tree) = LineTree::from_bytes(corrupted) else {
            detected += 1;
            continue;
        };
        let findings = tree.verify(1 << 20, &()).unwrap();
        assert!(!findings.is_empty(), "byte {offset}");
        let _ = tree.window([[0.0; 2], [500.0; 2]], &());
        let _ = tree.nearest(&[[0.0; 2]], 1, f64::INFINITY, &());
        detected += 1;
    }
    assert_eq!(detected, bytes.len().div_ceil(31));
    for length in [0, 10, 24, 100, bytes.len() / 2, bytes.len() - 1] {
        assert!(LineTree::from_bytes(bytes[..length].to_vec()).is_err());
    }
}

#[test]
fn lines_of_one_vertex_are_refused_and_extreme_lines_are_read() {
    let one = LineFeature { lines: vec![vec![[0, 0]]], values: Vec::new() };
    assert!(
        bytes_of(&[one], &LineBuildOptions::default())
            .unwrap_err()
            .to_string()
            .contains("a line of 1 vertices")
    );
    let far = LineFeature { lines: vec![vec![[i32::MIN; 2], [i32::MAX; 2]]], values: Vec::new() };
    let tree = tree_of(&[far], 5);
    assert_eq!(tree.window([[0.25; 2], [0.5; 2]], &()).unwrap(), [0]);
    assert_eq!(tree.window([[0.25, 0.5], [0.3, 0.6]], &()).unwrap(), [0u64; 0]);
    assert_eq!(tree.nearest(&[[3.0, 1.0]], 1, 2.0, &()).unwrap()[0][0].distance, 2f64.sqrt());
}

#[test]
fn values_of_wrong_types_are_reported() {
    let mut features = features(40, 4);
    features[7].values[1] = LineValue::Text("four".into());
    let findings = tree_of(&features, 10).verify(1 << 20, &()).unwrap();
    let [finding] = &findings[..] else { panic!("{findings:?}") };
    assert!(finding.place == "feature 7" && finding.problem.contains("`lanes`"), "{finding:?}");
}
