//! Incremental scanner of `GeoJSON` documents (RFC 7946), or of sequences of them (RFC 8142). It
//! yields the objects of a list one at a time.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use spinney_base::{Error, Result};

/// Input that can be read more than once.
pub(super) trait Input: Read + Seek {}

impl<T: Read + Seek> Input for T {}

/// Members of objects that describe features. All others are skipped.
const MEMBERS: [&str; 8] =
    ["type", "id", "properties", "geometry", "coordinates", "geometries", "crs", "name"];

/// Maximum nesting depth of values.
const MAX_DEPTH: usize = 100;

/// Maximum memory in bytes between two delimiters (comma, colon, start of a list): a third of a
/// point, including spare list capacity.
const BYTES_EACH: u64 = 32;

const BUFFER: usize = 1 << 16;

/// Members of an object, as text.
#[derive(Default)]
pub(super) struct Record([Option<String>; MEMBERS.len()]);

impl Record {
    pub(super) fn get(&self, name: &str) -> Option<&str> {
        self.0[MEMBERS.iter().position(|member| *member == name)?].as_deref()
    }

    /// Returns the object's declared type.
    pub(super) fn kind(&self) -> std::result::Result<String, String> {
        let kind = self.get("type").and_then(|text| serde_json::from_str(text).ok());
        kind.ok_or_else(|| "an object without a type".into())
    }
}

/// Scanned item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ScannedItem {
    /// Object of a list.
    Element(List),
    /// End of a document. Its members are in the record; its list preceded them.
    Document(Option<List>),
}

/// List whose objects are yielded one at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum List {
    Features,
    Geometries,
}

/// Parser state.
enum State {
    Outside,
    Members { is_first: bool },
    List { list: List, is_first: bool },
}

pub(super) struct Scanner {
    input: Box<dyn Input>,
    path: PathBuf,
    buffer: Vec<u8>,
    at: usize,
    end: usize,
    /// Offset of the buffer in the input.
    before: u64,
    state: State,
    /// Members of the document that contains the list, and that list.
    document: Record,
    list: Option<List>,
    /// Number of the feature, for messages.
    number: u64,
    /// Memory used by the current members, and its limit.
    used: u64,
    memory: u64,
    /// Whether only the types of geometries are kept.
    is_sketch: bool,
}

impl Scanner {
    /// Starts a first pass, which keeps only the types of geometries.
    pub(super) fn new(input: Box<dyn Input>, path: &Path, memory: u64) -> Scanner {
        Scanner {
            input,
            path: path.to_path_buf(),
            buffer: vec![0; BUFFER],
            at: 0,
            end: 0,
            before: 0,
            state: State::Outside,
            document: Record::default(),
            list: None,
            number: 1,
            used: 0,
            memory,
            is_sketch: true,
        }
    }

    /// Restarts, and keeps geometries.
    pub(super) fn rewind(&mut self) -> Result<()> {
        self.input.seek(SeekFrom::Start(0)).map_err(Error::io(&self.path, "read"))?;
        (self.at, self.end, self.before, self.number) = (0, 0, 0, 1);
        (self.state, self.document, self.list, self.is_sketch) =
            (State::Outside, Record::default(), None, false);
        Ok(())
    }

    /// Sets the number of the next feature.
    pub(super) fn set_number(&mut self, number: u64) {
        self.number = number;
    }

