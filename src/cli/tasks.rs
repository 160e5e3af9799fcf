//! The list of subcommands by task.

use clap::{Command, CommandFactory as _};

use super::Cli;

/// Tasks and their subcommands. Each subcommand is listed once.
const TASKS: [(&str, &[&str]); 6] = [
    ("Look at a file", &["show", "info", "get", "render", "legend", "dump"]),
    (
        "Make a file",
        &["build", "shard", "transform", "combine", "manifest", "convert", "contours", "section", "export"],
    ),
    ("Ask", &["point", "stats", "find"]),
    ("Change, and look back", &["edit", "log", "diff", "blame", "revert", "compact"]),
    ("Check", &["verify", "recover"]),
    ("Other", &["serve", "completions", "help"]),
];

/// Returns the program's arguments, with the list of its subcommands by task.
pub(super) fn program() -> Command {
    let mut command = Cli::command();
    command.build();
    let about = |name: &str| {
        let found = command.get_subcommands().find(|command| command.get_name() == name);
        found.and_then(Command::get_about).map(ToString::to_string).unwrap_or_default()
    };
    let mut list = String::new();
    for (task, names) in TASKS {
        list += &format!("{task}:\n");
        for name in names {
            list += &format!("  {name:<12} {}\n", about(name).trim_end_matches('.'));
        }
        list += "\n";
    }
    // (clap would treat braces as placeholders.)
    let list = list.replace(['{', '}'], "");
    Cli::command().help_template(format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}Options:\n{{options}}{{after-help}}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_subcommand_has_its_task() {
        let mut command = Cli::command();
        command.build();
        let mut all: Vec<&str> = command.get_subcommands().map(Command::get_name).collect();
        let mut listed: Vec<&str> = TASKS.iter().flat_map(|(_, names)| *names).copied().collect();
        all.sort_unstable();
        listed.sort_unstable();
        assert_eq!(listed, all);
        let help = program().render_help().to_string();
        assert!(help.contains("show") && help.contains("Show a file in the terminal"), "{help}");
    }
}
