//! Output files that appear whole or not at all.

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
use crate::url::{local_path, shown, url_of};
use crate::{Error, Result};

/// Destination of output: a new file that appears whole or not at all, or standard output.
///
/// A file is written under a temporary name in the target's directory. [`Output::commit`] renames
/// it to the target's name after its bytes are on the disk. Readers of an older file of that name
/// keep it. Dropping the output without a commit removes the temporary file; if the process is
/// killed, the next output of that name removes it. If the name is a symbolic link, the file that
/// it leads to is created or replaced.
pub struct Output {
    path: PathBuf,
    sink: Sink,
    /// Bytes appended so far, and their maximum.
    written: u64,
    most: u64,
    access: FileAccess,
    /// Record to write when the output is complete, if any.
    completion: Option<CompletionRecord>,
}

enum Sink {
    File {
        file: BufWriter<TemporaryFile>,
        /// Declared after `file`, and so dropped after it.
        _unfinished: Unfinished,
        /// Final path of the file, with symbolic links resolved.
        target: PathBuf,
        /// Whether the final path is remote. The file is then uploaded on commit, and `target` is
        /// next to the temporary file.
        is_remote: bool,
        /// Whether the commit fails if the file exists by then.
        create_new: bool,
    },
    /// A remote file that is uploaded while it is written.
    Remote { file: Box<dyn RemoteWriter>, create_new: bool },
    /// Standard output, a device or a pipe, which cannot be replaced by a file.
    Stream(BufWriter<Box<dyn Write + Send>>),
}

/// A file with a temporary name until it is finished.
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

/// Size of the write buffer. Larger writes, such as most segments, bypass it.
const BUFFER: usize = 1 << 16;

