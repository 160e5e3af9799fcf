//! BSP trees of segments, polygons and faces.

use std::path::Path;

use spinney_base::io::shown;
use spinney_base::space::Dimension;
use spinney_base::{Error, Progress, Result};
use spinney_brep::exact::normal::triangle_normal;
use spinney_brep::geometry::Triangulator;
use spinney_brep::{ExactModel, ExactPlane, Faces, Grid, MAX_BITS};

use super::facet::{Facet, sides};
use super::{Bsp, BspFragment, BspNode, Division};
use crate::extended_octree::check_on_grid;
use crate::preorder::PreorderBuilder;

/// Maximum number of fragments that segments or faces may be cut into.
pub const MAX_FRAGMENTS: usize = 1 << 20;

/// Candidate planes per node.
const TRIED: usize = 8;

/// Cost of a cut, relative to one fragment of imbalance between the two sides.
const CUT_WEIGHT: usize = 4;

impl Bsp {
    /// Builds a tree of the plane with these segments in its lines. The right side of a segment is
    /// in front. No cell is inside.
    ///
    /// # Errors
    /// If a segment is a point or leaves the grid, or there are more than [`MAX_FRAGMENTS`]
    /// fragments.
    pub fn of_segments(segments: &[[[i32; 2]; 2]]) -> Result<Bsp> {
        let fragments = segments.iter().enumerate();
        let fragments = fragments.map(|(source, segment)| fragment_of_segment(source, *segment));
        divided(Dimension::Quad, fragments.collect::<Result<_>>()?, false, &())
    }

    /// Builds a tree of the plane whose inside is that of these polygons. Each is an outer ring,
    /// followed by holes; rings may have either orientation and may touch in points. Polygons may
    /// touch in edges, too, of which nothing stays.
    ///
    /// # Errors
    /// If a vertex is outside of the grid, rings cross, or there are more than [`MAX_FRAGMENTS`]
    /// fragments.
    pub fn of_polygons(polygons: &[Vec<Vec<[i32; 2]>>]) -> Result<Bsp> {
        let mut fragments = Vec::new();
        for (source, polygon) in polygons.iter().enumerate() {
            for (number, ring) in polygon.iter().enumerate() {
                let area = ring_edges(ring).map(|[[ax, ay], [bx, by]]| {
                    i128::from(ax) * i128::from(by) - i128::from(ay) * i128::from(bx)
                });
                // The inside is on the left of an edge.
                let is_turned = (area.sum::<i128>() < 0) != (number > 0);
                for [from, to] in ring_edges(ring).filter(|[from, to]| from != to) {
                    let edge = if is_turned { [to, from] } else { [from, to] };
                    fragments.push(fragment_of_segment(source, edge)?);
                }
            }
        }
        grow(Dimension::Quad, fragments, &())
    }

    /// Builds a tree of space whose inside is bounded by a closed surface, or by those of bodies
    /// that touch. Each face is an outer ring, counterclockwise seen from outside, followed by
    /// holes.
    ///
    /// # Errors
    /// If a vertex is outside of the grid, a face cannot be triangulated, the surface is open or
    /// self-intersects, or there are more than [`MAX_FRAGMENTS`] fragments.
    pub fn of_faces(faces: &[Vec<Vec<[i32; 3]>>]) -> Result<Bsp> {
        let mut fragments = Fragments::default();
        for (source, rings) in faces.iter().enumerate() {
            let mut end = 0;
            let ends = rings.iter().map(|ring| {
                end += ring.len();
                end
            });
            fragments.push(&rings.concat(), &ends.collect::<Vec<_>>(), source)?;
        }
        grow(Dimension::Oct, fragments.list, &())
    }

    /// Builds the trees of exact models on a common grid, and returns that grid. The sources of
    /// fragments are numbers of faces.
    ///
    /// # Errors
    /// If a model cannot be read, is unbounded, or has faces with off-grid vertices; if their grids
    /// have different units or are too far apart; and those of [`Bsp::of_faces`].
    pub fn of_models(models: &[&ExactModel], progress: &dyn Progress) -> Result<(Vec<Bsp>, Grid)> {
        let Some(first) = models.first() else {
            return Err(Error::invalid("models", "none", "at least one"));
        };
        models.iter().try_for_each(|model| check_on_grid(model))?;
        let mut grid = first.grid().clone();
        let origins = models.iter().map(|model| model.grid().origin);
        grid.origin = origins.fold(grid.origin, |least, at| [0, 1, 2].map(|axis| least[axis].min(at[axis])));
        let mut shifts = Vec::new();
        for model in models {
            let own = model.grid();
            if own.width() != grid.width() {
                return Err(Error::invalid(
                    shown(model.path()),
                    format!("a grid with units of {}", own.width()),
                    format!(
                        "{}, as in {}; build both with the same --snap",
                        grid.width(),
                        shown(first.path())
                    ),
                ));
            }
            let shift = [0, 1, 2].map(|axis| own.origin[axis].saturating_sub(grid.origin[axis]));
            let end = shift.iter().map(|shift| shift.saturating_add(1 << own.bits)).max().unwrap_or(0);
            let bits = (64 - (end - 1).leading_zeros()) as u8;
            if bits > MAX_BITS {
                return Err(Error::invalid(
                    shown(model.path()),
                    format!("{end} grid units between the farthest points of the models"),
                    "at most 67108864; build both with a larger --snap",
                ));
            }
            grid.bits = grid.bits.max(bits);
            shifts.push(shift.map(|shift| shift as i32));
        }
        let tree = |(model, shift): (&&ExactModel, [i32; 3])| {
            let (mut fragments, mut points) = (Fragments::default(), Vec::new());
            model.each(&mut |face| {
                progress.check()?;
                points.clear();
                points.extend(face.points.iter().map(|at| [0, 1, 2].map(|axis| at[axis] + shift[axis])));
                fragments.push(&points, face.ring_ends, face.number as usize)
            })?;
            grow(Dimension::Oct, fragments.list, progress).map_err(|error| in_file(model.path(), error))
        };
        let trees = models.iter().zip(shifts).map(tree).collect::<Result<_>>()?;
        Ok((trees, grid))
    }

