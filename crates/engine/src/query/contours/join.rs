//! Joins the line fragments of neighbouring tiles to complete lines.

use std::collections::{BTreeMap, HashMap};

use super::fragments::{FragmentId, FragmentStore};
use super::tile::{EdgeKey, LineFragment};
use spinney_base::Result;

/// A line, complete or in progress.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContourLine {
    /// Number of the level or the band.
    pub(super) class: i32,
    /// First and last fragment.
    pub(super) first: FragmentId,
    last: FragmentId,
    /// Number of its points when it is returned.
    pub(super) count: u64,
    pub(super) is_ring: bool,
    /// Points where it may continue.
    ends: [Option<EdgeKey>; 2],
}

impl ContourLine {
    /// Creates a ring from its first fragment.
    pub(super) fn ring(class: i32, first: FragmentId, count: u64) -> ContourLine {
        ContourLine { class, first, last: first, count, is_ring: true, ends: [None; 2] }
    }
}

/// Lines in progress.
#[derive(Default)]
pub(super) struct Joiner {
    lines: HashMap<u64, ContourLine>,
    /// Lines that may continue, by their start (0) and end (1) points.
    waiting: [BTreeMap<EdgeKey, u64>; 2],
    /// Number of lines so far.
    number: u64,
}

impl Joiner {
    /// Adds a fragment, joins it to the lines that it meets, and returns the line if it is
    /// complete.
    ///
    /// # Errors
    /// If the fragments cannot be stored.
    pub(super) fn push(
        &mut self,
        fragment: LineFragment,
        fragments: &mut FragmentStore,
    ) -> Result<Option<ContourLine>> {
        let LineFragment { class, points, ends, is_ring } = fragment;
        let count = points.len() as u64;
        let number = fragments.add(points)?;
        let mut line = ContourLine { class, first: number, last: number, count, is_ring, ends };
        // The line before ends where this fragment starts.
        if let Some(before) = line.ends[0].and_then(|start| self.take(1, start)) {
            line = joined(before, line, fragments);
        }
        let [start, end] = line.ends;
        if end.is_some() && start == end {
            line.is_ring = true;
            line.ends = [None; 2];
        } else if let Some(after) = end.and_then(|end| self.take(0, end)) {
            line = joined(line, after, fragments);
            let [start, end] = line.ends;
            if end.is_some() && start == end {
                line.is_ring = true;
                line.ends = [None; 2];
            }
        }
        if line.ends == [None; 2] {
            return Ok(Some(line));
        }
        self.number += 1;
        for (waiting, end) in self.waiting.iter_mut().zip(line.ends) {
            if let Some(end) = end {
                waiting.insert(end, self.number);
            }
        }
        self.lines.insert(self.number, line);
        Ok(None)
    }

    /// Removes and returns the line that starts (0) or ends (1) at a point.
    fn take(&mut self, side: usize, at: EdgeKey) -> Option<ContourLine> {
        let number = self.waiting[side].get(&at)?;
        let line = self.lines.remove(number)?;
        for (waiting, end) in self.waiting.iter_mut().zip(line.ends) {
            if let Some(end) = end {
                waiting.remove(&end);
            }
        }
        Some(line)
    }

    /// Closes ends that could only have continued above a row, and returns the lines that are
    /// complete.
    pub(super) fn settle(&mut self, row: i64) -> Vec<ContourLine> {
        let mut whole = Vec::new();
        for side in 0..2 {
            while let Some(entry) = self.waiting[side].first_entry().filter(|entry| entry.key().row < row) {
                let number = entry.remove();
                if let Some(line) = self.lines.get_mut(&number) {
                    line.ends[side] = None;
                    if line.ends == [None; 2] {
                        whole.extend(self.lines.remove(&number));
                    }
                }
            }
        }
        whole
    }
}

/// Joins a line and its successor.
fn joined(before: ContourLine, after: ContourLine, fragments: &mut FragmentStore) -> ContourLine {
    fragments.link(before.last, after.first);
    let ends = [before.ends[0], after.ends[1]];
    ContourLine { last: after.last, count: before.count + after.count - 1, ends, ..before }
}
