//! Traces region borders line by line. Line `y` is the grid line above row `y` of the cells; after
//! the last row there is one more.
//!
//! Where two borders meet at a cell corner, one arc continues. Where three or four meet, arcs end
//! and start. A region's border continues from the arriving border with the next one clockwise,
//! because the region is between the two. Regions are therefore separate polygons where they only
//! touch at corners.

use super::arcs::Arcs;
use super::labels::Labels;
use super::points::NONE;
use super::rows::{Class, ClassSpan};
use super::simplify::Simplifier;
use spinney_base::Result;

/// A run of a row and the label of its cells; [`NONE`] if they are VOID.
#[derive(Clone, Copy)]
struct LabelledSpan {
    run: ClassSpan,
    label: u32,
}

/// The row above the current line, and the borders that continue downwards from it.
pub(super) struct Sweep {
    pub(super) arcs: Arcs,
    pub(super) labels: Labels,
    columns: u32,
    /// Whether cells that share a corner are connected.
    has_corners: bool,
    row: Vec<LabelledSpan>,
    /// Number of consecutive equal rows.
    height: u64,
    /// Columns and tips of the arcs that continue downwards.
    downward: Vec<(u32, u32)>,
    /// Number of the line below the row.
    line: u32,
}

/// A cell adjacent to a corner: its class and its label.
type Cell = (Class, u32);

const OUTSIDE: Cell = (Class::VOID, NONE);

impl Sweep {
    /// Starts above the first row of a raster of `columns` columns.
    pub(super) fn new(columns: u32, has_corners: bool, arcs: Arcs) -> Sweep {
        let row = vec![LabelledSpan { run: ClassSpan::new(Class::VOID, columns), label: NONE }];
        let labels = Labels::default();
        Sweep { arcs, labels, columns, has_corners, row, height: 0, downward: Vec::new(), line: 0 }
    }

    /// Skips a row that equals the one above it.
    pub(super) fn repeat(&mut self) {
        self.line += 1;
        self.height += 1;
    }

    /// Processes a row. Returns roots and classes of the regions that have ended.
    ///
    /// # Errors
    /// If arcs are simplified and the tree or a temporary file cannot be read.
    pub(super) fn next(
        &mut self,
        runs: &[ClassSpan],
        simplifier: &mut Option<Simplifier<'_>>,
    ) -> Result<Vec<(u32, Class)>> {
        if self.row.iter().map(|labelled| &labelled.run).eq(runs) {
            self.repeat();
            return Ok(Vec::new());
        }
        let below = self.label(runs);
        self.borders(&below);
        for number in self.arcs.take_finished() {
            if let Some(simplifier) = simplifier {
                simplifier.simplify(&mut self.arcs, number)?;
            }
            self.arcs.list(number, &mut self.labels);
        }
        // Regions without cells in the row below have ended. (New labels have line 0, so marks
        // start at 1.)
        let line = u64::from(self.line) + 1;
        let above = std::mem::replace(&mut self.row, below);
        for LabelledSpan { label, .. } in self.row.iter().filter(|run| run.label != NONE) {
            self.labels.mark_line(*label, line);
        }
        let mut ended = Vec::new();
        for LabelledSpan { run, label } in above.iter().filter(|run| run.label != NONE) {
            let root = self.labels.find(*label);
            if self.labels.mark_line(root, line) {
                ended.push((root, run.class()));
            }
        }
        (self.line, self.height) = (self.line + 1, 1);
        Ok(ended)
    }

    /// Labels the runs of the next row from the row above, and adds the cells of the row above to
    /// its regions.
    fn label(&mut self, runs: &[ClassSpan]) -> Vec<LabelledSpan> {
        let mut start = 0;
        for LabelledSpan { run, label } in &self.row {
            if *label != NONE {
                self.labels.count(*label, u64::from(run.end - start) * self.height);
            }
            start = run.end;
        }
        let mut below: Vec<LabelledSpan> = Vec::with_capacity(runs.len());
        let Sweep { labels, arcs, row, has_corners, .. } = self;
        let (mut first, mut start) = (0, 0);
        for run in runs {
            let class = run.class();
            if !class.is_valid {
                below.push(LabelledSpan { run: *run, label: NONE });
                start = run.end;
                continue;
            }
            // Start at the run above that ends where this one starts, if there is one: they share a
            // corner.
            while row[first].run.end < start {
                first += 1;
            }
            let mut label = NONE;
            // Labels of equal cells above that only share the left or the right upper corner. They
            // are joined last, when the run has a label. A run that only touches corners gets a new
            // one: its cells are another polygon of the same region.
            let mut corners = [NONE; 2];
            let mut above_start = if first == 0 { 0 } else { row[first - 1].run.end };
            for above in &row[first..] {
                if above_start > run.end {
                    break;
                }
                if above.run.class() == class {
                    if above.run.end == start {
                        corners[0] = above.label;
                    } else if above_start == run.end {
                        corners[1] = above.label;
                    } else if label == NONE {
                        label = above.label;
                    } else {
                        labels.join(label, above.label, true, |last, half| arcs.link_halves(last, half));
                    }
                }
                above_start = above.run.end;
            }
            if label == NONE {
                label = labels.add();
            }
            for corner in corners {
                if *has_corners && corner != NONE {
                    labels.join(label, corner, false, |last, half| arcs.link_halves(last, half));
                }
            }
            below.push(LabelledSpan { run: *run, label });
            start = run.end;
        }
        below
    }

