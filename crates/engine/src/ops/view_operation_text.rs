//! String format of view operations: parsing and printing.

use std::fmt;
use std::str::FromStr;

use super::affine::{AffineMap, Axis};
use super::calc::Calculation;
use super::view_operation::{RotationAxis, ViewOperation};
use spinney_base::{Error, Result};
use spinney_crs::{Coordinates, Crs};

/// All operations, for the message about an unknown one.
const OPERATIONS: &str = "window=, crop, translate=, scale=, rotate=, mirror=, transpose, axes=, affine=, depth=, \
                     tree-depth=, subtree=, embed=, crs=, like=, warp=, grid=, opaque, void=, calc=, reduce=, \
                     composite=, components= or sieve=";

impl FromStr for ViewOperation {
    type Err = Error;

    fn from_str(text: &str) -> Result<ViewOperation> {
        if let Some(definition) = text.strip_prefix("crs=") {
            let crs = Crs::parse(definition)?;
            return crs.check_registered().map(|()| ViewOperation::Crs(crs));
        }
        if let Some(target) = text.strip_prefix("warp=") {
            return target.parse().map(ViewOperation::Warp);
        }
        if let Some(calculation) = text.strip_prefix("calc=") {
            return Calculation::parse(calculation)
                .map(|calculation| ViewOperation::Calculation(Box::new(calculation)));
        }
        if let Some(reduction) = text.strip_prefix("reduce=") {
            let calculation = Calculation::parse_reduction(reduction)?;
            return Ok(ViewOperation::Calculation(Box::new(calculation)));
        }
        if let Some(names) = text.strip_prefix("composite=") {
            let calculation = Calculation::parse_composite(names)?;
            return Ok(ViewOperation::Calculation(Box::new(calculation)));
        }
        if let Some(neighbours) = text.strip_prefix("components=") {
            return neighbours.parse().map(ViewOperation::Components);
        }
        if let Some(sieve) = text.strip_prefix("sieve=") {
            return sieve.parse().map(ViewOperation::Sieve);
        }
        if let Some((window, coordinates)) = text.split_once(",in=")
            && window.starts_with("window=")
        {
            return OperationText::new(window)?.window_in(coordinates.parse()?);
        }
        let step = OperationText::new(text)?;
        match step.name {
            "window" => step.window(),
            "crop" if step.arguments.is_empty() => Ok(ViewOperation::Crop),
            "translate" => step.translate(),
            "opaque" if step.arguments.is_empty() => Ok(ViewOperation::Opaque),
            "scale" => step.scale(),
            "rotate" => step.rotate(),
            "mirror" => step.mirror(),
            "transpose" if step.arguments.is_empty() => symmetry([Axis::Y, Axis::X, Axis::Z], [false; 3]),
            "axes" => step.axes(),
            "affine" => step.affine(),
            "depth" => step.level(ViewOperation::Depth, "depth=N, a number of levels"),
            "tree-depth" => step.level(ViewOperation::TreeDepth, "tree-depth=N, a number of levels"),
            "subtree" => step.node(ViewOperation::Subtree),
            "embed" => step.node(ViewOperation::Embed),
            "like" if !step.arguments.is_empty() => step.like(),
            "grid" => step.grid(),
            "void" => match step.arguments.parse() {
                Ok(number) => Ok(ViewOperation::Void(number)),
                Err(_) => Err(step.wrong("void=NUMBER: cells with this number become VOID")),
            },
            _ => Err(step.wrong(OPERATIONS)),
        }
    }
}

/// String of an operation, split into name and arguments.
struct OperationText<'a> {
    whole: &'a str,
    name: &'a str,
    /// Everything after the `=`.
    arguments: &'a str,
    /// Arguments before the `@`, and after it.
    list: &'a str,
    centre: Option<&'a str>,
    /// The list, if it consists of finite numbers.
    numbers: Option<Vec<f64>>,
}

