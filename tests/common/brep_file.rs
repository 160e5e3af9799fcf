//! Splits files of exact models into their components and reassembles them as `formats.md`
//! specifies, with valid checksums.

use spinney::{Code, Dimension};

/// A block of faces or a segment, with its key.
pub type Chunk = (u64, Vec<u8>);

/// Tags of the optional lists.
const OTHERS: [&[u8; 4]; 3] = [b"EXAC", b"OBJE", b"FVAL"];

/// The components of a file.
#[derive(Clone)]
pub struct BrepFile {
    /// Without its checksum.
    pub header: Vec<u8>,
    pub blocks: Vec<Chunk>,
    pub segments: Vec<Chunk>,
    /// Entries of the optional lists: blocks of faces with off-grid vertices, and tables of parts
    /// and of faces.
    pub others: [Vec<Chunk>; 3],
    pub formula: Vec<u8>,
    /// Sums over all faces; empty if the file has none.
    pub sums: Vec<u8>,
    pub model: Vec<u8>,
    pub metadata: Vec<u8>,
}

fn short(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

fn shorts(numbers: impl IntoIterator<Item = u32>) -> Vec<u8> {
    numbers.into_iter().flat_map(u32::to_le_bytes).collect()
}

fn trailer(file: &[u8]) -> usize {
    let end = file.len() - 16;
    end - short(file, end) as usize
}

/// Returns the section with a tag, if the file has it.
pub fn section<'a>(file: &'a [u8], tag: &[u8; 4]) -> Option<&'a [u8]> {
    let trailer = trailer(file);
    let mut sections = (0..short(file, trailer + 32) as usize).map(|i| trailer + 36 + 24 * i);
    let at = sections.find(|at| file[*at..].starts_with(tag))?;
    let start = long(file, at + 8) as usize;
    Some(&file[start..start + long(file, at + 16) as usize])
}

impl BrepFile {
    pub fn of(file: &[u8]) -> BrepFile {
        let chunks = |tag: &[u8; 4]| {
            let chunk = |entry: &[u8]| {
                let start = long(entry, 8) as usize;
                (long(entry, 0), file[start..start + short(entry, 16) as usize].to_vec())
            };
            section(file, tag).unwrap_or_default().chunks(24).map(chunk).collect()
        };
        BrepFile {
            header: file[..20].to_vec(),
            blocks: chunks(b"FACE"),
            segments: chunks(b"DIRE"),
            others: OTHERS.map(chunks),
            sums: section(file, b"SUMS").unwrap_or_default().to_vec(),
            formula: section(file, b"FORM").unwrap_or_default().to_vec(),
            model: section(file, b"BREP").unwrap().to_vec(),
            metadata: section(file, b"META").unwrap().to_vec(),
        }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut file = self.header.clone();
        file.extend(crc32c::crc32c(&self.header).to_le_bytes());
        let mut list = |chunks: &[Chunk]| {
            let mut list = Vec::new();
            for (key, bytes) in chunks {
                list.extend(key.to_le_bytes());
                list.extend((file.len() as u64).to_le_bytes());
                list.extend(shorts([bytes.len() as u32, crc32c::crc32c(bytes)]));
                file.extend(bytes);
            }
            list
        };
        let [blocks, directory] = [&self.blocks, &self.segments].map(|chunks| list(chunks));
        let others = self.others.each_ref().map(|chunks| list(chunks));
        let mut sections = Vec::new();
        let always = [(b"FACE", &blocks), (b"DIRE", &directory)];
        let more = [
            (b"BREP", &self.model),
            (b"SUMS", &self.sums),
            (b"FORM", &self.formula),
            (b"META", &self.metadata),
        ];
        let all = always.into_iter().chain(OTHERS.into_iter().zip(&others)).chain(more);
        let is_there = |(tag, bytes): &(&[u8; 4], &Vec<u8>)| !bytes.is_empty() || *tag == b"FACE";
        for (tag, bytes) in all.filter(is_there) {
            sections.extend(tag);
            sections.extend(crc32c::crc32c(bytes).to_le_bytes());
            sections.extend((file.len() as u64).to_le_bytes());
            sections.extend((bytes.len() as u64).to_le_bytes());
            file.extend(bytes);
        }
        let mut trailer = file[..24].to_vec();
        trailer.extend(((file.len() + 36 + sections.len() + 16) as u64).to_le_bytes());
        trailer.extend(shorts([sections.len() as u32 / 24]));
        trailer.extend(sections);
        file.extend(&trailer);
        file.extend(shorts([trailer.len() as u32, crc32c::crc32c(&trailer)]));
        file.extend(b"\nnilboG\x93");
        file
    }

    /// The same tree with a segment of its own for each INNER node.
    pub fn cut_everywhere(mut self) -> BrepFile {
        let segments: Vec<(Code, Segment)> = self
            .segments
            .iter()
            .map(|(key, bytes)| (Code::from_bits(Dimension::Oct, *key).unwrap(), Segment::of(bytes)))
            .collect();
        self.segments.clear();
        for (code, segment) in &segments {
            segment.cut(*code, segment.words[0], &mut self.segments);
        }
        self.segments.sort_by_key(|(key, _)| *key);
        self
    }
}

