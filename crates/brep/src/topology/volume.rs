//! Exact volumes of shells.

use super::Topology;
use crate::exact::vector::{cross, dot};

impl Topology {
    /// Returns six times the volume that a closed shell encloses, an integer in cubed grid units.
    /// It is negative for a cavity, whose faces point inwards. For an open shell, it is
    /// meaningless.
    ///
    /// ```
    /// # use spinney::brep::{Face, Grid};
    /// # use spinney::raw::brep::FaceList;
    /// # use spinney::raw::brep::topology::{Topology, TopologyOptions};
    /// let corners = [[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4]];
    /// let mut faces = FaceList::new(Grid::over([[0.0; 3], [4.0; 3]], Some(1.0))?, vec!["solid".into()]);
    /// for [a, b, c] in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] {
    ///     let points = [corners[a], corners[b], corners[c]];
    ///     faces.push(&Face { number: 0, points: &points, ring_ends: &[3], colours: &[], part: 0, source: 0 });
    /// }
    /// let topology = Topology::of(&faces, &TopologyOptions::default(), &())?;
    /// assert_eq!(topology.six_volumes(0), 4 * 4 * 4);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    pub fn six_volumes(&self, shell: u32) -> i128 {
        let rings = self.faces_of_shell(shell).iter().flat_map(|&face| self.rings_of_face(face));
        rings.map(|ring| self.six_cones(ring)).sum()
    }

    /// Returns six times the volume of the cone from the point 0, 0, 0 over a ring.
    fn six_cones(&self, ring: u32) -> i128 {
        let mut half_edges = self.half_edges_of_ring(ring);
        let point = |half_edge: u32| self.point(self.origin(half_edge)).map(i128::from);
        let Some(first) = half_edges.next().map(point) else { return 0 };
        half_edges
            .map(|half_edge| {
                let (a, b) = (point(half_edge), point(self.next(half_edge)));
                dot(first, cross(a, b))
            })
            .sum()
    }
}
