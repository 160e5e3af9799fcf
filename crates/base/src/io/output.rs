//! Writing a file so that nobody ever sees half of it.

use std::fs::{File, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use super::access::FileAccess;
use super::completion::CompletionRecord;
use super::faults::{Faults, MayFail};
use super::file_id::FileId;
use super::platform::{free_space, set_output_permissions};
use super::regular::open_regular;
use super::remote::RemoteWriter;
use super::write::{FileBackend, check_limit};
use crate::url::{local_path, url_of};
use crate::{Error, Result};

/// Destination of output: a new file that appears whole or not at all, or standard output.
///
/// A file is written under a temporary name in the target's folder and takes the target's place only in
/// [`Output::commit`], after its bytes are on the disk; readers of an older file of that name keep it.
/// Dropping the output without committing removes the temporary file; if the process is killed, the next
/// output of that name does. Where the name is a symbolic link, what it leads to is made or replaced.
pub struct Output {
    path: PathBuf,
    sink: Sink,
    /// Bytes written to the end so far, and how many there may be.
    written: u64,
    most: u64,
    access: FileAccess,
    /// The file that says that the output is whole, if there is to be one.
    completion: Option<CompletionRecord>,
}

enum Sink {
    File {
        file: BufWriter<TemporaryFile>,
        /// (Behind the file, so that it goes after it.)
        _unfinished: Unfinished,
        /// The place of the file, which the path may lead to by symbolic links.
        target: PathBuf,
        /// Whether the place is elsewhere: the file is copied there in the end, and what is named here is beside the temporary file.
        is_remote: bool,
        /// Whether a file that is there by the end is an error.
        create_new: bool,
    },
    /// A file elsewhere, which goes there while it is written.
    Elsewhere { file: Box<dyn RemoteWriter>, create_new: bool },
    /// Standard output, a device or a pipe: there is nothing to take the place of.
    Stream(BufWriter<Box<dyn Write + Send>>),
}

/// A file that has another name until it is finished.
struct TemporaryFile {
    file: tempfile::NamedTempFile,
    faults: MayFail,
}

impl Write for TemporaryFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(self.faults.arriving(bytes)?)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Larger pieces, such as most segments, are written as they are.
const BUFFER: usize = 1 << 16;

impl Output {
    /// Starts a local file at `path`; `-` is standard output. Devices and named pipes are written to as they are.
    /// [`FileAccess::create`] also creates remote files.
    ///
    /// # Errors
    /// If `path` is a folder, or no file can be made in its folder.
    pub fn create(path: &Path) -> Result<Output> {
        FileAccess::default().create(path)
    }

    fn new(path: &Path, sink: Sink, access: &FileAccess) -> Output {
        let (path, access) = (path.to_path_buf(), access.clone());
        Output { path, sink, written: 0, most: u64::MAX, access, completion: None }
    }

    /// Starts a file at `path`, local or remote.
    pub(super) fn open(path: &Path, access: &FileAccess) -> Result<Output> {
        let path = &*local_path(path);
        let sink = if path == Path::new("-") {
            Sink::Stream(BufWriter::with_capacity(BUFFER, Box::new(io::stdout())))
        } else if path.is_dir() {
            let is_folder = io::Error::from(io::ErrorKind::IsADirectory);
            return Err(Error::io(path, "create a file")(is_folder));
        } else if std::fs::metadata(path).is_ok_and(|there| !there.is_file()) {
            let stream = File::options().write(true).open(path).map_err(Error::io(path, "open"))?;
            Sink::Stream(BufWriter::with_capacity(BUFFER, Box::new(stream)))
        } else {
            let is_remote = url_of(path).is_some();
            let target = if is_remote {
                // (Known to be reached before anything is made.)
                access.client(path)?;
                folder(path).join("spinney-upload")
            } else {
                follow_links(path).map_err(Error::io(path, "follow the symbolic link"))?
            };
            let file =
                temporary(&target).map_err(Error::io(path, "create a temporary file beside the target"))?;
            Sink::File {
                _unfinished: Unfinished::new(file.path()),
                file: BufWriter::with_capacity(BUFFER, TemporaryFile { file, faults: MayFail::default() }),
                target,
                is_remote,
                create_new: false,
            }
        };
        Ok(Output::new(path, sink, access))
    }

    /// Writes to a remote file while it is uploaded.
    pub(super) fn remote(path: &Path, file: Box<dyn RemoteWriter>, access: &FileAccess) -> Output {
        Output::new(path, Sink::Elsewhere { file, create_new: false }, access)
    }

    /// Sets how files that accompany the output are created, and how those that an operation makes it of are opened.
    #[must_use]
    pub fn with_access(self, access: &FileAccess) -> Output {
        Output { access: access.clone(), ..self }
    }

    /// How the output, and files that accompany it, are created; operations that make it of files open these with it, too.
    pub fn access(&self) -> &FileAccess {
        &self.access
    }

    /// Says how many bytes there will be, about, where that is known before the first one: parts of a file elsewhere are as large as they have to
    /// be for it.
    pub fn expect(&mut self, bytes: u64) {
        if let Sink::Elsewhere { file, .. } = &mut self.sink {
            file.expect(bytes);
        }
    }

    /// Output to whatever takes bytes, such as memory; the name is for messages, and for formats that are told by it.
    pub fn to_writer(name: &Path, writer: Box<dyn Write + Send>) -> Output {
        let sink = Sink::Stream(BufWriter::with_capacity(BUFFER, writer));
        Output::new(name, sink, &FileAccess::default())
    }

    /// Starts a file at `path`, or goes on with one that was not finished: what is written stays as `path` with `.partial`
    /// behind it until [`Output::commit`], also if it is dropped. Returns how many bytes there are already.
    ///
    /// # Errors
    /// If it cannot be made or read, or is being written by somebody else.
    pub fn resumable(path: &Path) -> Result<(Output, u64)> {
        if url_of(path).is_some() {
            let advice = "write it to this machine, and copy it when it is whole";
            return Err(Error::unsupported(path, "going on with a file elsewhere", advice));
        }
        let path = &*local_path(path);
        let target = follow_links(path).map_err(Error::io(path, "follow the symbolic link"))?;
        let partial = partial_of(&target);
        let mut options = File::options();
        options.read(true).write(true).create(true).truncate(false);
        let file = loop {
            let file = open_regular(&mut options, &partial)?;
            if matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
                return Err(Error::Locked { path: partial, holder: "another process".into() });
            }
            // Whoever had the lock may have put the file in its place after it was opened here.
            let own = FileId::of(&file).map_err(Error::io(&partial, "look at"))?;
            if FileId::at(&partial).is_ok_and(|there| there == own || there.is_unique()) {
                break file;
            }
        };
        let there = file.metadata().map_err(Error::io(&partial, "read"))?.len();
        let name = tempfile::TempPath::try_from_path(&partial).map_err(Error::io(&partial, "open"))?;
        let mut file = tempfile::NamedTempFile::from_parts(file, name);
        file.disable_cleanup(true);
        io::Seek::seek(&mut file, io::SeekFrom::End(0)).map_err(Error::io(&partial, "read"))?;
        let sink = Sink::File {
            _unfinished: Unfinished(PathBuf::new()),
            file: BufWriter::with_capacity(BUFFER, TemporaryFile { file, faults: MayFail::default() }),
            target,
            is_remote: false,
            create_new: false,
        };
        Ok((Output { written: there, ..Output::new(path, sink, &FileAccess::default()) }, there))
    }

    /// The place of a local file that is [resumable](Output::resumable), before it is in its place.
    ///
    /// # Errors
    /// If its symbolic links lead nowhere.
    pub fn partial_path(path: &Path) -> Result<PathBuf> {
        let path = &*local_path(path);
        Ok(partial_of(&follow_links(path).map_err(Error::io(path, "follow the symbolic link"))?))
    }

    /// The file as it is before it is in its place.
    pub fn unfinished_path(&self) -> Option<&Path> {
        let Sink::File { file, .. } = &self.sink else { return None };
        Some(file.get_ref().file.path())
    }

    /// Cuts a file off behind so many bytes, and goes on there.
    pub fn truncate(&mut self, length: u64) -> io::Result<()> {
        let Sink::File { file, .. } = &mut self.sink else { return Err(io::ErrorKind::Unsupported.into()) };
        file.flush()?;
        let file = &mut file.get_mut().file;
        file.as_file().set_len(length)?;
        self.written = length;
        io::Seek::seek(file, io::SeekFrom::End(0)).map(drop)
    }

    /// Makes what was written so far durable.
    pub fn sync(&mut self) -> io::Result<()> {
        let Sink::File { file, .. } = &mut self.sink else { return Ok(()) };
        file.flush()?;
        let TemporaryFile { file, faults } = file.get_ref();
        faults.sync()?;
        file.as_file().sync_data()
    }

    /// Makes writing fail, and nothing be left of the file, when there would be more bytes than so many, if a number is given.
    #[must_use]
    pub fn with_limit(self, most: impl Into<Option<u64>>) -> Output {
        Output { most: most.into().unwrap_or(self.most), ..self }
    }

    /// Makes sure, before anything is written, that there is room for a number of bytes; that is an estimate of those
    /// that will be written at least.
    ///
    /// # Errors
    /// If that is more than the limit, or than is free in the output's folder.
    pub fn check_room(&self, needed: u64) -> Result<()> {
        let no_room = |limit, whose| {
            let advice =
                "nothing was written; write a part of it, or a coarser tree (see `spinney transform`)";
            Err(Error::InsufficientSpace {
                path: self.path.clone(),
                needed,
                limit,
                whose,
                advice: advice.into(),
            })
        };
        if needed > self.most {
            return no_room(self.most, "are allowed");
        }
        let Sink::File { target, .. } = &self.sink else { return Ok(()) };
        match free_space(folder(target)) {
            Some(free) if needed > free => no_room(free, "are free in its folder"),
            _ => Ok(()),
        }
    }

    /// The final path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes writes and syncs of a file fail as a test wants it.
    #[must_use]
    pub fn with_faults(mut self, faults: Arc<dyn Faults>) -> Output {
        if let Sink::File { file, .. } = &mut self.sink {
            file.get_mut().faults = MayFail(Some(faults));
        }
        self
    }

    /// Whether bytes go to a file that takes its place in the end, and not to a stream.
    pub fn is_file(&self) -> bool {
        matches!(self.sink, Sink::File { .. })
    }

    /// Overwrites bytes of a file that were written before. A stream has no such bytes.
    pub fn overwrite(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        let Sink::File { file, .. } = &mut self.sink else { return Err(io::ErrorKind::Unsupported.into()) };
        file.flush()?;
        let TemporaryFile { file, faults } = file.get_mut();
        faults.write_all_at(file.as_file(), bytes, offset)?;
        // (Where positioned writes move the cursor, too.)
        io::Seek::seek(file, io::SeekFrom::End(0)).map(drop)
    }

    /// The file as something to be written in any order, if there is one.
    pub fn backend(&self) -> Option<io::Result<FileBackend>> {
        let Sink::File { file, .. } = &self.sink else { return None };
        let TemporaryFile { file, faults } = file.get_ref();
        let copy = file.as_file().try_clone();
        Some(
            copy.map(|copy| {
                FileBackend::of_output(copy, &self.path, (faults.clone(), self.most), &self.access)
            }),
        )
    }

    /// Makes [`Output::commit`] fail if by then there is a file of that name, instead of replacing it.
    pub fn keep_existing(&mut self) {
        if let Sink::File { create_new, .. } | Sink::Elsewhere { create_new, .. } = &mut self.sink {
            *create_new = true;
        }
    }

    /// Records that a file is whole, before it takes its place.
    pub fn record_completion(&mut self, record: CompletionRecord) {
        self.completion = Some(record);
    }

    /// Removes the temporary files of all outputs of this process that are not committed, for a program that
    /// is about to end without dropping them.
    pub fn remove_unfinished() {
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        for path in unfinished.drain(..) {
            let _ = std::fs::remove_file(&path).or_else(|_| std::fs::remove_dir_all(&path));
        }
    }

    /// Writes all bytes to the disk, where the file has a name of its own until it is put in place.
    pub(super) fn prepare(&mut self) -> io::Result<()> {
        let Sink::File { file, .. } = &mut self.sink else { return Ok(()) };
        file.flush()?;
        let TemporaryFile { file, faults } = file.get_ref();
        faults.sync()?;
        file.as_file().sync_all()
    }

    /// Puts the finished file in its place, on the disk and not only in the system's memory.
    ///
    /// An existing file's permissions are kept; a new file gets the usual ones.
    ///
    /// # Errors
    /// If that fails, or there is a file that must be kept: see [`Output::keep_existing`]. The new one is gone
    /// then.
    pub fn commit(self) -> Result<()> {
        let path = self.path;
        match self.sink {
            Sink::Stream(mut out) => out.flush().map_err(Error::io(path, "write")),
            Sink::Elsewhere { file, create_new } => file.commit(create_new),
            Sink::File { file, target, is_remote, create_new, _unfinished } => {
                let file = file.into_inner().map_err(|e| Error::io(&path, "write")(e.into_error()))?;
                let TemporaryFile { file, faults } = file;
                if is_remote {
                    let mut far = self.access.append_only(&path)?;
                    let failed = || Error::io(file.path(), "upload");
                    let mut whole = File::open(file.path()).map_err(failed())?;
                    far.expect(whole.metadata().map_err(failed())?.len());
                    io::copy(&mut whole, &mut far).map_err(failed())?;
                    if create_new {
                        far.keep_existing();
                    }
                    return far.commit();
                }
                set_output_permissions(file.as_file(), &path)
                    .map_err(Error::io(&path, "set the permissions"))?;
                // The bytes are durable before the name leads to them; the folder comes last, which makes the
                // rename durable.
                faults.sync().and_then(|()| file.as_file().sync_all()).map_err(Error::io(&path, "sync"))?;
                if let Some(record) = &self.completion {
                    let mut whole = File::open(file.path()).map_err(Error::io(&path, "read"))?;
                    record.write(&mut whole)?;
                }
                // (One step, so that no file can appear between a look and the renaming.)
                let persisted =
                    if create_new { file.persist_noclobber(&target) } else { file.persist(&target) };
                let file = persisted.map_err(|failed| match failed.error {
                    cause if create_new && cause.kind() == io::ErrorKind::AlreadyExists => {
                        already_exists_error(&path)
                    }
                    cause => Error::io(&path, "put in place")(cause),
                })?;
                // Whoever edits the file next must not find it locked: closing it is not enough while a process
                // that is being started has a copy of the descriptor.
                let _ = file.unlock();
                sync_folder(folder(&target)).map_err(Error::io(&path, "sync the folder"))
            }
        }
    }
}

