//! Small line features for trees of lines.

use spinney::Dimension;
use spinney::lines::LineFeature;
use spinney::raw::lines::{LineAttribute, LineValue, ValueKind};

/// Returns `count` features of two or three axes: short and long lines, with several lines or none,
/// duplicates, and attribute values of all types.
pub fn some(dimension: Dimension, count: i32) -> (Vec<LineAttribute>, Vec<LineFeature>) {
    let attributes = [("name", ValueKind::Text), ("lanes", ValueKind::Integer), ("other", ValueKind::Mixed)];
    let attributes =
        attributes.map(|(name, kind)| LineAttribute { name: name.into(), kind }).into_iter().collect();
    let feature = |number: i32| {
        let lines: Vec<Vec<[i32; 2]>> = match number % 4 {
            0 => vec![(0..6).map(|at| [number * 40 + at * 3, at * at * 7 - number]).collect()],
            1 => vec![vec![[-200, 9 * number], [900, 300 - number]], vec![[5, 5], [5, 5]]],
            2 => vec![vec![[64, 0], [64, 128], [0, 128]]],
            _ => Vec::new(),
        };
        let raised = |[x, y]: [i32; 2]| [x, y, if dimension == Dimension::Oct { (x ^ y) % 100 } else { 0 }];
        let lines = lines.into_iter().map(|line| line.into_iter().map(raised).collect()).collect();
        let other = match number % 6 {
            0 => LineValue::None,
            1 => LineValue::Number(0.1 * f64::from(number)),
            2 => LineValue::Boolean(true),
            3 => LineValue::Boolean(false),
            4 => LineValue::Json("[1]".into()),
            _ => LineValue::Text("way".into()),
        };
        let name = LineValue::Text(format!("road {}", number % 5));
        LineFeature { lines, values: vec![name, LineValue::Integer(i64::from(number) * 1000), other] }
    };
    (attributes, (0..count).map(feature).collect())
}
