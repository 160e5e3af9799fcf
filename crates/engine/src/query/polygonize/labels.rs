//! Connected components of runs: labels that are merged row by row (Rosenfeld and Pfaltz 1966, with
//! disjoint sets).

use super::points::NONE;

/// A label: a node of two disjoint-set forests. A root also has the data of its set.
struct Label {
    /// Parent in the forest of connected cells: the regions.
    parent: u32,
    /// Parent in the forest of cells that are connected by edges: the polygons of a region. It is
    /// the same forest unless cells that share a corner are connected.
    edge_parent: u32,
    /// Another label of the same set; all labels of a set form a cycle.
    next: u32,
    /// Number of cells of the set.
    cells: u64,
    /// First and last half-edge in the list of the set's borders.
    halves: [u32; 2],
    /// Last line in which the set was marked; 0 if it was not.
    line: u64,
}

/// All labels.
#[derive(Default)]
pub(super) struct Labels {
    labels: Vec<Label>,
    free: Vec<u32>,
}

impl Labels {
    /// Adds a label.
    pub(super) fn add(&mut self) -> u32 {
        let number = self.free.pop().unwrap_or(self.labels.len() as u32);
        let label =
            Label { parent: number, edge_parent: number, next: number, cells: 0, halves: [NONE; 2], line: 0 };
        match self.labels.get_mut(number as usize) {
            Some(slot) => *slot = label,
            None => self.labels.push(label),
        }
        number
    }

    /// Returns the root of a label's set.
    pub(super) fn find(&mut self, mut label: u32) -> u32 {
        while self.labels[label as usize].parent != label {
            let above = self.labels[label as usize].parent;
            self.labels[label as usize].parent = self.labels[above as usize].parent;
            label = above;
        }
        label
    }

    /// Returns the root of the cells that are connected to a label's cells by edges.
    pub(super) fn find_edge_root(&mut self, mut label: u32) -> u32 {
        while self.labels[label as usize].edge_parent != label {
            let above = self.labels[label as usize].edge_parent;
            self.labels[label as usize].edge_parent = self.labels[above as usize].edge_parent;
            label = above;
        }
        label
    }

    /// Merges two sets whose cells touch at an edge (`is_edge`) or at a corner. `link` appends the
    /// second half-edge to the list of the first.
    pub(super) fn join(&mut self, a: u32, b: u32, is_edge: bool, link: impl FnOnce(u32, u32)) {
        if is_edge {
            let (a, b) = (self.find_edge_root(a), self.find_edge_root(b));
            self.labels[a.max(b) as usize].edge_parent = a.min(b);
        }
        let (a, b) = (self.find(a), self.find(b));
        if a == b {
            return;
        }
        let (root, below) = (a.min(b), a.max(b));
        let Label { next, cells, halves, .. } = self.labels[below as usize];
        self.labels[below as usize].parent = root;
        self.labels[below as usize].next = self.labels[root as usize].next;
        let set = &mut self.labels[root as usize];
        set.next = next;
        set.cells += cells;
        match (set.halves, halves) {
            (_, [NONE, _]) => {}
            ([NONE, _], _) => set.halves = halves,
            ([_, last], [first, end]) => {
                link(last, first);
                set.halves[1] = end;
            }
        }
    }

    /// Adds cells to a set.
    pub(super) fn count(&mut self, label: u32, cells: u64) {
        let root = self.find(label);
        self.labels[root as usize].cells += cells;
    }

    /// Adds a half-edge to a set's list. `link` appends it to another half-edge.
    pub(super) fn push_half(&mut self, label: u32, half: u32, link: impl FnOnce(u32, u32)) {
        let root = self.find(label);
        let set = &mut self.labels[root as usize];
        if set.halves[0] == NONE {
            set.halves[0] = half;
        } else {
            link(set.halves[1], half);
        }
        set.halves[1] = half;
    }

    /// Marks that a set occurs in a line. Returns whether that was not marked before.
    pub(super) fn mark_line(&mut self, label: u32, line: u64) -> bool {
        let root = self.find(label);
        std::mem::replace(&mut self.labels[root as usize].line, line) != line
    }

    /// Returns the cell count of a root's set, and the first half-edge of its list.
    pub(super) fn set(&self, root: u32) -> (u64, u32) {
        let set = &self.labels[root as usize];
        (set.cells, set.halves[0])
    }

    /// Removes all labels of a root's set.
    pub(super) fn remove(&mut self, root: u32) {
        let mut label = root;
        loop {
            self.free.push(label);
            label = self.labels[label as usize].next;
            if label == root {
                return;
            }
        }
    }
}
