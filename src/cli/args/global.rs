//! Options of all subcommands.

use std::path::Path;
use std::sync::Arc;
#[cfg(feature = "remote")]
use std::time::Duration;

use anyhow::bail;
use spinney::FileAccess;

use super::super::report;
use super::GivenOptions;
use spinney::raw::io::shown;

/// Options of all subcommands.
#[derive(clap::Args)]
#[command(next_help_heading = "Options of all commands")]
pub(crate) struct Global {
    /// Print errors only
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    /// Number of threads [default: one per core]
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Read files by positioned reads, not by mapping: for network drives
    #[arg(long, global = true)]
    positioned: bool,
    /// Cache remote reads (https, s3, gs, az) in this directory
    #[arg(long, global = true, value_name = "DIRECTORY")]
    cache: Option<std::path::PathBuf>,
    /// Maximum bytes of unpacked segments to cache [default: 64M]
    #[arg(long, global = true, value_name = "BYTES", value_parser = super::memory::parse_bytes)]
    cache_memory: Option<u64>,
    /// Merge remote reads that are at most this many bytes apart [default: 32K]
    #[arg(long, global = true, value_name = "BYTES", value_parser = super::memory::parse_bytes)]
    request_gap: Option<u64>,
    /// Seconds that a request for a remote file may take
    #[arg(
        long,
        global = true,
        value_name = "SECONDS",
        env = "SPINNEY_REMOTE_TIMEOUT",
        hide_env_values = true,
        default_value_t = 60.0
    )]
    #[arg(value_parser = super::parse_seconds)]
    remote_timeout: f64,
    /// File of complete URLs of inputs, with their signatures
    #[arg(long, global = true, value_name = "FILE", env = "SPINNEY_SIGNED_URLS", hide_env_values = true)]
    signed_urls: Option<std::path::PathBuf>,
    /// Refuse remote files: for input of unknown origin
    #[arg(long, global = true)]
    no_remote: bool,
    /// Refuse VRT, NRRD and views files and manifests of other files
    #[arg(long, global = true)]
    no_external: bool,
    /// Report how files were read: requests, bytes, mapping, threads
    #[arg(short, long, global = true)]
    verbose: bool,
    /// Access to files, once the program has [started](Global::start).
    #[arg(skip)]
    access: FileAccess,
    /// Options of the subcommand on the command line.
    #[arg(skip)]
    given: GivenOptions,
}

/// Returns the nonempty lines of a text file.
#[cfg(feature = "remote")]
fn lines_of(path: &std::path::Path) -> spinney::Result<Vec<String>> {
    let text = std::fs::read_to_string(path).map_err(spinney::Error::io(path, "read the URLs"))?;
    Ok(text.lines().map(|line| line.trim().to_string()).filter(|line| !line.is_empty()).collect())
}

/// Maximum number of threads, whatever `--threads` says: more only use memory.
const MAX_THREADS: u16 = 256;

impl Global {
    /// Records which options of the subcommand are on the command line.
    pub(crate) fn remember(&mut self, program: &clap::Command, matches: &clap::ArgMatches) {
        self.given = GivenOptions::of(program, matches);
    }

    /// Returns the subcommand's options on the command line.
    pub(crate) fn given(&self) -> &GivenOptions {
        &self.given
    }

    /// Fails if a given option has no meaning for a file of the kind `what`.
    pub(crate) fn check_options(&self, file: &Path, what: &str, fitting: &[&str]) -> anyhow::Result<()> {
        match self.given.other(fitting) {
            Some(option) => bail!("{}: is {what}, on which {option} has no effect", file.display()),
            None => Ok(()),
        }
    }

    /// Sets the size of the thread pool, and how files are read, from the options.
    ///
    /// # Errors
    /// If the cache directory or the list of signed URLs cannot be used.
    pub(crate) fn start(&mut self) -> spinney::Result<()> {
        spinney::raw::register();
        let warn = |file: &Path, text: &str| report::warn(&format!("{}: {text}", shown(file)));
        let mut access = FileAccess::new().on_warning(Arc::new(warn));
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
            options.cache_directory.clone_from(&self.cache);
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

    /// Returns the access to files.
    pub(crate) fn access(&self) -> &FileAccess {
        &self.access
    }

    /// Reports how files were read, with `--verbose`.
    pub(crate) fn finish(&self) {
        if self.verbose {
            let [mapped, positioned] = self.access.opened();
            let (cached, threads) = (self.access.unpacked().max_held(), rayon::current_num_threads());
            eprintln!(
                "{mapped} files mapped, {positioned} read by position; at most {cached} unpacked bytes cached; {threads} threads"
            );
            eprintln!("{}", self.access.traffic());
        }
    }
}
