//! Boundaries of open surfaces.

use std::path::Path;

use super::{NONE, Topology};
use spinney_base::{Error, Result};

impl Topology {
    /// Returns whether every half-edge has a twin.
    pub fn is_closed(&self) -> bool {
        self.edges.iter().all(|[_, second]| *second != NONE)
    }

    /// Returns the boundaries of an open surface: closed chains of half-edges that have no twin.
    /// Their origins are the chain's points.
    pub fn boundaries(&self) -> impl Iterator<Item = Vec<u32>> {
        let mut is_done = Vec::new();
        let lone = self.edges.iter().filter(|[_, second]| *second == NONE).map(|[first, _]| *first);
        lone.filter_map(move |first| {
            if is_done.is_empty() {
                is_done = vec![false; self.half_edges() as usize];
            }
            let mut chain = Vec::new();
            let mut at = first;
            while !is_done[at as usize] {
                is_done[at as usize] = true;
                chain.push(at);
                // The first half-edge of an open fan has no twin.
                at = self.vertices[self.target(at) as usize].half_edge;
            }
            (!chain.is_empty()).then_some(chain)
        })
    }

    /// Checks that the surface is closed.
    ///
    /// # Errors
    /// If it is not. The message has the number of edges that lack a face, and the grid positions
    /// of the first of them.
    pub fn check_closed(&self, path: &Path) -> Result<()> {
        const MAX_SHOWN: usize = 8;
        let Some(chain) = self.boundaries().next() else { return Ok(()) };
        let lone = self.edges.iter().filter(|[_, second]| *second == NONE).count();
        let points: Vec<_> = chain.iter().take(MAX_SHOWN).map(|&at| self.point(self.origin(at))).collect();
        let more = if chain.len() > MAX_SHOWN { " and further points" } else { "" };
        let found = format!(
            "{lone} edges with a face on one side only, in {} chains; the first has {} edges and passes {points:?}{more}",
            self.boundaries().count(),
            chain.len(),
        );
        Err(Error::corrupt(path, "surface", found, "every edge in both directions"))
    }
}
