//! Triangulation by a plane sweep with exact integers. It takes `O(n log n)` time for `n` vertices,
//! whatever the rings' shape.
//!
//! After S. Hertel and K. Mehlhorn, "Fast triangulation of simple polygons", FCT 1983: a line
//! sweeps over the vertices from left to right. It divides the inside into intervals between an
//! edge and the next one above. Each interval has a chain of vertices on its left, next to the
//! finished triangles. The chain is concave as seen from the right, and the two edges end at its
//! ends. A new vertex is connected to all chain vertices that are visible from it. Any number of
//! edges may meet in a vertex, so rings may touch. An edge through a vertex is split there.

use std::cell::Cell;

use super::status::{Status, StatusPosition};
use super::turn::turn;
use spinney_base::sort;

/// Marks a missing edge, vertex or link.
const NONE: u32 = u32::MAX;

/// An edge of the rings, or its remainder to the right of the sweep line.
#[derive(Clone, Copy)]
struct Edge {
    left: u32,
    right: u32,
    /// Whether the ring passes it from left to right: the inside is then above.
    forward: bool,
    /// Chain of the interval above, if that is inside.
    chain: Chain,
    /// Another edge that starts at the same vertex.
    sibling: u32,
}

/// A chain by its links: the lowest, the highest, and the last one reached, which is the rightmost.
#[derive(Clone, Copy)]
struct Chain {
    front: u32,
    back: u32,
    last: u32,
}

impl Chain {
    const NONE: Chain = Chain { front: NONE, back: NONE, last: NONE };
}

#[derive(Clone, Copy)]
struct Link {
    corner: u32,
    below: u32,
    above: u32,
}

/// Error: rings cross, or enclose a region twice.
pub(super) struct Crossing;

/// Plane sweep over the rings of one face.
pub(super) struct Sweep<'a> {
    flat: &'a [[i64; 2]],
    edges: Vec<Edge>,
    /// By vertex: the first of the edges that start there, and the number of edges that end there.
    starting: Vec<u32>,
    ending: Vec<u32>,
    /// Edges on the sweep line, from below.
    status: Status,
    links: Vec<Link>,
    triangles: Vec<[u32; 3]>,
    /// Number of orientation tests so far.
    visits: Cell<u64>,
}

