//! The overlay of polygons of several sources.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use crate::crossings::{Square, crossings};
use crate::edges::{Edge, PartLists, unite, unite_cells};
use crate::exact::{Cell, Point};
use crate::grid::{OverlayGrid, cell_of};
use crate::passages::passages;
use crate::rings::polygons;
use crate::room::Room;
use crate::sets::PartSets;
use crate::sweep::sweep;
use spinney_base::{Error, Progress, Result};

/// Polygons that are laid over each other: each of a source, a number that the caller chose.
///
/// A place is in a polygon if a ray from it crosses the polygon's rings an odd number of times, and in a source if it is in one of its polygons. So rings may
/// have any direction and may cross themselves.
pub struct PolygonOverlay {
    grid: OverlayGrid,
    memory: u64,
    /// A file that polygons come from, for messages.
    path: PathBuf,
    edges: Vec<Edge<Point>>,
    lists: PartLists,
    /// The source of each polygon.
    sources: Vec<u32>,
    /// Corners in a row that are the same.
    repeated: u64,
}

/// All places that lie in the same sources, of those that were asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct OverlayPart {
    /// The numbers that stand for it.
    pub key: Vec<u32>,
    /// Its polygons, each an outer ring, counterclockwise, and its holes, clockwise; rings end with the corner that they begin with.
    pub polygons: Vec<Vec<Vec<[f64; 2]>>>,
    /// Its area, in square units of the coordinates.
    pub area: f64,
}

/// Counts of an overlay, and how exact it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OverlaySummary {
    /// Edges of all polygons, those that several have counted once.
    pub edges: u64,
    /// Places where edges cross in between their ends, by cells of the grid.
    pub crossings: u64,
    /// Corners of rings that repeated the one before.
    pub repeated_corners: u64,
    /// Width of the grid's cells.
    pub cell: f64,
    /// Most by which the area of all that one source covers may have changed: the length of all edges times the greatest way that a point
    /// on them may have gone, half of a cell's diagonal.
    pub area_bound: f64,
}

impl PolygonOverlay {
    /// Nothing, on a grid, of as much as about so many bytes of memory have room for.
    pub fn new(grid: OverlayGrid, memory: u64) -> PolygonOverlay {
        let (edges, sources) = (Vec::new(), Vec::new());
        PolygonOverlay {
            grid,
            memory,
            path: PathBuf::new(),
            edges,
            lists: PartLists::default(),
            sources,
            repeated: 0,
        }
    }

    /// Adds a polygon of a source: its rings, which may end with the corner that they begin with. `path` is the file it comes from, for messages.
    ///
    /// # Errors
    /// If a coordinate is too great for the grid, or no number; if it takes more memory than there may be.
    pub fn add(&mut self, path: &Path, source: u32, rings: &[Vec<[f64; 2]>]) -> Result<()> {
        let part = self.lists.number(&[self.sources.len() as u32]);
        self.sources.push(source);
        if self.path != path {
            self.path = path.into();
        }
        let grid = self.grid;
        let in_cells = |point: [f64; 2]| match point.map(|at| grid.in_cells(at)) {
            [Some(x), Some(y)] => Ok([x, y]),
            _ => {
                let advice = "coordinates of fewer cells of the grid: choose wider ones";
                Err(Error::corrupt(path, "a corner", format!("{point:?}"), advice))
            }
        };
        for ring in rings {
            let Some(last) = ring.last() else { continue };
            let mut before = in_cells(*last)?;
            let corners = if ring.first() == Some(last) { &ring[1..] } else { &ring[..] };
            for corner in corners {
                let corner = in_cells(*corner)?;
                if corner == before {
                    self.repeated += 1;
                    continue;
                }
                let ends = if before <= corner { [before, corner] } else { [corner, before] };
                self.edges.push(Edge { ends, parts: part });
                before = corner;
            }
        }
        let edges = self.edges.len() as u64;
        Room { path, memory: self.memory, edges, progress: &() }.check(0)
    }

