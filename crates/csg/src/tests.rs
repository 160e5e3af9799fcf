//! Octrees compared with testing all primitives at each cell, and untrusted input.

use std::path::Path;

use crate::expression::fold;
use crate::field::Field;
use crate::model::Csg;
use crate::source::CsgTree;
use spinney_base::Result;
use spinney_engine::tree::{Child, Source, no_children};

/// Pseudorandom numbers from a fixed seed.
struct Random(u64);

impl Random {
    fn below(&mut self, count: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) % count
    }

    /// Returns a number from -1 to 1, often with few digits.
    fn number(&mut self) -> f64 {
        let steps = if self.below(3) == 0 { 8 } else { 1 << 20 };
        self.below(2 * steps + 1) as f64 / steps as f64 - 1.0
    }

    fn numbers(&mut self, count: usize) -> String {
        (0..count).map(|_| self.number().to_string()).collect::<Vec<_>>().join(", ")
    }

    /// Returns a positive length.
    fn length(&mut self) -> f64 {
        (self.number().abs() + 0.1) / 2.0
    }

    fn ring(&mut self, least: f64) -> String {
        let count = 3 + self.below(20);
        let point = |random: &mut Random| {
            format!("[{}, {}]", random.number().max(least) + random.length() / 1e3, random.number())
        };
        format!("[{}]", (0..count).map(|_| point(self)).collect::<Vec<_>>().join(", "))
    }

    fn primitive(&mut self) -> String {
        let (length, other) = (self.length(), self.length());
        match self.below(9) {
            0 => format!(
                "block({}, {})",
                self.numbers(3),
                [length + 1.0; 3].map(|at| at.to_string()).join(",")
            ),
            1 => format!("ball({}, {length})", self.numbers(3)),
            2 => format!("cylinder({}, {}, 1.5, {length})", self.numbers(3), self.numbers(2)),
            3 => format!("cone({}, {length}, {}, -1.25, {other})", self.numbers(3), self.numbers(2)),
            4 => format!("torus({}, {}, 2, {}, {length})", self.numbers(3), self.numbers(2), length + other),
            5 => format!("half_space({}, 1.5, {})", self.numbers(2), self.number()),
            6 => format!("prism({}, {}, -0.5, {other})", self.ring(-2.0), self.ring(-2.0)),
            7 => format!("sweep({}, {}, {length})", self.ring(-2.0), self.numbers(2)),
            _ => format!("revolve({}, {}, 0.5, {}, 1)", self.ring(0.0), self.numbers(2), self.numbers(2)),
        }
    }

    /// Returns the text of a random solid with a maximum number of levels.
    fn solid(&mut self, levels: u64) -> String {
        if levels == 0 || self.below(5) == 0 {
            return self.primitive();
        }
        let count = 2 + self.below(3);
        let parts = |random: &mut Random, count: u64| {
            (0..count).map(|_| random.solid(levels - 1)).collect::<Vec<_>>().join(", ")
        };
        match self.below(10) {
            0 | 1 => format!("union({})", parts(self, count)),
            2 => format!("intersection({})", parts(self, 2)),
            3 => format!("difference({})", parts(self, count)),
            4 => format!("xor({})", parts(self, count)),
            5 => format!("complement({})", parts(self, 1)),
            6 => format!("translate({}, {})", self.numbers(3), parts(self, 1)),
            7 => format!("rotate({}, 2, {}, {})", self.numbers(2), 180.0 * self.number(), parts(self, 1)),
            8 => format!("mirror({}, 2, {})", self.numbers(2), parts(self, 1)),
            _ => format!("scale({}, {}, -1.5, {})", self.length(), self.length() + 0.5, parts(self, 1)),
        }
    }
}

fn parse(text: &str) -> Result<Csg> {
    Csg::parse(Path::new("test.csg"), text)
}

/// Returns the values of a tree's cells, x fastest.
fn cells<S: Source>(tree: &S) -> Vec<u8> {
    let side = 1usize << tree.depth();
    let mut cells = vec![0; side.pow(3)];
    let mut stack = vec![([0; 3], side, tree.root().unwrap())];
    while let Some((at, width, child)) = stack.pop() {
        match child {
            Child::Void => {}
            Child::Leaf(value) => {
                let value = value.to_bytes()[0];
                for z in at[2]..at[2] + width {
                    for y in at[1]..at[1] + width {
                        let first = (z * side + y) * side + at[0];
                        cells[first..first + width].fill(value);
                    }
                }
            }
            Child::Inner { node, .. } => {
                assert!(width > 1, "a cell that is not a leaf");
                let mut children = no_children();
                tree.children(&node, &mut children).unwrap();
                for (number, child) in children.into_iter().enumerate() {
                    let half = width / 2;
                    stack.push(([0, 1, 2].map(|axis| at[axis] + (number >> axis & 1) * half), half, child));
                }
            }
        }
    }
    cells
}

