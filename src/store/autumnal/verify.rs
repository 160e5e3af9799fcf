//! Verifies a file: every checksum, and every rule of a commit's tree.
//!
//! As for Goblin files the rules need no second statement: the tree is built anew from its leaves, and every
//! record that this would write must be there.

use super::builder::{Mode, RecordBuilder, shape};
use super::commit::Commit;
use super::extents::{FIRST_EXTENT, PAGE, SECTOR};
use super::reader::Autumnal;
use crate::store::builder::{BuildOptions, walk};
use crate::store::container::{Finding, MAX_FINDINGS};
use crate::tree::Source;
use crate::{Error, Progress, Result};

impl Autumnal {
    /// Checks every checksum of the file, all its commits, and every rule of the tree: pointers that lead to
    /// records, representatives and zones that agree with the leaves, no uniform INNER node. Takes about as
    /// long as building; memory is bounded by `memory`.
    ///
    /// # Errors
    /// If the file cannot be read, or on interruption. What is wrong with the file is no error but a finding;
    /// at most 100 are collected.
    pub fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        self.verify_extents(&mut findings, progress)?;
        if findings.is_empty() {
            self.verify_commits(&mut findings)?;
        }
        if findings.is_empty() {
            self.verify_tree(&mut findings, memory, progress)?;
        }
        findings.truncate(MAX_FINDINGS);
        Ok(findings)
    }

    /// Extents lie one behind the other; what was given up may stand between two commits.
    fn verify_extents(&self, findings: &mut Vec<Finding>, progress: &dyn Progress) -> Result<()> {
        let extents = self.extents();
        let mut next = FIRST_EXTENT;
        while next < extents.end && findings.len() < MAX_FINDINGS {
            progress.check()?;
            // Behind the last extent of a commit the next one is a page's start.
            let (start, extent) = match extents.extent_at(next)? {
                Some(extent) => (next, Some(extent)),
                None => (next.next_multiple_of(PAGE), extents.extent_at(next.next_multiple_of(PAGE))?),
            };
            let Some(extent) = extent else {
                if start < extents.end {
                    let problem = "no extent starts here".into();
                    findings.push(Finding { place: format!("byte {start}"), problem });
                }
                return Ok(());
            };
            add(findings, format!("extent at {start}"), extents.check_payload(&extent))?;
            next = extent.end().next_multiple_of(SECTOR);
        }
        Ok(())
    }

    /// All commits, the newest first: numbers and sequences count, metadata and roots can be read.
    fn verify_commits(&self, findings: &mut Vec<Finding>) -> Result<()> {
        let mut next = self.archive.meta.commit;
        let mut after: Option<Commit> = None;
        while next != 0 {
            let commit = match Commit::read(self.extents(), next) {
                Ok(commit) => commit,
                error => return add(findings, format!("commit at {next}"), error.map(|_| ())),
            };
            let fits = after.is_none_or(|after| {
                commit.number < after.number && commit.sequence.checked_add(1) == Some(after.sequence)
            });
            if !fits || (commit.previous == 0) != (commit.sequence == 1) {
                let problem =
                    format!("number {}, sequence {}, which do not count", commit.number, commit.sequence);
                findings.push(Finding { place: format!("commit at {next}"), problem });
                return Ok(());
            }
            let metadata = Autumnal::new(self.archive.clone(), commit.clone()).map(|_| ());
            add(findings, format!("commit {}", commit.number), metadata)?;
            next = commit.previous;
            after = Some(commit);
        }
        Ok(())
    }

    fn verify_tree(&self, findings: &mut Vec<Finding>, memory: u64, progress: &dyn Progress) -> Result<()> {
        let options = BuildOptions::like(self.header(), memory);
        let form = self.form();
        let mut made = Vec::new();
        let mode = Mode::Check(&mut made);
        let mut builder = RecordBuilder::new(form, &options, [u64::MAX; 3], mode, Some(self), None);
        let walked =
            walk(self, &options, shape(form.dimension, options.depth), false, &mut builder, progress);
        let is_good = walked.is_ok();
        add(findings, "tree".into(), walked)?;
        if is_good {
            let (root, zone) = builder.finish();
            let commit = &self.commit;
            if (&root, zone.records, zone.tally.cells) != (&commit.root, commit.records, commit.cells) {
                let problem = format!("a root or totals that differ from the tree's: {root:?}");
                findings.push(Finding { place: format!("commit {}", commit.number), problem });
            }
        }
        findings.append(&mut made);
        Ok(())
    }
}

/// Collects what is wrong with the file; other errors are errors.
fn add(findings: &mut Vec<Finding>, place: String, found: Result<()>) -> Result<()> {
    match found {
        Err(error @ (Error::Corrupt { .. } | Error::Invalid { .. } | Error::Unsupported { .. })) => {
            findings.push(Finding { place, problem: error.to_string() });
            Ok(())
        }
        other => other,
    }
}