    /// Hands out the parts that are asked for: `key_of` gets the sources that a place is in, in ascending order, and tells the numbers that stand for it, or
    /// nothing if it is not asked for. Places with the same numbers are one part; parts come in the order of these.
    ///
    /// # Errors
    /// Those of `take`; on interruption.
    pub fn parts(
        self,
        key_of: &mut dyn FnMut(&[u32]) -> Option<Vec<u32>>,
        progress: &dyn Progress,
        take: &mut dyn FnMut(OverlayPart) -> Result<()>,
    ) -> Result<OverlaySummary> {
        let PolygonOverlay { grid, memory, path, edges, mut lists, sources, repeated } = self;
        let edges = unite(edges, &mut lists);
        let room = Room { path: &path, memory, edges: edges.len() as u64, progress };
        let lengths = edges.iter().map(|edge| {
            let [[x, y], [next_x, next_y]] = edge.ends;
            (next_x - x).hypot(next_y - y)
        });
        let length: f64 = lengths.sum();
        let mut summary = OverlaySummary {
            edges: edges.len() as u64,
            repeated_corners: repeated,
            cell: grid.width(),
            area_bound: length * std::f64::consts::FRAC_1_SQRT_2 * grid.width() * grid.width(),
            crossings: 0,
        };
        progress.check()?;
        let edges = snapped(edges, &mut lists, &mut summary, &room)?;
        // The number that stands for each set of polygons: 0 is not asked for, others have a key.
        let mut keys: Vec<Vec<u32>> = Vec::new();
        let mut numbers: HashMap<Vec<u32>, u32> = HashMap::new();
        let mut of_set: HashMap<u32, u32> = HashMap::new();
        let mut sets = PartSets::new();
        let mut number_of = |sets: &PartSets, set: u32| {
            *of_set.entry(set).or_insert_with(|| {
                let mut own: Vec<u32> = sets.set(set).iter().map(|part| sources[*part as usize]).collect();
                own.sort_unstable();
                own.dedup();
                match if own.is_empty() { None } else { key_of(&own) } {
                    None => 0,
                    Some(key) => *numbers.entry(key).or_insert_with_key(|key| {
                        keys.push(key.clone());
                        keys.len() as u32
                    }),
                }
            })
        };
        let swept = sweep(&edges, &lists, &mut sets, progress, &mut |sets, [below, above]| {
            number_of(sets, below) != number_of(sets, above)
        })?;
        let mut number_of_face: HashMap<u32, u32> = HashMap::new();
        let faces = polygons(&edges, &mut |edge| {
            let own = swept.sides[edge].map(|set| number_of(&sets, set));
            [0, 1].map(|side| {
                let face = swept.faces[2 * edge + side];
                (own[0] != own[1] && own[side] > 0).then(|| {
                    number_of_face.insert(face, own[side]);
                    face
                })
            })
        });
        progress.check()?;
        let mut by_key: BTreeMap<&[u32], Vec<u32>> = BTreeMap::new();
        for face in faces.keys() {
            let number = number_of_face[face];
            by_key.entry(&keys[number as usize - 1]).or_default().push(*face);
        }
        let mut faces = faces;
        for (key, own) in by_key {
            let mut rings: Vec<Vec<Vec<Cell>>> = own.iter().filter_map(|face| faces.remove(face)).collect();
            rings.sort_by_key(|polygon| polygon[0][0]);
            let area = rings.iter().flatten().map(|ring| twice_area(ring)).sum::<i128>();
            let polygons = rings.iter().map(|polygon| {
                let point = |cell: &Cell| cell.map(|at| grid.coordinate(at));
                polygon.iter().map(|ring| ring.iter().map(point).collect()).collect()
            });
            take(OverlayPart {
                key: key.to_vec(),
                polygons: polygons.collect(),
                area: area as f64 / 2.0 * grid.width() * grid.width(),
            })?;
        }
        Ok(summary)
    }
}

/// Edges between middles of cells that have no point in common but ends.
fn snapped(
    edges: Vec<Edge<Point>>,
    lists: &mut PartLists,
    summary: &mut OverlaySummary,
    room: &Room<'_>,
) -> Result<Vec<Edge<Cell>>> {
    let ends = |edge: &Edge<Point>| edge.ends.map(|end| end.map(cell_of));
    let mut cells: Vec<Cell> = edges.iter().flat_map(ends).collect();
    let Some(low) = cells.iter().copied().reduce(|one, other| [one[0].min(other[0]), one[1].min(other[1])])
    else {
        return Ok(Vec::new());
    };
    let high = cells.iter().fold(low, |one, other| [one[0].max(other[0]), one[1].max(other[1])]);
    let square = Square::around(low, high);
    let mut crossed = crossings(&edges, square, room)?;
    summary.crossings = crossed.len() as u64;
    cells.append(&mut crossed);
    cells.sort_unstable();
    cells.dedup();
    // Invariant of snap rounding: each end and each crossing lies in one of these cells, and every edge goes through the middles of all of them that it passes, in its
    // order. Moving all points of such a cell to its middle at once carries no edge over a middle, so no two chains cross, though they may come to lie on each other.
    let passages = passages(&edges, &mut cells, square, room)?;
    let mut made = Vec::with_capacity(edges.len() + passages.len());
    let mut passages = passages.into_iter().peekable();
    for (number, edge) in edges.iter().enumerate() {
        let [mut from, last] = ends(edge);
        let mut go = |to: Cell| {
            if from != to {
                made.push(Edge { ends: if from <= to { [from, to] } else { [to, from] }, parts: edge.parts });
            }
            from = to;
        };
        while let Some(passage) = passages.next_if(|passage| passage.edge == number as u32) {
            go(passage.cell);
        }
        go(last);
    }
    Ok(unite_cells(made, lists))
}

/// Twice the area of a closed ring, positive if it is counterclockwise.
fn twice_area(ring: &[Cell]) -> i128 {
    let [x0, y0] = ring[0];
    let cross = |pair: &[Cell]| {
        let [[x, y], [next_x, next_y]] = [pair[0], pair[1]];
        i128::from(x - x0) * i128::from(next_y - y0) - i128::from(next_x - x0) * i128::from(y - y0)
    };
    ring.windows(2).map(cross).sum()
}
