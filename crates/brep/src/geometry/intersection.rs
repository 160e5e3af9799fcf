//! Outcomes of the tests of a face against an octant, and how many of them each test decided.

/// The test that gave the answer; the paper's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// 1: the face's bounds and the octant.
    Boxes,
    /// 2: the face's plane and the octant. More than the paper's: not only a plane along a wall, but every
    /// plane that does not pass through the octant's inside ends here, also what the paper's (4) and (5)
    /// reject in test 4.
    Planes,
    /// 3: the face's vertices and the octant: (1) and (2).
    Vertices,
    /// 4: the octant's section with the plane, and the outer ring: (6) to (10).
    Section,
    /// 5: the section and the holes: (11) to (17).
    Holes,
    /// None of the paper's: the triangles of a face that is not planar.
    Triangles,
}

/// Outcome of testing a face against an octant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Intersection {
    /// Whether the face has a point in common with the octant's inside.
    pub cuts: bool,
    /// The test that decided.
    pub stage: Stage,
}

/// Numbers of outcomes by the test that decided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stages {
    /// Faces that do not cut the octant, in the order of [`Stage`].
    pub apart: [u64; 6],
    /// Faces that do, in the same order.
    pub cutting: [u64; 6],
}

impl Stages {
    /// Counts the outcome of one test.
    pub fn count(&mut self, found: Intersection) {
        let side = if found.cuts { &mut self.cutting } else { &mut self.apart };
        side[found.stage as usize] += 1;
    }

    /// Tests that decided anything: name, outcomes without an intersection, and with one.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, u64, u64)> {
        let names = ["boxes", "planes", "vertices", "section", "holes", "triangles"];
        let counts = self.apart.into_iter().zip(self.cutting);
        let all = names.into_iter().zip(counts).map(|(name, (apart, cutting))| (name, apart, cutting));
        all.filter(|(_, apart, cutting)| apart + cutting > 0)
    }

    /// Adds the counts of another walk.
    pub fn add(&mut self, other: &Stages) {
        for stage in 0..6 {
            self.apart[stage] += other.apart[stage];
            self.cutting[stage] += other.cutting[stage];
        }
    }
}
