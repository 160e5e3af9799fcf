//! Steps of a chain as people write them: `window=0,0,512,512`, `rotate=30`.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::data_box::data_box;
use super::map::{Axis, Map};
use super::view::View;
use crate::space::{Code, Dimension, Frame};
use crate::tree::Source;
use crate::{Error, Result};

/// One step of what is done to a tree.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// `window=COL,ROW,W,H` or `window=X,Y,Z,W,H,D`: a box of cells, which may stick out.
    Window([i64; 3], [u64; 3]),
    /// `bbox=W,S,E,N`: the cells in a box of world coordinates.
    WorldBox([f64; 4]),
    /// `crop`: the smallest box around all that is not VOID.
    Crop,
    /// `translate=DX,DY[,DZ]`: moves by cells, whole or not.
    Translate([f64; 3]),
    /// `scale=F`, `scale=FX,FY[,FZ]`: so many times as many cells; one number is for all axes.
    Scale(Vec<f64>),
    /// `rotate=DEGREES`, `rotate=DEGREES@COL,ROW`, `rotate=DEGREES,AXIS@X,Y,Z`, where AXIS is `x`, `y`, `z` or a direction
    /// `VX,VY,VZ`: turns about a centre; if there is none, about the middle, where quarter turns take whole cells to whole
    /// cells.
    Rotate(f64, Turn, Option<[f64; 3]>),
    /// `mirror=x|y|z`, `transpose`, `axes=+y,-x,+z`, `affine=a,b,c,d,e,f` or the 12 numbers of a 3x4 matrix.
    Map(Map),
    /// `depth=N`: coarser or finer cells, so that the tree has N levels below its root.
    Depth(u8),
    /// `room=N`: N levels below the root over the same cells, with room for more on the far sides.
    Room(u8),
    /// `root=/031`: a node becomes the root.
    Root(String),
    /// `nest=/2`: the root becomes that node of a larger tree.
    Nest(String),
    /// `like=FILE`: onto the cells of another tree, whose place in the world is told.
    Like(PathBuf),
}

/// What a rotation turns about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turn {
    /// An axis of the tree.
    About(Axis),
    /// Any direction.
    AboutLine([f64; 3]),
}

impl FromStr for Step {
    type Err = Error;

