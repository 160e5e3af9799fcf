//! Verifies a whole file: every checksum, and every rule of the tree.
//!
//! Building is deterministic, so the rules are not implemented a second time: the tree is traversed
//! and rebuilt, and every segment is compared with the one in the file. Differences are reported.

use std::path::Path;

use super::directory::{Entry, show_sums};
use super::reader::Goblin;
use super::reference::Reference;
use super::segment_builder::{ALL_HAS_COME, SegmentBuilder};
use super::segment_sink::SegmentSink;
use crate::store::builder::{BuildOptions, SealedSegment, walk};
use crate::tree::Child;
use spinney_base::space::CodeRange;
use spinney_base::value::{Sums, ValueType, ZoneStats};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Codec, Finding, MAX_FINDINGS};

impl Goblin {
    /// Checks all layers of the file: every checksum and every rule of their trees: preorder,
    /// consistent skips, representatives and zone statistics that agree with the leaves, no uniform
    /// INNER node, no missing and no superfluous segment. Takes about as long as building; memory
    /// is bounded by `memory`.
    ///
    /// # Errors
    /// If the file cannot be read, or on cancellation. A problem of the file's contents is not an
    /// error but a finding; at most 100 are collected.
    pub fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        self.verify_layers(false, &|layer| layer.verify_layer(memory, progress), progress)
    }

    /// Checks an index without the cells in other files: all that it stores, and lengths and
    /// versions of these files. Other trees are checked as a whole: see [`Goblin::verify`].
    ///
    /// # Errors
    /// Those of [`Goblin::verify`].
    pub fn verify_quickly(&self, progress: &dyn Progress) -> Result<Vec<Finding>> {
        self.verify_layers(true, &|layer| Ok(layer.verify_stored()?.findings), progress)
    }

    /// Checks each layer, and what an index says about its sources; with `with_files` also these.
    fn verify_layers(
        &self,
        with_files: bool,
        verify: &dyn Fn(&Goblin) -> Result<Vec<Finding>>,
        progress: &dyn Progress,
    ) -> Result<Vec<Finding>> {
        let mut findings = match self.references() {
            Some((cells, bytes)) => cells.verify(bytes, with_files, progress)?,
            None => Vec::new(),
        };
        if self.layers().len() == 1 {
            findings.extend(verify(self)?);
        } else {
            for (number, layer) in self.layers().iter().enumerate() {
                progress.check()?;
                let found = match self.open_layer(number).and_then(|layer| verify(&layer)) {
                    Err(
                        error @ (Error::Corrupt { .. } | Error::Invalid { .. } | Error::Unsupported { .. }),
                    ) => {
                        vec![Finding { place: "layer".into(), problem: error.to_string() }]
                    }
                    found => found?,
                };
                let place = |finding: Finding| Finding {
                    place: format!("layer `{}`, {}", layer.name, finding.place),
                    ..finding
                };
                findings.extend(found.into_iter().map(place));
                if findings.len() >= MAX_FINDINGS {
                    break;
                }
            }
        }
        findings.truncate(MAX_FINDINGS);
        Ok(findings)
    }

    /// Checks what the file itself stores of this layer.
    fn verify_stored(&self) -> Result<Checker<'_>> {
        let mut checker = Checker { file: self, findings: Vec::new(), seen: 0, records: 0 };
        checker.checksums()?;
        checker.directory()?;
        Ok(checker)
    }

    /// Checks this layer.
    fn verify_layer(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut checker = self.verify_stored()?;
        // Rebuilding a tree from bytes known to be corrupt would only repeat the findings, at
        // length.
        if !checker.findings.is_empty() {
            return Ok(checker.findings);
        }
        let options = BuildOptions::like(self.header(), memory);
        let shape = self.header().shape;
        let mut builder = SegmentBuilder::new(self.header(), [u64::MAX; 3], &mut checker);
        match walk(self, &options, (shape, CodeRange::ALL), false, &mut builder, progress) {
            Err(error @ (Error::Corrupt { .. } | Error::Invalid { .. })) => {
                return Ok(vec![Finding { place: "tree".into(), problem: error.to_string() }]);
            }
            walked => walked?,
        }
        let (root, counts) = builder.finish();
        let root = root.expect(ALL_HAS_COME);
        if checker.seen != self.segments() {
            let found = format!("{} segments, but the tree needs {}", self.segments(), checker.seen);
            checker.add("directory".into(), found);
        }
        if self.stored_records() != checker.records {
            let problem =
                format!("{} records, but the segments have {}", self.stored_records(), checker.records);
            checker.add("trailer".into(), problem);
        }
        if self.root_child() != root.child {
            let show = |child| show_child(self.header().form.value, child);
            let (found, made) = (show(self.root_child()), show(root.child));
            checker.add("trailer".into(), format!("root {found}, but {made} computed from the leaves"));
        }
        if self.metadata().counts != counts {
            checker.add("metadata".into(), "node counts differ from those of the tree".into());
        }
        Ok(checker.findings)
    }
}

