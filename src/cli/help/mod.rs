//! Help: a short page (`-h`), a page (`--help`, `help COMMAND`), and for commands with many options
//! a page per topic (`help COMMAND TOPIC`).
//!
//! clap lays the pages out. This module chooses what is on them: examples come first, options of
//! all commands last, and options of a topic are on its page only.

mod build;
mod export;
mod find;
mod get;
mod plan;
mod stats;
mod tasks;

use std::ffi::OsString;

use clap::builder::StyledStr;
use clap::error::ErrorKind;
use clap::{Arg, Command};

/// Options of a command that are for one kind of input, output or query.
struct Topic {
    /// Word in the command line.
    name: &'static str,
    /// Description in one line: file types, or what is computed.
    summary: &'static str,
    /// Introduction of the topic's page.
    about: &'static str,
    /// Options, each with its meaning for this topic if the command's description is a general one.
    options: &'static [(&'static str, &'static str)],
    /// Command lines, one a line.
    examples: &'static [&'static str],
}

/// A command's topics. Options that are in none of them are on the command's page.
struct Topics {
    /// Noun for the topics, in the plural: "Kinds of input".
    heading: &'static str,
    topics: &'static [Topic],
    /// Options that the command shares with another one, and refuses.
    refused: &'static [&'static str],
}

/// Returns a command's name, with that of the command that it belongs to: `shard plan`.
fn name_of(command: &Command) -> &str {
    command.get_bin_name().unwrap_or_default().trim_start_matches("spinney ")
}

/// Returns the topics of a command.
fn topics_of(command: &Command) -> Option<&'static Topics> {
    Some(match name_of(command) {
        "build" => &build::TOPICS,
        "export" => &export::TOPICS,
        "find" => &find::TOPICS,
        "get" => &get::TOPICS,
        "shard plan" => &plan::TOPICS,
        "stats" => &stats::TOPICS,
        _ => return None,
    })
}

impl Topics {
    fn find(&self, name: &str) -> Option<&Topic> {
        self.topics.iter().find(|topic| topic.name == name)
    }

    /// Whether an option is not on the command's page.
    fn has_option(&self, name: &str) -> bool {
        self.refused.contains(&name)
            || self.topics.iter().any(|topic| topic.options.iter().any(|(option, _)| *option == name))
    }

    /// Returns the table of the topics.
    fn table(&self, command: &str) -> String {
        let mut table = format!("{} (options: `spinney help {command} TOPIC`):\n", self.heading);
        for topic in self.topics {
            table += &format!("  {:<9} {}\n", topic.name, topic.summary);
        }
        table
    }
}

/// Maximum width of a page.
const COLUMNS: usize = 100;

/// Kinds of pages.
#[derive(Clone, Copy)]
enum Page<'a> {
    /// At most [`SHORT_LINES`] lines: a line per option.
    Short,
    Full,
    Topic(&'a Topic),
}

/// Returns the help page that the command line requests. clap reports unknown commands. Lines are
/// as wide as the terminal, or [`COLUMNS`] if there is none.
///
/// # Errors
/// If the command has no such topic.
pub(super) fn page(words: &[OsString], is_terminal: bool) -> Option<Result<StyledStr, clap::Error>> {
    let words: Vec<&str> = words.iter().skip(1).map_while(|word| word.to_str()).collect();
    let words = words.split(|word| *word == "--").next().unwrap_or_default();
    let mut command = super::program();
    if !is_terminal {
        // (Otherwise clap uses the variable COLUMNS.)
        command = command.term_width(COLUMNS);
    }
    command.build();
    let is_short = words.contains(&"-h");
    let (is_help, mut rest) = match words {
        ["help", rest @ ..] => (true, rest),
        _ => (false, words),
    };
    if !(is_help || is_short || words.contains(&"--help")) {
        return None;
    }
    let mut depth = 0;
    while let [word, after @ ..] = rest {
        if let Some(found) = command.find_subcommand(word) {
            (command, depth) = (found.clone(), depth + 1);
        } else if is_help {
            if depth == 0 {
                return None;
            }
            let (name, topics) = (name_of(&command).to_string(), topics_of(&command));
            let problem = match (topics, topics.and_then(|topics| topics.find(word)), after) {
                (_, Some(topic), []) => return Some(Ok(laid_out(command, Page::Topic(topic)).render_help())),
                (_, Some(_), [other, ..]) => format!("`{other}` after the topic {word} of {name}"),
                (Some(topics), None, _) => format!("no topic `{word}` of {name}\n\n{}", topics.table(&name)),
                (None, None, _) => format!("`{word}`: {name} has no topics; see `spinney help {name}`"),
            };
            return Some(Err(command.error(ErrorKind::InvalidValue, problem)));
        }
        rest = after;
    }
    let page = if is_short { Page::Short } else { Page::Full };
    let mut laid_out = if depth == 0 { tasks::laid_out(command, is_short) } else { laid_out(command, page) };
    Some(Ok(laid_out.render_help()))
}