    fn from_str(text: &str) -> Result<Step> {
        let (name, arguments) = text.split_once('=').unwrap_or((text, ""));
        let wrong = |expected: &str| Error::invalid("step", format!("`{text}`"), expected);
        let (list, centre) = match arguments.split_once('@') {
            Some((list, centre)) => (list, Some(centre)),
            None => (arguments, None),
        };
        if centre.is_some() && name != "rotate" {
            return Err(wrong("no `@` but in rotate=DEGREES@COL,ROW"));
        }
        let numbers: Option<Vec<f64>> = list
            .split(',')
            .map(|number| number.trim().parse().ok().filter(|number: &f64| number.is_finite()))
            .collect();
        let whole = |number: f64| (number.fract() == 0.0 && number.abs() < 1e15).then_some(number as i64);
        let level = || arguments.parse::<u8>().ok();
        let axis = |name: &str| match name {
            "x" => Some(Axis::X),
            "y" => Some(Axis::Y),
            "z" => Some(Axis::Z),
            _ => None,
        };
        let symmetry = |from: [Axis; 3], mirror: [bool; 3]| Map::symmetry(from, mirror).map(Step::Map);
        match (name, numbers.as_deref()) {
            ("window", Some(numbers)) => {
                let expected = "window=COL,ROW,W,H or window=X,Y,Z,W,H,D in whole cells";
                let numbers: Option<Vec<i64>> = numbers.iter().map(|number| whole(*number)).collect();
                let (min, size) = match numbers.as_deref() {
                    Some(&[x, y, w, h]) => ([x, y, 0], [w, h, 1]),
                    Some(&[x, y, z, w, h, d]) => ([x, y, z], [w, h, d]),
                    _ => return Err(wrong(expected)),
                };
                if size.iter().any(|cells| *cells < 1) {
                    return Err(wrong("a window of at least one cell"));
                }
                Ok(Step::Window(min, size.map(|cells| cells as u64)))
            }
            ("bbox", Some(&[west, south, east, north])) if west < east && south < north => {
                Ok(Step::WorldBox([west, south, east, north]))
            }
            ("bbox", _) => Err(wrong("bbox=W,S,E,N with west below east and south below north")),
            ("crop", _) if arguments.is_empty() => Ok(Step::Crop),
            ("translate", Some(&[x, y])) => Ok(Step::Translate([x, y, 0.0])),
            ("translate", Some(&[x, y, z])) => Ok(Step::Translate([x, y, z])),
            ("translate", _) => Err(wrong("translate=DX,DY or translate=DX,DY,DZ")),
            ("scale", Some(factors)) if factors.len() <= 3 && factors.iter().all(|factor| *factor > 0.0) => {
                Ok(Step::Scale(factors.to_vec()))
            }
            ("scale", _) => Err(wrong("scale=F or a factor for each axis, as in scale=2,0.5; all above 0")),
            ("rotate", _) => {
                let expected = "rotate=DEGREES, rotate=DEGREES@COL,ROW or rotate=DEGREES,AXIS@X,Y,Z";
                let centre = centre.map(|centre| {
                    let numbers: Option<Vec<f64>> =
                        centre.split(',').map(|number| number.trim().parse().ok()).collect();
                    match numbers.as_deref() {
                        Some(&[x, y]) => Some([x, y, 0.0]),
                        Some(&[x, y, z]) => Some([x, y, z]),
                        _ => None,
                    }
                });
                let centre =
                    centre.map_or(Ok(None), |centre| centre.map(Some).ok_or_else(|| wrong(expected)))?;
                let (degrees, about) = list.split_once(',').unwrap_or((list, "z"));
                let degrees = degrees.trim().parse().ok().filter(|degrees: &f64| degrees.is_finite());
                let direction: Option<Vec<f64>> =
                    about.split(',').map(|number| number.trim().parse().ok()).collect();
                let turn = match (axis(about.trim()), direction.as_deref()) {
                    (Some(axis), _) => Turn::About(axis),
                    (None, Some(&[x, y, z])) => Turn::AboutLine([x, y, z]),
                    _ => return Err(wrong(expected)),
                };
                Ok(Step::Rotate(degrees.ok_or_else(|| wrong(expected))?, turn, centre))
            }
            ("mirror", _) => match axis(arguments) {
                Some(axis) => {
                    let mirror = [Axis::X, Axis::Y, Axis::Z].map(|other| other == axis);
                    symmetry([Axis::X, Axis::Y, Axis::Z], mirror)
                }
                None => Err(wrong("mirror=x, mirror=y or mirror=z")),
            },
            ("transpose", _) if arguments.is_empty() => symmetry([Axis::Y, Axis::X, Axis::Z], [false; 3]),
            ("axes", _) => {
                let expected = "axes=+y,-x,+z: where the new x, y and z come from, - is mirrored";
                let signed = |part: &str| {
                    let part = part.trim();
                    let (name, mirrored) = match part.strip_prefix('-') {
                        Some(name) => (name, true),
                        None => (part.strip_prefix('+').unwrap_or(part), false),
                    };
                    axis(name).map(|axis| (axis, mirrored))
                };
                let parts: Option<Vec<(Axis, bool)>> = arguments.split(',').map(signed).collect();
                let mut parts = parts.ok_or_else(|| wrong(expected))?;
                if parts.len() == 2 {
                    parts.push((Axis::Z, false));
                }
                let parts: [(Axis, bool); 3] = parts.try_into().map_err(|_| wrong(expected))?;
                symmetry(parts.map(|(axis, _)| axis), parts.map(|(_, mirrored)| mirrored))
            }
            ("affine", Some(&[a, b, c, d, e, f])) => {
                Ok(Step::Map(Map::from_rows([[a, b, 0.0, c], [d, e, 0.0, f], [0.0, 0.0, 1.0, 0.0]])))
            }
            ("affine", Some(numbers)) if numbers.len() == 12 => {
                Ok(Step::Map(Map::from_rows(std::array::from_fn(|row| {
                    std::array::from_fn(|column| numbers[4 * row + column])
                }))))
            }
            ("affine", _) => Err(wrong("affine=a,b,c,d,e,f or 12 numbers, row by row")),
            ("depth", _) => level().map(Step::Depth).ok_or_else(|| wrong("depth=N, a number of levels")),
            ("room", _) => level().map(Step::Room).ok_or_else(|| wrong("room=N, a number of levels")),
            ("root" | "nest", _) => {
                let digits = arguments.strip_prefix('/');
                if !digits.is_some_and(|digits| digits.bytes().all(|digit| (b'0'..b'8').contains(&digit))) {
                    return Err(wrong(
                        "an FD code, such as root=/031: / and a child's number for each level",
                    ));
                }
                let code = arguments.to_string();
                Ok(if name == "root" { Step::Root(code) } else { Step::Nest(code) })
            }
            ("like", _) if !arguments.is_empty() => Ok(Step::Like(arguments.into())),
            _ => Err(wrong(
                "window=, bbox=, crop, translate=, scale=, rotate=, mirror=, transpose, axes=, affine=, depth=, room=, \
                 root=, nest= or like=",
            )),
        }
    }
}