/// Compares a file with its rebuilt tree.
struct Checker<'a> {
    file: &'a Goblin,
    findings: Vec<Finding>,
    /// Number of the file's segments that the tree needs.
    seen: usize,
    /// Number of record slots in those segments.
    records: u64,
}

impl Checker<'_> {
    fn add(&mut self, place: String, problem: String) {
        if self.findings.len() < MAX_FINDINGS {
            self.findings.push(Finding { place, problem });
        }
    }

    fn checksums(&mut self) -> Result<()> {
        for index in 0..self.file.segments() {
            if self.findings.len() == MAX_FINDINGS {
                break;
            }
            // (The cells of references are read, and checked, when the tree is rebuilt.)
            let checked = match self.file.entry(index) {
                Ok(entry) if entry.codec == Codec::Reference => self.file.reference(index, &entry).map(drop),
                _ => self.file.segment(index).map(drop),
            };
            match checked {
                Err(error @ Error::Io { .. }) => return Err(error),
                Err(error) => self.add(format!("segment {index}"), error.to_string()),
                Ok(()) => {}
            }
        }
        Ok(())
    }

    /// Checks the order of the entries, and that of the segments in the file.
    fn directory(&mut self) -> Result<()> {
        let mut before = None;
        // Entries of the next entry's ancestors.
        let mut open: Vec<(usize, Entry)> = Vec::new();
        let shard_level = self.file.header().shape.shard_level();
        let mut ends = [0, self.file.layer().top_levels];
        for index in 0..self.file.segments() {
            let Ok(entry) = self.file.entry(index) else { continue };
            if before.is_some_and(|before| before >= entry.code) {
                self.add(format!("directory entry {index}"), format!("code {} is out of order", entry.code));
            }
            before = Some(entry.code);
            while let Some((_, done)) = open.pop_if(|(_, above)| !above.code.contains(entry.code)) {
                self.check_offset(&done, shard_level, &mut ends);
            }
            if let Some(found) = self.file.page_copies(index)? {
                let above = open
                    .iter()
                    .map(|(number, _)| Ok((*number as u64, self.file.entry_bytes(*number)?.to_vec())));
                if found != above.collect::<Result<Vec<_>>>()? {
                    let problem =
                        format!("{} copies differ from the entries of the nodes above", found.len());
                    self.add(format!("page of directory entry {index}"), problem);
                }
            }
            open.push((index, entry));
        }
        for (_, done) in open.iter().rev() {
            self.check_offset(done, shard_level, &mut ends);
        }
        let layer = self.file.layer();
        if ends != [layer.top_levels, layer.directory] && self.findings.is_empty() {
            let problem = format!(
                "segments end at {ends:?}, but the layer records {:?}",
                [layer.top_levels, layer.directory]
            );
            self.add("table of layers".into(), problem);
        }
        Ok(())
    }

    /// Checks that a segment starts where the previous one ends. The segments of a subtree precede
    /// its root's, and those of the top levels follow all others.
    fn check_offset(&mut self, entry: &Entry, shard_level: u8, ends: &mut [u64; 2]) {
        let end = &mut ends[usize::from(entry.code.level() < shard_level)];
        if entry.offset != *end {
            let problem = format!("starts at {}, but the previous segment ends at {end}", entry.offset);
            self.add(format!("segment {}", entry.code), problem);
        }
        *end = entry.offset.saturating_add(entry.length);
    }

    /// Formats one record of a segment.
    fn show_record(&self, records: &[u8], at: usize) -> String {
        let layout = self.file.layout();
        let Some(head) = layout.head(records, at) else { return "nothing".into() };
        let show = |child| self.file.header().form.value.show(layout.value(records, at, child));
        let values: Vec<String> = (0..layout.children()).map(show).collect();
        format!("[{}] states {:b} skip {}", values.join(", "), head.states, head.skip)
    }
}

