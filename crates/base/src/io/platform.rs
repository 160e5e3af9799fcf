//! Differences between operating systems, hidden by functions that are the same on all of them.
//!
//! Tested on Linux. macOS uses the Unix implementations, and Windows those that its API offers. On
//! targets without a file system, such as browsers, everything compiles, and opening a file fails.

use std::fs::{File, Metadata};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Sleeps for a while, so that other threads or processes can proceed. Does nothing on targets
/// without threads.
pub fn pause(time: Duration) {
    #[cfg(not(target_family = "wasm"))]
    std::thread::sleep(time);
    #[cfg(target_family = "wasm")]
    let _ = time;
}

/// Reads bytes at an offset of a file, independent of its cursor.
#[cfg(unix)]
pub fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

/// Reads bytes at an offset of a file, independent of its cursor.
#[cfg(windows)]
pub fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, offset)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            read => {
                bytes = &mut bytes[read..];
                offset += read as u64;
            }
        }
    }
    Ok(())
}

/// Reads bytes at an offset of a file. This moves the cursor, but targets without a file system
/// never call it.
#[cfg(not(any(unix, windows)))]
pub fn read_exact_at(mut file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    io::Seek::seek(&mut file, io::SeekFrom::Start(offset))?;
    io::Read::read_exact(&mut file, bytes)
}

/// Writes bytes at an offset of a file, which may lie after its end.
#[cfg(unix)]
pub fn write_all_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, offset)
}

/// Writes bytes at an offset of a file, which may lie after its end.
#[cfg(windows)]
pub fn write_all_at(file: &File, mut bytes: &[u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_write(file, bytes, offset)? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            written => {
                bytes = &bytes[written..];
                offset += written as u64;
            }
        }
    }
    Ok(())
}

/// Writes bytes at an offset of a file. This moves the cursor, as in [`read_exact_at`].
#[cfg(not(any(unix, windows)))]
pub fn write_all_at(mut file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    io::Seek::seek(&mut file, io::SeekFrom::Start(offset))?;
    io::Write::write_all(&mut file, bytes)
}

/// Makes all files below a directory durable: with one sync of the file system on Linux, file by
/// file on other systems.
pub fn sync_all_below(directory: &Path) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    {
        rustix::fs::syncfs(File::open(directory)?)?;
        Ok(())
    }
    #[cfg(not(target_os = "linux"))]
    {
        for entry in std::fs::read_dir(directory)? {
            let entry = entry?;
            let kind = entry.file_type()?;
            if kind.is_dir() {
                sync_all_below(&entry.path())?;
            } else if kind.is_file() {
                File::options().write(true).open(entry.path())?.sync_all()?;
            }
        }
        super::sync_directory(directory)
    }
}

/// Returns device and inode of a file; `None` on systems without such numbers.
pub(super) fn device_and_inode(metadata: &Metadata) -> Option<(u64, u64)> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        Some((metadata.dev(), metadata.ino()))
    }
    #[cfg(not(unix))]
    {
        let _ = metadata;
        None
    }
}

/// Returns the present path of an open file, even after a rename; `None` if the file was removed,
/// or the system does not report its path.
pub(super) fn path_of(file: &File) -> Option<PathBuf> {
    #[cfg(target_os = "linux")]
    {
        use std::os::fd::AsRawFd;
        let path = std::fs::read_link(format!("/proc/self/fd/{}", file.as_raw_fd())).ok()?;
        // The path of a removed file ends with " (deleted)", and does not exist.
        path.exists().then_some(path)
    }
    #[cfg(not(target_os = "linux"))]
    {
        let _ = file;
        None
    }
}

/// Returns the number of free bytes for files in a directory; `None` if the system does not report
/// it.
pub(super) fn free_space(directory: &Path) -> Option<u64> {
    #[cfg(unix)]
    {
        let found = rustix::fs::statvfs(directory).ok().filter(|found| found.f_frsize > 0)?;
        Some(found.f_bavail.saturating_mul(found.f_frsize))
    }
    #[cfg(not(unix))]
    {
        let _ = directory;
        None
    }
}

/// Gives a temporary file the permissions of the file that it will replace, or those of a new file.
#[cfg(unix)]
pub(super) fn set_output_permissions(file: &File, target: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let mode = match std::fs::metadata(target) {
        Ok(existing) => existing.permissions().mode() & 0o777,
        Err(_) => {
            // The mask can only be read by setting it.
            let mask = rustix::process::umask(rustix::fs::Mode::empty());
            rustix::process::umask(mask);
            // It has 16 bits on some systems, 32 on others.
            0o666 & !(u64::from(mask.bits()) as u32)
        }
    };
    file.set_permissions(std::fs::Permissions::from_mode(mode))
}

/// Does nothing on systems without Unix permissions.
#[cfg(not(unix))]
pub(super) fn set_output_permissions(_: &File, _: &Path) -> io::Result<()> {
    Ok(())
}
