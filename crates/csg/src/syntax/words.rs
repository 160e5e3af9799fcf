//! Keywords of the CSG language: their arguments and the solids that they create.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

use super::parse::Argument;
use super::{At, wrong};
use crate::affine::{Affine, MAX_NUMBER, dot};
use crate::model::{Builder, Solid};
use crate::outline::Outline;
use crate::patches::{FacetTree, Patch, shells};
use crate::shape::Shape;
use spinney_base::Result;

/// Creates a solid from a keyword's arguments.
type Make = fn(&mut Builder<'_>, &mut Arguments<'_>) -> Result<Solid>;

/// Keywords, with their usage and constructor.
const WORDS: [(&str, &str, Make); 20] = [
    ("block", "block(x0,y0,z0, x1,y1,z1)", block),
    ("ball", "ball(x,y,z, radius)", ball),
    ("cylinder", "cylinder(x0,y0,z0, x1,y1,z1, radius)", cylinder),
    ("cone", "cone(x0,y0,z0, radius0, x1,y1,z1, radius1)", cone),
    ("torus", "torus(x,y,z, ax,ay,az, ring_radius, tube_radius)", torus),
    ("half_space", "half_space(nx,ny,nz, distance)", half_space),
    ("prism", "prism([[x,y],...], ..., z0, z1)", prism),
    ("sweep", "sweep([[x,y],...], ..., dx,dy,dz [, z0])", sweep),
    ("revolve", "revolve([[r,z],...], ... [, x,y,z, ax,ay,az])", revolve),
    ("patches", "patches([[x,y,z],...], ...), with 9 or 16 points for each patch", patches),
    ("union", "union(a, b, ...)", union),
    ("intersection", "intersection(a, b, ...)", intersection),
    ("difference", "difference(a, b, ...)", difference),
    ("xor", "xor(a, b, ...)", xor),
    ("complement", "complement(a)", complement),
    ("translate", "translate(x,y,z, a)", translate),
    ("scale", "scale(factor, a) or scale(x,y,z, a)", scale),
    ("rotate", "rotate(ax,ay,az, degrees, a)", rotate),
    ("mirror", "mirror(nx,ny,nz, a)", mirror),
    ("affine", "affine(xx,xy,xz,x0, yx,yy,yz,y0, zx,zy,zz,z0, a)", affine),
];

/// Whether a name is a keyword.
pub(super) fn is_word(name: &str) -> bool {
    WORDS.iter().any(|(word, ..)| *word == name)
}

/// Returns a keyword's usage.
pub(super) fn usage(name: &str) -> &'static str {
    WORDS.iter().find(|(word, ..)| *word == name).map_or("an argument", |(_, usage, _)| usage)
}

/// Returns what is expected in place of an unknown name. Names of other CSG languages map to the
/// equivalent keyword.
pub(super) fn instead_of(name: &str) -> String {
    let same = match name {
        "cube" | "box" | "cuboid" => "block",
        "sphere" => "ball",
        "linear_extrude" | "polygon" | "extrude" => "prism",
        "rotate_extrude" => "revolve",
        "multmatrix" => "affine",
        "plane" | "halfspace" => "half_space",
        "intersect" => "intersection",
        "subtract" | "minus" => "difference",
        _ => {
            let words: Vec<&str> = WORDS.iter().map(|(word, ..)| *word).collect();
            return format!("{}, or a name defined before", words.join(", "));
        }
    };
    usage(same).into()
}

/// Creates the solid of a call.
pub(super) fn call(builder: &mut Builder<'_>, mut arguments: Arguments<'_>) -> Result<Solid> {
    let make = WORDS.iter().find(|(word, ..)| *word == arguments.word).map(|(.., make)| make);
    let make = make.ok_or_else(|| arguments.wrong(arguments.at, "an unknown word", "a keyword"))?;
    let solid = make(builder, &mut arguments)?;
    arguments.end()?;
    Ok(solid)
}

/// Returns the box of a `bounds` statement.
pub(super) fn bounds(mut arguments: Arguments<'_>) -> Result<[[f64; 3]; 2]> {
    let [x0, y0, z0, x1, y1, z1] = arguments.numbers()?;
    arguments.end()?;
    arguments.corners([x0, y0, z0], [x1, y1, z1])
}

/// The arguments of a call, consumed in order.
pub(super) struct Arguments<'a> {
    path: &'a Path,
    word: &'a str,
    at: At,
    end: At,
    rest: VecDeque<(Argument, At)>,
}

