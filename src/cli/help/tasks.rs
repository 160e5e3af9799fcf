//! The program's own page of help: its subcommands by task.

use clap::Command;

/// Tasks and their subcommands. Each subcommand is listed once.
const TASKS: [(&str, &[&str]); 6] = [
    ("View a file", &["show", "info", "get", "render", "legend", "dump"]),
    (
        "Make a file",
        &[
            "build",
            "index",
            "shard",
            "transform",
            "combine",
            "manifest",
            "convert",
            "contours",
            "section",
            "export",
        ],
    ),
    ("Query", &["point", "stats", "find"]),
    ("Edit, and read the history", &["edit", "log", "diff", "blame", "revert", "compact"]),
    ("Check", &["verify", "recover"]),
    ("Other", &["serve", "completions", "help"]),
];

/// End of the short page.
const SHORT_NOTES: &str =
    "\n`spinney --help` has examples and the options of all commands; `spinney COMMAND -h` those of one.";

/// Returns the program with the list of its subcommands: by task, or on the short page without
/// headings.
pub(super) fn laid_out(command: Command, is_short: bool) -> Command {
    let about = |name: &str| {
        let found = command.get_subcommands().find(|command| command.get_name() == name);
        let about = found.and_then(Command::get_about).map(ToString::to_string).unwrap_or_default();
        about.trim_end_matches('.').to_string()
    };
    let mut list = String::new();
    for (task, names) in TASKS {
        let lines: String = names.iter().map(|name| format!("  {name:<12} {}\n", about(name))).collect();
        list += &if is_short { lines } else { format!("{task}:\n{lines}\n") };
    }
    let template = match is_short {
        true => "{about-with-newline}\n{usage-heading} {usage}\n\n{before-help}",
        false => "{about-with-newline}\n{usage-heading} {usage}\n\n{before-help}{all-args}{after-help}",
    };
    let list = if is_short { list + SHORT_NOTES } else { list.trim_end().to_string() };
    // (Subcommands are listed once, by task.)
    let names: Vec<String> =
        command.get_subcommands().map(|command| command.get_name().to_string()).collect();
    let command = names
        .into_iter()
        .fold(command, |command, name| command.mut_subcommand(name, |subcommand| subcommand.hide(true)));
    command.before_help(list).override_usage("spinney [OPTIONS] <COMMAND>").help_template(template)
}

#[cfg(test)]
mod tests {
    use super::TASKS;

    #[test]
    fn every_subcommand_has_its_task() {
        let mut command = crate::cli::program();
        command.build();
        let mut all: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).collect();
        let mut listed: Vec<&str> = TASKS.iter().flat_map(|(_, names)| *names).copied().collect();
        all.sort_unstable();
        listed.sort_unstable();
        assert_eq!(listed, all);
    }
}