/// Receives the rebuilt segments and compares them.
impl SegmentSink for Checker<'_> {
    fn path(&self) -> &Path {
        self.file.path()
    }

    // (Segments are compared unpacked.)
    fn codec(&self) -> Codec {
        Codec::Plain
    }

    fn segment(&mut self, should: SealedSegment) -> Result<()> {
        let size = self.file.layout().size;
        let place = format!("segment {}", should.code);
        let index = self.file.find_segment(should.code)?;
        let index =
            index.filter(|index| self.file.entry(*index).is_ok_and(|entry| entry.code == should.code));
        let Some(index) = index else {
            let needed = should.records.len() / size;
            self.add(place, format!("missing, but the tree has {needed} records below that node"));
            return Ok(());
        };
        self.seen += 1;
        let entry = self.file.entry(index)?;
        if entry.codec == Codec::Reference {
            let header = self.file.header();
            let made = Reference::of(header, should.code.level(), &should.records, &should.tally);
            if self.file.reference(index, &entry)? != made {
                self.add(
                    place.clone(),
                    "a reference with other counts or another checksum than its cells".into(),
                );
            }
        }
        let segment = self.file.segment(index)?;
        let records = segment.records();
        self.records += (records.len() / size) as u64;
        if records != should.records {
            let pairs = records.chunks_exact(size).zip(should.records.chunks_exact(size));
            let same = pairs.take_while(|(found, made)| found == made).count();
            let (found, made) = (self.show_record(records, same), self.show_record(&should.records, same));
            self.add(
                format!("{place}, record {same}"),
                format!("{found}, but {made} computed from the leaves"),
            );
        }
        let zone = self.file.zone(index)?;
        if !are_same(&zone, &should.tally) {
            let (found, made) = (show_tally(&zone), show_tally(&should.tally));
            self.add(place, format!("statistics {found}, but {made} computed from the leaves"));
        }
        Ok(())
    }

    fn copy(&mut self, _: &[u8], _: Entry) -> Result<()> {
        unreachable!("trees to be checked are built without copies")
    }
}

/// Returns whether the statistics of a file equal others of the same value type as stored on disk:
/// NaN sums are equal, zeros of different signs are not.
fn are_same(a: &ZoneStats, b: &ZoneStats) -> bool {
    let channels = 0..usize::from(a.value_type.channels);
    let bytes_of = |sums: &Sums| {
        let mut bytes = Vec::new();
        channels.clone().for_each(|channel| sums.write(channel, &mut bytes));
        bytes
    };
    let same_sums = |a: &Sums, b: &Sums| bytes_of(a) == bytes_of(b);
    a.cells == b.cells
        && a.present[channels.clone()] == b.present[channels.clone()]
        && (a.min, a.max) == (b.min, b.max)
        && same_sums(&a.sum, &b.sum)
        && same_sums(&a.squares, &b.squares)
        && a.classes == *b.listed_classes().unwrap_or_default()
}

/// Formats a node without its descendants.
fn show_child(value_type: ValueType, child: Child<()>) -> String {
    match child {
        Child::Void => "Void".into(),
        Child::Leaf(value) => format!("Leaf({})", value_type.show(value)),
        Child::Inner { representative, .. } => {
            format!("Inner {{ representative: {}, node: () }}", value_type.show(representative))
        }
    }
}

/// Formats statistics.
fn show_tally(tally: &ZoneStats) -> String {
    let ZoneStats { value_type, cells, present, min, max, sum, squares, classes } = tally;
    let [min, max] = [min, max].map(|value| value_type.show(*value));
    let [sum, squares] = [sum, squares].map(|sums| show_sums(sums, value_type.channels));
    let class = |(value, cells): &(_, u64)| format!("({}, {cells})", value_type.show(*value));
    let classes = classes.iter().map(class).collect::<Vec<_>>().join(", ");
    let present = match value_type.is_masked() {
        true => format!(", present: {:?}", &present[..usize::from(value_type.channels)]),
        false => String::new(),
    };
    format!(
        "ZoneStats {{ cells: {cells}{present}, min: {min}, max: {max}, sum: {sum}, squares: {squares}, classes: [{classes}] }}"
    )
}
