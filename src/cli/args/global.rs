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
}

impl Global {
    /// Makes the pool of threads that everything runs on as large as was asked for.
    pub(crate) fn start_threads(&self) {
        if let Some(threads) = self.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
            pool.build_global().expect("no thread pool is running yet");
        }
    }
}
