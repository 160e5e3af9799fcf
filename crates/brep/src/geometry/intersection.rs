//! Results of face-octant tests, and statistics of the deciding stages.

/// The stage that decided a test, with the paper's numbers (see `polygon.rs`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// 1: the face's bounds and the octant.
    Boxes,
    /// 2: the face's plane and the octant. This stage decides more than the paper's: it rejects
    /// every plane that misses the octant's interior, not only planes along walls. It includes what
    /// the paper's (4) and (5) reject in test 4.
    Planes,
    /// 3: the face's vertices and the octant: (1) and (2).
    Vertices,
    /// 4: the octant's section with the plane, and the outer ring: (6) to (10).
    Section,
    /// 5: the section and the holes: (11) to (17).
    Holes,
    /// Not in the paper: the triangles of a face that is not planar.
    Triangles,
}

/// Result of testing a face against an octant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Intersection {
    /// Whether the face shares a point with the octant's interior.
    pub cuts: bool,
    /// The stage that decided.
    pub stage: Stage,
}

/// Numbers of results by deciding stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stages {
    /// Faces that do not cut the octant, in the order of [`Stage`].
    pub disjoint: [u64; 6],
    /// Faces that cut the octant, in the same order.
    pub cutting: [u64; 6],
}

impl Stages {
    /// Counts the result of one test.
    pub fn count(&mut self, found: Intersection) {
        let side = if found.cuts { &mut self.cutting } else { &mut self.disjoint };
        side[found.stage as usize] += 1;
    }

    /// Returns the stages that decided any test: name, misses and hits.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, u64, u64)> {
        let names = ["boxes", "planes", "vertices", "section", "holes", "triangles"];
        let counts = self.disjoint.into_iter().zip(self.cutting);
        let all = names.into_iter().zip(counts).map(|(name, (disjoint, cutting))| (name, disjoint, cutting));
        all.filter(|(_, disjoint, cutting)| disjoint + cutting > 0)
    }

    /// Adds other counts.
    pub fn add(&mut self, other: &Stages) {
        for stage in 0..6 {
            self.disjoint[stage] += other.disjoint[stage];
            self.cutting[stage] += other.cutting[stage];
        }
    }
}