impl<'a> Arguments<'a> {
    pub(super) fn new(
        path: &'a Path,
        word: &'a str,
        at: At,
        end: At,
        arguments: Vec<(Argument, At)>,
    ) -> Arguments<'a> {
        // Lists of numbers are flattened, so that points may be written with or without brackets.
        let mut rest = VecDeque::with_capacity(arguments.len());
        for (argument, at) in arguments {
            match argument {
                Argument::Numbers(numbers) => {
                    rest.extend(numbers.into_iter().map(|number| (Argument::Number(number), at)));
                }
                other => rest.push_back((other, at)),
            }
        }
        Arguments { path, word, at, end, rest }
    }

    /// Creates the error for an unexpected argument.
    fn wrong(&self, at: At, found: impl Into<String>, expected: &str) -> spinney_base::Error {
        wrong(self.path, at, found, format!("{expected}: {}", self.usage()))
    }

    fn usage(&self) -> &'static str {
        if self.word == "bounds" { "bounds(x0,y0,z0, x1,y1,z1)" } else { usage(self.word) }
    }

    /// Returns the next argument as error messages show it, and its position.
    fn next_shown(&self) -> (String, At) {
        match self.rest.front() {
            None => ("`)`".into(), self.end),
            Some((Argument::Number(number), at)) => (format!("the number {number}"), *at),
            Some((Argument::Numbers(_), at)) => ("numbers in brackets".into(), *at),
            Some((Argument::Points(_), at)) => ("an outline".into(), *at),
            Some((Argument::SpacePoints(points), at)) => {
                (format!("{} points of three numbers", points.len()), *at)
            }
            Some((Argument::Solid(_), at)) => ("a solid".into(), *at),
        }
    }

    /// Consumes `N` numbers.
    fn numbers<const N: usize>(&mut self) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            let Some((Argument::Number(next), _)) = self.rest.front() else {
                let (found, at) = self.next_shown();
                return Err(self.wrong(at, found, "a number"));
            };
            *number = *next;
            self.rest.pop_front();
        }
        Ok(numbers)
    }

    /// Returns how many numbers come next.
    fn number_count(&self) -> usize {
        self.rest.iter().take_while(|(argument, _)| matches!(argument, Argument::Number(_))).count()
    }

    /// Consumes an outline: all rings that come next.
    fn outline(&mut self) -> Result<Outline> {
        let mut rings = Vec::new();
        while let Some((Argument::Points(_), _)) = self.rest.front() {
            let Some((Argument::Points(mut points), at)) = self.rest.pop_front() else { break };
            points.dedup();
            if points.first() == points.last() {
                points.pop();
            }
            let is_flat = (0..2).any(|axis| points.iter().all(|point| point[axis] == points[0][axis]));
            if points.len() < 3 || is_flat {
                return Err(self.wrong(at, "an outline without an area", "at least three vertices"));
            }
            rings.push(points);
        }
        if rings.is_empty() {
            let (found, at) = self.next_shown();
            return Err(self.wrong(at, found, "an outline, such as [[0,0],[1,0],[0,1]]"));
        }
        Ok(Outline::new(rings))
    }

    /// Consumes all patches that come next, at least one.
    fn patches(&mut self) -> Result<Vec<Patch>> {
        let mut patches = Vec::new();
        while let Some((Argument::SpacePoints(points), at)) = self.rest.front_mut() {
            let (points, at) = (std::mem::take(points), *at);
            let count = points.len();
            let patch = Patch::new(points, at);
            let found = || format!("{count} points of patch {}", patches.len() + 1);
            let expected = "9 points (biquadratic) or 16 points (bicubic)";
            patches.push(patch.ok_or_else(|| self.wrong(at, found(), expected))?);
            self.rest.pop_front();
        }
        if patches.is_empty() {
            let (found, at) = self.next_shown();
            return Err(self.wrong(at, found, "a patch of 9 or 16 points of three numbers"));
        }
        Ok(patches)
    }

    /// Consumes all solids that come next, at least one.
    fn solids(&mut self) -> Result<Vec<Solid>> {
        let mut solids = Vec::new();
        while let Some((Argument::Solid(solid), _)) = self.rest.front() {
            solids.push(*solid);
            self.rest.pop_front();
        }
        if solids.is_empty() {
            let (found, at) = self.next_shown();
            return Err(self.wrong(at, found, "a solid"));
        }
        Ok(solids)
    }

    /// Fails if there are arguments left.
    fn end(&self) -> Result<()> {
        let (found, at) = self.next_shown();
        if self.rest.is_empty() { Ok(()) } else { Err(self.wrong(at, found, "`)`")) }
    }

    /// Checks that a length is positive.
    fn length(&self, what: &str, length: f64) -> Result<f64> {
        if length > 1.0 / MAX_NUMBER {
            return Ok(length);
        }
        Err(self.wrong(self.at, format!("the {what} {length}"), "a length above zero"))
    }

    /// Checks that a direction is not zero.
    fn direction(&self, what: &str, direction: [f64; 3]) -> Result<[f64; 3]> {
        let most = direction.iter().fold(0.0, |most: f64, part| most.max(part.abs()));
        if most > 1.0 / MAX_NUMBER {
            return Ok(direction);
        }
        Err(self.wrong(self.at, format!("{what} {direction:?}"), "a vector that is not zero"))
    }

    /// Returns the box between two opposite corners.
    fn corners(&self, a: [f64; 3], b: [f64; 3]) -> Result<[[f64; 3]; 2]> {
        let min = [0, 1, 2].map(|axis| a[axis].min(b[axis]));
        let max = [0, 1, 2].map(|axis| a[axis].max(b[axis]));
        if (0..3).any(|axis| min[axis] == max[axis]) {
            return Err(self.wrong(self.at, "a box without a volume", "two opposite corners"));
        }
        Ok([min, max])
    }

    /// Applies a transform to the solids that come next.
    fn moved(&mut self, builder: &mut Builder<'_>, map: Affine) -> Result<Solid> {
        if map.inverse().is_none() || !map.is_bounded() {
            return Err(self.wrong(self.at, "a transform that cannot be inverted", "an invertible one"));
        }
        let solids = self.solids()?;
        let all = builder.union(&solids, self.at)?;
        builder.moved(map, all, self.at)
    }

    /// Creates a primitive of a shape, with the transform from local coordinates to those of the
    /// text.
    fn primitive(&self, builder: &mut Builder<'_>, shape: Shape, map: Affine) -> Result<Solid> {
        if map.inverse().is_none() || !map.is_bounded() {
            return Err(self.wrong(self.at, "numbers that are too large or too small", "others"));
        }
        builder.primitive(shape, map, self.word, self.at)
    }
}

