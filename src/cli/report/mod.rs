//! Output of subcommands: results as text and JSON, and reports about the work.

pub(crate) mod commit;
pub(crate) mod exit;
mod found;
mod output;
mod printable;
mod progress;
pub(crate) mod quantity;
pub(crate) mod solid;
pub(crate) mod unit;
mod wording;

use std::fmt::Display;
use std::io::{self, IsTerminal as _, Write};
use std::path::Path;
use std::process::ExitCode;

use anyhow::Result;
use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use spinney::raw::io::redacted;
use spinney::raw::ops::Conversion;
use spinney::raw::report::printable_json;
use spinney::{Dataset, Output};

pub(crate) use found::Found;
pub(crate) use output::{report_built, report_output};
use printable::printable;
pub(crate) use printable::{PrintableWriter, csv_field, printable_line};
pub(crate) use progress::Work;

use super::Global;
use super::args::GivenOptions;

impl Global {
    /// Prints a line with a heading to standard error, unless `--quiet`. It is not part of the
    /// result.
    pub(crate) fn report(&self, heading: &str, text: impl Display) {
        if !self.quiet {
            // A closed standard error is no reason to fail.
            let _ = writeln!(io::stderr(), "{heading:<10} {}", printable(&redacted(&text.to_string())));
        }
    }
}

impl Global {
    /// Reports each conversion of a file. Resampling is not included: the operation reports that
    /// itself.
    pub(crate) fn report_conversions(&self, conversions: &[Conversion]) {
        for conversion in conversions.iter().filter(|conversion| conversion.what != "grid") {
            self.report("converted", conversion);
        }
    }
}

impl Global {
    /// Reports if the numbers of a level are approximate.
    pub(crate) fn report_approximate(&self, tree: &Dataset, level: u8) {
        if tree.is_approximate(level) {
            let text = format_args!("computed from level {level} of {}, not from cells", tree.depth());
            self.report("approximate", text);
        }
    }

    /// Reports if an output has approximate overviews.
    pub(crate) fn report_overviews(&self, tree: &Dataset) {
        if tree.is_approximate(0) {
            let text = "overviews are computed from coarse levels, not from cells; for exact ones, run `spinney transform` first";
            self.report("approximate", text);
        }
    }
}

/// Prints an error, in terms of the options on the command line.
pub(crate) fn complain(error: &anyhow::Error, given: &GivenOptions) {
    let message = wording::message_of(error, given);
    let _ = writeln!(io::stderr(), "spinney: {}", printable(&redacted(&message)));
}

/// Prints a page of help, with colours on a terminal, and returns the exit code.
pub(crate) fn print_help(page: &StyledStr) -> ExitCode {
    let text = if io::stdout().is_terminal() { page.ansi().to_string() } else { page.to_string() };
    let done = writeln!(io::stdout(), "{}", text.trim_end());
    if done.is_ok() { ExitCode::SUCCESS } else { ExitCode::from(exit::BROKEN_PIPE) }
}

/// Adds the advice to write the output with `-o` to the error for an argument too many that is the
/// name of a file, if the command has such an option.
pub(crate) fn suggest_output(error: &mut clap::Error, program: &clap::Command) {
    let (Some(ContextValue::String(word)), Some(ContextValue::StyledStr(usage))) =
        (error.get(ContextKind::InvalidArg), error.get(ContextKind::Usage))
    else {
        return;
    };
    let is_file = !word.starts_with('-')
        && Path::new(word).extension().is_some()
        && !word.chars().any(|character| character.is_control());
    if error.kind() != ErrorKind::UnknownArgument || !is_file {
        return;
    }
    // The usage has the names of the program and the subcommands, before all options.
    let (usage, mut command) = (usage.to_string(), program);
    for name in usage.split_whitespace().skip_while(|name| *name != program.get_name()).skip(1) {
        let Some(inner) = command.find_subcommand(name) else { break };
        command = inner;
    }
    let is_option = |option: &clap::Arg| option.get_long() == Some("output");
    let has_positional = command.get_positionals().any(|own| own.get_id() == "last");
    if command.get_arguments().any(is_option) && !has_positional {
        let tip = format!("write the output with -o: '-o {word}'");
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
}

/// Prints help, or the error in the command line, and returns the exit code.
pub(crate) fn explain_usage(error: &clap::Error) -> ExitCode {
    let text = error.render().to_string();
    let shown = redacted(&text);
    let clean = printable(&shown);
    let clean = wording::in_words(&clean);
    // (`print` uses colours on a terminal. Help only has the program's own strings, whose addresses
    // are examples: nothing is redacted.)
    let is_own = !error.use_stderr();
    let _ = if is_own || *clean == text { error.print() } else { write!(io::stderr(), "{clean}") };
    ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2))
}

/// Prints a warning.
pub(crate) fn warn(text: &str) {
    let _ = writeln!(io::stderr(), "warning    {}", printable(&redacted(text)));
}

/// Prints text of the result to standard output.
pub(crate) fn print_text(text: &str) -> Result<()> {
    Ok(io::stdout().write_all(printable(text).as_bytes())?)
}

/// Returns standard output for a table that is printed if no file was named for it.
pub(crate) fn printed_output() -> Output {
    Output::to_writer(Path::new("-"), Box::new(PrintableWriter::new(io::stdout())))
}

/// Returns the beginning of a string, with each further line indented by `indent` spaces.
pub(crate) fn shortened(text: &str, indent: usize) -> String {
    const MAX_CHARACTERS: usize = 200;
    let start: String = text.chars().take(MAX_CHARACTERS).collect();
    let more = if start.len() < text.len() { "..." } else { "" };
    let lines: Vec<&str> = start.lines().collect();
    lines.join(&format!("\n{}", " ".repeat(indent))) + more
}

/// Prints the result as JSON.
pub(crate) fn print_json(value: &serde_json::Value) -> Result<()> {
    print_text(&printable_json(&format!("{value:#}\n")))
}