impl<'a> OperationText<'a> {
    fn new(whole: &'a str) -> Result<OperationText<'a>> {
        let (name, arguments) = whole.split_once('=').unwrap_or((whole, ""));
        let (list, centre) = match arguments.split_once('@') {
            Some((list, centre)) => (list, Some(centre)),
            None => (arguments, None),
        };
        let finite = |number: &f64| number.is_finite();
        let numbers = numbers(list).filter(|numbers| numbers.iter().all(finite));
        let step = OperationText { whole, name, arguments, list, centre, numbers };
        if step.centre.is_some() && !matches!(name, "rotate" | "like") {
            return Err(step.wrong("an operation without `@`; only rotate=DEGREES@COL,ROW has one"));
        }
        Ok(step)
    }

    fn wrong(&self, expected: &str) -> Error {
        Error::invalid("operation", format!("`{}`", self.whole), expected)
    }

    fn like(&self) -> Result<ViewOperation> {
        Ok(match self.arguments.rsplit_once(",extent=") {
            Some((path, extent)) => ViewOperation::Like(path.into(), Some(extent.parse()?)),
            None => ViewOperation::Like(self.arguments.into(), None),
        })
    }

    fn window(&self) -> Result<ViewOperation> {
        let whole = |number: &f64| (number.fract() == 0.0 && number.abs() < 1e15).then_some(*number as i64);
        let Some(numbers) = &self.numbers else { return Err(self.wrong(OPERATIONS)) };
        let numbers: Option<Vec<i64>> = numbers.iter().map(whole).collect();
        let (min, size, axes) = match numbers.as_deref() {
            Some(&[x, y, w, h]) => ([x, y, 0], [w, h, 0], 2),
            Some(&[x, y, z, w, h, d]) => ([x, y, z], [w, h, d], 3),
            _ => return Err(self.wrong("window=COL,ROW,W,H or window=X,Y,Z,W,H,D, integers in cells")),
        };
        if size[..axes].iter().any(|cells| *cells < 1) {
            return Err(self.wrong("a window of at least one cell"));
        }
        Ok(ViewOperation::Window(min, size.map(|cells| cells as u64)))
    }

    fn window_in(&self, coordinates: Coordinates) -> Result<ViewOperation> {
        if coordinates == Coordinates::Cells {
            return self.window();
        }
        let [low, high] = match self.numbers.as_deref() {
            Some(&[west, south, east, north]) => {
                [[west, south, f64::NEG_INFINITY], [east, north, f64::INFINITY]]
            }
            Some(&[a, b, c, d, e, f]) => [[a, b, c], [d, e, f]],
            _ => return Err(self.wrong("window=W,S,E,N,in=world, or minimum x, y, z and maximum x, y, z")),
        };
        Ok(ViewOperation::WindowIn(coordinates, low, high))
    }

    fn translate(&self) -> Result<ViewOperation> {
        match self.numbers.as_deref() {
            Some(&[x, y]) => Ok(ViewOperation::Translate([x, y, 0.0])),
            Some(&[x, y, z]) => Ok(ViewOperation::Translate([x, y, z])),
            _ => Err(self.wrong("translate=DX,DY or translate=DX,DY,DZ")),
        }
    }

    fn scale(&self) -> Result<ViewOperation> {
        match &self.numbers {
            Some(factors) if factors.len() <= 3 && factors.iter().all(|factor| *factor > 0.0) => {
                Ok(ViewOperation::Scale(factors.clone()))
            }
            _ => Err(self.wrong("scale=F or a factor for each axis, such as scale=2,0.5; factors above 0")),
        }
    }

    fn rotate(&self) -> Result<ViewOperation> {
        let wrong = || self.wrong("rotate=DEGREES, rotate=DEGREES@COL,ROW or rotate=DEGREES,AXIS@X,Y,Z");
        let centre = match self.centre.map(numbers) {
            None => None,
            Some(numbers) => match numbers.as_deref() {
                Some(&[x, y]) => Some([x, y, 0.0]),
                Some(&[x, y, z]) => Some([x, y, z]),
                _ => return Err(wrong()),
            },
        };
        let (degrees, about) = self.list.split_once(',').unwrap_or((self.list, "z"));
        let turn = match (axis(about.trim()), numbers(about).as_deref()) {
            (Some(axis), _) => RotationAxis::About(axis),
            (None, Some(&[x, y, z])) => RotationAxis::AboutLine([x, y, z]),
            _ => return Err(wrong()),
        };
        let degrees = degrees.trim().parse().ok().filter(|degrees: &f64| degrees.is_finite());
        Ok(ViewOperation::Rotate(degrees.ok_or_else(wrong)?, turn, centre))
    }

    fn mirror(&self) -> Result<ViewOperation> {
        let axes = [Axis::X, Axis::Y, Axis::Z];
        match axis(self.arguments) {
            Some(axis) => symmetry(axes, axes.map(|other| other == axis)),
            None => Err(self.wrong("mirror=x, mirror=y or mirror=z")),
        }
    }

    fn axes(&self) -> Result<ViewOperation> {
        let wrong = || self.wrong("axes=+y,-x,+z: the old axis of each new axis x, y and z; - mirrors it");
        let signed = |part: &str| {
            let part = part.trim();
            let (name, mirrored) = match part.strip_prefix('-') {
                Some(name) => (name, true),
                None => (part.strip_prefix('+').unwrap_or(part), false),
            };
            axis(name).map(|axis| (axis, mirrored))
        };
        let parts: Option<Vec<(Axis, bool)>> = self.arguments.split(',').map(signed).collect();
        let mut parts = parts.ok_or_else(wrong)?;
        if parts.len() == 2 {
            parts.push((Axis::Z, false));
        }
        let parts: [(Axis, bool); 3] = parts.try_into().map_err(|_| wrong())?;
        symmetry(parts.map(|(axis, _)| axis), parts.map(|(_, mirrored)| mirrored))
    }

    fn affine(&self) -> Result<ViewOperation> {
        let map = match self.numbers.as_deref() {
            Some(&[a, b, c, d, e, f]) => {
                AffineMap::from_rows([[a, b, 0.0, c], [d, e, 0.0, f], [0.0, 0.0, 1.0, 0.0]])
            }
            Some(numbers) if numbers.len() == 12 => {
                let row = |row: usize| std::array::from_fn(|column| numbers[4 * row + column]);
                AffineMap::from_rows(std::array::from_fn(row))
            }
            _ => return Err(self.wrong("affine=a,b,c,d,e,f (6 numbers), or 12 numbers, row by row")),
        };
        Ok(ViewOperation::AffineMap(map))
    }

    fn grid(&self) -> Result<ViewOperation> {
        let zoom = match self.arguments.split_once(',') {
            None if self.arguments == "xyz" => return Ok(ViewOperation::WebMercator(None)),
            Some(("xyz", zoom)) => zoom.trim().parse().ok(),
            _ => None,
        };
        zoom.map(|zoom| ViewOperation::WebMercator(Some(zoom)))
            .ok_or_else(|| self.wrong("grid=xyz or grid=xyz,ZOOM"))
    }
    fn level(&self, step: fn(u8) -> ViewOperation, expected: &str) -> Result<ViewOperation> {
        self.arguments.parse().map(step).map_err(|_| self.wrong(expected))
    }

    fn node(&self, step: fn(String) -> ViewOperation) -> Result<ViewOperation> {
        let digits = self.arguments.strip_prefix('/');
        if digits.is_some_and(|digits| digits.bytes().all(|digit| (b'0'..b'8').contains(&digit))) {
            Ok(step(self.arguments.to_string()))
        } else {
            let name = self.name;
            Err(self
                .wrong(&format!("an FD code, such as {name}=/031: / and a child's number for each level")))
        }
    }
}

/// Parses numbers that are separated by commas.
fn numbers(list: &str) -> Option<Vec<f64>> {
    list.split(',').map(|number| number.trim().parse().ok()).collect()
}

fn axis(name: &str) -> Option<Axis> {
    match name {
        "x" => Some(Axis::X),
        "y" => Some(Axis::Y),
        "z" => Some(Axis::Z),
        _ => None,
    }
}

fn symmetry(from: [Axis; 3], mirror: [bool; 3]) -> Result<ViewOperation> {
    AffineMap::symmetry(from, mirror).map(ViewOperation::AffineMap)
}

/// Writes the notation that [`FromStr`] reads; parsing it gives the same operation.
impl fmt::Display for ViewOperation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ViewOperation::Window([x, y, 0], [w, h, 0]) => write!(f, "window={x},{y},{w},{h}"),
            ViewOperation::Window(min, size) => write!(f, "window={},{}", List(min), List(size)),
            ViewOperation::WindowIn(coordinates, low, high) => {
                // (Infinite bounds are omitted.)
                let axes = if low[2].is_finite() && high[2].is_finite() { 3 } else { 2 };
                write!(f, "window={},{},in=", List(&low[..axes]), List(&high[..axes]))?;
                match coordinates {
                    Coordinates::System(_) if *coordinates == Coordinates::LONLAT => f.write_str("lonlat"),
                    _ => coordinates.fmt(f),
                }
            }
            ViewOperation::Crop => f.write_str("crop"),
            ViewOperation::Opaque => f.write_str("opaque"),
            ViewOperation::Void(number) => write!(f, "void={number}"),
            ViewOperation::Translate(by) => write!(f, "translate={}", List(planar(by))),
            ViewOperation::Scale(factors) => write!(f, "scale={}", List(factors)),
            ViewOperation::Rotate(degrees, turn, centre) => {
                write!(f, "rotate={degrees}")?;
                match turn {
                    RotationAxis::About(Axis::Z) => {}
                    RotationAxis::About(axis) => write!(f, ",{}", name(*axis))?,
                    RotationAxis::AboutLine(direction) => write!(f, ",{}", List(direction))?,
                }
                centre.map_or(Ok(()), |centre| write!(f, "@{}", List(planar(&centre))))
            }
            ViewOperation::AffineMap(map) => write_map(f, map),
            ViewOperation::Depth(depth) => write!(f, "depth={depth}"),
            ViewOperation::TreeDepth(depth) => write!(f, "tree-depth={depth}"),
            ViewOperation::Subtree(code) => write!(f, "subtree={code}"),
            ViewOperation::Embed(code) => write!(f, "embed={code}"),
            // (On one line, since it is part of the provenance; a line break means no more than a
            // space.)
            ViewOperation::Crs(crs) => write!(f, "crs={}", crs.definition().replace(['\n', '\r'], " ")),
            ViewOperation::Like(path, extent) => {
                write!(f, "like={}", path.display())?;
                extent.map_or(Ok(()), |extent| write!(f, ",extent={extent}"))
            }
            ViewOperation::Warp(target) => write!(f, "warp={target}"),
            ViewOperation::WebMercator(None) => write!(f, "grid=xyz"),
            ViewOperation::WebMercator(Some(zoom)) => write!(f, "grid=xyz,{zoom}"),
            ViewOperation::Calculation(calculation) => calculation.fmt(f),
            ViewOperation::Components(connect) => write!(f, "components={connect}"),
            ViewOperation::Sieve(sieve) => sieve.fmt(f),
        }
    }
}