    /// Builds the tree of the inside within a cell, from the fragments of the faces that cut it.
    /// Without fragments in the cell, all of it is inside or not, as `is_inside` says.
    ///
    /// # Errors
    /// If there are more than [`MAX_FRAGMENTS`] fragments.
    pub(crate) fn of_cell(fragments: Fragments, half_units: [[i64; 3]; 2], is_inside: bool) -> Result<Bsp> {
        let mut list = fragments.list;
        for (side, ends) in half_units.into_iter().enumerate() {
            for (axis, end) in ends.into_iter().enumerate() {
                let mut normal = [0; 3];
                normal[axis] = if side == 0 { -2 } else { 2 };
                let wall = ExactPlane { normal, offset: if side == 0 { -end } else { end }.into() };
                let within = |fragment: BspFragment| {
                    let signs = fragment.facet.signs(&wall);
                    match sides(&signs) {
                        [true, false] => Some(fragment),
                        [true, true] => {
                            let [facet, _] = fragment.facet.cut(&wall, &signs);
                            Some(BspFragment { facet, ..fragment })
                        }
                        [false, _] => None,
                    }
                };
                list = list.into_iter().filter_map(within).collect();
            }
        }
        if list.is_empty() {
            return Ok(Bsp { dimension: Dimension::Oct, nodes: vec![BspNode::Leaf(is_inside)] });
        }
        divided(Dimension::Oct, list, true, &())
    }

    /// Builds a tree of space with these triangles in its planes. A triangle is counterclockwise
    /// seen from its front. No cell is inside. The triangles need not be closed, and may touch and
    /// intersect. Those without area are skipped.
    ///
    /// # Errors
    /// If a vertex is outside of the grid, or there are more than [`MAX_FRAGMENTS`] fragments.
    pub fn of_triangles(triangles: &[[[i32; 3]; 3]]) -> Result<Bsp> {
        let mut fragments = Vec::new();
        for (source, corners) in triangles.iter().enumerate() {
            corners.iter().try_for_each(|corner| check(source, *corner))?;
            let normal = triangle_normal(corners);
            if normal != [0; 3] {
                let plane = ExactPlane::through(corners[0], normal);
                fragments.push(BspFragment { source, facet: Facet::of_triangle(plane, corners) });
            }
        }
        divided(Dimension::Oct, fragments, false, &())
    }
}

/// Names the file in an error about one of its faces.
fn in_file(path: &Path, error: Error) -> Error {
    match error {
        Error::Invalid { what, found, expected } => {
            Error::Invalid { what: format!("{}, {what}", shown(path)), found, expected }
        }
        other => other,
    }
}

/// Triangles of faces.
#[derive(Default)]
pub(crate) struct Fragments {
    list: Vec<BspFragment>,
    triangulator: Triangulator,
    triangles: Vec<[u32; 3]>,
    wide: Vec<[i64; 3]>,
}

impl Fragments {
    /// Adds the triangles of a face, with rings that end at these vertices.
    ///
    /// # Errors
    /// If a vertex is outside of the grid, or the face cannot be triangulated.
    pub(crate) fn push(&mut self, points: &[[i32; 3]], ring_ends: &[usize], source: usize) -> Result<()> {
        points.iter().try_for_each(|corner| check(source, *corner))?;
        self.wide.clear();
        self.wide.extend(points.iter().map(|corner| corner.map(i64::from)));
        self.triangles.clear();
        if !self.triangulator.triangulate(&self.wide, ring_ends, &mut self.triangles) {
            return Err(Error::invalid(
                format!("face {source}"),
                "rings that cross or have no area",
                "a polygon with holes",
            ));
        }
        for triangle in &self.triangles {
            let corners = triangle.map(|corner| points[corner as usize]);
            let normal = triangle_normal(&corners);
            // A triangle without area bounds nothing.
            if normal != [0; 3] {
                let plane = ExactPlane::through(corners[0], normal);
                self.list.push(BspFragment { source, facet: Facet::of_triangle(plane, &corners) });
            }
        }
        Ok(())
    }
}