fn block(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let [x0, y0, z0, x1, y1, z1] = arguments.numbers()?;
    let [min, max] = arguments.corners([x0, y0, z0], [x1, y1, z1])?;
    arguments.primitive(builder, Shape::Block { min, max }, Affine::IDENTITY)
}

fn ball(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let [x, y, z, radius] = arguments.numbers()?;
    let radius = arguments.length("radius", radius)?;
    arguments.primitive(builder, Shape::Ball { radius }, Affine::translation([x, y, z]))
}

fn cylinder(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let [x0, y0, z0, x1, y1, z1, radius] = arguments.numbers()?;
    let radius = arguments.length("radius", radius)?;
    cone_between(builder, arguments, [[x0, y0, z0], [x1, y1, z1]], [radius; 2])
}

fn cone(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let [x0, y0, z0, low, x1, y1, z1, high] = arguments.numbers()?;
    arguments.length("larger radius", low.max(high))?;
    if low < 0.0 || high < 0.0 {
        return Err(arguments.wrong(arguments.at, "a negative radius", "radii of at least zero"));
    }
    cone_between(builder, arguments, [[x0, y0, z0], [x1, y1, z1]], [low, high])
}

fn cone_between(
    builder: &mut Builder<'_>,
    arguments: &Arguments<'_>,
    [from, to]: [[f64; 3]; 2],
    radii: [f64; 2],
) -> Result<Solid> {
    let along = [0, 1, 2].map(|axis| to[axis] - from[axis]);
    arguments.direction("an axis along", along)?;
    let height = arguments.length("height", dot(along, along).sqrt())?;
    arguments.primitive(builder, Shape::Cone { radii, height }, Affine::frame(from, along))
}

fn torus(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let [x, y, z, ax, ay, az, ring, tube] = arguments.numbers()?;
    let axis = arguments.direction("the axis", [ax, ay, az])?;
    let tube = arguments.length("radius of the tube", tube)?;
    if ring <= tube {
        let found = format!("a ring of radius {ring} around a tube of radius {tube}");
        return Err(arguments.wrong(arguments.at, found, "a ring radius above the tube radius"));
    }
    arguments.primitive(builder, Shape::Torus { ring, tube }, Affine::frame([x, y, z], axis))
}

