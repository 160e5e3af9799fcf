//! Statistics of the cells in polygons, for one dataset or several layers at once.

use super::{Dataset, Tree};
use crate::query::{ZonalGroup, ZonalRequest, ZonalTree, ZoneStatistics, zonal};
use spinney_base::{Error, Progress, Result};
use spinney_overlay::Polygon;

impl Dataset {
    /// Computes zonal statistics: exact statistics of the cells in each polygon. The polygons'
    /// vertices are in cells of the deepest level
    /// ([`Frame::to_cells`](spinney_crs::Frame::to_cells)). Reads the tree only where borders cut
    /// it, on all threads of the current pool. In an octree, a polygon is a prism through the whole
    /// extent along z.
    ///
    /// ```
    /// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
    /// use spinney::query::{EdgeRule, Polygon};
    ///
    /// let map = spinney::open("fixtures/v1/classes.goblin")?;
    /// let triangle = Polygon::new(&[vec![[40.0, 40.0], [180.0, 60.0], [90.0, 170.0]]])?;
    /// let zones = map.zonal(&[triangle], &EdgeRule::Area.into(), &())?;
    /// let cells: f64 = zones[0].classes.iter().map(|(_, cells)| cells).sum();
    /// assert!((cells - zones[0].cells).abs() < 1e-6);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If a quantile is invalid, the file is corrupt there, temporary files cannot be used, or on
    /// cancellation.
    pub fn zonal(
        &self,
        polygons: &[Polygon],
        request: &ZonalRequest,
        progress: &dyn Progress,
    ) -> Result<Vec<ZoneStatistics>> {
        let polygons: Vec<Option<Polygon>> = polygons.iter().cloned().map(Some).collect();
        let mut found = Vec::with_capacity(polygons.len());
        let take = &mut |mut zone: Vec<ZoneStatistics>| {
            found.append(&mut zone);
            Ok(())
        };
        Dataset::zonal_layers(&[(self, &polygons)], request, progress, take)?;
        Ok(found)
    }

    /// Computes zonal statistics of several layers, each with the polygons in its own cells (`None`
    /// is outside of the layer). Passes the statistics of all layers to `take`, polygon by polygon.
    /// Layers of equal size that share one list of polygons also share the computed coverage of
    /// cells, so each further layer costs little more than reading its values.
    ///
    /// # Errors
    /// If layers have different numbers of polygons, a quantile is invalid, a file is corrupt
    /// there, temporary files cannot be used, `take` fails, or on cancellation.
    pub fn zonal_layers(
        layers: &[(&Dataset, &[Option<Polygon>])],
        request: &ZonalRequest,
        progress: &dyn Progress,
        take: &mut dyn FnMut(Vec<ZoneStatistics>) -> Result<()>,
    ) -> Result<()> {
        let count = layers.first().map_or(0, |(_, polygons)| polygons.len());
        let mut groups: Vec<([u64; 3], ZonalGroup<'_>)> = Vec::new();
        for (number, (layer, polygons)) in layers.iter().enumerate() {
            if polygons.len() != count {
                let found = format!("{} polygons for one layer and {count} for another", polygons.len());
                return Err(Error::invalid("zones", found, "the same polygons for all layers"));
            }
            let tree = (number, layer.zonal_tree());
            let extent = layer.header().extent;
            let is_same = |(other, group): &&mut ([u64; 3], ZonalGroup<'_>)| {
                *other == extent && std::ptr::eq(group.polygons, *polygons)
            };
            match groups.iter_mut().find(is_same) {
                Some((_, group)) => group.trees.push(tree),
                None => groups.push((extent, ZonalGroup { trees: vec![tree], polygons })),
            }
        }
        let groups: Vec<ZonalGroup<'_>> = groups.into_iter().map(|(_, group)| group).collect();
        zonal(&groups, request, progress, take)
    }

    /// Returns, for each layer, the index of the first layer on the same grid: same extent, depth
    /// and frame.
    pub fn same_cells(layers: &[&Dataset]) -> Vec<usize> {
        let mut grids: Vec<usize> = Vec::new();
        let is_same = |a: &Dataset, b: &Dataset| {
            let (own, other) = (a.header(), b.header());
            own.extent == other.extent
                && own.depth() == other.depth()
                && a.metadata().frame == b.metadata().frame
        };
        let mut firsts = Vec::with_capacity(layers.len());
        for (number, layer) in layers.iter().enumerate() {
            let known = grids.iter().copied().find(|grid| is_same(layers[*grid], layer));
            if known.is_none() {
                grids.push(number);
            }
            firsts.push(known.unwrap_or(number));
        }
        firsts
    }

    fn zonal_tree(&self) -> ZonalTree<'_> {
        match &self.tree {
            Tree::Goblin(file) => ZonalTree::of_file(file),
            Tree::Autumnal(file) => ZonalTree::of_source(&**file, file.header()),
            Tree::View(viewed) => ZonalTree::of_source(viewed.view(), viewed.header()),
        }
    }
}