/// The error for a file that must be new, and is there.
pub fn already_exists_error(path: &Path) -> Error {
    let advice = "nothing was written; choose another name, or remove that file first";
    Error::unsupported(path, "replacing a file that has appeared meanwhile", advice)
}

/// Temporary files of this process.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A temporary file or folder, for [`Output::remove_unfinished`].
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// Notes that a path is unfinished.
    pub fn new(path: &Path) -> Unfinished {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_path_buf());
        Unfinished(path.to_path_buf())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).retain(|path| *path != self.0);
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        check_limit(self.written, bytes.len(), self.most)?;
        let count = match &mut self.sink {
            Sink::File { file, .. } => file.write(bytes),
            Sink::Elsewhere { file, .. } => file.write(bytes),
            Sink::Stream(out) => out.write(bytes),
        }?;
        self.written += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.sink {
            Sink::File { file, .. } => file.flush(),
            Sink::Elsewhere { file, .. } => file.flush(),
            Sink::Stream(out) => out.flush(),
        }
    }
}

/// Letters and digits between a temporary file's prefix and suffix.
const RANDOM: usize = 6;

const SUFFIX: &str = ".partial";

/// Bytes of a file's name that its temporary file's name has as well: with all that surrounds them they fit
/// where names may have 255 bytes.
const MAX_PREFIX: usize = 200;