impl Output {
    /// Starts a local file at `path`; `-` is standard output. Devices and named pipes are written
    /// to directly. [`FileAccess::create`] also creates remote files.
    ///
    /// # Errors
    /// If `path` is a directory, or no file can be created in its directory.
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
            let is_directory = io::Error::from(io::ErrorKind::IsADirectory);
            return Err(Error::io(path, "create a file")(is_directory));
        } else if std::fs::metadata(path).is_ok_and(|there| !there.is_file()) {
            let stream = File::options().write(true).open(path).map_err(Error::io(path, "open"))?;
            Sink::Stream(BufWriter::with_capacity(BUFFER, Box::new(stream)))
        } else {
            let is_remote = url_of(path).is_some();
            let target = if is_remote {
                // A missing client is detected before any file is created.
                access.client(path)?;
                directory_of(path).join("spinney-upload")
            } else {
                follow_links(path).map_err(Error::io(path, "follow the symbolic link"))?
            };
            let file = temporary(&target).map_err(|cause| not_created(path, &target, &cause))?;
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
        Output::new(path, Sink::Remote { file, create_new: false }, access)
    }

    /// Sets the access for files that accompany the output, and for the input files of the
    /// operation that writes it.
    #[must_use]
    pub fn with_access(self, access: &FileAccess) -> Output {
        Output { access: access.clone(), ..self }
    }

    /// Returns the access for files that accompany the output, and for the input files of the
    /// operation that writes it.
    pub fn access(&self) -> &FileAccess {
        &self.access
    }

    /// Announces the approximate size in bytes, if it is known before the first byte is written. A
    /// remote file's upload parts are made large enough for it.
    pub fn expect(&mut self, bytes: u64) {
        if let Sink::Remote { file, .. } = &mut self.sink {
            file.expect(bytes);
        }
    }

    /// Creates an output to any writer, such as memory. The name is for messages, and for formats
    /// that are selected by it.
    pub fn to_writer(name: &Path, writer: Box<dyn Write + Send>) -> Output {
        let sink = Sink::Stream(BufWriter::with_capacity(BUFFER, writer));
        Output::new(name, sink, &FileAccess::default())
    }

    /// Starts a file at `path`, or continues an unfinished one, and returns how many bytes it has
    /// already.
    ///
    /// Until [`Output::commit`] the file is stored as `path` with the suffix `.partial`, even if
    /// the output is dropped.
    ///
    /// # Errors
    /// If the file is remote, cannot be created or read, or is being written by another process.
    pub fn resumable(path: &Path) -> Result<(Output, u64)> {
        if url_of(path).is_some() {
            let advice = "write to a local file, and copy it when it is complete";
            return Err(Error::unsupported(path, "resuming a remote output", advice));
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
            // The previous holder of the lock may have renamed the file after it was opened here.
            let own = FileId::of(&file).map_err(Error::io(&partial, "stat"))?;
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

    /// Returns the path of a local [resumable](Output::resumable) file before its commit.
    ///
    /// # Errors
    /// If symbolic links form a cycle, or there are more than 40.
    pub fn partial_path(path: &Path) -> Result<PathBuf> {
        let path = &*local_path(path);
        Ok(partial_of(&follow_links(path).map_err(Error::io(path, "follow the symbolic link"))?))
    }

    /// Returns the path of the temporary file; `None` for streams and uploads.
    pub fn unfinished_path(&self) -> Option<&Path> {
        let Sink::File { file, .. } = &self.sink else { return None };
        Some(file.get_ref().file.path())
    }

    /// Truncates the file to `length` bytes, and continues there.
    pub fn truncate(&mut self, length: u64) -> io::Result<()> {
        let Sink::File { file, .. } = &mut self.sink else { return Err(io::ErrorKind::Unsupported.into()) };
        file.flush()?;
        let file = &mut file.get_mut().file;
        file.as_file().set_len(length)?;
        self.written = length;
        io::Seek::seek(file, io::SeekFrom::End(0)).map(drop)
    }

    /// Makes the bytes written so far durable.
    pub fn sync(&mut self) -> io::Result<()> {
        let Sink::File { file, .. } = &mut self.sink else { return Ok(()) };
        file.flush()?;
        let TemporaryFile { file, faults } = file.get_ref();
        faults.sync()?;
        file.as_file().sync_data()
    }

    /// Sets the maximum size in bytes, if one is given. A write beyond it fails; the caller then
    /// drops the output, which removes the file.
    #[must_use]
    pub fn with_limit(self, most: impl Into<Option<u64>>) -> Output {
        Output { most: most.into().unwrap_or(self.most), ..self }
    }

    /// Checks, before any byte is written, that there is space for `needed` bytes: an estimate of
    /// the minimum size.
    ///
    /// # Errors
    /// [`Error::InsufficientSpace`] if `needed` exceeds the limit, or the free space in the
    /// output's directory.
    pub fn check_space(&self, needed: u64) -> Result<()> {
        let insufficient = |limit, whose| {
            let advice = "nothing was written; select a window or a coarser level (see `spinney transform`)";
            Err(Error::InsufficientSpace {
                path: self.path.clone(),
                needed,
                limit,
                whose,
                advice: advice.into(),
            })
        };
        if needed > self.most {
            return insufficient(self.most, "are allowed");
        }
        let Sink::File { target, .. } = &self.sink else { return Ok(()) };
        match free_space(directory_of(target)) {
            Some(free) if needed > free => insufficient(free, "are free in its directory"),
            _ => Ok(()),
        }
    }

    /// Returns the final path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Simulates failures of writes and syncs of a file, for tests.
    #[must_use]
    pub fn with_faults(mut self, faults: Arc<dyn Faults>) -> Output {
        if let Sink::File { file, .. } = &mut self.sink {
            file.get_mut().faults = MayFail(Some(faults));
        }
        self
    }

    /// Whether bytes go to a local file until the commit, and not to a stream or an upload.
    pub fn is_file(&self) -> bool {
        matches!(self.sink, Sink::File { .. })
    }

    /// Returns the directory for temporary files: the file's, since space is needed there anyway,
    /// or the system's if the output is no local file.
    pub fn temporary_directory(&self) -> PathBuf {
        match self.is_file() {
            true => directory_of(self.path()).to_path_buf(),
            false => std::env::temp_dir(),
        }
    }

    /// Overwrites bytes of a file that were written before. Streams and uploads do not support
    /// that.
    pub fn overwrite(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        let Sink::File { file, .. } = &mut self.sink else { return Err(io::ErrorKind::Unsupported.into()) };
        file.flush()?;
        let TemporaryFile { file, faults } = file.get_mut();
        faults.write_all_at(file.as_file(), bytes, offset)?;
        // Positioned writes move the cursor on some systems.
        io::Seek::seek(file, io::SeekFrom::End(0)).map(drop)
    }

    /// Returns the file as a backend for writes in any order; `None` for streams and uploads.
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

    /// Makes [`Output::commit`] fail if the file exists by then, instead of replacing it.
    pub fn keep_existing(&mut self) {
        if let Sink::File { create_new, .. } | Sink::Remote { create_new, .. } = &mut self.sink {
            *create_new = true;
        }
    }

    /// Returns a function that starts the file again, from its first byte, after this output was
    /// dropped. `None` if bytes go to a stream or an upload, which cannot be undone.
    pub fn restart(&self) -> Option<impl FnOnce() -> Result<Output> + use<>> {
        let Sink::File { create_new, .. } = self.sink else { return None };
        let (path, access, most) = (self.path.clone(), self.access.clone(), self.most);
        Some(move || {
            let mut output = Output::open(&path, &access)?.with_limit(most);
            if create_new {
                output.keep_existing();
            }
            Ok(output)
        })
    }

    /// Sets a record that is written when the file is complete, before it is renamed.
    pub fn record_completion(&mut self, record: CompletionRecord) {
        self.completion = Some(record);
    }

    /// Removes the temporary files of all uncommitted outputs of this process, for a program that
    /// is about to exit without dropping them.
    pub fn remove_unfinished() {
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        for path in unfinished.drain(..) {
            let _ = std::fs::remove_file(&path).or_else(|_| std::fs::remove_dir_all(&path));
        }
    }

    /// Writes all bytes to the disk, under the temporary name.
    pub(super) fn prepare(&mut self) -> io::Result<()> {
        let Sink::File { file, .. } = &mut self.sink else { return Ok(()) };
        file.flush()?;
        let TemporaryFile { file, faults } = file.get_ref();
        faults.sync()?;
        file.as_file().sync_all()
    }

    /// Puts the finished file in place, durably.
    ///
    /// The permissions of an existing file are kept; a new file gets the usual ones.
    ///
    /// # Errors
    /// If that fails, or a file exists that must be kept: see [`Output::keep_existing`]. The new
    /// file is then removed.
    pub fn commit(self) -> Result<()> {
        let path = self.path;
        match self.sink {
            Sink::Stream(mut out) => out.flush().map_err(Error::io(path, "write")),
            Sink::Remote { file, create_new } => file.commit(create_new),
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
                // The bytes are durable before the name leads to them. Syncing the directory last
                // makes the rename durable.
                faults.sync().and_then(|()| file.as_file().sync_all()).map_err(Error::io(&path, "sync"))?;
                if let Some(record) = &self.completion {
                    let mut whole = File::open(file.path()).map_err(Error::io(&path, "read"))?;
                    record.write(&mut whole)?;
                }
                // Atomic, so that no file can appear between a check and the rename.
                let persisted =
                    if create_new { file.persist_noclobber(&target) } else { file.persist(&target) };
                let file = persisted.map_err(|failed| match failed.error {
                    cause if create_new && cause.kind() == io::ErrorKind::AlreadyExists => {
                        already_exists_error(&path)
                    }
                    cause => Error::io(&path, "rename the temporary file to it")(cause),
                })?;
                // The next writer must not find the file locked. Closing the file is not enough
                // while a process that is being spawned has a copy of the descriptor.
                let _ = file.unlock();
                sync_directory(directory_of(&target)).map_err(Error::io(&path, "sync its directory"))
            }
        }
    }
}