/// Returns a tree over a solid's box.
fn tree(csg: &Csg, depth: u8, by_area: bool) -> CsgTree<'static> {
    let bounded = csg.bounded().unwrap();
    let [min, max] = bounded.bounds;
    let longest = (0..3).map(|axis| max[axis] - min[axis]).fold(0.0, f64::max);
    let cell = longest / f64::from(1u32 << depth);
    let frame: [[f64; 4]; 3] = std::array::from_fn(|row| {
        std::array::from_fn(|column| match column {
            3 => min[row],
            column if column == row => cell,
            _ => 0.0,
        })
    });
    let field = Field::new(&bounded, &frame, f64::from(1u32 << depth));
    CsgTree { field, instructions: bounded.lowered.instructions, depth, by_area, progress: &() }
}

#[test]
fn trees_have_the_cells_that_all_primitives_say() {
    let mut random = Random(42);
    let mut kinds = [0; 2];
    for _ in 0..400 {
        let text = format!("bounds(-1,-1,-1, 1,1,1); {}", random.solid(4));
        let csg = parse(&text).unwrap();
        let depth = 1 + random.below(5) as u8;
        let tree = tree(&csg, depth, false);
        let side = 1usize << depth;
        for (number, value) in cells(&tree).into_iter().enumerate() {
            let at = [number % side, number / side % side, number / side / side];
            let inside = tree.field.has(&tree.instructions, at.map(|at| at as f64 + 0.5));
            assert_eq!(value, if inside { 255 } else { 0 }, "{at:?} of {side}: {text}");
            kinds[usize::from(inside)] += 1;
        }
    }
    assert!(kinds.iter().all(|count| *count > 100_000), "{kinds:?}");
}

#[test]
fn shares_of_cells_are_those_of_finer_cells() {
    let mut random = Random(7);
    for _ in 0..60 {
        let text = format!("bounds(-1,-1,-1, 1,1,1); {}", random.solid(3));
        let csg = parse(&text).unwrap();
        let (coarse, fine) = (cells(&tree(&csg, 3, true)), cells(&tree(&csg, 6, false)));
        for (number, value) in coarse.into_iter().enumerate() {
            let [x, y, z] = [number % 8, number / 8 % 8, number / 64];
            let all = (0..512).filter(|cell| {
                let at = [8 * x + cell % 8, 8 * y + cell / 8 % 8, 8 * z + cell / 64];
                fine[(at[2] * 64 + at[1]) * 64 + at[0]] != 0
            });
            assert_eq!(usize::from(value), (all.count() * 255 + 256) / 512, "{text}");
        }
    }
}

/// Nesting, complements and names are equivalent notations.
#[test]
fn expressions_mean_what_they_say() {
    let same = [
        (
            "difference(block(0,0,0,4,4,4), ball(1,1,1,2))",
            "intersection(block(0,0,0,4,4,4), complement(ball(1,1,1,2)))",
        ),
        (
            "complement(union(ball(0,0,0,2), ball(1,0,0,2)))",
            "intersection(complement(ball(0,0,0,2)), complement(ball(1,0,0,2)))",
        ),
        (
            "xor(ball(0,0,0,2), complement(ball(1,0,0,2)), ball(0,1,0,2))",
            "complement(xor(ball(0,0,0,2), xor(ball(1,0,0,2), ball(0,1,0,2))))",
        ),
        ("let a = ball(1,0,0,1); union(a, translate(0,2,0, a))", "ball([1,0,0],1); ball([1,2,0],1);"),
        ("translate(1,2,3, rotate(0,0,1,90, scale(2, block(0,0,0,1,2,3))))", "block(-3,2,3, 1,4,9)"),
        ("affine(1,0,0,5, 0,1,0,6, 0,0,1,7, ball(0,0,0,1))", "ball(5,6,7, 1)"),
        ("mirror(1,0,0, prism([[0,0],[2,0],[0,2]], 0, 1))", "prism([[0,0],[-2,0],[0,2]], 1, 0)"),
        ("revolve([[0,0],[2,0],[2,3],[0,3]])", "cylinder(0,0,0, 0,0,3, 2)"),
        ("sweep([[0,0],[1,0],[1,1],[0,1]], 0,0,2, 3)", "block(0,0,3, 1,1,5)"),
        ("# a\nball(0,0,0,1) // b", "\r\n\tball(\n0 , 0, 0,1,);"),
    ];
    for (one, other) in same {
        let clip = "bounds(-4,-4,-4, 8,8,10);";
        let [one, other] =
            [one, other].map(|text| cells(&tree(&parse(&format!("{clip}{text}")).unwrap(), 6, false)));
        let differ = one.iter().zip(&other).filter(|(one, other)| one != other).count();
        assert_eq!(differ, 0);
        assert!(one.contains(&255) && one.contains(&0));
    }
}