/// Splits a text after the command's options into its examples and its other paragraphs.
fn examples_of(command: &Command) -> (Vec<String>, String) {
    let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let (examples, notes): (Vec<&str>, Vec<&str>) =
        text.split("\n\n").partition(|paragraph| paragraph.starts_with("Examples:\n"));
    let examples = examples.iter().flat_map(|paragraph| paragraph.lines().skip(1));
    (examples.map(|line| line.trim().to_string()).collect(), notes.join("\n\n"))
}

/// Returns the names of the options of all commands, as a sentence.
fn global_names(command: &Command) -> String {
    let globals = command.get_arguments().filter(|option| option.is_global_set());
    let names: Vec<_> =
        globals.filter_map(|option| option.get_long()).map(|name| format!("--{name}")).collect();
    format!("Options of all commands: {}", names.join(", "))
}

/// Returns a command whose descriptions are those of a page.
fn laid_out(command: Command, page: Page<'_>) -> Command {
    let topics = topics_of(&command);
    let name = name_of(&command).to_string();
    let (mut examples, mut notes) = examples_of(&command);
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let mut about = command.get_long_about().map_or(about.clone(), |long| match page {
        Page::Short => about,
        _ => long.to_string(),
    });
    match page {
        Page::Short => {
            examples.truncate(4);
            notes = topics.map_or(String::new(), |topics| topics.table(&name) + "\n");
            notes += &global_names(&command);
            notes += &format!("\n`spinney help {name}` describes all in detail.");
        }
        Page::Full => {
            if let Some(topics) = topics {
                notes = [notes, topics.table(&name)].join("\n\n").trim_start().to_string();
            }
        }
        Page::Topic(topic) => {
            about = topic.about.to_string();
            examples = topic.examples.iter().map(ToString::to_string).collect();
            notes = format!("`spinney help {name}` describes the options that all of them have.");
        }
    }
    let hidden = |option: &Arg| {
        let of_topic = |name: &str| topics.is_some_and(|topics| topics.has_option(name));
        let long = option.get_long().unwrap_or_default();
        match page {
            Page::Short => option.is_global_set() || of_topic(long),
            Page::Full => of_topic(long),
            Page::Topic(topic) => !topic.options.iter().any(|(name, _)| *name == long),
        }
    };
    let mut command = command.mut_args(|option| {
        if option.is_positional() {
            return option;
        }
        let help = option.get_help().map(ToString::to_string).unwrap_or_default();
        let hides = hidden(&option) || option.get_id() == "version";
        let option = option.hide(hides).long_help(None::<&'static str>);
        match page {
            Page::Short => option
                .help(first_phrase(&help))
                .help_heading(None::<&'static str>)
                .hide_default_value(true)
                .hide_possible_values(true)
                .hide_env(true),
            Page::Topic(topic) => {
                let own = topic.options.iter().find(|(name, _)| option.get_long() == Some(name));
                let help =
                    own.map(|(_, help)| *help).filter(|help| !help.is_empty()).map_or(help, String::from);
                option.help(help).help_heading(None::<&'static str>)
            }
            Page::Full => option,
        }
    });
    command = command.about(about).long_about(None::<&'static str>).after_help(notes);
    if examples.is_empty() {
        return command
            .help_template("{about-with-newline}\n{usage-heading} {usage}\n\n{all-args}{after-help}");
    }
    let lines: String = examples.iter().map(|line| format!("\n  {line}")).collect();
    command
        .before_help(format!("Examples:{lines}"))
        .help_template("{about-with-newline}\n{usage-heading} {usage}\n\n{before-help}{all-args}{after-help}")
}

/// Returns the first phrase of an option's description, which fits on a line.
fn first_phrase(help: &str) -> String {
    const WIDTH: usize = 64;
    let ends = [": ", "; ", ". ", " (", " [", ", such as", ", as in"];
    let end = ends.iter().filter_map(|end| help.find(end)).min().unwrap_or(help.len());
    let phrase = help[..end].trim_end_matches('.');
    if phrase.chars().count() <= WIDTH {
        return phrase.to_string();
    }
    let words = phrase.split(' ').scan(0, |width, word| {
        *width += word.chars().count() + 1;
        (*width < WIDTH - 3).then_some(word)
    });
    words.collect::<Vec<_>>().join(" ") + " ..."
}

#[cfg(test)]
mod tests {
    use std::ffi::OsString;

    use super::super::program;
    use super::{COLUMNS, page, topics_of};

    const SHORT_LINES: usize = 40;
    const FULL_LINES: usize = 70;

    fn text(words: &[&str]) -> String {
        let words: Vec<OsString> = ["spinney"].iter().chain(words).map(OsString::from).collect();
        page(&words, false).unwrap_or_else(|| panic!("no page: {words:?}")).expect("a topic").to_string()
    }

    /// Returns the names of all commands, and of nested ones.
    fn names() -> Vec<Vec<String>> {
        let mut program = program();
        program.build();
        let mut all = vec![vec![]];
        for command in program.get_subcommands().filter(|command| command.get_name() != "help") {
            let name = command.get_name().to_string();
            let nested = command.get_subcommands().filter(|command| command.get_name() != "help");
            all.extend(nested.map(|nested| vec![name.clone(), nested.get_name().to_string()]));
            all.push(vec![name]);
        }
        all
    }

    #[test]
    fn pages_are_short() {
        for name in names() {
            let name: Vec<&str> = name.iter().map(String::as_str).collect();
            for (word, max) in [("-h", Some(SHORT_LINES)), ("--help", None)] {
                let text = text(&[&name[..], &[word]].concat());
                let lines = text.trim_end().lines().count();
                let has_topics = text.contains("TOPIC");
                let max = max.or(has_topics.then_some(FULL_LINES)).unwrap_or(usize::MAX);
                assert!(lines <= max, "{name:?} {word} has {lines} lines:\n{text}");
                let wide = text.lines().find(|line| line.chars().count() > COLUMNS);
                assert_eq!(wide, None, "{name:?} {word}");
            }
        }
    }

    #[test]
    fn every_option_is_on_a_page() {
        for name in names().into_iter().filter(|name| !name.is_empty()) {
            let name: Vec<&str> = name.iter().map(String::as_str).collect();
            let mut pages = text(&[&["help"], &name[..]].concat());
            let mut command = program();
            command.build();
            for word in &name {
                command = command.find_subcommand(word).unwrap().clone();
            }
            let longs: Vec<&str> = command.get_arguments().filter_map(|option| option.get_long()).collect();
            let topics = topics_of(&command);
            if let Some(topics) = topics {
                for topic in topics.topics {
                    for (option, _) in topic.options {
                        assert!(longs.contains(option), "{name:?} has no --{option}");
                    }
                    let page = text(&[&["help"], &name[..], &[topic.name]].concat());
                    assert!(page.contains("Examples:") && page.contains(topic.examples[0]), "{page}");
                    pages += &page;
                }
            }
            let refused = topics.map_or(&[][..], |topics| topics.refused);
            for long in longs.into_iter().filter(|long| *long != "version" && !refused.contains(long)) {
                assert!(pages.contains(&format!("--{long}")), "--{long} of {name:?}");
            }
        }
    }

    #[test]
    fn only_requests_for_help_have_a_page() {
        let page = |words: &[&str]| page(&words.iter().map(OsString::from).collect::<Vec<_>>(), false);
        for words in [
            &["spinney"][..],
            &["spinney", "info", "x.goblin"],
            &["spinney", "info", "--", "--help"],
            &["spinney", "help", "nonsense"],
        ] {
            assert!(page(words).is_none(), "{words:?}");
        }
        let unknown = page(&["spinney", "help", "build", "nonsense"]).unwrap().unwrap_err().to_string();
        assert!(unknown.contains("no topic `nonsense` of build") && unknown.contains("volumes"), "{unknown}");
        for words in [["info", "lines", ""], ["build", "raster", "extra"]] {
            let words = ["spinney", "help"].iter().chain(&words).filter(|word| !word.is_empty());
            assert!(page(&words.copied().collect::<Vec<_>>()).unwrap().is_err());
        }
        assert!(page(&["spinney", "--threads", "2", "build", "x", "-h"]).is_some());
        let edit = text(&["help", "edit", "fill"]);
        assert!(edit.contains("spinney edit <FILE> fill") || edit.contains("fill"), "{edit}");
    }
}