fn half_space(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let [x, y, z, distance] = arguments.numbers()?;
    let normal = arguments.direction("the normal", [x, y, z])?;
    let square = dot(normal, normal);
    let origin = normal.map(|part| part * distance / square);
    arguments.primitive(builder, Shape::HalfSpace, Affine::frame(origin, normal))
}

fn prism(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let outline = arguments.outline()?;
    let [z0, z1] = arguments.numbers()?;
    arguments.length("height", (z1 - z0).abs())?;
    let heights = [z0.min(z1), z0.max(z1)];
    arguments.primitive(builder, Shape::Prism { outline, heights }, Affine::IDENTITY)
}

fn sweep(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let outline = arguments.outline()?;
    let [dx, dy, dz] = arguments.numbers()?;
    let [z0] = if arguments.number_count() > 0 { arguments.numbers()? } else { [0.0] };
    if dz.abs() <= 1.0 / MAX_NUMBER {
        let expected = "a vector out of the outline's plane";
        return Err(arguments.wrong(arguments.at, format!("the vector {:?}", [dx, dy, dz]), expected));
    }
    let map = Affine { rows: [[1.0, 0.0, dx, 0.0], [0.0, 1.0, dy, 0.0], [0.0, 0.0, dz, z0]] };
    arguments.primitive(builder, Shape::Prism { outline, heights: [0.0, 1.0] }, map)
}

fn revolve(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let outline = arguments.outline()?;
    let mut points = outline.rings.iter().flat_map(|ring| &ring.points);
    if let Some([radius, z]) = points.find(|point| point[0] < 0.0) {
        let found = format!("the point [{radius}, {z}]");
        return Err(arguments.wrong(arguments.at, found, "distances from the axis of at least zero"));
    }
    let map = if arguments.number_count() > 0 {
        let [x, y, z, ax, ay, az] = arguments.numbers()?;
        Affine::frame([x, y, z], arguments.direction("the axis", [ax, ay, az])?)
    } else {
        Affine::IDENTITY
    };
    arguments.primitive(builder, Shape::Revolved { outline }, map)
}

fn patches(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let patches = arguments.patches()?;
    solid_of_patches(builder, arguments.path, patches, arguments.at)
}

/// Creates the solid of patches: the union of their shells.
pub(crate) fn solid_of_patches(
    builder: &mut Builder<'_>,
    path: &Path,
    patches: Vec<Patch>,
    at: At,
) -> Result<Solid> {
    let mut solids = Vec::new();
    for shell in shells(path, patches)? {
        let shape = Shape::Patches { shell: Arc::new(shell), facets: FacetTree::default().into() };
        solids.push(builder.primitive(shape, Affine::IDENTITY, "patches", at)?);
    }
    builder.union(&solids, at)
}

fn union(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    builder.union(&arguments.solids()?, arguments.at)
}

fn intersection(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    builder.intersection(&arguments.solids()?, arguments.at)
}

fn difference(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let mut solids = arguments.solids()?;
    for solid in &mut solids[1..] {
        *solid = builder.complement(*solid, arguments.at)?;
    }
    builder.intersection(&solids, arguments.at)
}

fn xor(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    builder.xor(&arguments.solids()?, arguments.at)
}

fn complement(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let solids = arguments.solids()?;
    if solids.len() > 1 {
        return Err(arguments.wrong(arguments.at, format!("{} solids", solids.len()), "one"));
    }
    builder.complement(solids[0], arguments.at)
}

fn translate(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let by = arguments.numbers()?;
    arguments.moved(builder, Affine::translation(by))
}

fn scale(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let by = if arguments.number_count() == 1 {
        let [factor] = arguments.numbers()?;
        [factor; 3]
    } else {
        arguments.numbers()?
    };
    arguments.moved(builder, Affine::scale(by))
}

fn rotate(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let [x, y, z, degrees] = arguments.numbers()?;
    let axis = arguments.direction("the axis", [x, y, z])?;
    arguments.moved(builder, Affine::rotation(axis, degrees))
}

fn mirror(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let normal = arguments.numbers()?;
    let normal = arguments.direction("the normal", normal)?;
    arguments.moved(builder, Affine::mirror(normal))
}

fn affine(builder: &mut Builder<'_>, arguments: &mut Arguments<'_>) -> Result<Solid> {
    let numbers: [f64; 12] = arguments.numbers()?;
    let rows = std::array::from_fn(|row| std::array::from_fn(|column| numbers[4 * row + column]));
    arguments.moved(builder, Affine { rows })
}
