//! Properties of FD codes, for both dimensions.

use std::cmp::Ordering;

use proptest::prelude::*;
use spinney::Dimension::{Oct, Quad};
use spinney::{Code, Dimension};

/// A random node of a tree, as the digits of its path.
fn code(dimension: Dimension) -> impl Strategy<Value = Code> {
    let steps = prop::collection::vec(0..dimension.children(), 0..=dimension.max_depth() as usize);
    steps.prop_map(move |steps| Code::from_digits(dimension, steps).unwrap())
}

/// Two nodes with a common path prefix more often than by chance.
fn pair(dimension: Dimension) -> impl Strategy<Value = (Code, Code)> {
    (code(dimension), code(dimension), 0..=dimension.max_depth()).prop_map(move |(a, b, shared)| {
        let start = a.digits().take(shared as usize);
        let steps = start.chain(b.digits()).take(dimension.max_depth() as usize);
        (a, Code::from_digits(dimension, steps).unwrap())
    })
}

fn round_trips(code: Code) {
    let (dimension, level) = (code.dimension(), code.level());
    assert_eq!(Code::from_bits(dimension, code.bits()), Some(code));
    assert_eq!(Code::from_cell(dimension, level, code.cell()), Some(code));
    assert_eq!(Code::from_path(dimension, level, code.path()), Some(code));
    assert_eq!(Code::from_digits(dimension, code.digits()), Some(code));
    assert_eq!(Code::from_self_delimiting(dimension, code.self_delimiting()), Some(code));
    assert_eq!(Code::parse(dimension, &code.to_string()).unwrap(), code);
    assert_eq!(code.digits().len(), level as usize);
    assert_eq!(code.to_string().len(), level as usize + 1);
}

/// The cell by its definition: bit `axis` of every digit is the next bit of the coordinate.
fn cell_is_the_steps_bits(code: Code) {
    let mut cell = [0u32; 3];
    for step in code.digits() {
        for (axis, coordinate) in cell.iter_mut().enumerate() {
            *coordinate = *coordinate << 1 | (step as u32 >> axis & 1);
        }
    }
    assert_eq!(code.cell(), cell);
}

fn layout(code: Code) {
    let (dimension, bits) = (code.dimension(), code.bits());
    let axes = dimension.axes() as u32;
    assert!(bits as i64 >= 0, "the sign bit is clear");
    assert_eq!(bits & 31, code.level() as u64);
    let used = axes * code.level() as u32;
    assert_eq!(bits << (1 + used) >> (1 + used), code.level() as u64, "unused levels are zero");
    for level in 0..code.level() {
        let shift = 63 - axes * (level as u32 + 1);
        assert_eq!((bits >> shift) as usize & (dimension.children() - 1), code.step(level));
    }
    // Any other bit set below the path makes the code invalid, and so does the sign.
    for bit in 5..63 - used {
        assert_eq!(Code::from_bits(dimension, bits | 1 << bit), None);
    }
    assert_eq!(Code::from_bits(dimension, bits | 1 << 63), None);
}

fn up_and_down(code: Code) {
    assert_eq!(code.parent().is_none(), code.level() == 0);
    for level in 0..=code.level() {
        let above = code.ancestor(level);
        assert_eq!(above.level(), level);
        assert!(above <= code && above.contains(code));
        assert_eq!(above.cell(), code.cell().map(|x| (x as u64 >> (code.level() - level)) as u32));
        assert!((above.bits()..=above.last_bits()).contains(&code.bits()));
    }
    if code.level() < code.dimension().max_depth() {
        let children: Vec<_> = (0..code.dimension().children()).map(|i| code.child(i)).collect();
        assert!(children.is_sorted() && code < children[0]);
        for (i, child) in children.iter().enumerate() {
            assert_eq!((child.parent(), child.step(code.level())), (Some(code), i));
            assert!(child.last_bits() <= code.last_bits());
        }
        assert!(children.windows(2).all(|pair| pair[0].last_bits() < pair[1].bits()));
    }
}

fn order_is_preorder(a: Code, b: Code) {
    // Preorder: by digits, ancestors first. That is the lexicographic order of lists.
    let (steps_a, steps_b): (Vec<_>, Vec<_>) = (a.digits().collect(), b.digits().collect());
    assert_eq!(a.cmp(&b), steps_a.cmp(&steps_b));
    assert_eq!(a.bits().cmp(&b.bits()), steps_a.cmp(&steps_b));
    assert_eq!((a.bits() as i64).cmp(&(b.bits() as i64)), steps_a.cmp(&steps_b));
    let below = steps_b.starts_with(&steps_a);
    assert_eq!(a.contains(b), below);
    assert_eq!((a.bits()..=a.last_bits()).contains(&b.bits()), below);
    let common = steps_a.iter().zip(&steps_b).take_while(|(x, y)| x == y).count();
    let ancestor = a.common_ancestor(b);
    assert_eq!(ancestor, b.common_ancestor(a));
    assert_eq!(ancestor, a.ancestor(common as u8));
    assert!(ancestor.contains(a) && ancestor.contains(b));
    if a.contains(b) && a != b {
        assert_eq!(a.cmp(&b), Ordering::Less);
    }
}

fn any_bits(dimension: Dimension, bits: u64) {
    if let Some(code) = Code::from_bits(dimension, bits) {
        assert_eq!((code.dimension(), code.bits()), (dimension, bits));
        round_trips(code);
    }
}

