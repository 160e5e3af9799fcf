//! Appends records to a file, in extents, and makes commits of them.

use std::mem;
use std::path::PathBuf;

use super::commit::{Commit, Written};
use super::extents::{ExtentKind, GRAIN, HEAD, LONG, PAGE, head};
use super::form::{Field, Form, LONGEST};
use super::medium::Medium;
use super::meta::Meta;
use super::share::{Shares, hash};
use crate::store::Storage;
use crate::{Error, Result};

/// Bytes that wait to be written.
const WAITING: usize = 4 << 20;

/// Writes a file behind what it has already.
pub(super) struct Appender {
    pub(super) medium: Box<dyn Medium>,
    path: PathBuf,
    form: Form,
    /// Where the first byte that waits belongs.
    start: u64,
    /// Bytes that wait.
    waiting: Vec<u8>,
    /// Where in them the extent starts that is being made.
    extent: Option<(usize, ExtentKind)>,
    pub(super) written: Written,
    shares: Option<Shares>,
    /// What is on the medium, for comparing with what is written; read anew when it has grown.
    storage: Option<Box<dyn Storage>>,
    /// The content of a record that is looked for.
    content: Vec<u8>,
    /// Something failed: what is on the medium is not known.
    poisoned: bool,
}

impl Appender {
    /// Goes on behind `end`. `share` has the bytes of memory for finding equal subtrees.
    pub(super) fn new(
        medium: Box<dyn Medium>,
        path: PathBuf,
        form: Form,
        end: u64,
        share: Option<u64>,
    ) -> Appender {
        Appender {
            medium,
            path,
            form,
            start: end.next_multiple_of(PAGE),
            waiting: Vec::new(),
            extent: None,
            written: Written::default(),
            shares: share.map(Shares::new),
            storage: None,
            content: Vec::new(),
            poisoned: false,
        }
    }

    /// Where the next byte will be.
    pub(super) fn position(&self) -> u64 {
        self.start + self.waiting.len() as u64
    }

    /// Makes sure that an extent of a kind is open that has room.
    fn open(&mut self, kind: ExtentKind) -> Result<()> {
        if let Some((start, open)) = self.extent
            && (open != kind || self.waiting.len() - start > LONG)
        {
            self.close();
        }
        if self.waiting.len() > WAITING {
            self.flush()?;
        }
        if self.extent.is_none() {
            self.extent = Some((self.waiting.len(), kind));
            self.waiting.resize(self.waiting.len() + HEAD, 0);
        }
        Ok(())
    }

    /// Ends the extent.
    fn close(&mut self) {
        let Some((start, kind)) = self.extent.take() else { return };
        let place = self.start + start as u64;
        let head = head(kind, place, &self.waiting[start + HEAD..]);
        self.waiting[start..start + HEAD].copy_from_slice(&head);
        let end = self.position().next_multiple_of(GRAIN);
        self.waiting.resize((end - self.start) as usize, 0);
    }

    /// Writes what waits.
    pub(super) fn flush(&mut self) -> Result<()> {
        self.close();
        if !self.waiting.is_empty() {
            let (start, waiting) = (self.start, mem::take(&mut self.waiting));
            self.attempt("write", |medium| medium.write(start, &waiting))?;
            self.start += waiting.len() as u64;
            self.waiting = waiting;
            self.waiting.clear();
            self.storage = None;
        }
        Ok(())
    }

    /// After a failure nobody knows what is on the medium, and trying again would not tell: nothing more is written.
    fn attempt(
        &mut self,
        doing: &'static str,
        act: impl FnOnce(&mut dyn Medium) -> std::io::Result<()>,
    ) -> Result<()> {
        if self.poisoned {
            let advice = "an earlier write or sync failed; open the file again, its last commit is whole";
            return Err(Error::unsupported(&self.path, "going on after a failure", advice));
        }
        let done = act(&mut *self.medium);
        self.poisoned = done.is_err();
        done.map_err(Error::io(&*self.path, doing))
    }

