//! Overlay of polygons from several sources.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use crate::crossings::{Square, crossings};
use crate::edges::{Edge, PartLists, unite, unite_cells};
use crate::exact::{Cell, Point};
use crate::grid::{OverlayGrid, cell_of};
use crate::memory_limit::MemoryLimit;
use crate::passages::passages;
use crate::rings::polygons;
use crate::sets::PartSets;
use crate::sweep::sweep;
use spinney_base::io::shown;
use spinney_base::{Error, Progress, Result};

/// An overlay of polygons. Each polygon belongs to a source, a number chosen by the caller.
///
/// A point is in a polygon if a ray from it crosses the polygon's rings an odd number of times. It
/// is in a source if it is in any of the source's polygons. So rings may have any direction and may
/// cross themselves.
pub struct PolygonOverlay {
    grid: OverlayGrid,
    memory: u64,
    /// File of the polygons that were added last, for error messages.
    path: PathBuf,
    edges: Vec<Edge<Point>>,
    lists: PartLists,
    /// The source of each polygon.
    sources: Vec<u32>,
    /// Number of consecutive duplicate vertices.
    repeated: u64,
}

/// The region of all points whose sources map to the same key.
#[derive(Clone, Debug, PartialEq)]
pub struct OverlayRegion {
    /// The key that the caller assigned to the sources.
    pub key: Vec<u32>,
    /// Polygons of the region: an outer ring, counterclockwise, followed by holes, clockwise. Rings
    /// repeat their first vertex at the end.
    pub polygons: Vec<Vec<Vec<[f64; 2]>>>,
    /// Its area, in square units of the coordinates.
    pub area: f64,
}

/// Statistics and error bound of an overlay.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OverlaySummary {
    /// Number of edges of all polygons; an edge shared by several polygons counts once.
    pub edges: u64,
    /// Number of grid cells that contain crossings of edges.
    pub crossings: u64,
    /// Number of ring vertices that repeat the previous one.
    pub repeated_corners: u64,
    /// Width of the grid's cells, in units of the coordinates.
    pub cell: f64,
    /// Maximum change of the area that one source covers, in square units of the coordinates: the
    /// total length of all edges times the maximum displacement of a point, half a cell's diagonal.
    pub area_bound: f64,
}

impl PolygonOverlay {
    /// Creates an empty overlay on a grid that uses up to about `memory` bytes.
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

    /// Adds a polygon to a source. Its rings may repeat their first vertex at the end. `path` is
    /// the file that the polygon comes from, for error messages.
    ///
    /// # Errors
    /// If a coordinate is too large for the grid or not finite; if the edges exceed the memory
    /// limit.
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
                let expected = "coordinates within the overlay grid; choose a larger --snap";
                Err(Error::invalid(format!("{}: a vertex", shown(path)), format!("{point:?}"), expected))
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
        MemoryLimit { path, memory: self.memory, edges, progress: &() }.check(0)
    }

    /// Yields the requested regions. `key_of` receives the sources that cover a point, in ascending
    /// order, and returns the key of that set, or `None` to leave it out. Points with equal keys
    /// form one region. Regions are yielded in the order of their keys.
    ///
    /// # Errors
    /// Those of `take`; if crossings exceed the memory limit; on cancellation.
    pub fn regions(
        self,
        key_of: &mut dyn FnMut(&[u32]) -> Option<Vec<u32>>,
        progress: &dyn Progress,
        take: &mut dyn FnMut(OverlayRegion) -> Result<()>,
    ) -> Result<OverlaySummary> {
        let PolygonOverlay { grid, memory, path, edges, mut lists, sources, repeated } = self;
        let edges = unite(edges, &mut lists);
        let memory_limit = MemoryLimit { path: &path, memory, edges: edges.len() as u64, progress };
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
        let edges = snapped(edges, &mut lists, &mut summary, &memory_limit)?;
        // Key number of each set of polygons: 0 for sets that are not requested.
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
            take(OverlayRegion {
                key: key.to_vec(),
                polygons: polygons.collect(),
                area: area as f64 / 2.0 * grid.width() * grid.width(),
            })?;
        }
        Ok(summary)
    }
}

/// Splits and snaps edges: the results run between cell centres and share no points except their
/// ends.
fn snapped(
    edges: Vec<Edge<Point>>,
    lists: &mut PartLists,
    summary: &mut OverlaySummary,
    memory_limit: &MemoryLimit<'_>,
) -> Result<Vec<Edge<Cell>>> {
    let ends = |edge: &Edge<Point>| edge.ends.map(|end| end.map(cell_of));
    let mut cells: Vec<Cell> = edges.iter().flat_map(ends).collect();
    let Some(low) = cells.iter().copied().reduce(|one, other| [one[0].min(other[0]), one[1].min(other[1])])
    else {
        return Ok(Vec::new());
    };
    let high = cells.iter().fold(low, |one, other| [one[0].max(other[0]), one[1].max(other[1])]);
    let square = Square::around(low, high);
    let mut crossed = crossings(&edges, square, memory_limit)?;
    summary.crossings = crossed.len() as u64;
    cells.append(&mut crossed);
    cells.sort_unstable();
    cells.dedup();
    // Invariant of snap rounding: each end and each crossing lies in one of these cells, and every
    // edge is routed through the centres of all of these cells that it passes, in its order. Moving
    // all points of such a cell to its centre at once moves no edge across a centre. So no two
    // chains cross, though they may come to overlap.
    let passages = passages(&edges, &mut cells, square, memory_limit)?;
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
