//! The command line: one module per subcommand, and what they share.

mod build;
mod combine;
mod compact;
mod completions;
mod diff;
mod dump;
mod edit;
mod export;
mod find;
mod get;
mod history;
mod info;
mod log;
mod model;
mod output;
mod place;
mod point;
mod progress;
mod publish;
mod quantity;
mod render;
mod revert;
mod slice;
mod solid;
mod stats;
mod transform;
mod verify;
mod viewed;

use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use spinney::dataset::Dataset;

/// What most subcommands give back.
type Result<T = (), E = anyhow::Error> = std::result::Result<T, E>;

/// Keeps pictures and solids that are larger than memory as quadtrees and octrees, any part at any level of detail straight
/// from disk.
#[derive(Parser)]
#[command(name = "spinney", version, propagate_version = true, max_term_width = 100, after_help = EXAMPLES)]
struct Cli {
    #[command(flatten)]
    global: Global,
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Start here:
  spinney build world.tif -o world.goblin              make a tree of a picture
  spinney info world.goblin                            see what is in it
  spinney get world.goblin small.png --size 1024x512   look at it
  spinney build bunny.ply -o bunny.goblin              make a tree of a solid
  spinney render bunny.goblin bunny.png                look at that
  spinney build world.tif -o world.autumn              make a tree that can be edited
  spinney help edit                                    all about that
  spinney help build                                   all about building

Exit codes: 0 fine, 1 failure, 2 wrong usage, 130 interrupted.";

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

/// A new subcommand is a module, a line here and one in [`Command::run`].
#[derive(Subcommand)]
enum Command {
    Build(build::Args),
    Info(info::Args),
    Get(get::Args),
    Point(point::Args),
    Stats(stats::Args),
    Find(find::Args),
    Render(render::Args),
    Dump(dump::Args),
    Export(export::Args),
    Transform(transform::Args),
    Combine(combine::Args),
    Edit(edit::Args),
    Log(log::Args),
    Diff(diff::Args),
    Revert(revert::Args),
    Compact(compact::Args),
    Publish(publish::Args),
    Verify(verify::Args),
    Completions(completions::Args),
}

impl Command {
    fn run(self, global: &Global) -> Result<ExitCode> {
        match self {
            Command::Build(args) => build::run(args, global),
            Command::Info(args) => info::run(&args),
            Command::Get(args) => get::run(&args, global),
            Command::Point(args) => point::run(&args),
            Command::Stats(args) => stats::run(&args, global),
            Command::Find(args) => find::run(&args),
            Command::Render(args) => render::run(&args, global),
            Command::Dump(args) => dump::run(&args),
            Command::Export(args) => export::run(&args, global),
            Command::Transform(args) => transform::run(args, global),
            Command::Combine(args) => combine::run(args, global),
            Command::Edit(args) => edit::run(args, global),
            Command::Log(args) => log::run(&args),
            Command::Diff(args) => diff::run(&args, global),
            Command::Revert(args) => revert::run(&args, global),
            Command::Compact(args) => compact::run(&args, global),
            Command::Publish(args) => publish::run(&args, global),
            Command::Verify(args) => return verify::run(&args, global),
            Command::Completions(args) => completions::run(args),
        }
        .map(|()| ExitCode::SUCCESS)
    }
}

impl Global {
    /// A line for people; not part of the result.
    pub(crate) fn say(&self, line: impl std::fmt::Display) {
        if !self.quiet {
            // Nobody may be listening, which is no reason to fail.
            let _ = writeln!(io::stderr(), "{line}");
        }
    }
}

/// Opens a tree file of any type.
fn open(path: &Path) -> Result<Dataset> {
    Ok(spinney::dataset::open(path, &Default::default())?)
}

fn print_text(text: &str) -> Result {
    Ok(io::stdout().write_all(text.as_bytes())?)
}

fn print_json(value: &serde_json::Value) -> Result {
    print_text(&format!("{value:#}\n"))
}

/// Runs the program with the arguments that it was given.
pub(crate) fn main() -> ExitCode {
    let Cli { global, command } = Cli::parse();
    if let Some(threads) = global.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        pool.build_global().expect("no thread pool is running yet");
    }
    match command.run(&global) {
        Ok(code) => code,
        Err(error) => {
            let code = exit_code(&error);
            if code != BROKEN_PIPE {
                complain(&error);
            }
            ExitCode::from(code)
        }
    }
}

/// A line about a failure.
fn complain(error: &anyhow::Error) {
    let _ = writeln!(io::stderr(), "spinney: {error:#}");
}

/// What a shell reports of a program that wrote to a closed pipe: no failure to tell about.
const BROKEN_PIPE: u8 = 141;

fn exit_code(error: &anyhow::Error) -> u8 {
    let is_broken_pipe = |error: &io::Error| error.kind() == io::ErrorKind::BrokenPipe;
    match error.downcast_ref() {
        Some(spinney::Error::Interrupted) => 130,
        Some(spinney::Error::Io { cause, .. }) if is_broken_pipe(cause) => BROKEN_PIPE,
        _ if error.downcast_ref().is_some_and(is_broken_pipe) => BROKEN_PIPE,
        _ => 1,
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn arguments_are_consistent() {
        super::Cli::command().debug_assert();
    }
}
