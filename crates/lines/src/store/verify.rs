//! Verification of a file against the rules of its format.

use super::reader::LineTree;
use crate::build::{segments_of, statistics_of};
use crate::codec::LineSegment;
use crate::statistics::Statistics;
use spinney_base::io::Sorter;
use spinney_base::space::Code;
use spinney_base::{Error, Progress, Result, parallel};
use spinney_container::{Finding, MAX_FINDINGS};

/// Returns the bytes of a segment in the sorter: feature, vertex, ends, level.
fn row_of(segment: &LineSegment) -> Vec<u8> {
    let mut row = segment.feature.to_be_bytes().to_vec();
    row.extend_from_slice(&segment.vertex.to_be_bytes());
    segment.ends.iter().flatten().for_each(|number| row.extend_from_slice(&number.to_le_bytes()));
    row.push(segment.first);
    row
}

/// Findings, up to a limit.
#[derive(Default)]
struct Findings(Vec<Finding>);

impl Findings {
    fn report(&mut self, location: String, problem: impl Into<String>) {
        if self.0.len() < MAX_FINDINGS {
            self.0.push(Finding { place: location, problem: problem.into() });
        }
    }

    /// Converts a corruption error to a finding; returns other errors.
    fn report_corruption<T>(&mut self, found: Result<T>) -> Result<Option<T>> {
        match found {
            Ok(found) => Ok(Some(found)),
            Err(Error::Corrupt { location, found, expected, .. }) => {
                self.report(location, format!("found {found}, expected {expected}"));
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }
}

impl LineTree {
    /// Checks all checksums and rules: blocks can be decoded, each segment of each feature is
    /// stored exactly once, in its node or an ancestor, and the statistics of nodes are correct.
    /// Reports at most [`MAX_FINDINGS`]; uses about `memory` bytes, and temporary files.
    ///
    /// # Errors
    /// If the file cannot be read, or no temporary file can be written.
    pub fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = Findings::default();
        let (nodes, blocks, feature_blocks) = self.counts();
        let total = (blocks + feature_blocks) as u64;
        let mut own = vec![Statistics::NONE; nodes];
        let mut rows = Sorter::new(&std::env::temp_dir(), memory);
        let (mut node, mut next) = (0, 0);
        while next < blocks {
            progress.check()?;
            let batch: Vec<usize> = (next..(next + 4 * parallel::threads()).min(blocks)).collect();
            next += batch.len();
            let read = parallel::map(&batch, |block| self.block(*block));
            for (block, segments) in batch.iter().zip(read) {
                let entry = self.block_entry(*block);
                while node + 1 < nodes && self.node(node)?.code.bits() < entry.block.key {
                    node += 1;
                }
                let Some(segments) = findings.report_corruption(segments)? else { continue };
                let statistics = statistics_of(self.grid(), &segments);
                let location = || format!("block {block}");
                if statistics.bounds != entry.bounds {
                    let problem =
                        format!("found bounds {:?}, expected {:?}", entry.bounds, statistics.bounds);
                    findings.report(location(), problem);
                }
                let code = Code::from_bits(self.grid().dimension, entry.block.key);
                let is_here = |segment: &LineSegment| {
                    self.grid().code(segment.ends).zip(code).is_some_and(|(own, code)| code.contains(own))
                };
                if let Some(segment) = segments.iter().position(|segment| !is_here(segment)) {
                    findings.report(location(), format!("segment {segment} belongs to another node"));
                }
                own[node].add(&statistics);
                for segment in &segments {
                    rows.push(segment.feature, &row_of(segment))?;
                }
            }
            progress.advance(batch.len() as u64, total);
        }
        self.check_nodes(own, &mut findings)?;
        self.check_features(rows, &mut findings, (progress, total))?;
        Ok(findings.0)
    }

    /// Compares the statistics of nodes with their blocks.
    fn check_nodes(&self, mut own: Vec<Statistics>, findings: &mut Findings) -> Result<()> {
        let mut below: Vec<(Code, Statistics)> = Vec::new();
        let mut segments = 0;
        // In reverse order, descendants come before their ancestors.
        for index in (0..own.len()).rev() {
            let found = self.node(index)?;
            let mut all = std::mem::replace(&mut own[index], Statistics::NONE);
            segments += all.segments;
            let mut sum = Statistics::NONE;
            while let Some((_, child)) = below.pop_if(|(code, _)| found.code.contains(*code)) {
                sum.add(&child);
            }
            all.add(&sum);
            let stored = (found.segments, found.features, found.length.to_bits(), found.bounds);
            let features = all.features(found.code.level());
            if stored != (all.segments, features, all.length.to_bits(), all.bounds) {
                let problem = "counts, length or bounds differ from those of its lines";
                findings.report(format!("node {}", found.code), problem);
            }
            below.push((found.code, all));
        }
        if below.len() > 1 {
            let problem = format!("found {} nodes without a parent, expected one root", below.len());
            findings.report("list of nodes".into(), problem);
        }
        if segments != self.segments() {
            let problem = format!("found {segments} segments, expected {}", self.segments());
            findings.report("lines".into(), problem);
        }
        Ok(())
    }

    /// Compares the segments in blocks with those of the features.
    fn check_features(
        &self,
        rows: Sorter,
        findings: &mut Findings,
        (progress, total): (&dyn Progress, u64),
    ) -> Result<()> {
        let blocks = self.counts().2;
        let mut block = 0;
        // Next segments that the features require, in reverse order.
        let mut wanted: Vec<Vec<u8>> = Vec::new();
        let mut is_wrong = false;
        let mut next = |findings: &mut Findings| -> Result<Option<Vec<u8>>> {
            while wanted.is_empty() && block < blocks {
                progress.check()?;
                let first = self.feature_entry(block).block.key;
                if let Some(features) = findings.report_corruption(self.feature_block(block))? {
                    for (number, feature) in (first..).zip(&features) {
                        let mut values = self.attributes().iter().zip(&feature.values);
                        if let Some((wrong, _)) = values.find(|(own, value)| !own.kind.has(value)) {
                            let problem =
                                format!("the value of `{}` does not have the attribute's type", wrong.name);
                            findings.report(format!("feature {number}"), problem);
                        }
                        let Some(segments) = segments_of(self.grid(), number, feature) else {
                            findings.report(format!("feature {number}"), "extends beyond the grid");
                            continue;
                        };
                        wanted.extend(segments.iter().map(|(_, segment)| row_of(segment)));
                    }
                    wanted.sort_unstable_by(|a, b| b.cmp(a));
                }
                block += 1;
                progress.advance(1, total);
            }
            Ok(wanted.pop())
        };
        // The sorter orders rows by feature only; rows of one feature are sorted here.
        let mut held: Vec<Vec<u8>> = Vec::new();
        let mut compare = |held: &mut Vec<Vec<u8>>, findings: &mut Findings| -> Result<()> {
            held.sort_unstable();
            for row in held.drain(..) {
                if next(findings)?.as_ref() != Some(&row) && !is_wrong {
                    is_wrong = true;
                    let feature = u64::from_be_bytes(std::array::from_fn(|byte| row[byte]));
                    findings.report(
                        format!("feature {feature}"),
                        "its segments in blocks differ from those of its lines",
                    );
                }
            }
            Ok(())
        };
        rows.finish(&mut |row| {
            if held.last().is_some_and(|last| last[..8] != row[..8]) {
                compare(&mut held, findings)?;
            }
            held.push(row.to_vec());
            Ok(())
        })?;
        compare(&mut held, findings)?;
        let mut missing = 0u64;
        while next(findings)?.is_some() {
            missing += 1;
        }
        if missing > 0 && !is_wrong {
            findings.report("features".into(), format!("{missing} segments of lines are in no block"));
        }
        Ok(())
    }
}
