//! Which runs of cells hang together: labels, joined as rows are gone through (Rosenfeld and Pfaltz 1966, with disjoint sets).

use super::points::NONE;

/// A label: a node of two forests of disjoint sets. Of a root, what is known of its set.
struct Label {
    /// Towards the label of all cells that hang together.
    parent: u32,
    /// Towards the label of all cells that hang together by edges.
    part: u32,
    /// Another one of the same set, so that all of them are a ring.
    next: u32,
    /// The cells of the set.
    cells: u64,
    /// First and last half of a border of the set.
    halves: [u32; 2],
    /// The line that the set was seen in last.
    line: u64,
}

/// All labels.
#[derive(Default)]
pub(super) struct Labels {
    labels: Vec<Label>,
    free: Vec<u32>,
}

impl Labels {
    /// A new label.
    pub(super) fn add(&mut self) -> u32 {
        let number = self.free.pop().unwrap_or(self.labels.len() as u32);
        let label =
            Label { parent: number, part: number, next: number, cells: 0, halves: [NONE; 2], line: 0 };
        match self.labels.get_mut(number as usize) {
            Some(slot) => *slot = label,
            None => self.labels.push(label),
        }
        number
    }

    /// The root of a label's set.
    pub(super) fn find(&mut self, mut label: u32) -> u32 {
        while self.labels[label as usize].parent != label {
            let above = self.labels[label as usize].parent;
            self.labels[label as usize].parent = self.labels[above as usize].parent;
            label = above;
        }
        label
    }

    /// The root of the cells that hang together by edges.
    pub(super) fn find_part(&mut self, mut label: u32) -> u32 {
        while self.labels[label as usize].part != label {
            let above = self.labels[label as usize].part;
            self.labels[label as usize].part = self.labels[above as usize].part;
            label = above;
        }
        label
    }

    /// Joins two sets, whose cells touch at an edge or else at a corner; `link` lets the second half of a border come behind the first.
    pub(super) fn join(&mut self, a: u32, b: u32, is_edge: bool, link: impl FnOnce(u32, u32)) {
        if is_edge {
            let (a, b) = (self.find_part(a), self.find_part(b));
            self.labels[a.max(b) as usize].part = a.min(b);
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

    /// Counts cells of a set.
    pub(super) fn count(&mut self, label: u32, cells: u64) {
        let root = self.find(label);
        self.labels[root as usize].cells += cells;
    }

    /// Adds half of a border to a set; `link` lets it come behind another.
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

    /// Notes that a set is in a line; whether it was not noted before.
    pub(super) fn note(&mut self, label: u32, line: u64) -> bool {
        let root = self.find(label);
        std::mem::replace(&mut self.labels[root as usize].line, line) != line
    }

    /// The cells of a root's set, and the first half of its borders.
    pub(super) fn set(&self, root: u32) -> (u64, u32) {
        let set = &self.labels[root as usize];
        (set.cells, set.halves[0])
    }

    /// Forgets all labels of a root's set.
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
