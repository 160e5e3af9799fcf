//! Options of all subcommands.

use std::path::Path;
#[cfg(feature = "remote")]
use std::time::Duration;

use anyhow::bail;
use spinney::FileAccess;

use super::GivenOptions;

/// Options of all subcommands.
#[derive(clap::Args)]
pub(crate) struct Global {
    /// Print errors only
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    /// Threads to work with [default: one per core]
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Read files by positioned reads instead of mapping them: for network folders, and files that others may
    /// cut short
    #[arg(long, global = true)]
    positioned: bool,
    /// Keep what is read of files elsewhere (https://, s3://, gs://, az://) in a folder, for the next time
    #[arg(long, global = true, value_name = "FOLDER")]
    cache: Option<std::path::PathBuf>,
    /// Bytes of packed segments, unpacked, that are kept in memory for the next use [default: 64M]
    #[arg(long, global = true, value_name = "BYTES", value_parser = super::memory::parse_bytes)]
    cache_memory: Option<u64>,
    /// Bytes between two parts of a file elsewhere up to which these are fetched with one request [default: 32K]
    #[arg(long, global = true, value_name = "BYTES", value_parser = super::memory::parse_bytes)]
    request_gap: Option<u64>,
    /// Seconds that a request for a remote file may take, its repetitions included; one try may take half of them
    #[arg(
        long,
        global = true,
        value_name = "SECONDS",
        env = "SPINNEY_REMOTE_TIMEOUT",
        default_value_t = 60.0
    )]
    #[arg(value_parser = super::parse_seconds)]
    remote_timeout: f64,
    /// File of whole URLs, one a line, with the queries (signatures, tokens) and passwords that manifests and plans of jobs do not store
    #[arg(long, global = true, value_name = "FILE", env = "SPINNEY_SIGNED_URLS")]
    signed_urls: Option<std::path::PathBuf>,
    /// Refuse remote files, whatever names them: for input of unknown origin
    #[arg(long, global = true)]
    no_remote: bool,
    /// Refuse VRT, NRRD and views files and manifests whose data are in other files: for input of unknown origin
    #[arg(long, global = true)]
    no_external: bool,
    /// Report how files were read: requests for remote files and their bytes, files that were mapped or read at positions, unpacked bytes
    /// that are kept, and threads
    #[arg(short, long, global = true)]
    verbose: bool,
    /// How files are opened and created, once the program has [started](Global::start).
    #[arg(skip)]
    access: FileAccess,
    /// Options of the subcommand that were given on the command line.
    #[arg(skip)]
    given: GivenOptions,
}

/// The lines of a text file that are not empty.
#[cfg(feature = "remote")]
fn lines_of(path: &std::path::Path) -> spinney::Result<Vec<String>> {
    let text = std::fs::read_to_string(path).map_err(spinney::Error::io(path, "read the URLs of"))?;
    Ok(text.lines().map(|line| line.trim().to_string()).filter(|line| !line.is_empty()).collect())
}

/// Threads that are started at most, whatever is asked for: more only take memory.
const MAX_THREADS: u16 = 256;

impl Global {
    /// Remembers which options of the subcommand were given.
    pub(crate) fn remember(&mut self, program: &clap::Command, matches: &clap::ArgMatches) {
        self.given = GivenOptions::of(program, matches);
    }

    /// The options of the subcommand that were given.
    pub(crate) fn given(&self) -> &GivenOptions {
        &self.given
    }

    /// Fails if an option was given that means nothing for a file, which is `what`.
    pub(crate) fn check_options(&self, file: &Path, what: &str, fitting: &[&str]) -> anyhow::Result<()> {
        match self.given.other(fitting) {
            Some(option) => bail!("{}: is {what}, for which {option} means nothing", file.display()),
            None => Ok(()),
        }
    }

    /// Makes the pool of threads that everything runs on as large as was asked for, and files be read as was asked
    /// for.
    ///
    /// # Errors
    /// If the folder for what is kept of files elsewhere cannot be used.
    pub(crate) fn start(&mut self) -> spinney::Result<()> {
        let mut access = FileAccess::new();
        if self.positioned {
            access = access.positioned(None);
        }
        if let Some(bytes) = self.cache_memory {
            access = access.unpacked_cache(bytes);
        }
        if let Some(threads) = self.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.min(MAX_THREADS).into());
            pool.build_global().expect("no thread pool is running yet");
        }
        if self.no_remote {
            access = access.no_remote();
        }
        if self.no_external {
            access = access.no_external();
        }
        #[cfg(feature = "remote")]
        if !self.no_remote {
            let mut options = spinney::remote::RemoteOptions::default();
            options.folder.clone_from(&self.cache);
            options.gap = self.request_gap.unwrap_or(options.gap);
            options.limit = Duration::from_secs_f64(self.remote_timeout);
            options.timeout = options.limit / 2;
            if let Some(list) = &self.signed_urls {
                options.signed_urls = lines_of(list)?;
            }
            options.is_stopped = crate::cli::signals::stop_is_wanted;
            access = access.remote(spinney::remote::client(options)?);
        }
        self.access = access;
        Ok(())
    }

    /// How files are opened and created.
    pub(crate) fn access(&self) -> &FileAccess {
        &self.access
    }

    /// Reports how files were read, with `--verbose`.
    pub(crate) fn finish(&self) {
        if self.verbose {
            let [mapped, positioned] = self.access.opened();
            let (kept, threads) = (self.access.unpacked().most_held(), rayon::current_num_threads());
            eprintln!(
                "{mapped} files mapped, {positioned} read at positions; at most {kept} unpacked bytes kept; {threads} threads"
            );
            eprintln!("{}", self.access.traffic());
        }
    }
}