#[test]
fn boxes_hold_solids() {
    let bounds = |text: &str| parse(text).map(|csg| csg.bounded().map(|bounded| bounded.bounds));
    let sure = |text: &str| bounds(text).unwrap().unwrap();
    assert_eq!(sure("ball(1,2,3, 4)"), [[-3.0, -2.0, -1.0], [5.0, 6.0, 7.0]]);
    assert_eq!(sure("difference(block(0,0,0,1,2,3), ball(9,9,9,1))"), [[0.0; 3], [1.0, 2.0, 3.0]]);
    assert_eq!(sure("intersection(block(0,0,0,9,9,9), half_space(0,0,2, 4))"), [[0.0; 3], [9.0, 9.0, 2.0]]);
    assert_eq!(sure("torus(0,0,0, 0,0,1, 3, 1)"), [[-4.0, -4.0, -1.0], [4.0, 4.0, 1.0]]);
    assert_eq!(sure("complement(block(0,0,0,1,1,1))"), [[0.0; 3], [1.0; 3]]);
    // (An empty solid gets the box around its primitives.)
    assert_eq!(sure("intersection(ball(0,0,0,1), ball(9,0,0,1))"), [[-1.0; 3], [10.0, 1.0, 1.0]]);
    assert!(bounds("half_space(0,0,1, 0)").unwrap().is_err());
}

fn error_of(text: &str) -> String {
    let error = parse(text).unwrap_err().to_string();
    assert!(error.len() < 600, "a message of {} bytes", error.len());
    error
}

#[test]
fn errors_report_position_and_expectation() {
    let cases = [
        ("", "line 1, column 1: got the end of the text, expected a solid"),
        ("ball(0,0,0)", "line 1, column 11: got `)`, expected a number: ball(x,y,z, radius)"),
        ("ball(0,0,0,1,2)", "line 1, column 14: got the number 2, expected `)`: ball"),
        ("\n  ball(0,0,0,-1)", "line 2, column 3: got the radius -1, expected a length above zero"),
        ("ball(0,0,0,nan)", "line 1, column 12: got `nan`, expected block"),
        ("ball(0,0,0,1e999)", "line 1, column 12: got `1e999`, expected a number from -1e30 to 1e30"),
        ("ball(0,0,0,1e31)", "line 1, column 12: got `1e31`"),
        ("ball(0,0,0,1x)", "line 1, column 12: got `1x`, expected a number such as"),
        ("ball(0 0,0,1)", "line 1, column 8: got the number 0, expected `,` or `)`"),
        ("sphere(1)", "line 1, column 1: got `sphere`, expected ball(x,y,z, radius)"),
        ("let a = a; a", "line 1, column 9: got `a`, expected block"),
        ("let a = union(b, a); a", "line 1, column 15: got `b`"),
        ("let a = ball(0,0,0,1); let a = a; a", "line 1, column 28: got `a`, expected another name"),
        ("let ball = ball(0,0,0,1);", "line 1, column 5: got `ball`, expected a name that is not a keyword"),
        ("let a = ball(0,0,0,1)", "got the end of the text, expected `;` after the definition of `a`"),
        ("union()", "line 1, column 7: got `)`, expected a solid"),
        ("union(1)", "line 1, column 7: got the number 1, expected a solid"),
        ("union", "line 1, column 6: got the end of the text, expected `(` after union"),
        ("complement(ball(0,0,0,1), ball(1,0,0,1))", "got 2 solids, expected one"),
        ("scale(0, ball(0,0,0,1))", "got a transform that cannot be inverted"),
        (
            "scale(1e-20, scale(1e-20, ball(0,0,0,1)))",
            "line 1, column 27: got a primitive whose transformed coordinates",
        ),
        (
            "rotate(0,0,0, 45, ball(0,0,0,1))",
            "got the axis [0.0, 0.0, 0.0], expected a vector that is not zero",
        ),
        ("torus(0,0,0, 0,0,1, 1, 2)", "expected a ring radius above the tube radius"),
        ("revolve([[-1,0],[1,0],[1,1]])", "got the point [-1, 0], expected distances from the axis"),
        ("prism([[0,0],[1,1]], 0, 1)", "got an outline without an area"),
        (
            "prism([[0,0],[1,1],[2]], 0, 1)",
            "line 1, column 22: got `]`, expected `,`: the point at line 1, column 20",
        ),
        ("prism([[0,0],1], 0, 1)", "expected numbers, as in [1, 2, 3], or points"),
        ("prism(0, 1)", "got the number 0, expected an outline"),
        ("prism([], 0, 1)", "got nothing in brackets"),
        ("sweep([[0,0],[1,0],[0,1]], 1,0,0)", "expected a vector out of the outline's plane"),
        ("block(0,0,0, 1,0,1)", "got a box without a volume"),
        ("unit(yard); ball(0,0,0,1)", "line 1, column 6: got `yard`, expected mm, cm, m, km, in or ft"),
        ("bounds(0,0,0,1,1,1); bounds(0,0,0,1,1,1); ball(0,0,0,1)", "got a second `bounds`"),
        ("bounds(0,0,ball(0,0,0,1))", "line 1, column 12: got `ball`, expected a number"),
        ("ball(0,0,0,1) ball(0,0,0,1)", "line 1, column 15: got `ball`, expected `;`"),
        ("ball(0,0,0,1); $", "line 1, column 16: got the character '$'"),
        ("cylinder(0,0,0, 0,0,0, 1)", "got an axis along [0.0, 0.0, 0.0]"),
        ("cone(0,0,0,-1, 0,0,1,2)", "got a negative radius"),
    ];
    for (text, expected) in cases {
        let found = error_of(text);
        assert!(found.contains(expected), "{text}: {found}");
    }
}