impl Step {
    /// Does it to a view; `frame` is that of the view's source, `like` finds frame and extent of another tree.
    ///
    /// # Errors
    /// If it cannot be done: see the methods of [`View`].
    pub fn apply<S: Source>(
        &self,
        view: View<S>,
        frame: &Frame,
        like: impl Fn(&Path) -> Result<(Frame, [u64; 3])>,
    ) -> Result<View<S>> {
        let axes = S::Dim::AXES;
        match self {
            Step::Window(min, size) => {
                let mut size = *size;
                if axes > 2 && min[2] == 0 && size[2] == 1 && view.extent()[2] > 1 {
                    // Four numbers mean columns of any height.
                    size[2] = view.extent()[2];
                }
                view.window(*min, size)
            }
            Step::WorldBox([west, south, east, north]) => {
                let here = view.frame(frame, false);
                let corners = [[*west, *south], [*east, *south], [*west, *north], [*east, *north]];
                let mut low = [f64::INFINITY; 2];
                let mut high = [f64::NEG_INFINITY; 2];
                for corner in corners {
                    let cell = here.to_cells([corner[0], corner[1], 0.0]).ok_or_else(|| no_inverse(&here))?;
                    for axis in 0..2 {
                        low[axis] = low[axis].min(cell[axis]);
                        high[axis] = high[axis].max(cell[axis]);
                    }
                }
                let extent = view.extent();
                let first = |axis: usize| (low[axis] + 1e-6).floor().clamp(0.0, extent[axis] as f64) as i64;
                let end = |axis: usize| (high[axis] - 1e-6).ceil().clamp(0.0, extent[axis] as f64) as i64;
                let size = |axis: usize| (end(axis) - first(axis)).max(0) as u64;
                view.window([first(0), first(1), 0], [size(0), size(1), extent[2]])
            }
            Step::Crop => match data_box(&view)? {
                Some(bounds) => view.window(bounds.min.map(|cell| cell as i64), bounds.size()),
                None => Err(Error::invalid("crop", "a tree that is VOID", "some data")),
            },
            Step::Translate(by) => view.translate(*by),
            Step::Scale(factors) => {
                let each = |axis: usize| match factors[..] {
                    [factor] if axis < axes => factor,
                    _ => factors.get(axis).copied().unwrap_or(1.0),
                };
                view.scale(std::array::from_fn(each))
            }
            Step::Rotate(degrees, turn, centre) => {
                let about = centre.unwrap_or(view.extent().map(|cells| cells as f64 / 2.0));
                let map = match turn {
                    Turn::About(axis) => Map::rotation(*axis, *degrees, about),
                    Turn::AboutLine(direction) => Map::rotation_about(*direction, *degrees, about)?,
                };
                // A quarter turn about the middle of an odd by an even number of cells would cut all of them in half.
                let map = if centre.is_none() { map.on_whole_cells(view.extent()) } else { map };
                view.transform(&map)
            }
            Step::Map(map) => view.transform(map),
            Step::Depth(depth) => view.resolve(*depth),
            Step::Room(depth) => view.deepened(*depth),
            Step::Root(code) => {
                let code: Code<S::Dim> = code.parse()?;
                if code.level() > view.depth() {
                    let expected = format!("at most {} digits", view.depth());
                    return Err(Error::invalid("root", code.to_string(), expected));
                }
                let size = view.depth() - code.level();
                let min = code.cell().map(|cell| i64::from(cell) << size);
                let min = std::array::from_fn(|axis| if axis < axes { min[axis] } else { 0 });
                let most = |axis: usize| view.extent()[axis].saturating_sub(min[axis] as u64);
                let extent =
                    std::array::from_fn(|axis| if axis < axes { most(axis).min(1 << size) } else { 1 });
                view.window(min, extent)?.deepened(size)
            }
            Step::Nest(code) => {
                let code: Code<S::Dim> = code.parse()?;
                let depth = view.depth();
                if u32::from(depth) + u32::from(code.level()) > u32::from(S::Dim::MAX_DEPTH) {
                    let expected = format!("at most {} levels in all", S::Dim::MAX_DEPTH);
                    return Err(Error::invalid("nest", format!("{code} over {depth} levels"), expected));
                }
                let by = code.cell().map(|cell| (u64::from(cell) << depth) as f64);
                let by = std::array::from_fn(|axis| if axis < axes { by[axis] } else { 0.0 });
                view.translate(by)?.deepened(depth + code.level())
            }
            Step::Like(path) => {
                let (other, extent) = like(path)?;
                let here = view.frame(frame, false);
                if let (Some(a), Some(b)) = (here.epsg, other.epsg)
                    && a != b
                {
                    let found = format!("EPSG:{b}");
                    return Err(Error::invalid(
                        "coordinate system of the tree to be like",
                        found,
                        format!("EPSG:{a}"),
                    ));
                }
                let back = Map::from_rows(other.matrix).inverse()?;
                view.onto(&Map::from_rows(here.matrix).then(&back), extent)
            }
        }
    }
}

fn no_inverse(frame: &Frame) -> Error {
    Error::invalid("frame", format!("{:?}", frame.matrix), "one that has an inverse")
}
