//! Zonal statistics: statistics of the cells in polygons.
//!
//! The tree is walked from the root down as for a box. What lies in a polygon as a whole is counted by the statistics that
//! the tree stores; what a border cuts is gone into, down to uniform blocks, whose part in the polygon is counted in rows,
//! or cell by cell along its border. Cells and shares are counted in integers, so that all numbers are the same however a tree stores its cells. Where single values are asked for (`values.rs`), everything in a polygon is gone into, unless classes are counted.

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

/// A tree that is asked for the cells in polygons.
pub(crate) struct ZonalTree<'a> {
    form: TreeType,
    depth: u8,
    counts_classes: bool,
    /// Cells that can be other than VOID.
    picture: Bounds,
    walk: Box<WalkZone<'a>>,
}

/// A walk over the cells of a zone.
type WalkZone<'a> = dyn Fn(&ZoneCells<'_>, &mut Gather<'_>) -> Walked + Sync + 'a;

impl<'a> ZonalTree<'a> {
    /// A file in segments.
    pub(crate) fn of_file(tree: &'a Goblin) -> ZonalTree<'a> {
        ZonalTree::new(tree.header(), Box::new(|zone, gather| walk(tree, zone, gather)))
    }

    /// Any other source, and the header that a file of it has.
    pub(crate) fn of_source<S: Source>(source: &'a S, header: &Header) -> ZonalTree<'a> {
        ZonalTree::new(header, Box::new(|zone, gather| walk_source(source, zone, gather)))
    }

    fn new(header: &Header, walk: Box<WalkZone<'a>>) -> ZonalTree<'a> {
        let (depth, counts_classes) = (header.depth(), header.counts_classes());
        ZonalTree { form: header.form, depth, counts_classes, picture: header.picture(), walk }
    }
}

/// A kernel that adds the cells of a dense block in a box to a `T`, each with a share of it.
type AddDense<T> = fn(&mut T, &DenseBlock<'_>, ([usize; 3], [usize; 3]), u64);

/// Trees of the same grid, by their numbers among all, with polygons in its cells; of those that lie outside there is none.
pub(crate) struct ZonalGroup<'a> {
    pub(crate) trees: Vec<(usize, ZonalTree<'a>)>,
    pub(crate) polygons: &'a [Option<Polygon>],
}

/// Statistics of all trees in a polygon, in their order.
type ZoneSink<'a> = dyn FnMut(Vec<ZoneStatistics>) -> Result<()> + 'a;

/// Polygons that are worked on before somebody is told of it, and answers that are held at most, unless there are more trees.
const BATCH: usize = 64;
const MAX_HELD: usize = 1 << 16;

/// Hands out the statistics of the cells in each of some polygons, of all trees; time goes with the nodes along their borders. Which
/// cells are in a polygon is found once for all trees of a grid.
///
/// # Errors
/// If a file is damaged there, `take` fails, or on interruption.
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
    /// Statistics in a polygon, at the places of the group's trees.
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
            let zone = ZoneCells { polygon, rule: request.edge, picture: tree.picture, found: found.take() };
            let mut gather = Gather::new(tree, &zone, (request, memory), progress);
            ended((tree.walk)(&zone, &mut gather))?;
            all[*place] = gather.finish()?;
            found = zone.found;
        }
        Ok(())
    }
}