fn ring_edges(ring: &[[i32; 2]]) -> impl Iterator<Item = [[i32; 2]; 2]> {
    ring.iter().zip(ring.iter().cycle().skip(1)).map(|(from, to)| [*from, *to])
}

fn check(source: usize, corner: [i32; 3]) -> Result<()> {
    match corner.iter().all(|at| (0..1 << MAX_BITS).contains(at)) {
        true => Ok(()),
        false => Err(Error::invalid(
            format!("shape {source}"),
            format!("a vertex at {corner:?}"),
            "coordinates from 0 to 67108863",
        )),
    }
}

/// Wall of height 1 over a segment.
fn fragment_of_segment(source: usize, [[px, py], [qx, qy]]: [[i32; 2]; 2]) -> Result<BspFragment> {
    let at = |z: i32| ([px, py, z], [qx, qy, z]);
    let ((p, q), (above_p, above_q)) = (at(0), at(1));
    check(source, p)?;
    check(source, q)?;
    if p == q {
        return Err(Error::invalid(
            format!("segment {source}"),
            format!("the point {px}, {py}"),
            "two different ends",
        ));
    }
    let [dx, dy] = [i64::from(qx) - i64::from(px), i64::from(qy) - i64::from(py)];
    let across = if dx.abs() >= dy.abs() { [1, 0, 0] } else { [0, 1, 0] };
    let wall = ExactPlane::through;
    let edges = [
        (p, wall(p, [0, 0, 1])),
        (q, wall(q, across)),
        (above_q, wall(above_q, [0, 0, 1])),
        (above_p, wall(p, across)),
    ];
    Ok(BspFragment { source, facet: Facet::of_grid(wall(p, [dy, -dx, 0]), &edges) })
}

/// Builds the tree whose inside is at the back of all fragments. They must be its whole boundary.
fn grow(dimension: Dimension, fragments: Vec<BspFragment>, progress: &dyn Progress) -> Result<Bsp> {
    let tree = divided(dimension, fragments, true, progress)?;
    tree.check_boundary(progress)?;
    // (Of a surface of which one half covers the other, both sides are inside.)
    tree.check_bounded()?;
    Ok(tree)
}

/// Builds the tree of fragments. If `is_solid`, the back of each fragment is inside.
fn divided(
    dimension: Dimension,
    fragments: Vec<BspFragment>,
    is_solid: bool,
    progress: &dyn Progress,
) -> Result<Bsp> {
    let mut made = PreorderBuilder::new(|by: &Division| !by.fragments.is_empty());
    let mut count = fragments.len();
    // Fragments of cells that are still to be divided, and whether the cell is inside if it has
    // none.
    let mut pending = vec![(fragments, false)];
    while let Some((fragments, is_inside)) = pending.pop() {
        progress.check()?;
        if count > MAX_FRAGMENTS {
            let found = format!("more than {MAX_FRAGMENTS} fragments of segments or faces");
            return Err(Error::invalid("BSP tree", found, format!("at most {MAX_FRAGMENTS}")));
        }
        if fragments.is_empty() {
            made.leaf(is_inside);
            continue;
        }
        let plane = choose(&fragments);
        let (mut within, mut parts) = (Vec::new(), [const { Vec::new() }; 2]);
        for fragment in fragments {
            let signs = fragment.facet.signs(&plane);
            match sides(&signs) {
                [false, false] => within.push(fragment),
                [true, false] => parts[0].push(fragment),
                [false, true] => parts[1].push(fragment),
                [true, true] => {
                    count += 1;
                    for (part, facet) in parts.iter_mut().zip(fragment.facet.cut(&plane, &signs)) {
                        part.push(BspFragment { source: fragment.source, facet });
                    }
                }
            }
        }
        // If a side has no other fragments, those in the plane determine whether it is inside: the
        // back of each is. (Where bodies touch, both sides are.)
        let is_inside = [true, false].map(|is_back| {
            let is_at = |fragment: &BspFragment| fragment.facet.plane.is_turned_as(&plane) == is_back;
            is_solid && within.iter().any(is_at)
        });
        made.divide(Division { plane, fragments: within });
        let [back, front] = parts;
        pending.extend([(front, is_inside[1]), (back, is_inside[0])]);
    }
    Ok(Bsp { dimension, nodes: made.finish() })
}

/// Chooses from a few candidates a plane that cuts few fragments and balances both sides.
fn choose(fragments: &[BspFragment]) -> ExactPlane {
    let tried = (0..TRIED.min(fragments.len()))
        .map(|i| fragments[i * fragments.len() / TRIED.min(fragments.len())].facet.plane);
    let weight = |plane: &ExactPlane| {
        let (mut cuts, mut back, mut front) = (0, 0usize, 0);
        for fragment in fragments {
            let [is_back, is_front] = sides(&fragment.facet.signs(plane));
            cuts += usize::from(is_back && is_front);
            back += usize::from(is_back);
            front += usize::from(is_front);
        }
        CUT_WEIGHT * cuts + back.abs_diff(front)
    };
    // There is at least one fragment.
    tried.min_by_key(weight).unwrap_or(fragments[0].facet.plane)
}