/// Returns the error for a file that must be new, but exists.
pub fn already_exists_error(path: &Path) -> Error {
    let advice = "nothing was written; choose another name, or remove that file first";
    Error::unsupported(path, "replacing a file that another process has created", advice)
}

/// Temporary files of this process.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A temporary file or directory, for [`Output::remove_unfinished`].
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// Registers a path as unfinished.
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
            Sink::Remote { file, .. } => file.write(bytes),
            Sink::Stream(out) => out.write(bytes),
        }?;
        self.written += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.sink {
            Sink::File { file, .. } => file.flush(),
            Sink::Remote { file, .. } => file.flush(),
            Sink::Stream(out) => out.flush(),
        }
    }
}

/// Returns the error for an output whose temporary file cannot be created. It names the output's
/// directory, not the temporary file.
fn not_created(path: &Path, target: &Path, cause: &io::Error) -> Error {
    let directory = directory_of(target);
    let name = shown(directory);
    let text = match std::fs::metadata(directory) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            format!("the directory {name} does not exist; create it first")
        }
        Ok(there) if !there.is_dir() => format!("{name} is a file, expected a directory"),
        _ => {
            // (`tempfile` appends the temporary file's path.)
            let text = cause.to_string();
            format!("in the directory {name}: {}", text.split(" at path ").next().unwrap_or(&text))
        }
    };
    Error::io(path, "create the file")(io::Error::new(cause.kind(), text))
}

