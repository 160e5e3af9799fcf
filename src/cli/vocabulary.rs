//! One table of names: an option has the same meaning in all commands, and the documentation lists
//! it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use clap::{Arg, Command, CommandFactory};

/// The page with the table.
const PAGE: &str = include_str!("../../docs/options.md");

/// Table of the effect of each option of each command, which a test of the program checks
/// (`tests/program/cli_options.rs`).
const EFFECTS: &str = include_str!("../../tests/program/option_effects.txt");

/// Returns all commands. Nested commands have both names.
fn commands() -> Vec<(String, Command)> {
    let mut program = super::Cli::command();
    program.build();
    let mut found = Vec::new();
    for command in program.get_subcommands().filter(|command| command.get_name() != "help") {
        let name = command.get_name().to_string();
        for inner in command.get_subcommands().filter(|inner| inner.get_name() != "help") {
            found.push((format!("{name} {}", inner.get_name()), inner.clone()));
        }
        found.push((name, command.clone()));
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    found
}

fn options(command: &Command) -> impl Iterator<Item = &Arg> {
    command
        .get_arguments()
        .filter(|arg| arg.get_long().is_some_and(|name| !["help", "version"].contains(&name)))
}

/// Returns the cells of the page's table rows that begin with `begin`.
fn rows(begin: &str) -> Vec<Vec<&'static str>> {
    let rows = PAGE.lines().filter(|line| line.starts_with(begin));
    rows.map(|row| row.trim_matches('|').split(" | ").map(|cell| cell.trim().trim_matches('`')).collect())
        .collect()
}

#[test]
fn every_option_has_one_meaning() {
    let mut meanings: BTreeMap<String, (&str, Vec<String>)> = BTreeMap::new();
    for row in rows("| `--") {
        let [name, meaning, ..] = row[..] else { panic!("docs/options.md: {row:?}") };
        assert!(
            meanings.insert(name.into(), (meaning, Vec::new())).is_none(),
            "docs/options.md: two rows of {name}"
        );
    }
    let (mut wrong, mut shorts) = (String::new(), BTreeMap::new());
    for (command, arguments) in commands() {
        for option in options(&arguments) {
            let name = format!("--{}", option.get_long().unwrap());
            let help = option.get_help().map(ToString::to_string).unwrap_or_default();
            let short = *shorts.entry(name.clone()).or_insert(option.get_short());
            assert_eq!(
                option.get_short(),
                short,
                "{name} of {command} has another letter than in other commands"
            );
            match meanings.get_mut(&name) {
                None => writeln!(wrong, "{name} of {command} is not in docs/options.md").unwrap(),
                Some((meaning, used)) if help.starts_with(*meaning) => used.push(command.clone()),
                Some((meaning, _)) => {
                    writeln!(wrong, "{name} of {command} is `{help}`, not `{meaning}`").unwrap();
                }
            }
        }
    }
    for row in rows("| `--") {
        let used = meanings[row[0]].1.join(", ");
        let everywhere = commands().len() == meanings[row[0]].1.len();
        let expected = if everywhere { "all" } else { &used };
        if row[2] != expected {
            writeln!(wrong, "{} is an option of: {expected}; docs/options.md says: {}", row[0], row[2])
                .unwrap();
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn every_command_is_listed() {
    let listed: Vec<_> =
        rows("| `spinney ").iter().map(|row| row[0]["spinney ".len()..].to_string()).collect();
    let all: Vec<_> = commands().into_iter().map(|(name, _)| name).collect();
    assert_eq!(listed, all);
}

/// Returns command and option of each line with an option's effect.
fn effects() -> BTreeSet<(String, String)> {
    let lines = EFFECTS.lines().filter(|line| line.contains("[--"));
    lines
        .map(|line| {
            let (_, command) = line.split_once(" | ").expect("an effect and a command");
            let (before, option) = command.split_once("[--").expect("an option in brackets");
            let option = option.split([' ', ']']).next().unwrap_or_default();
            let name = match before.split(' ').collect::<Vec<_>>()[..] {
                ["edit", _, change, ..] => format!("edit {change}"),
                ["shard", task, ..] => format!("shard {task}"),
                [name, ..] => name.to_string(),
                [] => unreachable!("a split has a part"),
            };
            (name, format!("--{option}"))
        })
        .collect()
}

#[test]
fn every_option_has_an_effect() {
    let (effects, mut all, mut wrong) = (effects(), BTreeSet::new(), String::new());
    for (command, arguments) in commands() {
        for option in options(&arguments) {
            let name = format!("--{}", option.get_long().unwrap());
            // (An option of all commands needs a line for one of them.)
            let is_global = option.is_global_set();
            let has_effect =
                effects.iter().any(|(of, named)| *named == name && (is_global || *of == command));
            // (Commands with subcommands have only the global options.)
            if !has_effect && !arguments.has_subcommands() {
                writeln!(wrong, "{name} of {command}").unwrap();
            }
            all.insert((command.clone(), name));
        }
    }
    assert!(wrong.is_empty(), "tests/program/option_effects.txt has no line for:\n{wrong}");
    let unknown: Vec<_> = effects.difference(&all).collect();
    assert!(unknown.is_empty(), "no options: {unknown:?}");
}