impl<'a> Sweep<'a> {
    pub(super) fn new(flat: &'a [[i64; 2]]) -> Sweep<'a> {
        Sweep {
            flat,
            edges: Vec::new(),
            starting: vec![NONE; flat.len()],
            ending: vec![0; flat.len()],
            status: Status::default(),
            links: Vec::new(),
            triangles: Vec::new(),
            visits: Cell::new(0),
        }
    }

    /// Triangulates the region between a counterclockwise ring and clockwise holes.
    ///
    /// The triangles are correct if the rings do not cross. Not every crossing is detected: the
    /// caller has to check the result.
    pub(super) fn cut(&mut self, rings: &[Vec<u32>]) -> Result<Vec<[u32; 3]>, Crossing> {
        let mut corners: Vec<u32> = rings.iter().flatten().copied().collect();
        sort::numbers32(&mut corners);
        corners.dedup();
        sort::by_wide_key(&mut corners, |&corner| sort::flat_key(self.at(corner)));
        // Distinct vertices that coincide in projection (in a face that is not planar): an edge
        // between them has no direction.
        if corners.windows(2).any(|two| self.at(two[0]) == self.at(two[1])) {
            return Err(Crossing);
        }
        for ring in rings {
            for (i, &a) in ring.iter().enumerate() {
                let b = ring[(i + 1) % ring.len()];
                if a != b {
                    let forward = self.at(a) < self.at(b);
                    let (left, right) = if forward { (a, b) } else { (b, a) };
                    self.add(left, right, forward);
                    self.ending[right as usize] += 1;
                }
            }
        }
        for corner in corners {
            self.pass(corner)?;
        }
        Ok(std::mem::take(&mut self.triangles))
    }

    /// Returns the number of orientation tests so far.
    pub(super) fn visits(&self) -> u64 {
        self.visits.get()
    }

    /// Returns twice the area of a triangle, positive if it is counterclockwise.
    fn turn(&self, a: u32, b: u32, c: u32) -> i128 {
        self.visits.set(self.visits.get() + 1);
        turn(self.at(a), self.at(b), self.at(c))
    }

    fn at(&self, corner: u32) -> [i64; 2] {
        self.flat[corner as usize]
    }

    fn edge(&self, edge: u32) -> Edge {
        self.edges[edge as usize]
    }

    fn add(&mut self, left: u32, right: u32, forward: bool) {
        let sibling = std::mem::replace(&mut self.starting[left as usize], self.edges.len() as u32);
        self.edges.push(Edge { left, right, forward, chain: Chain::NONE, sibling });
    }

    /// Returns twice the area between an edge and a vertex, positive if the vertex is above.
    fn side(&self, edge: u32, corner: u32) -> i128 {
        let Edge { left, right, .. } = self.edge(edge);
        self.turn(left, right, corner)
    }

    /// Advances the sweep line over a vertex.
    fn pass(&mut self, corner: u32) -> Result<(), Crossing> {
        // Invariant: the status has the edges in their order along the sweep line, from below.
        // Edges meet only at their ends, since an edge through a vertex is split there, so their
        // order does not change between vertices. The binary search for a vertex's edges relies on
        // that. If rings cross, it misses an edge, which the count of edges that end here detects.
        let mut position = self.status.first_not(|edge| self.side(edge, corner) > 0);
        let below = self.status.before(position);
        let ended = self.end(corner, &mut position)?;
        let starting = self.start(corner)?;
        // Invariant: inside and outside alternate from edge to edge below and above each vertex,
        // both to its left and to its right. A forward edge has the inside above; coincident edges
        // that cancel are not inserted. So an interval is inside if the edge below it is a forward
        // edge, and only such intervals have chains.
        let is_inside = |edge: Option<u32>| edge.is_some_and(|edge| self.edge(edge).forward);
        let inside_below = is_inside(below);
        let inside_above = if ended.is_empty() { inside_below } else { is_inside(ended.last().copied()) };
        for edges in [&ended, &starting] {
            let mut inside = inside_below;
            for &edge in edges {
                if self.edge(edge).forward == inside {
                    return Err(Crossing);
                }
                inside = !inside;
            }
            if inside != inside_above {
                return Err(Crossing);
            }
        }
        let (low, high) = self.join(corner, below, &ended);
        match (starting.last(), below) {
            (Some(&highest), _) => {
                if let Some(below) = below {
                    self.edges[below as usize].chain = low;
                }
                for &edge in &starting {
                    self.edges[edge as usize].chain = self.chain(corner);
                }
                if inside_above {
                    self.edges[highest as usize].chain = high;
                }
            }
            // Two intervals are merged.
            (None, Some(below)) if inside_below && !ended.is_empty() => {
                let links = [low.back, high.front].map(|link| self.links[link as usize]);
                self.links[low.back as usize].above = links[1].above;
                let back = match links[1].above {
                    NONE => low.back,
                    above => {
                        self.links[above as usize].below = low.back;
                        high.back
                    }
                };
                self.edges[below as usize].chain = Chain { front: low.front, back, last: low.back };
            }
            _ => {}
        }
        for &edge in starting.iter().rev() {
            position = self.status.insert(position, edge);
        }
        Ok(())
    }

    /// Removes the edges that end in a vertex, from below, and splits those that pass through it.
    fn end(&mut self, corner: u32, position: &mut StatusPosition) -> Result<Vec<u32>, Crossing> {
        let mut ended = Vec::new();
        while let Some(edge) = self.status.get(*position).filter(|&edge| self.side(edge, corner) == 0) {
            *position = self.status.remove(*position);
            ended.push(edge);
            if self.edge(edge).right == corner {
                self.ending[corner as usize] = self.ending[corner as usize].wrapping_sub(1);
            } else {
                self.divide(edge, corner);
            }
        }
        // If edges cross, they are out of order, and the search misses some.
        if self.ending[corner as usize] == 0 { Ok(ended) } else { Err(Crossing) }
    }

    /// Splits an edge at a vertex on it; a triangle without area keeps the original edge.
    fn divide(&mut self, edge: u32, corner: u32) {
        let Edge { left, right, forward, .. } = self.edge(edge);
        self.triangles.push(if forward { [left, right, corner] } else { [right, left, corner] });
        self.add(corner, right, forward);
    }

    /// Returns the edges that start in a vertex, from below, without those that occur in both
    /// directions.
    fn start(&mut self, corner: u32) -> Result<Vec<u32>, Crossing> {
        let mut edges = Vec::new();
        let mut next = self.starting[corner as usize];
        while next != NONE {
            edges.push(next);
            next = self.edge(next).sibling;
        }
        let right = |edge: u32| self.edge(edge).right;
        sort::by(&mut edges, &mut |&a, &b| {
            let (a, b) = (right(a), right(b));
            0.cmp(&self.turn(corner, a, b)).then_with(|| self.at(a).cmp(&self.at(b)))
        });
        let mut starting = Vec::with_capacity(edges.len());
        let mut rest = edges.as_slice();
        while let Some(&first) = rest.first() {
            let nearest = self.edge(first).right;
            let together =
                rest.iter().take_while(|&&edge| self.side(first, self.edge(edge).right) == 0).count();
            let (same, others) = rest.split_at(together);
            rest = others;
            // Overlapping edges: the longer ones are split where the shortest ends.
            let mut times = 0;
            for &edge in same {
                times += if self.edge(edge).forward { 1 } else { -1 };
                if self.edge(edge).right == nearest {
                    self.ending[nearest as usize] -= 1;
                } else {
                    self.divide(edge, nearest);
                }
            }
            let direction = match times {
                0 => continue,
                1 => true,
                -1 => false,
                _ => return Err(Crossing),
            };
            let edge = &mut self.edges[first as usize];
            (edge.right, edge.forward) = (nearest, direction);
            self.ending[nearest as usize] += 1;
            starting.push(first);
        }
        Ok(starting)
    }

    /// Connects a vertex to the chain vertices that are visible from it, and returns the chains of
    /// the intervals below and above it.
    fn join(&mut self, corner: u32, below: Option<u32>, ended: &[u32]) -> (Chain, Chain) {
        let chain_above = |edge: Option<u32>| {
            edge.map(|edge| self.edge(edge)).filter(|edge| edge.forward).map(|edge| edge.chain)
        };
        let interval_below = chain_above(below);
        if ended.is_empty() {
            let Some(chain) = interval_below else { return (Chain::NONE, Chain::NONE) };
            // The vertex is within an interval, and is connected to the rightmost vertex.
            let above = self.links[chain.last as usize].above;
            let second = self.links.len() as u32;
            let last = self.links[chain.last as usize];
            self.links.push(Link { below: NONE, ..last });
            if above != NONE {
                self.links[above as usize].below = second;
            }
            self.links[chain.last as usize].above = NONE;
            let back = if above == NONE { second } else { chain.back };
            let low = self.append(corner, Chain { back: chain.last, ..chain });
            return (low, self.prepend(corner, Chain { front: second, back, ..chain }));
        }
        let interval_above = chain_above(ended.last().copied());
        let between: Vec<Chain> =
            ended[..ended.len() - 1].iter().filter_map(|&edge| chain_above(Some(edge))).collect();
        for Chain { front, .. } in between {
            let mut lower = self.links[front as usize];
            while lower.above != NONE {
                let upper = self.links[lower.above as usize];
                self.triangles.push([corner, upper.corner, lower.corner]);
                lower = upper;
            }
        }
        let low = interval_below.map_or(Chain::NONE, |chain| self.append(corner, chain));
        let high = interval_above.map_or(Chain::NONE, |chain| self.prepend(corner, chain));
        (low, high)
    }

    /// Creates a chain of one vertex.
    fn chain(&mut self, corner: u32) -> Chain {
        let link = self.links.len() as u32;
        self.links.push(Link { corner, below: NONE, above: NONE });
        Chain { front: link, back: link, last: link }
    }

    /// Appends a vertex to the top of a chain, and cuts off the highest vertices that triangles
    /// with it cover.
    // Invariant: a chain is concave as seen from the right, and nothing is between it and the sweep
    // line. So the vertices that are visible from a new one are at one end of the chain, up to the
    // first one that is not. The tests are one more than the removed vertices, so the work is
    // linear. Triangles beyond a hidden vertex would overlap others.
    fn append(&mut self, corner: u32, chain: Chain) -> Chain {
        let mut back = chain.back;
        loop {
            let upper = self.links[back as usize];
            if upper.below == NONE
                || !self.cut_off(corner, upper.corner, self.links[upper.below as usize].corner)
            {
                break;
            }
            back = upper.below;
        }
        let new = self.chain(corner).last;
        self.links[back as usize].above = new;
        self.links[new as usize].below = back;
        Chain { front: chain.front, back: new, last: new }
    }

    /// Prepends a vertex to the bottom of a chain, and cuts off the lowest vertices that triangles
    /// with it cover.
    fn prepend(&mut self, corner: u32, chain: Chain) -> Chain {
        let mut front = chain.front;
        loop {
            let lower = self.links[front as usize];
            if lower.above == NONE
                || !self.cut_off(corner, self.links[lower.above as usize].corner, lower.corner)
            {
                break;
            }
            front = lower.above;
        }
        let new = self.chain(corner).last;
        self.links[front as usize].below = new;
        self.links[new as usize].above = front;
        Chain { front: new, back: chain.back, last: new }
    }

    /// Adds a triangle if it is counterclockwise, and returns whether it is.
    fn cut_off(&mut self, corner: u32, upper: u32, lower: u32) -> bool {
        let is_seen = self.turn(corner, upper, lower) > 0;
        if is_seen {
            self.triangles.push([corner, upper, lower]);
        }
        is_seen
    }
}
