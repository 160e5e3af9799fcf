//! Verifies a whole file: every checksum, and every rule of the tree.
//!
//! Building is deterministic, so the rules need no second statement: the tree is walked, built anew, and every
//! segment compared with the one in the file. What differs is told.

use zerocopy::IntoBytes;

use super::assemble::{Assembled, Assembler, SegmentSink};
use super::directory::Entry;
use super::reader::Goblin;
use super::record::{Layout, Record};
use super::segment::Segment;
use crate::store::build::{BuildOptions, Sealed, walk};
use crate::value::Value;
use crate::{Error, Progress, Result};

/// Something that is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The part of the file.
    pub place: String,
    /// What is wrong with it.
    pub problem: String,
}

impl<D: Layout, V: Value> Goblin<D, V> {
    /// Checks every checksum and every rule of the tree: preorder, skips that add up, representatives and zone
    /// statistics that agree with the leaves, no uniform INNER node, every segment there that must be, none that
    /// must not. Takes about as long as building; memory is bounded by `memory`.
    ///
    /// # Errors
    /// If the file cannot be read, or on interruption. What is wrong with the file is no error but a finding; at
    /// most 100 are collected.
    pub fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut checker = Checker { file: self, findings: Vec::new(), seen: 0 };
        checker.checksums()?;
        checker.directory();
        if !checker.findings.is_empty() {
            return Ok(checker.findings);
        }
        let options = BuildOptions::like(self.header(), memory);
        let shape = self.header().shape;
        let mut assembler = Assembler::new(shape, options.rule, [u64::MAX; 3], checker);
        match walk(self, &options, shape, false, &mut assembler, progress) {
            Err(error @ (Error::Corrupt { .. } | Error::Invalid { .. })) => {
                return Ok(vec![Finding { place: "tree".into(), problem: error.to_string() }]);
            }
            walked => walked?,
        }
        let Assembled { sink: mut checker, root, counts } = assembler.finish();
        if checker.seen != self.segments() {
            let found = format!("{} segments, {} of them are needed", self.segments(), checker.seen);
            checker.add("directory".into(), found);
        }
        let root = root.child;
        if self.root_place()? != root && !root.value().is_some_and(|value| value.is_nan()) {
            checker
                .add("trailer".into(), format!("root {:?}, the leaves make it {root:?}", self.root_place()?));
        }
        if self.metadata().counts != counts {
            checker.add("metadata".into(), "node counts that differ from the tree's".into());
        }
        Ok(checker.findings)
    }
}

/// Findings that are collected before checking is given up.
const MOST_FINDINGS: usize = 100;

struct Checker<'a, D: Layout, V: Value> {
    file: &'a Goblin<D, V>,
    findings: Vec<Finding>,
    seen: usize,
}

impl<D: Layout, V: Value> Checker<'_, D, V> {
    fn add(&mut self, place: String, problem: String) {
        if self.findings.len() < MOST_FINDINGS {
            self.findings.push(Finding { place, problem });
        }
    }

    fn checksums(&mut self) -> Result<()> {
        for (name, stored, found) in self.file.section_checksums()? {
            if stored != found {
                self.add(name.into(), format!("checksum {found:08x}, stored is {stored:08x}"));
            }
        }
        for index in 0..self.file.segments() {
            if self.findings.len() == MOST_FINDINGS {
                break;
            }
            match self.file.segment(index) {
                Err(error @ Error::Io { .. }) => return Err(error),
                Err(error) => self.add(format!("segment {index}"), error.to_string()),
                Ok(_) => {}
            }
        }
        Ok(())
    }

    fn directory(&mut self) {
        let mut before = None;
        for index in 0..self.file.segments() {
            let Ok(entry) = self.file.entry(index) else { continue };
            if before.is_some_and(|before| before >= entry.code) {
                self.add(format!("directory entry {index}"), format!("code {} is out of order", entry.code));
            }
            before = Some(entry.code);
        }
    }
}

/// Takes the segments as they should be.
impl<D: Layout, V: Value> SegmentSink<D, V> for Checker<'_, D, V> {
    fn copy(&mut self, _: &Segment<'_, D, V>, _: Entry<D, V>) -> Result<()> {
        unreachable!("what is to be checked is made anew")
    }

    fn segment(&mut self, should: Sealed<D, V>) -> Result<()> {
        let place = format!("segment {}", should.code);
        let index = self.file.find_segment(should.code);
        let index =
            index.filter(|index| self.file.entry(*index).is_ok_and(|entry| entry.code == should.code));
        let Some(index) = index else {
            self.add(
                place,
                format!("missing; the tree has {} records below that node", should.records.len()),
            );
            return Ok(());
        };
        self.seen += 1;
        let segment = self.file.segment(index)?;
        let records = segment.records();
        if records.as_bytes() != should.records.as_bytes() {
            let pairs = records.iter().zip(&should.records);
            let same = pairs.take_while(|(a, b)| a.as_bytes() == b.as_bytes()).count();
            let show = |record: Option<&D::Record<V>>| match record {
                None => "nothing".to_string(),
                Some(record) => {
                    let values: Vec<V> = (0..D::CHILDREN).map(|child| record.value(child)).collect();
                    format!("{values:?} states {:b} skip {}", record.states(), record.skip())
                }
            };
            let (is, should) = (show(records.get(same)), show(should.records.get(same)));
            self.add(format!("{place}, record {same}"), format!("{is}; the leaves make it {should}"));
        }
        let zone = self.file.zone(index)?;
        if format!("{zone:?}") != format!("{:?}", should.tally) {
            self.add(place, format!("statistics {zone:?}; the leaves make them {:?}", should.tally));
        }
        Ok(())
    }
}
