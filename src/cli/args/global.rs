//! Options of all subcommands.

use spinney::FileAccess;

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
    /// Tell how files elsewhere were read: rounds of requests, requests and bytes
    #[arg(short, long, global = true)]
    verbose: bool,
    /// How files are opened and created, once the program has [started](Global::start).
    #[arg(skip)]
    access: FileAccess,
}

/// Threads that are started at most, whatever is asked for: more only take memory.
const MAX_THREADS: u16 = 256;

impl Global {
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
        #[cfg(feature = "remote")]
        {
            let mut options = spinney::remote::RemoteOptions::default();
            options.folder.clone_from(&self.cache);
            options.gap = self.request_gap.unwrap_or(options.gap);
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

    /// Tells how files elsewhere were read, if that was asked for.
    pub(crate) fn finish(&self) {
        if self.verbose {
            eprintln!("{}", self.access.traffic());
        }
    }
}
