//! Text formats: operations of views, and DF-expressions of quadtrees, octrees and bintrees.

use spinney::raw::ops::Calculation;
use spinney::raw::partitions::Bintree;
use spinney::raw::store::goblin::Goblin;
use spinney::raw::tree::df;
use spinney::tree::Source;
use spinney::{Bounds, Crs, Dataset, Dimension, Rule, SampleType, TreeType, Value, ValueType, ViewOperation};

/// A small file for views: the raster of the specification.
pub const CLASSIC: &[u8] = include_bytes!("../../fixtures/v1/classic.goblin");

/// Maximum number of cells along an axis of views that are read further.
const MAX_SIDE: u64 = 1 << 18;

/// A definition of a coordinate system: the parsed system's own definition parses to the same
/// system.
pub fn crs_text(bytes: &[u8]) {
    let Ok(crs) = Crs::parse(&String::from_utf8_lossy(bytes)) else { return };
    let again = Crs::parse(&crs.definition());
    // (The text of GeoTIFF keys is only informative.)
    if !matches!(crs, Crs::GeoKeys(_)) {
        assert!(again.is_ok_and(|again| again.is_same(&crs)), "{}", crs.definition());
    }
    assert!(crs.is_same(&crs.clone()) && !crs.to_string().is_empty());
    let other = Crs::epsg(2056);
    assert_eq!(crs.is_same(&other), other.is_same(&crs));
    let _ = (crs.unit(), crs.numbers(), crs.name());
}

/// Operations, a line each: their strings parse to the same operations, and views with them can be
/// queried.
pub fn step_text(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let steps: Vec<ViewOperation> = text.lines().take(4).filter_map(|line| line.parse().ok()).collect();
    for step in &steps {
        let text = step.to_string();
        let again: ViewOperation = text.parse().unwrap_or_else(|error| panic!("`{text}`: {error}"));
        assert_eq!(again.to_string(), text);
    }
    // (No files but this one.)
    if steps.is_empty() || steps.iter().any(|step| !step.files().is_empty()) {
        return;
    }
    let Ok(mut view) = Goblin::from_bytes(CLASSIC.to_vec()).and_then(|file| Dataset::of(file.into())) else {
        return;
    };
    for step in steps {
        // (In huge rasters a crop, for example, takes time proportional to its border.)
        if view.header().extent.iter().any(|cells| *cells > MAX_SIDE) {
            return;
        }
        match view.view(&[step]) {
            Ok(next) => view = next,
            Err(_) => return,
        }
    }
    let size = view.header().extent;
    for min in [[0; 3], size.map(|cells| cells / 2), size.map(|cells| cells - 1)] {
        let max = std::array::from_fn(|axis| size[axis].min(min[axis] + 8));
        let bounds = Bounds { min, max };
        let mut bytes = vec![0; bounds.volume() as usize * view.header().form.width()];
        let _ = view.window(view.depth(), &bounds, 0.0, &mut bytes, None);
        let _ = view.point(min, view.depth(), &mut [spinney::Number::default(); 4]);
    }
}

/// A calculation: its string parses to the same calculation. On a raster, a window has the numbers
/// of its single cells, and at most as many as statistics count.
pub fn calculation_text(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    for calculation in [Calculation::parse(&text), Calculation::parse_reduction(&text)].into_iter().flatten()
    {
        let text = calculation.to_string();
        let step: ViewOperation = text.parse().unwrap_or_else(|error| panic!("`{text}`: {error}"));
        assert_eq!(step.to_string(), text);
        // (No files but this one.)
        if !step.files().is_empty() {
            continue;
        }
        let Ok(view) = Goblin::from_bytes(CLASSIC.to_vec())
            .and_then(|file| Dataset::of(file.into()))
            .and_then(|file| file.view(&[step]))
        else {
            continue;
        };
        let value = view.header().form.value;
        for level in [0, view.depth()] {
            let bounds = view.extent_at(level);
            let cells = bounds.volume() as usize;
            let (mut bytes, mut valid) = (vec![0; cells * value.size()], vec![false; cells]);
            view.window(level, &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
            for (cell, valid) in valid.iter().enumerate() {
                let cell_position = [cell as u64 % bounds.max[0], cell as u64 / bounds.max[0], 0];
                let mut numbers = [spinney::Number::default(); 4];
                assert_eq!(view.point(cell_position, level, &mut numbers).unwrap(), *valid);
                let number =
                    value.first_sample(Value::from_bytes(&bytes[cell * value.size()..][..value.size()]));
                assert!(!number.is_nan() && (!valid || number == numbers[0].to_f64()));
            }
            if level == view.depth() {
                let counted = view.statistics(None, &()).unwrap().cells;
                assert_eq!(counted, valid.iter().filter(|valid| **valid).count() as u64);
            }
        }
    }
}

/// A DF-expression of a tree type that the first byte selects: its tree has an expression of the
/// same tree.
pub fn df_text(bytes: &[u8]) {
    let Some((choice, text)) = bytes.split_first() else { return };
    let dimension = if choice & 1 == 0 { Dimension::Quad } else { Dimension::Oct };
    let value = match choice >> 1 & 3 {
        0 => ValueType::new(SampleType::U8, 1),
        1 => ValueType::new(SampleType::U8, 3),
        2 => ValueType::new(SampleType::I32, 1),
        _ => ValueType::new(SampleType::F64, 1),
    };
    let (form, depth, rule) = (TreeType::new(dimension, value), choice >> 3, Rule::Nearest);
    let full: Value = value.nearest(|_| 9.0);
    let Ok(tree) = df::from_text(form, &String::from_utf8_lossy(text), depth, full, rule) else { return };
    let text = df::to_text(&tree, Some(full)).unwrap();
    let again = df::from_text(form, &text, depth, full, rule).unwrap();
    assert_eq!(df::to_text(&again, Some(full)).unwrap(), text);
    let packed = df::to_packed(&tree).unwrap();
    assert_eq!(packed.bits.len(), packed.symbols.div_ceil(4));
}

/// A DF-expression of a bintree: its tree has an expression of the same tree, fills its space, and
/// equals its conversion to a quadtree or octree.
pub fn bintree_text(bytes: &[u8]) {
    const MAX_NODES: usize = 4000;
    let Ok(tree) = Bintree::from_text(&String::from_utf8_lossy(bytes), MAX_NODES) else { return };
    let text = tree.to_text();
    assert_eq!(Bintree::from_text(&text, MAX_NODES).unwrap().to_text(), text);
    let (space, mut cells) = (Bounds::space(tree.form().dimension, tree.depth()), 0);
    tree.each_leaf(&mut |block, value| {
        assert!(value.is_none() || Bounds::of_extent(tree.extent()).contains(&block));
        cells += block.volume();
    });
    assert_eq!(cells, space.volume());
    // (A tree of few long and narrow nodes may become one of very many.)
    if let Ok(alternating) = Bintree::alternating(&tree, tree.extent(), MAX_NODES) {
        let again = Bintree::alternating(&alternating, tree.extent(), MAX_NODES).unwrap();
        assert_eq!(again.to_text(), alternating.to_text());
    }
}