/// Writes numbers that are separated by commas.
struct List<'a, T>(&'a [T]);

impl<T: fmt::Display> fmt::Display for List<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, number) in self.0.iter().enumerate() {
            write!(f, "{}{number}", if i > 0 { "," } else { "" })?;
        }
        Ok(())
    }
}

/// Without z, if that is 0.
fn planar(numbers: &[f64; 3]) -> &[f64] {
    if numbers[2] == 0.0 { &numbers[..2] } else { numbers }
}

fn name(axis: Axis) -> &'static str {
    ["x", "y", "z"][axis as usize]
}

/// Writes a map in its shortest notation.
fn write_map(f: &mut fmt::Formatter<'_>, map: &AffineMap) -> fmt::Result {
    let rows = map.to_rows();
    if map.keeps_cells() && rows.iter().all(|row| row[3] == 0.0) {
        // Source axis of each new axis, and whether it is mirrored.
        let from = rows.map(|row| {
            let column = (0..3).find(|column| row[*column] != 0.0).unwrap_or(0);
            ([Axis::X, Axis::Y, Axis::Z][column], row[column] < 0.0)
        });
        return write_symmetry(f, from);
    }
    let [x, y, z] = rows;
    if z == [0.0, 0.0, 1.0, 0.0] && x[2] == 0.0 && y[2] == 0.0 {
        write!(f, "affine={}", List(&[x[0], x[1], x[3], y[0], y[1], y[3]]))
    } else {
        write!(f, "affine={}", List(rows.as_flattened()))
    }
}

