//! Options of all subcommands.

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
}

/// Threads that are started at most, whatever is asked for: more only take memory.
const MAX_THREADS: u16 = 256;

impl Global {
    /// Makes the pool of threads that everything runs on as large as was asked for, and files be read as was asked
    /// for.
    pub(crate) fn start(&self) {
        if self.positioned {
            spinney::io::prefer_positioned_reads();
        }
        if let Some(threads) = self.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.min(MAX_THREADS).into());
            pool.build_global().expect("no thread pool is running yet");
        }
    }
}
