//! Verifies a file: every checksum, and every rule of a commit's tree.
//!
//! As for Goblin files, the rules are not implemented twice: the tree is rebuilt from its leaves,
//! and every record that this would write must be present.

use std::collections::HashMap;

use super::builder::{Check, Mode, RecordBuilder};
use super::commit::Commit;
use super::meta::Slot;
use super::pages::{FIRST_EXTENT, PAGE};
use super::reader::Autumnal;
use super::verified::{Unverified, Verified};
use crate::store::builder::{BuildOptions, walk};
use spinney_base::space::CodeRange;
use spinney_base::{Error, Progress, Result};
use spinney_container::{Finding, MAX_FINDINGS};

impl Autumnal {
    /// Checks every checksum of the file, all its commits, and every rule of their trees: pointers
    /// lead to records, representatives and zones agree with the leaves, no INNER node is uniform.
    /// Subtrees that occur several times, in one tree or several, are checked once as far as
    /// `memory` (bytes) permits. Takes about as long as building.
    ///
    /// # Errors
    /// If the file cannot be read, or on cancellation. Defects of the file are findings, not
    /// errors; at most 100 are collected.
    pub fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        self.verify_trees(true, memory, progress)
    }

    /// Checks as [`Autumnal::verify`] does, but skips the trees of other commits.
    ///
    /// # Errors
    /// Those of [`Autumnal::verify`].
    pub fn verify_quickly(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        self.verify_trees(false, memory, progress)
    }

    fn verify_trees(&self, all: bool, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        self.verify_slots(&mut findings)?;
        let slots = findings.len();
        self.verify_extents(&mut findings, progress)?;
        if findings.len() == slots {
            self.verify_commits(&mut findings)?;
        }
        if findings.len() > slots {
            findings.truncate(MAX_FINDINGS);
            return Ok(findings);
        }
        let mut verified = VerifiedLayers { memory: memory / 2, layers: HashMap::new() };
        let memory = memory - verified.memory;
        self.verify_layers(&self.commit, &mut findings, &mut verified, memory, progress)?;
        let mut next = if all { self.archive.meta.commit } else { 0 };
        while next != 0 && findings.len() < MAX_FINDINGS {
            let commit = Commit::read(self.extents(), next)?;
            next = commit.previous;
            if commit.number != self.commit.number {
                self.verify_layers(&commit, &mut findings, &mut verified, memory, progress)?;
            }
        }
        findings.truncate(MAX_FINDINGS);
        Ok(findings)
    }

    /// Checks the trees of a commit, except for subtrees that were verified already.
    fn verify_layers(
        &self,
        commit: &Commit,
        findings: &mut Vec<Finding>,
        verified: &mut VerifiedLayers,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<()> {
        for (number, layer) in commit.layers.iter().enumerate() {
            if findings.len() >= MAX_FINDINGS {
                break;
            }
            let tree = Autumnal::new(self.archive.clone(), commit.clone(), number)?;
            // Layers may share records, but rule, kind and depth in a layer's header determine what
            // they must contain: a record that is valid in one layer may be invalid in another.
            let share = verified.memory / commit.layers.len() as u64;
            let known = verified.layers.entry(layer.header.clone()).or_insert_with(|| Verified::new(share));
            tree.verify_tree(findings, known, memory, progress)?;
        }
        Ok(())
    }

    /// Reports slots that are not valid. Such a slot is harmless, but something has corrupted it.
    fn verify_slots(&self, findings: &mut Vec<Finding>) -> Result<()> {
        for (slot, name) in self.extents().slots()?.into_iter().zip(["first", "second"]) {
            // (After the first commit of a file, the other slot is empty.)
            if slot == Slot::Corrupt || slot == Slot::Empty && self.archive.meta.sequence > 1 {
                let problem = "is corrupt; the next edit rewrites it".into();
                findings.push(Finding { place: format!("{name} meta slot"), problem });
            }
        }
        Ok(())
    }

    /// Checks that extents are contiguous, and that those of each commit start at a page.
    fn verify_extents(&self, findings: &mut Vec<Finding>, progress: &dyn Progress) -> Result<()> {
        let extents = self.extents();
        let mut next = FIRST_EXTENT;
        while next < extents.end && findings.len() < MAX_FINDINGS {
            progress.check()?;
            if extents.reaches_beyond(next)? {
                let problem = "extends beyond the end of the newest commit".into();
                findings.push(Finding { place: format!("extent at {next}"), problem });
                return Ok(());
            }
            // (The next extent usually starts at `next`. Only after an extent that is no commit may
            // it start at the next page instead: another program may have left the extents of a
            // cancelled edit there. Spinney overwrites those, and a commit's extent skips to the
            // page anyway.)
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
            next = extent.next_start();
        }
        Ok(())
    }

    /// Checks all commits, the newest first: numbers and sequences descend, each refers to the
    /// correct older commits, metadata and roots can be read.
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
                let problem = format!(
                    "number {}, sequence {}: not consecutive with the next commit",
                    commit.number, commit.sequence
                );
                findings.push(Finding { place: format!("commit at {next}"), problem });
                return Ok(());
            }
            add(findings, format!("commit {}, its older commit", commit.number), self.verify_jump(&commit))?;
            for number in 0..commit.layers.len() {
                let metadata = Autumnal::new(self.archive.clone(), commit.clone(), number).map(|_| ());
                add(findings, format!("commit {}", commit.number), metadata)?;
            }
            next = commit.previous;
            after = Some(commit);
        }
        Ok(())
    }

    /// Checks that a commit's jump leads to the correct older commit.
    fn verify_jump(&self, commit: &Commit) -> Result<()> {
        let extents = self.extents();
        let should = match commit.previous {
            0 => (0, 0),
            previous => Commit::read(extents, previous)?.next_jump(extents, previous)?,
        };
        if commit.jump == should {
            return Ok(());
        }
        let show = |(sequence, start)| format!("sequence {sequence} at byte {start}");
        Err(extents.corrupt("older commit", show(commit.jump), &show(should)))
    }

    /// Checks the commit's tree, except for subtrees that were verified already.
    fn verify_tree(
        &self,
        findings: &mut Vec<Finding>,
        verified: &Verified,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<()> {
        let options = BuildOptions::like(self.header(), memory);
        let mut made = Vec::new();
        let mode = Mode::Check(Check::new(&mut made, verified));
        let mut builder = RecordBuilder::new(self, &options, [u64::MAX; 3], mode, None);
        let source = Unverified { tree: self };
        let shape = self.heights().shape();
        let walked = walk(&source, &options, (shape, CodeRange::ALL), true, &mut builder, progress);
        let layer = self.layer();
        let place = match &*layer.name {
            "" => format!("commit {}", self.commit.number),
            name => format!("commit {}, layer `{name}`", self.commit.number),
        };
        let is_good = walked.is_ok();
        add(findings, format!("{place}, tree"), walked)?;
        if is_good {
            let (root, zone) = builder.finish();
            if (&root, zone.inner_nodes, zone.tally.cells) != (&layer.root, layer.inner_nodes, layer.cells) {
                let problem = format!("the root or totals differ from those of the tree: {root:?}");
                findings.push(Finding { place: place.clone(), problem });
            }
        }
        let made = made.into_iter();
        findings
            .extend(made.map(|finding| Finding { place: format!("{place}, {}", finding.place), ..finding }));
        Ok(())
    }
}

/// Verified records, by the headers of their layers.
struct VerifiedLayers {
    /// Memory limit in bytes.
    memory: u64,
    layers: HashMap<Vec<u8>, Verified>,
}

/// Turns errors about the file's content into findings, and passes other errors on.
fn add(findings: &mut Vec<Finding>, place: String, found: Result<()>) -> Result<()> {
    match found {
        Err(error @ (Error::Corrupt { .. } | Error::Invalid { .. } | Error::Unsupported { .. })) => {
            findings.push(Finding { place, problem: error.to_string() });
            Ok(())
        }
        other => other,
    }
}