fn write_symmetry(f: &mut fmt::Formatter<'_>, from: [(Axis, bool); 3]) -> fmt::Result {
    let order = from.map(|(axis, _)| axis);
    let mirrored = from.iter().filter(|(_, mirrored)| *mirrored);
    match (order, mirrored.clone().count()) {
        ([Axis::X, Axis::Y, Axis::Z], 1) => {
            mirrored.map(|(axis, _)| name(*axis)).try_for_each(|axis| write!(f, "mirror={axis}"))
        }
        ([Axis::Y, Axis::X, Axis::Z], 0) => f.write_str("transpose"),
        _ => {
            let axes =
                from.map(|(axis, mirrored)| format!("{}{}", if mirrored { "-" } else { "+" }, name(axis)));
            // (Two are enough where z stays.)
            let axes = if from[2] == (Axis::Z, false) { &axes[..2] } else { &axes };
            write!(f, "axes={}", List(axes))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_written_as_they_are_read() {
        for text in [
            "window=0,0,512,512",
            "components=8",
            "sieve=100",
            "sieve=12.5m2,connect=26",
            "window=-3,4,5,6,7,8",
            "crs=EPSG:4326+5773",
            "crs=LOCAL_CS[\"a, b@c=d\",UNIT[\"m\",1]]",
            "window=5.5,44,17,48,in=world",
            "window=175,-1,-175,1,in=lonlat",
            "window=1,2,3,4,5,6,in=EPSG:3035",
            "crop",
            "opaque",
            "translate=3,-0.25",
            "translate=0,0,1",
            "scale=2",
            "scale=2,0.5",
            "rotate=30",
            "rotate=-90,x",
            "rotate=30,1,1,0@2,3",
            "rotate=30@0.5,3,7",
            "mirror=y",
            "transpose",
            "axes=+y,-x",
            "axes=-z,+x,-y",
            "affine=1,0.1,0,0,1,7",
            "affine=1,0,0,0,0,1,0,0,0,0.5,1,0",
            "depth=7",
            "tree-depth=9",
            "subtree=/031",
            "embed=/",
            "like=other map.goblin",
            "like=map.autumn@3,extent=union",
            "void=0",
            "void=-9999.5",
            "grid=xyz",
            "grid=xyz,7",
            "warp=EPSG:3035",
            "warp=EPSG:4326+5773,cell=0.5",
            "warp=+proj=utm +zone=32 +datum=WGS84,resampling=cubic",
            "warp=EPSG:3035,cell=30,resampling=area",
            "calc=where((b2-b1)/(b2+b1)>0.5,1,0),a=x,in=y.goblin,type=u8",
            "reduce=median,a=x.goblin,type=u16",
            "composite=B08,\"a,b\",B03",
        ] {
            let step: ViewOperation = text.parse().unwrap();
            assert_eq!(step.to_string(), text);
        }
    }

    #[test]
    fn other_spellings_mean_the_same() {
        for (text, usual) in [
            ("axes=-x,+y,+z", "mirror=x"),
            ("affine=-1,0,0,0,1,0", "mirror=x"),
            ("axes=y,x", "transpose"),
            ("rotate= 30,z@1,2,0", "rotate=30@1,2"),
        ] {
            let step: ViewOperation = text.parse().unwrap();
            assert_eq!(step.to_string(), usual);
            assert_eq!(usual.parse::<ViewOperation>().unwrap(), step);
        }
    }

    #[test]
    fn old_names_are_refused_with_the_new_ones() {
        for text in ["levels=7", "root=/0", "nest=/0", "spin=3"] {
            let error = text.parse::<ViewOperation>().unwrap_err().to_string();
            assert!(
                error.contains(text)
                    && error.contains(
                        "tree-depth=, subtree=, embed=, crs=, like=, warp=, grid=, opaque, void=, calc=, reduce=, composite=, components= or sieve="
                    ),
                "{error}"
            );
        }
    }
}