proptest! {
    #[test]
    fn quadtree_codes(code in code(Quad)) {
        round_trips(code);
        cell_is_the_steps_bits(code);
        layout(code);
        up_and_down(code);
        assert_eq!(Code::from_quadkey(&code.quadkey()), Some(code));
        let (z, x, y) = code.zxy();
        assert_eq!(Code::from_zxy(z, x, y), Some(code));
    }

    #[test]
    fn octree_codes(code in code(Oct)) {
        round_trips(code);
        cell_is_the_steps_bits(code);
        layout(code);
        up_and_down(code);
    }

    #[test]
    fn quadtree_order(pair in pair(Quad)) {
        order_is_preorder(pair.0, pair.1);
    }

    #[test]
    fn octree_order(pair in pair(Oct)) {
        order_is_preorder(pair.0, pair.1);
    }

    #[test]
    fn bits_that_are_no_code_are_refused(bits: u64, level in 0u64..32) {
        any_bits(Quad, bits);
        any_bits(Oct, bits);
        let clear = |axes: u64| bits >> 1 & !((1 << 63u64.saturating_sub(axes * level)) - 1) | level;
        any_bits(Quad, clear(2));
        any_bits(Oct, clear(3));
    }

    #[test]
    fn cells_outside_are_refused(level in 0u8..40, x: u32, y: u32, z: u32) {
        let inside = |axes: usize, most: u8| {
            let side = 1u64 << level;
            let coordinates = [x, y, z].into_iter().enumerate();
            level <= most && coordinates.into_iter().all(|(i, c)| (c as u64) < if i < axes { side } else { 1 })
        };
        assert_eq!(Code::from_cell(Quad, level, [x, y, z]).is_some(), inside(2, 29));
        assert_eq!(Code::from_cell(Quad, level, [x, y, 0]).is_some(), inside(2, 29) || (z != 0
            && level <= 29 && (x.max(y) as u64) < 1 << level));
        assert_eq!(Code::from_cell(Oct, level, [x, y, z]).is_some(), inside(3, 19));
    }
}

#[test]
fn known_quadkeys() {
    // The example of the Bing Maps documentation: level 3, x 3, y 5.
    let code = Code::from_zxy(3, 3, 5).unwrap();
    assert_eq!(code.quadkey(), "213");
    assert_eq!(code.to_string(), "/213");
    assert_eq!(Code::from_quadkey("213"), Some(code));
    assert_eq!(code.zxy(), (3, 3, 5));
    assert_eq!(Code::root(Quad).quadkey(), "");
    assert_eq!(Code::from_quadkey(""), Some(Code::root(Quad)));
    for bad in ["4", "21x", "2 1", "/21", "é", &"0".repeat(30)] {
        assert_eq!(Code::from_quadkey(bad), None, "{bad}");
    }
    assert_eq!(Code::from_zxy(3, 8, 0), None);
    assert_eq!(Code::from_zxy(30, 0, 0), None);
}

#[test]
fn known_bits() {
    let quad = |digits: &[usize]| Code::from_digits(Quad, digits.iter().copied()).unwrap().bits();
    assert_eq!(quad(&[]), 0);
    assert_eq!(quad(&[0]), 1);
    assert_eq!(quad(&[1]), 0x2000_0000_0000_0001);
    assert_eq!(quad(&[3]), 0x6000_0000_0000_0001);
    assert_eq!(quad(&[1, 0, 2, 3]), 0x2580_0000_0000_0004);
    assert_eq!(quad(&[3; 29]), 0x7FFF_FFFF_FFFF_FFE0 | 29);
    let oct = |digits: &[usize]| Code::from_digits(Oct, digits.iter().copied()).unwrap().bits();
    assert_eq!(oct(&[7]), 0x7000_0000_0000_0001);
    assert_eq!(oct(&[4, 1]), 0x4200_0000_0000_0002);
    assert_eq!(oct(&[7; 19]), 0x7FFF_FFFF_FFFF_FFC0 | 19);
}

#[test]
fn codes_of_planes_and_volumes_are_never_equal() {
    assert_eq!(Code::root(Quad).bits(), Code::root(Oct).bits());
    assert_ne!(Code::root(Quad), Code::root(Oct));
    // The same bits are valid in both dimensions.
    let [plane, volume] = [Quad, Oct].map(|dimension| Code::from_bits(dimension, 1).unwrap());
    assert_ne!(plane, volume);
    assert_eq!((plane.child(3).cell(), volume.child(3).cell()), ([1, 1, 0], [1, 1, 0]));
    assert_eq!((plane.dimension(), volume.child(7).parent()), (Quad, Some(volume)));
}

#[test]
fn invalid_codes_are_rejected() {
    for bad in ["", "1", "//", "/4", "/1a", " /1", "/-1"] {
        let error = Code::parse(Quad, bad).unwrap_err().to_string();
        assert!(error.contains("FD code"), "{error}");
    }
    assert!(Code::parse(Oct, "/7").is_ok() && Code::parse(Oct, "/8").is_err());
    assert_eq!(Code::from_self_delimiting(Quad, 5), None); // <1,0> in base 5: there is no digit 0
    assert_eq!(Code::from_self_delimiting(Quad, u128::MAX), None);
}