/// Number of random letters and digits between a temporary file's prefix and suffix.
const RANDOM: usize = 6;

const SUFFIX: &str = ".partial";

/// Maximum number of bytes of a file's name in its temporary name. With all that surrounds them,
/// they fit where names may have 255 bytes.
const MAX_PREFIX: usize = 200;

/// Maximum number of symbolic links that are followed consecutively, as in Linux.
const MAX_LINKS: usize = 40;

/// Resolves symbolic links. The file need not exist.
fn follow_links(path: &Path) -> io::Result<PathBuf> {
    let mut target = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        match std::fs::read_link(&target) {
            // An absolute link replaces the directory.
            Ok(next) => target = directory_of(&target).join(next),
            // No link, or no file.
            Err(_) => return Ok(target),
        }
    }
    Err(io::Error::other("too many symbolic links"))
}

/// Returns the prefix of the names of temporary files for a target.
fn prefix(target: &Path) -> String {
    let name = target.file_name().unwrap_or_default();
    let text = name.to_string_lossy();
    if text.len() <= MAX_PREFIX {
        return format!(".{text}.");
    }
    // Long names may have the same beginning: a hash distinguishes them.
    let hash = xxhash_rust::xxh3::xxh3_64(name.as_encoded_bytes());
    let end = (0..=MAX_PREFIX - 17).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
    format!(".{}~{hash:016x}.", &text[..end])
}

/// Creates a file next to the target, with a lock that shows other processes that it is being
/// written.
fn temporary(target: &Path) -> io::Result<tempfile::NamedTempFile> {
    let prefix = prefix(target);
    let directory = directory_of(target);
    remove_abandoned(directory, &prefix);
    loop {
        let file = tempfile::Builder::new()
            .prefix(&prefix)
            .suffix(SUFFIX)
            .rand_bytes(RANDOM)
            .tempfile_in(directory)?;
        // Until it is locked, another process may consider it abandoned and remove it. Without file
        // locks no process removes abandoned files.
        let taken = matches!(file.as_file().try_lock(), Err(TryLockError::WouldBlock));
        if !taken && file.path().exists() {
            return Ok(file);
        }
    }
}

/// Removes files that killed processes have left: temporary files for the same target that no
/// process has locked. Failures are ignored.
fn remove_abandoned(directory: &Path, prefix: &str) {
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let random = name.to_str().and_then(|name| name.strip_prefix(prefix)?.strip_suffix(SUFFIX));
        let is_ours = random.is_some_and(|random| {
            random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric())
        });
        if !is_ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        // The lock is held during the removal, so that its creator cannot lock the file meanwhile.
        if let Ok(file) = File::open(entry.path())
            && file.try_lock().is_ok()
        {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Returns the path of a resumable file or directory before it is finished.
pub fn partial_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(SUFFIX);
    name.into()
}

/// Returns the directory of a path, which holds the temporary files of its file; for a remote path
/// the system's temporary directory.
pub fn directory_of(path: &Path) -> &Path {
    static TEMPORARY: LazyLock<PathBuf> = LazyLock::new(std::env::temp_dir);
    if url_of(path).is_some() {
        return &TEMPORARY;
    }
    path.parent().filter(|directory| !directory.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Returns the path of a file's GDAL sidecar: `a.tif.aux.xml` for `a.tif`.
pub fn sidecar_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".aux.xml");
    name.into()
}

/// Makes a rename in a directory durable.
pub fn sync_directory(directory: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(directory)?.sync_all() } else { Ok(()) }
}