    /// Reads the next object into the record; `None` at the end of the file.
    pub(super) fn step(&mut self, record: &mut Record) -> Result<Option<ScannedItem>> {
        *record = Record::default();
        self.used = 0;
        loop {
            match self.state {
                State::Outside => match self.peek()? {
                    None => return Ok(None),
                    Some(b'{') => {
                        self.at += 1;
                        (self.document, self.list) = (Record::default(), None);
                        self.state = State::Members { is_first: true };
                    }
                    Some(other) => return Err(self.unexpected(Some(other), "an object")),
                },
                State::Members { is_first } => {
                    let Some(key) = self.key(is_first)? else {
                        self.state = State::Outside;
                        *record = std::mem::take(&mut self.document);
                        return Ok(Some(ScannedItem::Document(self.list)));
                    };
                    let list = match key.as_str() {
                        "features" => Some(List::Features),
                        "geometries" => Some(List::Geometries),
                        _ => None,
                    };
                    if let Some(list) = list
                        && self.peek()? == Some(b'[')
                    {
                        if self.list.is_some() {
                            return Err(self.wrong("a second list of features", "only one"));
                        }
                        self.at += 1;
                        self.list = Some(list);
                        self.state = State::List { list, is_first: true };
                        continue;
                    }
                    self.state = State::Members { is_first: false };
                    let mut document = std::mem::take(&mut self.document);
                    self.member(&key, &mut document)?;
                    self.document = document;
                }
                State::List { list, is_first } => {
                    let mut next = self.peek()?;
                    if next == Some(b']') {
                        self.at += 1;
                        self.state = State::Members { is_first: false };
                        continue;
                    }
                    if !is_first {
                        if next != Some(b',') {
                            return Err(self.unexpected(next, "a comma or the end of the list"));
                        }
                        self.at += 1;
                        next = self.peek()?;
                    }
                    if next != Some(b'{') {
                        return Err(self.unexpected(next, "an object"));
                    }
                    self.state = State::List { list, is_first: false };
                    self.object(record)?;
                    return Ok(Some(ScannedItem::Element(list)));
                }
            }
        }
    }

    /// Reads the members of an object.
    fn object(&mut self, record: &mut Record) -> Result<()> {
        self.at += 1;
        let mut is_first = true;
        while let Some(key) = self.key(is_first)? {
            self.member(&key, record)?;
            is_first = false;
        }
        Ok(())
    }

    /// Reads the value of a member.
    fn member(&mut self, key: &str, record: &mut Record) -> Result<()> {
        let Some(place) = MEMBERS.iter().position(|member| *member == key) else { return self.value(None) };
        match (self.is_sketch, key) {
            (true, "coordinates" | "geometries") => self.value(None),
            (true, "geometry") if self.peek()? == Some(b'{') => {
                let mut geometry = Record::default();
                self.object(&mut geometry)?;
                record.0[place] = geometry.0[0].take();
                Ok(())
            }
            _ => {
                let mut bytes = Vec::new();
                self.value(Some(&mut bytes))?;
                let text = String::from_utf8(bytes);
                record.0[place] = Some(text.map_err(|error| self.wrong(&error.to_string(), "UTF-8"))?);
                Ok(())
            }
        }
    }

    /// Reads the name of the next member and the colon; `None` at the end of the object.
    fn key(&mut self, is_first: bool) -> Result<Option<String>> {
        let mut next = self.peek()?;
        if next == Some(b'}') {
            self.at += 1;
            return Ok(None);
        }
        if !is_first {
            if next != Some(b',') {
                return Err(self.unexpected(next, "a comma or the end of the object"));
            }
            self.at += 1;
            next = self.peek()?;
        }
        if next != Some(b'"') {
            return Err(self.unexpected(next, "the name of a member"));
        }
        let used = self.used;
        let mut bytes = Vec::new();
        self.value(Some(&mut bytes))?;
        self.used = used;
        let key = serde_json::from_slice(&bytes)
            .map_err(|error| self.wrong(&error.to_string(), "the name of a member"))?;
        match self.peek()? {
            Some(b':') => self.at += 1,
            other => return Err(self.unexpected(other, "a colon")),
        }
        Ok(Some(key))
    }

