//! The Euler-Poincaré formula.

use super::{NONE, Topology};

/// Entity counts of a shell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Vertices.
    pub vertices: u64,
    /// Edges.
    pub edges: u64,
    /// Faces.
    pub faces: u64,
    /// Rings in addition to the first one of each face: holes in faces.
    pub rings: u64,
    /// Boundaries: chains of edges with a face on one side only. 0 if the shell is closed.
    pub boundaries: u64,
}

impl Counts {
    /// Returns the number of handles, G in `V - E + F - R + B = 2 (1 - G)`. Returns `None` if that
    /// is not an integer of at least 0, as for a face without edges, or for a face whose interior
    /// is not connected.
    pub fn genus(&self) -> Option<u64> {
        let of = |count: u64| count as i64;
        let sum = of(self.vertices) - of(self.edges) + of(self.faces) - of(self.rings) + of(self.boundaries);
        let twice = u64::try_from(2 - sum).ok()?;
        twice.is_multiple_of(2).then_some(twice / 2)
    }
}

/// Entity counts of a model, for which `V - E + F - R + B = 2 (S - G)` holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Euler {
    /// V: vertices.
    pub vertices: u64,
    /// E: edges.
    pub edges: u64,
    /// F: faces.
    pub faces: u64,
    /// R: rings in addition to the first one of each face.
    pub rings: u64,
    /// S: shells.
    pub shells: u64,
    /// B: boundaries; 0 if the surface is closed.
    pub boundaries: u64,
    /// G: handles of all shells; `None` if those of a shell are not an integer of at least 0.
    pub genus: Option<u64>,
}

impl Topology {
    /// Returns the entity counts of each shell.
    pub fn counts_by_shell(&self) -> Vec<Counts> {
        let mut shells = vec![Counts::default(); self.shells() as usize];
        let at = |face: u32| self.shell_of_face(face) as usize;
        for face in 0..self.faces() {
            let counts = &mut shells[at(face)];
            counts.faces += 1;
            counts.rings += (self.rings_of_face(face).len() as u64).saturating_sub(1);
        }
        for vertex in &self.vertices {
            shells[at(self.face(vertex.half_edge))].vertices += 1;
        }
        for [first, _] in &self.edges {
            shells[at(self.face(*first))].edges += 1;
        }
        if self.edges.iter().any(|[_, second]| *second == NONE) {
            for chain in self.boundaries() {
                shells[at(self.face(chain[0]))].boundaries += 1;
            }
        }
        shells
    }

    /// Returns the counts of all entities, and the sum of the shells' genera.
    pub fn euler(&self) -> Euler {
        let mut euler = Euler { genus: Some(0), ..Euler::default() };
        for counts in self.counts_by_shell() {
            euler.vertices += counts.vertices;
            euler.edges += counts.edges;
            euler.faces += counts.faces;
            euler.rings += counts.rings;
            euler.boundaries += counts.boundaries;
            euler.shells += 1;
            euler.genus = euler.genus.zip(counts.genus()).map(|(all, genus)| all + genus);
        }
        euler
    }
}
