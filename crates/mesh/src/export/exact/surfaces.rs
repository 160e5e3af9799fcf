//! JSON fragments of CityJSON surfaces, kept in a temporary file until a part is complete.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::Job;
use super::semantics::Semantics;
use super::shells::{Shell, Shells};
use spinney_base::io::Sorter;
use spinney_base::{Error, Result};
use spinney_brep::Face;

/// Bytes after which a run ends.
const MAX_BYTES: u64 = 1 << 20;

/// Bytes of memory for sorting the runs.
const MEMORY: u64 = 64 << 20;

/// Lists of a geometry, in file order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum List {
    /// Surfaces as rings of vertex numbers.
    Boundaries,
    /// Semantics of surfaces.
    Semantics,
    /// Number of each surface's semantics.
    Values,
}

impl List {
    const ALL: [List; 3] = [List::Boundaries, List::Semantics, List::Values];
}

/// Lists of all parts. A part whose surfaces have no semantics has only boundaries.
pub(super) struct Surfaces<'a> {
    shells: &'a mut Shells,
    directory: PathBuf,
    file: BufWriter<File>,
    runs: Sorter,
    /// Number of runs. A run is a stretch of the temporary file with fragments of one list of one
    /// shell.
    count: u64,
    /// Current part and shell.
    shell: Option<(u32, u32)>,
    /// Number of faces.
    faces: u64,
    start: u64,
    at: u64,
    text: String,
    values: String,
    semantics: Semantics,
}

impl<'a> Surfaces<'a> {
    pub(super) fn new(directory: &Path, shells: &'a mut Shells) -> Result<Surfaces<'a>> {
        let file = tempfile::tempfile_in(directory).map_err(Error::io(directory, "use a temporary file"))?;
        Ok(Surfaces {
            shells,
            directory: directory.to_path_buf(),
            file: BufWriter::with_capacity(1 << 20, file),
            runs: Sorter::new(directory, MEMORY),
            count: 0,
            shell: None,
            faces: 0,
            start: 0,
            at: 0,
            text: String::new(),
            values: String::new(),
            semantics: Semantics::default(),
        })
    }

    /// Adds a surface with the vertex numbers of its corners. `values` are its values in the
    /// columns of semantics; empty if the model has none.
    pub(super) fn push(&mut self, face: &Face<'_>, numbers: &[u64], values: &[Option<String>]) -> Result<()> {
        let shell = Some((face.part, self.shells.of_face(face, self.faces)));
        self.faces += 1;
        if self.shell != shell || self.at - self.start > MAX_BYTES || self.semantics.is_full() {
            self.end_run(self.shell.is_none_or(|(part, _)| part != face.part))?;
            self.shell = shell;
        }
        self.text.clear();
        let separator = if self.at > self.start { "," } else { "" };
        self.text.push_str(separator);
        if !values.is_empty() {
            let number = self.semantics.number(face.part, values);
            let number = number.map_or("null".into(), |number| number.to_string());
            self.values.push_str(separator);
            self.values.push_str(&number);
        }
        let mut start = 0;
        for &end in face.ring_ends {
            self.text.push_str(if start == 0 { "[[" } else { ",[" });
            for (i, number) in numbers[start..end].iter().enumerate() {
                if i > 0 {
                    self.text.push(',');
                }
                self.text.push_str(&number.to_string());
            }
            self.text.push(']');
            start = end;
        }
        self.text.push_str(if start == 0 { "[]\n" } else { "]\n" });
        self.write()
    }

    /// Appends the text to the temporary file.
    fn write(&mut self) -> Result<()> {
        self.at += self.text.len() as u64;
        self.file.write_all(self.text.as_bytes()).map_err(Error::io(&self.directory, "use a temporary file"))
    }

    /// Ends the current runs. The run of semantics ends only at the end of the part, or if the
    /// buffer is full.
    fn end_run(&mut self, is_last: bool) -> Result<()> {
        let Some((part, shell)) = self.shell.filter(|_| self.at > self.start) else { return Ok(()) };
        self.push_run(part, shell, List::Boundaries)?;
        self.text = std::mem::take(&mut self.values);
        self.write()?;
        self.push_run(part, shell, List::Values)?;
        if is_last || self.semantics.is_full() {
            self.text = self.semantics.take();
            self.write()?;
            self.push_run(part, shell, List::Semantics)?;
        }
        Ok(())
    }

    /// Adds the bytes written since the last run as a run, unless there are none.
    fn push_run(&mut self, part: u32, shell: u32, list: List) -> Result<()> {
        let len = self.at - self.start;
        if len == 0 {
            return Ok(());
        }
        // Output order is by part: boundaries of its shells, semantics, values of its shells. These
        // are less than 2^34 lists, as a model has at most 2^32 faces. The run count orders the
        // runs of a list. It stays below 2^30, since a model of that size exceeds the face limit.
        let (first, shells) = (u64::from(self.shells.first(part)), u64::from(self.shells.count(part)));
        let own = u64::from(shell) - first;
        let place = 2 * first
            + u64::from(part)
            + match list {
                List::Boundaries => own,
                List::Semantics => shells,
                List::Values => shells + 1 + own,
            };
        let key = place << 30 | self.count & ((1 << 30) - 1);
        let mut item = Vec::with_capacity(21);
        item.extend(shell.to_le_bytes());
        item.extend(self.start.to_le_bytes());
        item.extend(len.to_le_bytes());
        item.push(list as u8);
        self.count += 1;
        self.start = self.at;
        self.runs.push(key, &item)
    }

    /// Passes all lists to `each` as text fragments, part by part and shell by shell. The caller
    /// writes the commas between runs. Returns the number of surfaces and semantics members that
    /// were left out.
    pub(super) fn finish(
        mut self,
        job: &Job<'_>,
        each: &mut dyn FnMut(Shell, List, &str) -> Result<()>,
    ) -> Result<u64> {
        self.end_run(true)?;
        let failed = || Error::io(&self.directory, "use a temporary file");
        let mut file = self.file.into_inner().map_err(io::IntoInnerError::into_error).map_err(failed())?;
        let mut bytes = Vec::new();
        self.runs.finish(&mut |item| {
            job.progress.check()?;
            let eight = |at: usize| u64::from_le_bytes(item[at..at + 8].try_into().unwrap_or_default());
            let shell = self.shells.get(u32::from_le_bytes(item[..4].try_into().unwrap_or_default()));
            let (start, len) = (eight(4), eight(12));
            let list = List::ALL[usize::from(item[20])];
            if list == List::Values && !self.semantics.has_some(shell.part) {
                return Ok(());
            }
            file.seek(SeekFrom::Start(start)).map_err(failed())?;
            bytes.clear();
            (&mut file).take(len).read_to_end(&mut bytes).map_err(failed())?;
            each(shell, list, str::from_utf8(&bytes).unwrap_or_default())
        })?;
        Ok(self.semantics.lost())
    }
}