/// Symbolic links that are followed one after the other, as many as the system follows.
const MAX_LINKS: usize = 40;

/// The file that a path leads to by symbolic links; it need not be there.
fn follow_links(path: &Path) -> io::Result<PathBuf> {
    let mut target = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        match std::fs::read_link(&target) {
            // (An absolute one replaces the folder.)
            Ok(next) => target = folder(&target).join(next),
            // No link, or nothing there.
            Err(_) => return Ok(target),
        }
    }
    Err(io::Error::other("too many symbolic links"))
}

/// The beginning of the names of temporary files for a target.
fn prefix(target: &Path) -> String {
    let name = target.file_name().unwrap_or_default();
    let text = name.to_string_lossy();
    if text.len() <= MAX_PREFIX {
        return format!(".{text}.");
    }
    // Long names may begin alike: a hash tells them apart.
    let hash = xxhash_rust::xxh3::xxh3_64(name.as_encoded_bytes());
    let end = (0..=MAX_PREFIX - 17).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
    format!(".{}~{hash:016x}.", &text[..end])
}

/// A file beside the target, with a lock that tells others that it is being written.
fn temporary(target: &Path) -> io::Result<tempfile::NamedTempFile> {
    let prefix = prefix(target);
    let folder = folder(target);
    remove_left_behind(folder, &prefix);
    loop {
        let file =
            tempfile::Builder::new().prefix(&prefix).suffix(SUFFIX).rand_bytes(RANDOM).tempfile_in(folder)?;
        // Before it is locked, another process may take it for one that was left behind. Where there are no
        // locks, nobody takes anything.
        let taken = matches!(file.as_file().try_lock(), Err(TryLockError::WouldBlock));
        if !taken && file.path().exists() {
            return Ok(file);
        }
    }
}

/// Removes what processes that were killed have left: temporary files for the same target that nobody holds a
/// lock on. What cannot be removed stays, which is no reason to fail.
fn remove_left_behind(folder: &Path, prefix: &str) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let random = name.to_str().and_then(|name| name.strip_prefix(prefix)?.strip_suffix(SUFFIX));
        let is_ours = random.is_some_and(|random| {
            random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric())
        });
        if !is_ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        // The lock is held while the file is removed, so that its maker cannot take it meanwhile.
        if let Ok(file) = File::open(entry.path())
            && file.try_lock().is_ok()
        {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// The place of a file, or folder, that can be gone on with before it is finished.
pub fn partial_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(SUFFIX);
    name.into()
}

/// The folder a path lies in, where temporary files of its file go; of a path elsewhere, the system's folder for these.
pub fn folder(path: &Path) -> &Path {
    static TEMPORARY: LazyLock<PathBuf> = LazyLock::new(std::env::temp_dir);
    if url_of(path).is_some() {
        return &TEMPORARY;
    }
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// GDAL's sidecar of a file: `a.tif.aux.xml` for `a.tif`.
pub fn sidecar_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".aux.xml");
    name.into()
}

/// Makes a rename in a folder durable.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}
