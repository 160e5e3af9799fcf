//! An output whose header is known only at the end.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use spinney_base::io::Output;
use spinney_base::{Error, Result};

/// An output whose bytes can be overwritten. Standard output cannot seek, so its content is spooled
/// in an unnamed temporary file.
pub(crate) struct Seekable {
    output: Output,
    spool: Option<BufWriter<File>>,
    position: u64,
}

impl Seekable {
    pub(crate) fn new(output: Output) -> Result<Seekable> {
        let spool = match output.is_file() {
            true => None,
            false => {
                let file = tempfile::tempfile()
                    .map_err(Error::io(output.path(), "create a temporary file for it"))?;
                Some(BufWriter::with_capacity(1 << 20, file))
            }
        };
        Ok(Seekable { output, spool, position: 0 })
    }

    pub(crate) fn path(&self) -> &Path {
        self.output.path()
    }

    /// Bytes written so far.
    pub(crate) fn position(&self) -> u64 {
        self.position
    }

    /// Appends bytes.
    pub(crate) fn append(&mut self, bytes: &[u8]) -> Result<()> {
        let written = match &mut self.spool {
            Some(spool) => spool.write_all(bytes),
            None => self.output.write_all(bytes),
        };
        self.position += bytes.len() as u64;
        written.map_err(Error::io(self.path(), "write"))
    }

    /// Overwrites bytes at the given offset.
    pub(crate) fn patch(&mut self, at: u64, bytes: &[u8]) -> Result<()> {
        let patched = match &mut self.spool {
            Some(spool) => spool.flush().and_then(|()| overwrite(spool.get_mut(), at, bytes)),
            None => self.output.overwrite(at, bytes),
        };
        patched.map_err(Error::io(self.path(), "write"))
    }

    pub(crate) fn commit(mut self) -> Result<()> {
        if let Some(mut spool) = self.spool.take() {
            let path = self.output.path().to_path_buf();
            let mut copy = || -> io::Result<()> {
                spool.flush()?;
                spool.get_mut().seek(SeekFrom::Start(0))?;
                io::copy(spool.get_mut(), &mut self.output).map(drop)
            };
            copy().map_err(Error::io(path, "write"))?;
        }
        self.output.commit()
    }
}

fn overwrite(file: &mut File, at: u64, bytes: &[u8]) -> io::Result<()> {
    file.seek(SeekFrom::Start(at))?;
    file.write_all(bytes)?;
    file.seek(SeekFrom::End(0)).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standard_output_is_buffered_in_a_file() {
        let mut output = Seekable::new(Output::create(Path::new("-")).unwrap()).unwrap();
        output.append(b"headbody").unwrap();
        output.patch(1, b"EA").unwrap();
        output.append(b"tail").unwrap();
        assert_eq!(output.position(), 12);
        let mut spool = output.spool.take().unwrap().into_inner().unwrap();
        spool.rewind().unwrap();
        assert_eq!(io::read_to_string(spool).unwrap(), "hEAdbodytail");
    }

    #[test]
    fn output_files_are_patched_in_place() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a");
        let mut output = Seekable::new(Output::create(&path).unwrap()).unwrap();
        output.append(b"headbody").unwrap();
        output.patch(1, b"EA").unwrap();
        output.append(b"tail").unwrap();
        output.commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"hEAdbodytail");
    }
}
