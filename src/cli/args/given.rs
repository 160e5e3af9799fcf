//! The options that were given, and whether the command takes them for its input.

use anyhow::{Result, bail};
use clap::parser::ValueSource;
use clap::{ArgMatches, Command};

/// Long names of the options of a subcommand that were given on the command line, but for those that it requires. (Those of all
/// subcommands are for everything, and what the environment says is left aside where it has no meaning.)
//
// A kind of file lists the options that it takes, and not those that it does not: an option that is new, or was forgotten, is refused until
// its effect is written down.
#[derive(Clone, Debug, Default)]
pub(crate) struct GivenOptions(Vec<String>);

/// Options that limit what a command takes, which hold where it takes less.
const LIMITS: [&str; 2] = ["--memory", "--max-bytes"];

impl GivenOptions {
    /// The options that were given to a program.
    pub(super) fn of(command: &Command, matches: &ArgMatches) -> GivenOptions {
        if let Some((name, inner)) = matches.subcommand()
            && let Some(command) = command.find_subcommand(name)
        {
            return GivenOptions::of(command, inner);
        }
        let given = command.get_arguments().filter(|option| {
            let source = matches.value_source(option.get_id().as_str());
            let is_for_all = option.is_global_set() || option.is_required_set();
            !is_for_all && source == Some(ValueSource::CommandLine)
        });
        GivenOptions(given.filter_map(|option| option.get_long()).map(|name| format!("--{name}")).collect())
    }

    /// Whether an option was given.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.0.iter().any(|given| given == name)
    }

    /// An option that was given and is none of those that fit.
    pub(crate) fn other(&self, fitting: &[&str]) -> Option<&str> {
        let is_other = |name: &&str| !fitting.contains(name) && !LIMITS.contains(name);
        self.0.iter().map(String::as_str).find(is_other)
    }

    /// Fails if an option was given that means nothing for the output or the query.
    pub(crate) fn check(&self, what: &str, fitting: &[&str]) -> Result<()> {
        match self.other(fitting) {
            Some(option) => bail!("{option}: means nothing for {what}"),
            None => Ok(()),
        }
    }
}