#[test]
fn malicious_input_is_rejected_quickly() {
    let many = 1_000_000;
    for text in [
        "[".repeat(many),
        "(".repeat(many),
        "union(".repeat(many),
        format!("prism({}", "[".repeat(many)),
        "let ".repeat(many),
        "a".repeat(many),
        "9".repeat(many),
        "-".repeat(many),
        "ball(0,0,0,1)".repeat(many / 10),
        "# \n".repeat(many),
        "é".repeat(many),
        format!("ball({}", "0,".repeat(many)),
        "x".repeat(9 << 20),
    ] {
        error_of(&text);
    }
    // Each name doubles the previous one.
    let mut text = "let a0 = ball(0,0,0,1);".to_string();
    for number in 1..64 {
        text += &format!("let a{number} = union(a{0}, a{0});", number - 1);
    }
    assert!(error_of(&text).contains("more than 1048576 primitives"));
    // Chains of names may have any length.
    let mut text = "let a0 = ball(0,0,0,1);".to_string();
    for number in 1..100_000 {
        text += &format!("let a{number} = complement(a{});", number - 1);
    }
    let csg = parse(&format!("{text} difference(block(0,0,0,1,1,1), a99999);")).unwrap();
    assert_eq!(csg.primitives(), 2);
    let deep = format!("{}ball(0,0,0,1){}", "union(".repeat(4095), ")".repeat(4095));
    assert_eq!(parse(&deep).unwrap().primitives(), 1);
    assert!(parse("\u{feff}ball(0,0,0,1)").is_ok());
    assert!(error_of(&format!("union({deep})")).contains("4097 nested calls"));
}

/// Invalid input is rejected, and parsing of valid input terminates.
#[test]
fn corrupt_input_does_no_harm() {
    let mut random = Random(3);
    for _ in 0..3000 {
        let mut text = random.solid(3).into_bytes();
        for _ in 0..1 + random.below(3) {
            let at = random.below(text.len() as u64) as usize;
            text[at] = b"()[],;=#/let0.9e-xab "[random.below(21) as usize];
        }
        if let Ok(csg) = parse(std::str::from_utf8(&text).unwrap())
            && csg.bounded().is_ok_and(|bounded| bounded.bounds.iter().flatten().all(|at| at.abs() < 1e9))
        {
            let tree = tree(&csg, 3, false);
            let count = fold(&tree.instructions, &mut Vec::new(), |_, _| 1, |_, of| of.iter().sum()).unwrap();
            assert_eq!(
                count,
                tree.instructions
                    .iter()
                    .filter(|instruction| matches!(
                        instruction,
                        crate::expression::Instruction::Primitive(..)
                    ))
                    .count()
            );
            cells(&tree);
        }
    }
}