    /// Skips a value; appends its bytes to `into`, if given.
    fn value(&mut self, mut into: Option<&mut Vec<u8>>) -> Result<()> {
        let first = self.peek()?;
        let is_nested = matches!(first, Some(b'{' | b'['));
        if !is_nested && !matches!(first, Some(b'"' | b'-' | b't' | b'f' | b'n' | b'0'..=b'9')) {
            return Err(self.unexpected(first, "a value"));
        }
        let is_bare = !is_nested && first != Some(b'"');
        let (mut depth, mut in_string, mut is_escaped) = (0, false, false);
        loop {
            if self.at == self.end && !self.fill()? {
                return if is_bare { Ok(()) } else { Err(self.unexpected(None, "the end of a value")) };
            }
            let mut marks = 0;
            let chunk = &self.buffer[self.at..self.end];
            let mut bytes = chunk.iter().enumerate();
            // End of the value, if it is in this chunk.
            let end = loop {
                let Some((index, &byte)) = bytes.next() else { break None };
                if in_string {
                    match byte {
                        _ if is_escaped => is_escaped = false,
                        b'\\' => is_escaped = true,
                        b'"' => {
                            in_string = false;
                            if depth == 0 {
                                break Some(index + 1);
                            }
                        }
                        _ => {}
                    }
                    continue;
                }
                match byte {
                    b'"' if is_bare => break Some(index),
                    b'"' => in_string = true,
                    b'{' | b'[' => {
                        depth += 1;
                        marks += 1;
                        if depth > MAX_DEPTH {
                            return Err(self.wrong(&format!("values nested {depth} deep"), "fewer levels"));
                        }
                    }
                    b'}' | b']' if depth == 0 => break Some(index),
                    b'}' | b']' => {
                        depth -= 1;
                        if depth == 0 {
                            break Some(index + 1);
                        }
                    }
                    b',' | b':' if depth > 0 => marks += 1,
                    b',' | b':' | b' ' | b'\t' | b'\r' | b'\n' | SEPARATOR if depth == 0 => {
                        break Some(index);
                    }
                    _ => {}
                }
            };
            let taken = end.unwrap_or(chunk.len());
            if let Some(into) = &mut into {
                into.extend_from_slice(&chunk[..taken]);
                self.used += taken as u64 + BYTES_EACH * marks;
                if self.used > self.memory {
                    return Err(Error::TooLarge {
                        path: self.path.clone(),
                        what: format!("feature {}", self.number),
                        needed: self.used,
                        limit: self.memory,
                        advice: "allow more memory, or divide the feature".into(),
                    });
                }
            }
            self.at += taken;
            if end.is_some() {
                return Ok(());
            }
        }
    }

    /// Returns the next non-blank byte; `None` at the end of the file.
    fn peek(&mut self) -> Result<Option<u8>> {
        loop {
            if self.at == self.end && !self.fill()? {
                return Ok(None);
            }
            match self.buffer[self.at] {
                b' ' | b'\t' | b'\r' | b'\n' => self.at += 1,
                // Separators between documents are skipped, and a byte order mark before the first.
                SEPARATOR if matches!(self.state, State::Outside) => self.at += 1,
                0xef if self.before == 0
                    && self.buffer[..self.end].starts_with(b"\xef\xbb\xbf")
                    && self.at == 0 =>
                {
                    self.at = 3;
                }
                byte => return Ok(Some(byte)),
            }
        }
    }

    /// Reads more; returns whether there are any bytes.
    fn fill(&mut self) -> Result<bool> {
        self.before += self.end as u64;
        (self.at, self.end) = (0, 0);
        // The first three bytes are read together, so that a byte order mark is not split.
        while self.end < 3 {
            let read =
                self.input.read(&mut self.buffer[self.end..]).map_err(Error::io(&self.path, "read"))?;
            if read == 0 {
                break;
            }
            self.end += read;
        }
        Ok(self.end > 0)
    }

    fn unexpected(&self, found: Option<u8>, expected: &str) -> Error {
        let found = match found {
            None => "the end of the file".into(),
            Some(byte) if byte.is_ascii_graphic() => format!("`{}`", byte as char),
            Some(byte) => format!("a byte {byte}"),
        };
        self.wrong(&found, expected)
    }

    fn wrong(&self, found: &str, expected: &str) -> Error {
        let at = self.before + self.at as u64;
        Error::corrupt(&self.path, format!("GeoJSON, byte {at}, feature {}", self.number), found, expected)
    }
}

/// Separator before each document of a sequence (RFC 7464).
const SEPARATOR: u8 = 0x1e;
