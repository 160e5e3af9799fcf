//! The options on the command line, and whether the command accepts them for its input.

use anyhow::{Result, bail};
use clap::parser::ValueSource;
use clap::{ArgMatches, Command};

/// Long names of the subcommand's options on the command line, except required ones. Global options
/// and values from the environment are not included: the latter are ignored where they have no
/// meaning.
// Each kind of file lists the options that it accepts, not those that it rejects. A new or
// forgotten option is thus refused until its effect is written down.
#[derive(Clone, Debug, Default)]
pub(crate) struct GivenOptions(Vec<String>);

/// Resource limits. They are accepted also where the work cannot reach them.
const LIMITS: [&str; 2] = ["--memory", "--max-bytes"];

impl GivenOptions {
    /// Collects the options of a command, or of its subcommand.
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

    /// Returns the first given option that is not in `fitting`.
    pub(crate) fn other(&self, fitting: &[&str]) -> Option<&str> {
        let is_other = |name: &&str| !fitting.contains(name) && !LIMITS.contains(name);
        self.0.iter().map(String::as_str).find(is_other)
    }

    /// Fails if a given option has no meaning for the output or the query. `what` names it in the
    /// message.
    pub(crate) fn check(&self, what: &str, fitting: &[&str]) -> Result<()> {
        match self.other(fitting) {
            Some(option) => bail!("{option}: has no effect on {what}"),
            None => Ok(()),
        }
    }
}
