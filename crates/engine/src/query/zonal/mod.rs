//! Zonal statistics: statistics of the cells in polygons.
//!
//! The tree is traversed from the root as for a box. The statistics of a node that is entirely in a
//! polygon come from the tree. Nodes that a border crosses are descended into, down to uniform
//! blocks, whose cells in the polygon are counted in rows, or cell by cell along the border. Cells
//! and shares are counted in integers, so that the results do not depend on how a tree stores its
//! cells. If single values are requested (`values.rs`) and the tree does not count classes, all
//! nodes in a polygon are descended into.

mod cells;
mod gather;
mod parts;
mod request;
mod values;

use std::cell::RefCell;

use super::walk::{Walked, ended, walk, walk_source};
use crate::store::goblin::Goblin;
use crate::store::records::dense::DenseBlock;
use crate::tree::Source;
use cells::{FoundCells, ZoneCells};
use gather::Gather;
pub use request::{ZonalRequest, ZoneChannel, ZoneMeasure, ZoneStatistics, ZoneValues};
use spinney_base::TreeType;
use spinney_base::io::batch;
use spinney_base::parallel;
use spinney_base::space::Bounds;
use spinney_base::{Progress, Result};
use spinney_container::Header;
use spinney_overlay::Polygon;

/// A tree to compute zonal statistics of.
pub(crate) struct ZonalTree<'a> {
    form: TreeType,
    depth: u8,
    counts_classes: bool,
    /// Box of the cells that may be other than VOID.
    extent: Bounds,
    walk: Box<WalkZone<'a>>,
}

/// Traversal of the cells of a zone.
type WalkZone<'a> = dyn Fn(&ZoneCells<'_>, &mut Gather<'_>) -> Walked + Sync + 'a;

impl<'a> ZonalTree<'a> {
    /// Wraps a Goblin file.
    pub(crate) fn of_file(tree: &'a Goblin) -> ZonalTree<'a> {
        ZonalTree::new(tree.header(), Box::new(|zone, gather| walk(tree, zone, gather)))
    }

    /// Wraps any other source, with the header of its file.
    pub(crate) fn of_source<S: Source>(source: &'a S, header: &Header) -> ZonalTree<'a> {
        ZonalTree::new(header, Box::new(|zone, gather| walk_source(source, zone, gather)))
    }

    fn new(header: &Header, walk: Box<WalkZone<'a>>) -> ZonalTree<'a> {
        let (depth, counts_classes) = (header.depth(), header.counts_classes());
        ZonalTree { form: header.form, depth, counts_classes, extent: header.extent_bounds(), walk }
    }
}

/// Kernel that adds the cells of a dense block in a box to a `T`, each with the same share.
type AddDense<T> = fn(&mut T, &DenseBlock<'_>, ([usize; 3], [usize; 3]), u64);

/// Trees of the same grid, with their indices among all trees, and polygons in the grid's cells. A
/// polygon outside of the grid is `None`.
pub(crate) struct ZonalGroup<'a> {
    pub(crate) trees: Vec<(usize, ZonalTree<'a>)>,
    pub(crate) polygons: &'a [Option<Polygon>],
}

/// Receives the statistics of all trees in a polygon, in their order.
type ZoneSink<'a> = dyn FnMut(Vec<ZoneStatistics>) -> Result<()> + 'a;

/// Maximum number of polygons per batch.
const BATCH: usize = 64;
/// Maximum number of results to hold in memory (at least one per tree).
const MAX_HELD: usize = 1 << 16;

/// Passes the statistics of the cells in each polygon, of all trees, to `take`. The time is
/// proportional to the nodes along the borders. The cells in a polygon are determined once for all
/// trees of a grid.
///
/// # Errors
/// If a file is corrupt there, `take` fails, or on cancellation.
pub(crate) fn zonal(
    groups: &[ZonalGroup<'_>],
    request: &ZonalRequest,
    progress: &dyn Progress,
    take: &mut ZoneSink<'_>,
) -> Result<()> {
    request.check()?;
    let memory = request.memory / parallel::threads() as u64;
    let trees: usize = groups.iter().map(|group| group.trees.len()).sum();
    let polygons = groups.iter().map(|group| group.polygons.len()).max().unwrap_or(0);
    let numbers: Vec<usize> = (0..polygons).collect();
    for batch in numbers.chunks((MAX_HELD / trees.max(1)).clamp(1, BATCH)) {
        let zone_of = |number: &usize| {
            let mut all = vec![ZoneStatistics::default(); trees];
            groups.iter().try_for_each(|group| group.zone(*number, (request, memory), progress, &mut all))?;
            Ok(all)
        };
        batch::map(batch, zone_of)?.into_iter().try_for_each(&mut *take)?;
        progress.check()?;
        progress.advance((batch.len() * trees) as u64, (polygons * trees) as u64);
    }
    Ok(())
}

impl ZonalGroup<'_> {
    /// Computes the statistics in a polygon and stores them at the indices of the group's trees.
    fn zone(
        &self,
        number: usize,
        (request, memory): (&ZonalRequest, u64),
        progress: &dyn Progress,
        all: &mut [ZoneStatistics],
    ) -> Result<()> {
        let Some(Some(polygon)) = self.polygons.get(number) else { return Ok(()) };
        let mut found = (self.trees.len() > 1).then(RefCell::<FoundCells>::default);
        for (place, tree) in &self.trees {
            let zone = ZoneCells { polygon, rule: request.edge, extent: tree.extent, found: found.take() };
            let mut gather = Gather::new(tree, &zone, (request, memory), progress);
            ended((tree.walk)(&zone, &mut gather))?;
            all[*place] = gather.finish()?;
            found = zone.found;
        }
        Ok(())
    }
}
