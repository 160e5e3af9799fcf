//! The command line: a module per subcommand, and the options and the output that they share.

mod args;
mod blame;
mod build;
mod combine;
mod compact;
mod completions;
mod contours;
mod convert;
mod diff;
mod dump;
mod edit;
mod exact;
mod export;
mod features;
mod find;
mod get;
mod help;
mod index;
mod info;
mod legend;
mod lines;
mod log;
mod manifest;
mod overlay;
mod point;
mod points;
mod recover;
mod render;
mod report;
mod revert;
mod section;
mod serve;
mod shard;
mod show;
mod signals;
mod stats;
mod stdio;
mod transform;
mod verify;
#[cfg(test)]
mod vocabulary;

use std::io::{self, IsTerminal as _};
use std::path::Path;
use std::process::ExitCode;

use anyhow::Result;
use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use spinney::Dataset;
use spinney::FileAccess;

use self::args::{Global, words};
use self::report::exit::{BROKEN_PIPE, exit_code};

/// Store rasters and solids that are larger than memory as quadtrees and octrees, with fast access
/// to any region at any level of detail
#[derive(Parser)]
#[command(name = "spinney", version, propagate_version = true, max_term_width = 100, after_help = EXAMPLES)]
struct Cli {
    #[command(flatten)]
    global: Global,
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  spinney build world.tif -o world.goblin              build a tree of a raster
  spinney show world.goblin                            show it in the terminal
  spinney info world.goblin                            print its properties
  spinney get world.goblin -o small.png --size 1024    write an image of it
  spinney build bunny.ply -o bunny.goblin              build a tree of a solid
  spinney render bunny.goblin -o bunny.png             write an image of the solid
  spinney build world.tif -o world.autumn              build a tree that can be edited
  spinney help build                                   describe a command

Exit codes: 0 success, 1 failure, 2 usage error, 130 interrupted.";

/// Subcommands. A new one is a module, a variant here and an arm in [`Command::run`].
#[derive(Subcommand)]
enum Command {
    Build(Box<build::Args>),
    Index(Box<index::Args>),
    Shard(shard::Args),
    Show(show::Args),
    Info(info::Args),
    Get(get::Args),
    Point(point::Args),
    Stats(stats::Args),
    Find(find::Args),
    Contours(contours::Args),
    Section(section::Args),
    Render(render::Args),
    Legend(legend::Args),
    Dump(dump::Args),
    Export(export::Args),
    Transform(transform::Args),
    Combine(combine::Args),
    Manifest(manifest::Args),
    Edit(edit::Args),
    Log(log::Args),
    Blame(blame::Args),
    Diff(diff::Args),
    Revert(revert::Args),
    Recover(recover::Args),
    Compact(compact::Args),
    Convert(convert::Args),
    Verify(verify::Args),
    Serve(serve::Args),
    Completions(completions::Args),
}

impl Command {
    fn run(self, global: &Global) -> Result<ExitCode> {
        match self {
            Command::Build(args) => build::run(*args, global),
            Command::Index(args) => index::run(*args, global),
            Command::Shard(args) => shard::run(args, global),
            Command::Show(args) => show::run(&args, global),
            Command::Blame(args) => blame::run(&args, global),
            Command::Info(args) => info::run(&args, global),
            Command::Get(args) => get::run(&args, global),
            Command::Point(args) => point::run(&args, global),
            Command::Stats(args) => stats::run(&args, global),
            Command::Find(args) => find::run(&args, global),
            Command::Contours(args) => contours::run(&args, global),
            Command::Section(args) => section::run(&args, global),
            Command::Render(args) => render::run(&args, global),
            Command::Legend(args) => legend::run(&args, global),
            Command::Dump(args) => dump::run(&args, global),
            Command::Export(args) => export::run(&args, global),
            Command::Transform(args) => transform::run(args, global),
            Command::Combine(args) => combine::run(args, global),
            Command::Manifest(args) => manifest::run(&args, global),
            Command::Edit(args) => edit::run(args, global),
            Command::Log(args) => log::run(&args, global),
            Command::Diff(args) => diff::run(&args, global),
            Command::Revert(args) => revert::run(&args, global),
            Command::Recover(args) => recover::run(&args, global),
            Command::Compact(args) => compact::run(&args, global),
            Command::Convert(args) => convert::run(&args, global),
            Command::Serve(args) => serve::run(&args, global),
            Command::Verify(args) => return verify::run(&args, global),
            Command::Completions(args) => completions::run(args),
        }
        .map(|()| ExitCode::SUCCESS)
    }
}

/// Opens a tree file of any type, and prints its remark as a warning.
fn open(path: &Path, access: &FileAccess) -> Result<Dataset> {
    let tree = spinney::raw::dataset::open(path, &access.into())?;
    if let Some(remark) = tree.remark() {
        report::warn(&format!("{}: {remark}", path.display()));
    }
    Ok(tree)
}

/// Returns the program's arguments.
fn program() -> clap::Command {
    Cli::command()
}

/// Runs the program with its command-line arguments.
pub(crate) fn main() -> ExitCode {
    let words: Vec<_> = words().collect();
    if let Some(page) = help::page(&words, io::stdout().is_terminal()) {
        return match page {
            Ok(page) => report::print_help(&page),
            Err(error) => report::explain_usage(&error),
        };
    }
    let mut program = program();
    let parsed = program.try_get_matches_from_mut(words).and_then(|matches| {
        let mut cli = Cli::from_arg_matches(&matches)?;
        cli.global.remember(&program, &matches);
        Ok(cli)
    });
    let Cli { mut global, command } = match parsed {
        Ok(cli) => cli,
        Err(mut error) => {
            report::suggest_output(&mut error, &program);
            return report::explain_usage(&error);
        }
    };
    stdio::refuse_closed_stdout();
    signals::report_lost_pages();
    let done = global.start().map_err(anyhow::Error::from).and_then(|()| command.run(&global));
    global.finish();
    match done {
        Ok(code) => code,
        Err(error) => {
            let code = exit_code(&error);
            if code != BROKEN_PIPE {
                report::complain(&error, global.given());
            }
            if stdio::stdout_was_closed() {
                report::complain(&anyhow::anyhow!("standard output is closed"), global.given());
            }
            ExitCode::from(code)
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn arguments_are_consistent() {
        super::program().debug_assert();
    }
}