    /// Continues the borders of the row above to the row below.
    fn borders(&mut self, below: &[LabelledSpan]) {
        let y = self.line;
        let mut downward = Vec::with_capacity(below.len() + 1);
        let mut upper = self.downward.iter().peekable();
        let cell = |row: &[LabelledSpan], index: usize| {
            row.get(index).map_or(OUTSIDE, |labelled| (labelled.run.class(), labelled.label))
        };
        // Runs of the cells to the right of the corner.
        let (mut above_run, mut below_run) = (0, 0);
        let (mut north_west, mut south_west) = (OUTSIDE, OUTSIDE);
        let mut x = 0;
        // Tip of the arc that arrives along the line from the left.
        let mut west = NONE;
        loop {
            let (north_east, south_east) = if x == self.columns {
                (OUTSIDE, OUTSIDE)
            } else {
                (cell(&self.row, above_run), cell(below, below_run))
            };
            let north = upper.next_if(|(column, _)| *column == x).map_or(NONE, |(_, tip)| *tip);
            let has_south = south_west.0 != south_east.0;
            let has_east = north_east.0 != south_east.0;
            let edges = [north != NONE, has_east, has_south, west != NONE];
            let at = [x, y];
            // Arcs have the lesser class on their left.
            let goes_south = south_east.0 < south_west.0;
            let goes_east = north_east.0 < south_east.0;
            let south_labels =
                if goes_south { [south_east.1, south_west.1] } else { [south_west.1, south_east.1] };
            let east_labels =
                if goes_east { [north_east.1, south_east.1] } else { [south_east.1, north_east.1] };
            match edges {
                [false, false, false, false] => {}
                [true, false, true, false] => downward.push((x, north)),
                [false, true, false, true] => {}
                [true, true, false, false] => {
                    self.arcs.push(north, at);
                    west = north;
                }
                [false, false, true, true] => {
                    self.arcs.push(west, at);
                    downward.push((x, west));
                    west = NONE;
                }
                [true, false, false, true] => {
                    self.arcs.meet([north, west], at);
                    west = NONE;
                }
                [false, true, true, false] => {
                    let [start, end] = self.arcs.begin(at, south_labels);
                    let (south, east) = if goes_south { (end, start) } else { (start, end) };
                    downward.push((x, south));
                    west = east;
                }
                // A junction.
                _ => {
                    // Diagonal cells of equal class may belong to one region, which then touches
                    // itself here.
                    let is_pinched =
                        edges == [true; 4] && (north_west.0 == south_east.0 || north_east.0 == south_west.0);
                    // Ends at the junction clockwise: north, east, south, west.
                    let mut ends = [NONE; 4];
                    if north != NONE {
                        ends[0] = self.arcs.end(north, at, is_pinched);
                    }
                    if west != NONE {
                        ends[3] = self.arcs.end(west, at, is_pinched);
                    }
                    west = NONE;
                    if has_east {
                        let side = u8::from(!goes_east);
                        (ends[1], west) = self.arcs.begin_at_junction(at, side, east_labels, is_pinched);
                    }
                    if has_south {
                        let side = u8::from(!goes_south);
                        let (end, tip) = self.arcs.begin_at_junction(at, side, south_labels, is_pinched);
                        ends[2] = end;
                        downward.push((x, tip));
                    }
                    // Link each end to the next one clockwise, and the last one to the first.
                    let (mut last, first) = (NONE, ends.iter().copied().find(|end| *end != NONE));
                    for end in ends.into_iter().chain(first).filter(|end| *end != NONE) {
                        if last != NONE {
                            self.arcs.link(last, end);
                        }
                        last = end;
                    }
                }
            }
            if x == self.columns {
                break;
            }
            (north_west, south_west) = (north_east, south_east);
            let (above_end, below_end) = (self.row[above_run].run.end, below[below_run].run.end);
            x = above_end.min(below_end);
            above_run += usize::from(above_end == x);
            below_run += usize::from(below_end == x);
        }
        self.downward = downward;
    }
}
