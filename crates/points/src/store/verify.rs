//! Verification of point tree files.

use super::reader::PointTree;
use crate::statistics::Statistics;
use spinney_base::space::Code;
use spinney_base::{Error, Progress, Result, parallel};
use spinney_container::{Finding, MAX_FINDINGS};

impl PointTree {
    /// Checks all checksums and rules: blocks can be decoded, points lie in their nodes, and node
    /// statistics match the points. Reports at most [`MAX_FINDINGS`] findings.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn verify(&self, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        let mut report = |location: String, problem: String| {
            if findings.len() < MAX_FINDINGS {
                findings.push(Finding { place: location, problem });
            }
        };
        let (nodes, blocks) = self.counts();
        // Statistics of each node's blocks, in node order.
        let mut own: Vec<Statistics> = vec![Statistics::none(self.columns()); nodes];
        let (mut node, mut next) = (0, 0);
        while next < blocks {
            progress.check()?;
            let batch: Vec<usize> = (next..(next + 4 * parallel::threads()).min(blocks)).collect();
            next += batch.len();
            let checked = parallel::map(&batch, |block| self.check_block(*block));
            for (block, checked) in batch.iter().zip(checked) {
                let code = self.entry(*block).block.key;
                while node + 1 < nodes && self.node(node)?.code.bits() < code {
                    node += 1;
                }
                match checked {
                    Ok((statistics, problems)) => {
                        own[node].add(&statistics);
                        problems.into_iter().for_each(|problem| report(format!("block {block}"), problem));
                    }
                    Err(Error::Corrupt { location, found, expected, .. }) => {
                        report(location, format!("found {found}, expected {expected}"));
                    }
                    Err(error) => return Err(error),
                }
            }
            progress.advance(batch.len() as u64, blocks as u64);
        }
        // In reverse order, nodes below come before those above.
        let mut below: Vec<(Code, Statistics)> = Vec::new();
        let mut points = 0;
        for index in (0..nodes).rev() {
            let found = self.node(index)?;
            let mut all = std::mem::replace(&mut own[index], Statistics::none(0));
            points += all.points;
            let mut sum = Statistics::none(self.columns());
            while below.last().is_some_and(|(code, _)| found.code.contains(*code)) {
                sum.add(&below.pop().expect("there is one").1);
            }
            all.add(&sum);
            if all != found.statistics {
                report(
                    format!("node {}", found.code),
                    "counts, extremes or sums differ from those of its points".into(),
                );
            }
            below.push((found.code, all));
        }
        if below.len() > 1 {
            report(
                "list of nodes".into(),
                format!("found {} nodes without a parent, expected one root", below.len()),
            );
        }
        if points != self.len() {
            report("points".into(), format!("found {points} points, expected {}", self.len()));
        }
        Ok(findings)
    }

    /// Returns the statistics of a block's points, and its problems.
    fn check_block(&self, block: usize) -> Result<(Statistics, Vec<String>)> {
        let entry = self.entry(block);
        let columns = self.block(block, &vec![true; self.columns()])?;
        let statistics = Statistics::of(&columns, self.attributes());
        let mut problems = Vec::new();
        if statistics.bounds() != entry.bounds {
            problems.push(format!("found bounds {:?}, expected {:?}", entry.bounds, statistics.bounds()));
        }
        let code = Code::from_bits(self.dimension(), entry.block.key);
        let lies_in = |point: usize| {
            let position: [i32; 3] = std::array::from_fn(|axis| columns[axis][point] as i32);
            let is_on_grid = (0..3).all(|axis| columns[axis][point] == i64::from(position[axis]));
            let found = self.grid().code(position).filter(|_| is_on_grid);
            found.zip(code).is_some_and(|(found, code)| code.contains(found))
        };
        if let Some(point) = (0..columns[0].len()).find(|point| !lies_in(*point)) {
            problems.push(format!("point {point} is outside its node"));
        }
        Ok((statistics, problems))
    }
}
