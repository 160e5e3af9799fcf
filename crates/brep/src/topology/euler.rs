//! The law of Euler and Poincaré.

use super::{NONE, Topology};

/// Numbers of a shell's entities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Vertices.
    pub vertices: u64,
    /// Edges.
    pub edges: u64,
    /// Faces.
    pub faces: u64,
    /// Rings beside the first of each face: holes in faces.
    pub rings: u64,
    /// Boundaries: chains of edges with a face on one side only. None if the shell is closed.
    pub boundaries: u64,
}

impl Counts {
    /// Number of handles, G of `V - E + F - R + B = 2 (1 - G)`; `None` if that is no whole number of 0 or more, as
    /// for a face without edges, or one of whose parts only touch.
    pub fn genus(&self) -> Option<u64> {
        let of = |count: u64| count as i64;
        let sum = of(self.vertices) - of(self.edges) + of(self.faces) - of(self.rings) + of(self.boundaries);
        let twice = u64::try_from(2 - sum).ok()?;
        twice.is_multiple_of(2).then_some(twice / 2)
    }
}

/// Numbers of a model's entities, which fulfil `V - E + F - R + B = 2 (S - G)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Euler {
    /// V: vertices.
    pub vertices: u64,
    /// E: edges.
    pub edges: u64,
    /// F: faces.
    pub faces: u64,
    /// R: rings beside the first of each face.
    pub rings: u64,
    /// S: shells.
    pub shells: u64,
    /// B: boundaries; none if the surface is closed.
    pub boundaries: u64,
    /// G: handles of all shells; `None` if those of one are no whole number of 0 or more.
    pub genus: Option<u64>,
}

impl Topology {
    /// Numbers of the entities of each shell.
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

    /// Numbers of all entities, and the genus that follows from those of each shell.
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