    /// Writes a record, its zone behind it, and tells where it is; or where an equal one is.
    pub(super) fn record(&mut self, representative: &[u8], fields: &[Field<'_>], zone: &[u8]) -> Result<u64> {
        let mut shares = self.shares.take();
        let address = match &mut shares {
            Some(shares) => self.share(shares, representative, fields, zone),
            None => self.write_record(representative, fields, zone),
        };
        self.shares = shares;
        address
    }

    fn write_record(&mut self, representative: &[u8], fields: &[Field<'_>], zone: &[u8]) -> Result<u64> {
        self.open(ExtentKind::Records)?;
        let address = self.position();
        let first = self.waiting.len();
        self.waiting.resize(first + self.form.states, 0);
        self.waiting.extend_from_slice(representative);
        let mut states = 0u32;
        for (child, field) in fields.iter().enumerate() {
            let state = match field {
                Field::Void => 0,
                Field::Leaf(value) => {
                    self.waiting.extend_from_slice(value);
                    1
                }
                Field::Inner(to) => {
                    let (state, bytes, length) = self.form.point(address, *to);
                    self.waiting.extend_from_slice(&bytes[..length]);
                    state
                }
            };
            states |= state << (2 * child);
        }
        self.waiting.extend_from_slice(zone);
        let bytes = states.to_le_bytes();
        self.waiting[first..first + self.form.states].copy_from_slice(&bytes[..self.form.states]);
        self.written.records += 1;
        self.written.bytes += (self.waiting.len() - first) as u64;
        if self.form.far < 8 && address >> (8 * self.form.far) != 0 {
            let advice = "compact it into a new file";
            return Err(Error::unsupported(&self.path, "a file too long for its pointers", advice));
        }
        Ok(address)
    }

    /// What a record says, wherever it stands: pointers are places.
    fn content_of(content: &mut Vec<u8>, representative: &[u8], fields: &[Field<'_>], zone: &[u8]) {
        content.clear();
        content.push(zone.is_empty().into());
        content.extend_from_slice(representative);
        for field in fields {
            match field {
                Field::Void => content.push(0),
                Field::Leaf(value) => {
                    content.push(1);
                    content.extend_from_slice(value);
                }
                Field::Inner(address) => {
                    content.push(2);
                    content.extend_from_slice(&address.to_le_bytes());
                }
            }
        }
        content.extend_from_slice(zone);
    }

    fn share(
        &mut self,
        shares: &mut Shares,
        representative: &[u8],
        fields: &[Field<'_>],
        zone: &[u8],
    ) -> Result<u64> {
        let mut content = mem::take(&mut self.content);
        Self::content_of(&mut content, representative, fields, zone);
        let hash = hash(&content);
        let mut found = None;
        for known in shares.find(hash) {
            // (The lowest bit says whether there is a zone, which a record does not say of itself.)
            let (address, has_zone) = (known >> 1, known & 1 == 1);
            if has_zone != zone.is_empty() && self.says(address, &content, zone.len())? {
                found = Some(address);
                break;
            }
        }
        self.content = content;
        if let Some(address) = found {
            self.written.shared += 1;
            let pointer = usize::from(self.form.near);
            let fields: usize = fields
                .iter()
                .map(|field| match field {
                    Field::Void => 0,
                    Field::Leaf(value) => value.len(),
                    Field::Inner(_) => pointer,
                })
                .sum();
            self.written.spared += (self.form.head() + fields + zone.len()) as u64;
            return Ok(address);
        }
        let address = self.write_record(representative, fields, zone)?;
        shares.put(hash, address << 1 | u64::from(!zone.is_empty()));
        Ok(address)
    }

    /// Whether the record at an address has this content, with so many bytes of zone.
    fn says(&mut self, address: u64, content: &[u8], zone: usize) -> Result<bool> {
        if address < self.start && self.storage.is_none() {
            self.storage = Some(self.medium.storage()?);
        }
        let most = LONGEST + zone;
        let read;
        let bytes = match (&self.storage, address.checked_sub(self.start)) {
            (_, Some(at)) => &self.waiting[at as usize..],
            (Some(storage), None) => {
                read = storage.read(address, most.min((storage.len() - address) as usize))?;
                &read[..]
            }
            (None, None) => return Ok(false),
        };
        let form = &self.form;
        let Some(states) = form.states_of(bytes) else { return Ok(false) };
        let mut at = form.head();
        let mut fields = [Field::Void; 8];
        for (child, field) in fields[..form.children].iter_mut().enumerate() {
            match states >> (2 * child) & 3 {
                0 => {}
                1 => {
                    let Some(value) = bytes.get(at..at + form.value) else { return Ok(false) };
                    *field = Field::Leaf(value);
                    at += form.value;
                }
                state => {
                    let Some(to) = form.pointer(bytes, at, state, address) else { return Ok(false) };
                    *field = Field::Inner(to);
                    at += form.pointer_size(state);
                }
            }
        }
        let (Some(representative), Some(zone)) =
            (bytes.get(form.states..form.head()), bytes.get(at..at + zone))
        else {
            return Ok(false);
        };
        let mut said = Vec::with_capacity(content.len());
        Self::content_of(&mut said, representative, &fields[..form.children], zone);
        Ok(said == content)
    }

    /// Writes an extent of its own and tells where it starts.
    pub(super) fn extent(&mut self, kind: ExtentKind, bytes: &[u8]) -> Result<u64> {
        self.close();
        self.open(kind)?;
        let start = self.position() - HEAD as u64;
        self.waiting.extend_from_slice(bytes);
        self.close();
        Ok(start)
    }

    /// Makes what was written durable, and then the commit the newest. Tells the meta slot.
    pub(super) fn commit(&mut self, commit: &Commit) -> Result<Meta> {
        let place = self.extent(ExtentKind::Commit, &commit.to_bytes()?)?;
        self.flush()?;
        let meta = Meta { sequence: commit.sequence, commit: place, end: self.position() };
        self.attempt("sync", |medium| medium.sync())?;
        self.attempt("write the meta slot", |medium| medium.write(meta.place(), &meta.to_bytes()))?;
        self.attempt("sync", |medium| medium.sync())?;
        self.start = self.start.next_multiple_of(PAGE);
        self.written = Written::default();
        Ok(meta)
    }
}
