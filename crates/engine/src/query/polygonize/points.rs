//! Border points as linked lists, in memory up to a limit and then in a temporary file.

use std::fs::File;
use std::path::PathBuf;

use zerocopy::IntoBytes;

use spinney_base::io::platform::{read_exact_at, write_all_at};
use spinney_base::{Error, Result};

/// A cell corner: column and row of the cell to the right of and below it.
pub(super) type Point = [u32; 2];

/// Null index.
pub(super) const NONE: u32 = u32::MAX;

/// A point, or a run of points in the file. A run has the column [`NONE`] and its number as the
/// row.
#[derive(Clone, Copy)]
struct Node {
    at: Point,
    next: u32,
}

/// Points of all borders.
pub(super) struct Points {
    nodes: Vec<Node>,
    free: Vec<u32>,
    /// Maximum number of nodes before points are moved to the file.
    max_nodes: usize,
    /// Runs of points in the file: offset and point count.
    runs: Vec<(u64, u32)>,
    free_runs: Vec<u32>,
    file: Option<File>,
    /// End of the used bytes of the file.
    end: u64,
    directory: PathBuf,
}

/// First and last node of a border.
#[derive(Clone, Copy)]
pub(super) struct Chain {
    first: u32,
    last: u32,
}

/// Points per read from the file.
const READ_POINTS: u32 = 1 << 12;

/// Minimum number of points of a run in the file, so that reading it is worth a system call.
const MIN_RUN_POINTS: usize = 8;

impl Points {
    /// Creates an empty set of points that may use `memory` bytes. The temporary file is created in
    /// `directory`.
    pub(super) fn new(memory: u64, directory: PathBuf) -> Points {
        let max_nodes = usize::try_from(memory / size_of::<Node>() as u64).unwrap_or(usize::MAX).max(64);
        let (nodes, free, runs, free_runs) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Points { nodes, free, max_nodes, runs, free_runs, file: None, end: 0, directory }
    }

    fn node(&mut self, at: Point, next: u32) -> u32 {
        let node = Node { at, next };
        match self.free.pop() {
            Some(number) => {
                self.nodes[number as usize] = node;
                number
            }
            None => {
                self.nodes.push(node);
                (self.nodes.len() - 1) as u32
            }
        }
    }

    /// Creates a chain of one point.
    pub(super) fn begin(&mut self, at: Point) -> Chain {
        let first = self.node(at, NONE);
        Chain { first, last: first }
    }

    /// Adds a point before the first (0) or after the last (1) point of a chain.
    pub(super) fn push(&mut self, chain: &mut Chain, side: usize, at: Point) {
        if side == 0 {
            chain.first = self.node(at, chain.first);
        } else {
            let number = self.node(at, NONE);
            self.nodes[chain.last as usize].next = number;
            chain.last = number;
        }
    }

    /// Concatenates two chains.
    pub(super) fn join(&mut self, before: Chain, after: Chain) -> Chain {
        self.nodes[before.last as usize].next = after.first;
        Chain { first: before.first, last: after.last }
    }

    /// Removes a chain.
    pub(super) fn remove(&mut self, chain: Chain) {
        let mut number = chain.first;
        while number != NONE {
            let Node { at, next } = self.nodes[number as usize];
            if at[0] == NONE {
                self.free_runs.push(at[1]);
            }
            self.free.push(number);
            number = next;
        }
        // Reuse the file's space once nothing is in it.
        if self.free_runs.len() == self.runs.len() {
            self.end = 0;
        }
    }

    /// Returns whether points should be moved to the file.
    pub(super) fn is_full(&self) -> bool {
        self.nodes.len() - self.free.len() > self.max_nodes
    }