/// A segment of the octree.
struct Segment {
    faces: Vec<u32>,
    exact: Vec<u32>,
    words: Vec<u32>,
    leaves: Vec<u8>,
}

const INNER: u32 = 2;
const CUT: u32 = 3;
const LEAF: u32 = 4;
const NEAR_VOID: u32 = 5;
const NEAR_FULL: u32 = 6;

impl Segment {
    fn of(bytes: &[u8]) -> Segment {
        let [faces, exact, words] = [0, 4, 8].map(|at| short(bytes, at) as usize);
        let list =
            |from: usize, count: usize| (0..count).map(|i| short(bytes, 16 + 4 * (from + i))).collect();
        Segment {
            faces: list(0, faces),
            exact: list(faces, exact),
            words: list(faces + exact, words),
            leaves: bytes[16 + 4 * (faces + exact + words)..].to_vec(),
        }
    }

    fn to_bytes(&self) -> Vec<u8> {
        let Segment { faces, exact, words, leaves } = self;
        let counts = [faces.len(), exact.len(), words.len(), leaves.len()].map(|count| count as u32);
        [shorts(counts), shorts([&faces[..], exact, words].concat()), leaves.clone()].concat()
    }

    /// Returns the head byte of a leaf, its faces by their numbers in the model, and the exact
    /// faces near it.
    fn leaf(&self, at: usize) -> (u8, [Vec<u32>; 2]) {
        let head = self.leaves[at];
        let (faces, length) = self.list(at + 1, &self.faces);
        let near = if head & 32 == 0 { Vec::new() } else { self.list(at + 1 + length, &self.exact).0 };
        (head, [faces, near])
    }

    /// Returns the faces of a list and the list's length in bytes.
    fn list(&self, at: usize, numbers: &[u32]) -> (Vec<u32>, usize) {
        let mut bytes = &self.leaves[at..];
        let mut next = || {
            let (mut number, mut shift) = (0, 0);
            loop {
                let byte = bytes[0];
                bytes = &bytes[1..];
                number |= u32::from(byte & 127) << shift;
                shift += 7;
                if byte < 128 {
                    return number;
                }
            }
        };
        let count = next();
        let mut own = 0;
        let faces = (0..count).map(|i| {
            own += next() + u32::from(i > 0);
            numbers[own as usize]
        });
        let faces = faces.collect();
        (faces, self.leaves.len() - at - bytes.len())
    }

    /// Appends the segment of a node, and those of the INNER nodes below it.
    fn cut(&self, code: Code, word: u32, out: &mut Vec<Chunk>) {
        let mut segment =
            Segment { faces: Vec::new(), exact: Vec::new(), words: Vec::new(), leaves: Vec::new() };
        // Appends a list of faces, renumbered within the segment.
        let push = |leaves: &mut Vec<u8>, all: &mut Vec<u32>, faces: &[u32]| {
            leaves.push(faces.len() as u8);
            let number = |face: &u32| {
                let known = all.iter().position(|known| known == face);
                known.unwrap_or_else(|| {
                    all.push(*face);
                    all.len() - 1
                }) as u8
            };
            let mut own: Vec<u8> = faces.iter().map(number).collect();
            own.sort_unstable();
            assert!(faces.len() < 128 && own.last() < Some(&128), "numbers of one byte");
            let mut next = 0;
            for number in own {
                leaves.push(number - next);
                next = number + 1;
            }
        };
        let mut add = |word: u32, is_root: bool| match word & 7 {
            INNER => segment.words.push(if is_root { 1 << 3 | INNER } else { CUT }),
            LEAF => {
                segment.words.push((segment.leaves.len() as u32) << 3 | LEAF);
                let (head, [faces, near]) = self.leaf((word >> 3) as usize);
                segment.leaves.push(head);
                push(&mut segment.leaves, &mut segment.faces, &faces);
                if !near.is_empty() {
                    push(&mut segment.leaves, &mut segment.exact, &near);
                }
            }
            state @ (NEAR_VOID | NEAR_FULL) => {
                segment.words.push((segment.leaves.len() as u32) << 3 | state);
                let near = self.list((word >> 3) as usize, &self.exact).0;
                push(&mut segment.leaves, &mut segment.exact, &near);
            }
            _ => segment.words.push(word),
        };
        add(word, true);
        let children: Vec<u32> = match word & 7 {
            INNER => (0..8).map(|child| self.words[(word >> 3) as usize + child]).collect(),
            _ => Vec::new(),
        };
        children.iter().for_each(|child| add(*child, false));
        out.push((code.bits(), segment.to_bytes()));
        for (child, word) in children.into_iter().enumerate().filter(|(_, word)| word & 7 == INNER) {
            self.cut(code.child(child), word, out);
        }
    }
}
