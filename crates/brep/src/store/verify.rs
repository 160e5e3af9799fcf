//! Verification of a whole file: its chunks, then each face, then whether they form a closed
//! surface, then whether the octree matches the faces, and finally the summary.

use std::collections::BTreeMap;

use super::block::FaceBuffer;
use super::reader::ExactModel;
use crate::build::{Checked, OctreeCheck};
use crate::closure::{Closure, Seed, edges};
use crate::face_check::{FaceCheck, FaceFlaw};
use crate::part_sums::SumsOfParts;
use crate::query::SurfaceDetail;
use crate::{Face, Faces};
use spinney_base::io::Sorter;
use spinney_base::{Error, Progress, Result};
use spinney_container::{Finding, Tag};

/// Maximum number of findings.
const MAX_LISTED: usize = 100;

/// An edge, the smaller end first.
type Edge = [[i32; 3]; 2];

impl ExactModel {
    /// Checks every checksum, every face and every node: faces must be planar polygons, their
    /// surface must be closed and bound a solid, and the octree must match the faces. Takes about
    /// `memory` bytes, and temporary files for faces that exceed them. Faces with off-grid vertices
    /// are held in memory in any case.
    ///
    /// Nodes are only checked if the surface is closed, and the surface only if no chunk is
    /// corrupt: repair the first findings first. At most 100 findings are listed.
    ///
    /// # Errors
    /// If the file cannot be read, if the memory is not enough for the faces of one leaf, or on
    /// cancellation. Corruption is not an error but a finding.
    pub fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = self.verify_chunks(progress)?;
        if findings.is_empty() {
            findings = self.verify_surface(memory, progress)?;
        }
        findings.truncate(MAX_LISTED);
        Ok(findings)
    }

    /// Returns the flaws of lists, blocks, segments and sections, each by itself.
    fn verify_chunks(&self, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        let sections = [
            ("directory", self.trailer.section(super::summary::DIRECTORY)),
            ("list of faces", self.trailer.section(super::summary::FACES)),
            ("list of exact faces", self.trailer.section(super::exact::EXACT)),
            ("list of parts", self.trailer.section(super::objects::OBJECTS)),
            ("list of values of faces", self.trailer.section(super::objects::FACE_VALUES)),
            ("sums", self.trailer.section(super::sums::SUMS)),
            ("formula", self.trailer.section(super::formula::FORMULA)),
            ("levels", self.trailer.section(super::levels::LEVELS)),
            ("list of clusters", self.trailer.section(super::levels::CLUSTERS)),
            ("list of coarse faces", self.trailer.section(super::levels::LEVEL_FACES)),
        ];
        for (name, section) in sections.into_iter().filter(|(_, section)| section.length > 0) {
            match section.read(&self.path, &*self.backend, name) {
                Err(error @ Error::Io { .. }) => return Err(error),
                Err(error) => findings.push(finding(name, &error)),
                Ok(_) => {}
            }
        }
        let lists = [
            ("block of faces", &self.blocks),
            ("segment", &self.segments),
            ("block of exact faces", &self.exact),
            ("table of parts", &self.objects),
            ("table of faces", &self.face_values),
            ("table of clusters", &self.clusters),
            ("block of coarse faces", &self.level_faces),
        ];
        for (name, count) in lists.map(|(name, list)| (name, list.len())) {
            for index in 0..count {
                progress.check()?;
                let read = match name {
                    "segment" => self.segment(index).map(drop),
                    "block of exact faces" => self.exact_block(index).map(drop),
                    "table of parts" => self.values(&self.objects, index).map(drop),
                    "table of faces" => self.values(&self.face_values, index).map(drop),
                    "table of clusters" => self.cluster_table(index).map(drop),
                    "block of coarse faces" => self.level_block(index).map(drop),
                    _ => self.block(index).map(drop),
                };
                match read {
                    Err(error @ Error::Io { .. }) => return Err(error),
                    Err(error) if findings.len() < MAX_LISTED => {
                        findings.push(finding(&format!("{name} {index}"), &error));
                    }
                    _ => {}
                }
            }
        }
        if findings.is_empty() {
            match self.check_tables(progress).and_then(|()| self.formula().map(drop)) {
                Err(error @ (Error::Io { .. } | Error::Interrupted)) => return Err(error),
                Err(error) => findings.push(finding("attributes", &error)),
                Ok(()) => {}
            }
        }
        Ok(findings)
    }

    /// Returns the flaws of the faces and the octree of a file whose chunks are valid.
    fn verify_surface(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        let seed = Seed::new();
        let (mut closure, mut octree) = (Closure::new(seed), OctreeCheck::new(memory, self.summary.reach));
        let mut check = FaceCheck::new(self.summary.grid.bits);
        let mut buffer = FaceBuffer::default();
        let total = 2 * self.len();
        let mut proxies = 0;
        let mut sums = SumsOfParts::new(&std::env::temp_dir(), self.summary.grid.bits, memory / 16);
        for index in 0..self.blocks.len() {
            progress.check()?;
            let block = self.block(index)?;
            for place in 0..block.len() {
                block.read(place, &mut buffer);
                let face = buffer.face();
                proxies += u64::from(buffer.is_proxy);
                closure.add(&face);
                sums.add(&face, buffer.is_proxy)?;
                match check.has_area(&face) {
                    Ok(true) => octree.push(&face)?,
                    Ok(false) => octree.note_sliver(),
                    Err(FaceFlaw { found, expected }) if findings.len() < MAX_LISTED => {
                        findings.push(Finding {
                            place: format!("face {}", face.number),
                            problem: format!("{found}, expected {expected}"),
                        })
                    }
                    Err(_) => {}
                }
            }
            progress.advance(block.len() as u64, total);
        }
        if findings.is_empty() && !closure.is_closed() {
            findings = self.open_edges(memory, progress)?;
        }
        if findings.is_empty() {
            findings = self.verify_exact_faces(seed, &mut octree, &mut sums, progress)?;
        }
        if findings.is_empty() && proxies != self.summary.proxies {
            let problem = format!("{} proxies, expected {proxies}", self.summary.proxies);
            findings.push(Finding { place: "model".into(), problem });
        }
        if findings.is_empty() {
            findings = match self.verify_sums(sums) {
                Err(error @ Error::Corrupt { .. }) => vec![finding("sums", &error)],
                found => found?,
            };
        }
        if !findings.is_empty() {
            return Ok(findings);
        }
        let checked = match octree.finish(self, progress, (self.len(), total)) {
            Err(error @ Error::Corrupt { .. }) => return Ok(vec![finding("tree", &error)]),
            checked => checked?,
        };
        findings.extend(self.compare(checked));
        if findings.is_empty() {
            findings = self.verify_levels(seed, progress)?;
        }
        Ok(findings)
    }

    /// Returns stored sums that differ from the sums over the faces.
    fn verify_sums(&self, computed: SumsOfParts) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        let mut stored = 0;
        let has_sums = self.each_part_sums(&mut |_, _| {
            stored += 1;
            Ok(())
        })?;
        if !has_sums {
            return Ok(findings);
        }
        let mut differs = |place: String, problem: String| {
            if findings.len() < MAX_LISTED {
                findings.push(Finding { place, problem });
            }
        };
        let mut parts = 0;
        let total = computed.finish(&mut |part, expected| {
            parts += 1;
            let problem = match self.part_sums(part)? {
                Some(found) => found.difference(expected).map(|what| format!("{what} of other faces")),
                None => Some("no sums".into()),
            };
            problem.into_iter().for_each(|problem| {
                differs(format!("sums of part {part}"), format!("{problem}, expected sums over its faces"));
            });
            Ok(())
        })?;
        if stored != parts {
            differs("sums".into(), format!("sums of {stored} parts, expected {parts}, those with faces"));
        }
        if let Some(what) = self.stored_sums()?.and_then(|found| found.difference(&total)) {
            differs("sums".into(), format!("{what} of other faces, expected sums over all faces"));
        }
        Ok(findings)
    }

    /// Returns levels of detail that are not closed, or do not have as many faces as recorded.
    fn verify_levels(&self, seed: Seed, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        // Parts that are closed by themselves in the exact level, which is the first one here.
        let mut is_closed: Option<Vec<bool>> = None;
        for (number, level) in self.levels.iter().enumerate().rev() {
            let surface = match self.surface(SurfaceDetail::Level(number as u8), None, progress) {
                Err(error @ Error::Corrupt { .. }) => {
                    findings.push(finding(&format!("level {number}"), &error));
                    break;
                }
                surface => surface?,
            };
            let mut closures = vec![Closure::new(seed); self.parts.len()];
            let mut faces = 0u64;
            let read = surface.each(&mut |face| {
                if face.number.is_multiple_of(1 << 12) {
                    progress.check()?;
                }
                closures[face.part as usize].add(face);
                faces += 1;
                Ok(())
            });
            let mut whole = Closure::new(seed);
            closures.iter().for_each(|closure| whole.append(*closure));
            let parts: Vec<bool> = closures.iter().map(Closure::is_closed).collect();
            let expected = is_closed.get_or_insert_with(|| parts.clone());
            let are_closed = whole.is_closed() && parts.iter().zip(expected).all(|(is, was)| *is || !*was);
            let place = format!("level {number}");
            match read {
                Err(error @ Error::Corrupt { .. }) => findings.push(finding(&place, &error)),
                read => read?,
            }
            let summary = (surface.len(), surface.grid_error(), surface.clusters() as u64);
            if findings.is_empty()
                && (faces != level.faces || summary != (faces, level.error, level.clusters))
            {
                let problem = format!("{faces} faces, {summary:?} by its clusters, expected {level:?}");
                findings.push(Finding { place, problem });
            } else if findings.is_empty() && !are_closed {
                let problem = "edges that have a face on one side only, expected a closed surface".into();
                findings.push(Finding { place, problem });
            }
        }
        Ok(findings)
    }

    /// Compares the octree check's result with the summary.
    fn compare(&self, checked: Checked) -> Vec<Finding> {
        let Checked { mut findings, defects, counts, cut } = checked;
        // (Where the surface is thinner than a grid unit, proxies may intersect.)
        let is_thin = self.has_exact_faces() && self.metadata.tag(Tag::ModelIntersections).is_some();
        if !is_thin {
            let of = |defect: &crate::Defect| Finding { place: "faces".into(), problem: defect.to_string() };
            findings.extend(defects.iter().map(of));
        }
        let mut differs = |place: &str, problem: String| {
            if findings.is_empty() {
                findings.push(Finding { place: place.into(), problem });
            }
        };
        if counts != self.summary.nodes {
            differs("model", format!("{:?} nodes, expected {counts:?} from the tree", self.summary.nodes));
        }
        if cut + 1 != self.segments.len() as u64 {
            differs("directory", format!("{} segments, expected {}", self.segments.len(), cut + 1));
        }
        findings
    }

    /// Returns the flaws of faces with off-grid vertices, and adds these faces to the octree check.
    fn verify_exact_faces(
        &self,
        seed: Seed,
        octree: &mut OctreeCheck,
        sums: &mut SumsOfParts,
        progress: &dyn Progress,
    ) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        if !self.has_exact_faces() {
            return Ok(findings);
        }
        let mut number = 0u64;
        let read = self.each_exact(&mut |face| {
            if let Some(problem) = face.flaw(progress)?
                && findings.len() < MAX_LISTED
            {
                findings.push(Finding { place: format!("exact face {number}"), problem: problem.into() });
            }
            octree.push_exact(&face);
            sums.add_exact(&face)?;
            number += 1;
            Ok(())
        });
        match read {
            Err(error @ Error::Corrupt { .. }) => findings.push(finding("exact faces", &error)),
            read => read?,
        }
        if findings.is_empty() && !self.is_exactly_closed(seed, progress)? {
            let problem = "edges that have a face on one side only, expected a closed surface".into();
            findings.push(Finding { place: "exact faces".into(), problem });
        }
        Ok(findings)
    }

    /// Returns the edges that do not occur equally often in both directions. Edges are sorted
    /// externally, since their number is not limited by the memory.
    fn open_edges(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        /// Six coordinates, a direction and a face.
        const ITEM: usize = 6 * 4 + 1 + 4;
        let mut sorter = Sorter::new(&std::env::temp_dir(), memory / 2);
        self.each(&mut |face: &Face<'_>| {
            if face.number.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            for [from, to] in edges(face) {
                let is_forward = from < to;
                let edge: Edge = if is_forward { [from, to] } else { [to, from] };
                let mut item = Vec::with_capacity(ITEM);
                edge.as_flattened().iter().for_each(|at| item.extend_from_slice(&at.to_le_bytes()));
                item.push(is_forward.into());
                item.extend_from_slice(&(face.number as u32).to_le_bytes());
                // (Along x and then y: equal edges have equal keys, and few others share them.)
                let key = u64::from(edge[0][0] as u32) << 38
                    ^ u64::from(edge[0][1] as u32) << 12
                    ^ u64::from(edge[0][2] as u32 & 0xfff);
                sorter.push(key, &item)?;
            }
            Ok(())
        })?;
        let mut findings = Vec::new();
        // Surpluses of edges that begin at the same point, with a face of each.
        let mut group: BTreeMap<Edge, (i64, u32)> = BTreeMap::new();
        let mut before = [0; 3];
        let mut report = |group: &mut BTreeMap<Edge, (i64, u32)>| {
            for (edge, (surplus, face)) in std::mem::take(group) {
                if surplus != 0 && findings.len() < MAX_LISTED {
                    let [from, to] = if surplus > 0 { edge } else { [edge[1], edge[0]] };
                    let count = surplus.unsigned_abs();
                    let problem = format!(
                        "the edge from {from:?} to {to:?} {count} times more often than its reverse, expected equally often"
                    );
                    findings.push(Finding { place: format!("face {face}"), problem });
                }
            }
        };
        let mut count = 0u64;
        sorter.finish(&mut |item| {
            count += 1;
            if count.is_multiple_of(1 << 14) {
                progress.check()?;
            }
            let four = |at: usize| <[u8; 4]>::try_from(&item[4 * at..4 * at + 4]).expect("four bytes");
            let edge: Edge = [0, 3].map(|end| [0, 1, 2].map(|axis| i32::from_le_bytes(four(end + axis))));
            if edge[0] != before {
                report(&mut group);
                before = edge[0];
            }
            let face = u32::from_le_bytes(item[25..29].try_into().expect("four bytes"));
            let entry = group.entry(edge).or_insert((0, face));
            entry.0 += if item[24] == 1 { 1 } else { -1 };
            Ok(())
        })?;
        report(&mut group);
        Ok(findings)
    }
}

fn finding(place: &str, error: &Error) -> Finding {
    Finding { place: place.into(), problem: error.to_string() }
}