    /// Moves the points of chains to the file: consecutive points become a run, and one node for it
    /// replaces theirs. Chains may grow afterwards, and be moved again.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn spool<'a>(&mut self, chains: impl Iterator<Item = &'a mut Chain>) -> Result<()> {
        let failed = || Error::io(&self.directory, "write a temporary file");
        if self.file.is_none() {
            self.file = Some(tempfile::tempfile_in(&self.directory).map_err(failed())?);
        }
        // Invariant: the buffer has the bytes of the file from `written` to `self.end`.
        let (mut buffer, mut written) = (Vec::new(), self.end);
        for chain in chains {
            // Last node that stays in the chain, and the next node to process.
            let mut before = NONE;
            let mut number = chain.first;
            while number != NONE {
                // Collect the points up to the next run or the end, `tail` being the last of them.
                let (first, start, mut tail) = (number, buffer.len(), before);
                while number != NONE && self.nodes[number as usize].at[0] != NONE {
                    let node = self.nodes[number as usize];
                    buffer.push(node.at);
                    (tail, number) = (number, node.next);
                }
                let count = buffer.len() - start;
                if count < MIN_RUN_POINTS {
                    // Too few: they stay in memory.
                    buffer.truncate(start);
                    before = tail;
                } else {
                    let run = (self.end, count as u32);
                    self.end += (count * size_of::<Point>()) as u64;
                    let slot = match self.free_runs.pop() {
                        Some(slot) => {
                            self.runs[slot as usize] = run;
                            slot
                        }
                        None => {
                            self.runs.push(run);
                            (self.runs.len() - 1) as u32
                        }
                    };
                    // The first node becomes that of the run, so that the link to it stays valid.
                    // The others are freed.
                    let mut freed = self.nodes[first as usize].next;
                    while freed != number {
                        self.free.push(freed);
                        freed = self.nodes[freed as usize].next;
                    }
                    self.nodes[first as usize] = Node { at: [NONE, slot], next: number };
                    before = first;
                }
                // Pass over a run that is in the file already.
                if number != NONE {
                    (before, number) = (number, self.nodes[number as usize].next);
                }
            }
            // (A chain has at least one node, so one is before the end.)
            chain.last = before;
            if buffer.len() >= 1 << 15 {
                let file = self.file.as_ref().expect("there is one");
                write_all_at(file, buffer.as_bytes(), written).map_err(failed())?;
                written = self.end;
                buffer.clear();
            }
        }
        let file = self.file.as_ref().expect("there is one");
        write_all_at(file, buffer.as_bytes(), written).map_err(failed())?;
        // The remaining points stay in memory. Try again only when there are twice as many.
        let left = self.nodes.len() - self.free.len();
        self.max_nodes = self.max_nodes.max(left.saturating_mul(2));
        Ok(())
    }

    /// Passes the points of a chain to `each` in chunks, forwards or backwards.
    ///
    /// # Errors
    /// If the temporary file cannot be read, or `each` fails.
    pub(super) fn each(
        &self,
        chain: Chain,
        is_backward: bool,
        each: &mut dyn FnMut(&[Point]) -> Result<()>,
    ) -> Result<()> {
        let mut chunk: Vec<Point> = Vec::new();
        if !is_backward {
            let mut number = chain.first;
            while number != NONE {
                let node = self.nodes[number as usize];
                self.node_points(node, false, &mut chunk, each)?;
                number = node.next;
            }
            return each(&chunk);
        }
        let mut numbers = Vec::new();
        let mut number = chain.first;
        while number != NONE {
            numbers.push(number);
            number = self.nodes[number as usize].next;
        }
        for number in numbers.into_iter().rev() {
            self.node_points(self.nodes[number as usize], true, &mut chunk, each)?;
        }
        each(&chunk)
    }

    fn node_points(
        &self,
        node: Node,
        is_backward: bool,
        chunk: &mut Vec<Point>,
        each: &mut dyn FnMut(&[Point]) -> Result<()>,
    ) -> Result<()> {
        if chunk.len() >= READ_POINTS as usize {
            each(chunk)?;
            chunk.clear();
        }
        if node.at[0] != NONE {
            chunk.push(node.at);
            return Ok(());
        }
        each(chunk)?;
        chunk.clear();
        let (offset, count) = self.runs[node.at[1] as usize];
        let file = self.file.as_ref().expect("runs are in a file");
        let mut done = 0;
        while done < count {
            let length = READ_POINTS.min(count - done);
            let start = if is_backward { count - done - length } else { done };
            chunk.clear();
            chunk.resize(length as usize, [0; 2]);
            let at = offset + u64::from(start) * size_of::<Point>() as u64;
            let read = read_exact_at(file, chunk.as_mut_slice().as_mut_bytes(), at);
            read.map_err(Error::io(&self.directory, "read a temporary file"))?;
            if is_backward {
                chunk.reverse();
            }
            each(chunk)?;
            done += length;
        }
        chunk.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(points: &Points, chain: Chain, is_backward: bool) -> Vec<Point> {
        let mut all = Vec::new();
        points
            .each(chain, is_backward, &mut |chunk| {
                all.extend_from_slice(chunk);
                Ok(())
            })
            .unwrap();
        all
    }

    #[test]
    fn chains_are_the_same_in_a_file() {
        let mut points = Points::new(0, std::env::temp_dir());
        let mut chains: Vec<(Chain, std::collections::VecDeque<Point>)> = Vec::new();
        for step in 0..60_000u32 {
            let at = [step, step.wrapping_mul(2_654_435_761) >> 8];
            let which = (at[1] % 7) as usize;
            if chains.len() <= which || step % 50 == 0 {
                chains.push((points.begin(at), [at].into()));
                continue;
            }
            let (chain, model) = &mut chains[which];
            let side = (at[1] >> 5 & 1) as usize;
            points.push(chain, side, at);
            if side == 0 {
                model.push_front(at)
            } else {
                model.push_back(at)
            }
            if points.is_full() {
                points.spool(chains.iter_mut().map(|(chain, _)| chain)).unwrap();
            }
            if step % 5000 == 4999 && chains.len() > 8 {
                let (after, rest) = chains.pop().unwrap();
                let (chain, model) = &mut chains[0];
                *chain = points.join(*chain, after);
                model.extend(rest);
                points.remove(chains.swap_remove(1).0);
            }
        }
        assert!(points.end > 0, "something is in the file");
        for (chain, model) in chains {
            let mut model: Vec<Point> = model.into();
            assert_eq!(read(&points, chain, false), model);
            model.reverse();
            assert_eq!(read(&points, chain, true), model);
            points.remove(chain);
        }
        assert_eq!((points.end, points.nodes.len()), (0, points.free.len()));
    }
}
