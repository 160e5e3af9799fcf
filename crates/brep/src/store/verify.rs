//! Checks of a whole file.

use super::reader::{ExactModel, ModelNode, ModelNodeState};
use super::summary::NodeCounts;
use spinney_base::{Error, Progress, Result};
use spinney_container::Finding;

/// Findings beyond these are not listed.
const MOST: usize = 100;

impl ExactModel {
    /// Checks every checksum, every face and every node.
    ///
    /// # Errors
    /// If the file cannot be read, or on interruption. What is damaged is no error but a finding.
    pub fn verify(&self, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        let sections = [
            ("directory", self.trailer.directory),
            ("list of faces", self.trailer.section(super::summary::FACES)),
        ];
        for (name, section) in sections {
            match section.read(&self.path, &*self.backend, name) {
                Err(error @ Error::Io { .. }) => return Err(error),
                Err(error) => findings.push(finding(name, error)),
                Ok(_) => {}
            }
        }
        for (name, count) in [("block of faces", self.blocks.len()), ("segment", self.segments.len())] {
            for index in 0..count {
                progress.check()?;
                let read = match name {
                    "segment" => self.segment(index).map(drop),
                    _ => self.block(index).map(drop),
                };
                match read {
                    Err(error @ Error::Io { .. }) => return Err(error),
                    Err(error) if findings.len() < MOST => {
                        findings.push(finding(&format!("{name} {index}"), error));
                    }
                    _ => {}
                }
            }
        }
        match self.exact_part() {
            Err(error @ Error::Io { .. }) => return Err(error),
            Err(error) => findings.push(finding("exact faces", error)),
            Ok(_) => {}
        }
        if !findings.is_empty() {
            return Ok(findings);
        }
        let mut counts = NodeCounts::default();
        let mut cut = 0;
        match self.root().and_then(|root| self.count(&root, &mut counts, &mut cut, progress)) {
            Err(error @ Error::Corrupt { .. }) => findings.push(finding("tree", error)),
            counted => counted?,
        }
        if findings.is_empty() && counts != self.summary.nodes {
            let problem = format!("{:?} nodes, the tree has {counts:?}", self.summary.nodes);
            findings.push(Finding { place: "model".into(), problem });
        }
        if findings.is_empty() && cut + 1 != self.segments.len() as u64 {
            let problem = format!("{} segments, {} of them are needed", self.segments.len(), cut + 1);
            findings.push(Finding { place: "directory".into(), problem });
        }
        if findings.is_empty() && self.trailer.stored_records != counts.total() {
            let problem = format!("{} nodes, the tree has {}", self.trailer.stored_records, counts.total());
            findings.push(Finding { place: "trailer".into(), problem });
        }
        Ok(findings)
    }

    fn count<'a>(
        &'a self,
        node: &ModelNode<'a>,
        counts: &mut NodeCounts,
        cut: &mut u64,
        progress: &dyn Progress,
    ) -> Result<()> {
        match node.state() {
            ModelNodeState::Void => counts.void += 1,
            ModelNodeState::Full => counts.full += 1,
            ModelNodeState::Leaf { kind, .. } => counts.count(kind),
            ModelNodeState::Inner => {
                counts.inner += 1;
                if counts.inner.is_multiple_of(1 << 12) {
                    progress.check()?;
                }
                for child in 0..8 {
                    let child = self.child(node, child)?;
                    *cut += u64::from(child.begins_segment());
                    self.count(&child, counts, cut, progress)?;
                }
            }
        }
        Ok(())
    }
}

fn finding(place: &str, error: Error) -> Finding {
    Finding { place: place.into(), problem: error.to_string() }
}
