//! The commands of the documents run as printed, with the documented output.
//!
//! All blocks marked `sh` in `README.md` and `docs/*.md` run in order, each page's in its own
//! directory with `fixtures`, and the program as `target/debug/spinney`. A following block marked
//! `text` is the expected output, including standard error; `...` matches anything within a line,
//! and a line `...` matches any lines. `<!-- not run: REASON -->` before a block excludes it. The
//! first of the README's two set-up commands runs with the existing program.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::command::command;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// Pages without commands.
const WITHOUT: [&str; 9] = [
    "glossary.md",
    "c.md",
    "how-it-works.md",
    "javascript.md",
    "literature.md",
    "options.md",
    "python.md",
    "remote.md",
    "serve.md",
];

/// A block of commands.
struct Block {
    line: usize,
    commands: String,
    output: Option<String>,
}

/// Returns the kind of the block that begins at a line, and its number of lines.
fn fenced<'a>(lines: &[&'a str], start: usize) -> Option<(&'a str, usize)> {
    let kind = lines.get(start)?.strip_prefix("```")?;
    let length =
        lines[start + 1..].iter().position(|line| *line == "```").expect("a block that does not end");
    Some((kind, length))
}

/// Returns the commands of a page to be run.
fn blocks(page: &str, text: &str) -> Vec<Block> {
    let lines: Vec<&str> = text.lines().collect();
    let text_of = |first: usize, length: usize| lines[first..first + length].join("\n");
    let (mut found, mut at, mut note) = (Vec::new(), 0, "");
    while at < lines.len() {
        let Some((kind, length)) = fenced(&lines, at) else {
            if !lines[at].is_empty() {
                note = lines[at];
            }
            at += 1;
            continue;
        };
        let (line, mut commands) = (at + 1, text_of(at + 1, length));
        at += length + 2;
        if kind != "sh" {
            note = "";
            continue;
        }
        if let Some(reason) = note.strip_prefix("<!-- not run:") {
            let reason = reason.strip_suffix("-->").expect("a remark of one line").trim();
            assert!(!reason.is_empty(), "{page}:{line}: why is this not run?");
            note = "";
            continue;
        }
        if note == "<!-- set-up -->" {
            let first =
                commands.lines().next().and_then(|command| command.strip_prefix("cargo run --locked -- "));
            commands = format!("target/debug/spinney {}", first.expect("the first command runs the program"));
        }
        note = "";
        at += lines[at..].iter().take_while(|line| line.is_empty()).count();
        let output = match fenced(&lines, at) {
            Some(("text", length)) => {
                let output = text_of(at + 1, length);
                at += length + 2;
                Some(output)
            }
            _ => None,
        };
        found.push(Block { line, commands, output });
    }
    found
}

/// Returns whether a line matches the expected one, in which `...` matches anything.
fn is_alike(expected: &str, line: &str) -> bool {
    let (expected, line) = (expected.trim_end(), line.trim_end());
    let Some((first, others)) = expected.split_once("...") else {
        return expected == line;
    };
    let (middle, last) = others.rsplit_once("...").unwrap_or(("", others));
    let Some(mut rest) = line.strip_prefix(first).and_then(|rest| rest.strip_suffix(last)) else {
        return false;
    };
    middle.split("...").all(|part| {
        rest.split_once(part).is_some_and(|(_, after)| {
            rest = after;
            true
        })
    })
}

/// Returns whether lines match the expected ones, in which a line `...` matches any number of
/// lines.
fn are_alike(expected: &[&str], lines: &[&str]) -> bool {
    match expected.split_first() {
        None => lines.is_empty(),
        Some((first, rest)) if first.trim() == "..." => {
            (0..=lines.len()).any(|skip| are_alike(rest, &lines[skip..]))
        }
        Some((first, rest)) => {
            lines.split_first().is_some_and(|(line, left)| is_alike(first, line) && are_alike(rest, left))
        }
    }
}

/// Runs a page's commands. Returns the failures.
fn run(page: &Path) -> Vec<String> {
    let name = page.strip_prefix(ROOT).unwrap().display().to_string();
    let blocks = blocks(&name, &fs::read_to_string(page).unwrap());
    let has_none = WITHOUT.iter().any(|known| page.file_name().is_some_and(|name| name == *known));
    if blocks.is_empty() != has_none {
        return vec![format!("{name}: {} blocks of commands", blocks.len())];
    }
    let directory = tempfile::tempdir().unwrap();
    let programs = directory.path().join("target/debug");
    fs::create_dir_all(&programs).unwrap();
    symlink(command(&[]).get_program(), programs.join("spinney")).unwrap();
    symlink(Path::new(ROOT).join("fixtures"), directory.path().join("fixtures")).unwrap();
    let path = format!("{}:{}", programs.display(), std::env::var("PATH").unwrap());
    let mut wrong = Vec::new();
    for block in blocks {
        let mut bash = Command::new("bash");
        bash.args(["-euo", "pipefail", "-c", &format!("exec 2>&1 < /dev/null\n{}", block.commands)]);
        bash.current_dir(directory.path())
            .env("PATH", &path)
            .env("SPINNEY_AUTHOR", "")
            .env_remove("SOURCE_DATE_EPOCH");
        let output = bash.output().unwrap();
        let said = String::from_utf8(output.stdout).unwrap();
        let expected: Option<Vec<&str>> = block.output.as_ref().map(|text| text.lines().collect());
        let fits = expected.is_none_or(|expected| are_alike(&expected, &said.lines().collect::<Vec<_>>()));
        if !output.status.success() || !fits {
            let status = output.status;
            wrong.push(format!("{name}:{}: {status}\n{}\n-- says:\n{said}", block.line, block.commands));
        }
    }
    wrong
}

/// Returns the README, and the pages that it links to.
fn pages() -> Vec<PathBuf> {
    let directory = fs::read_dir(Path::new(ROOT).join("docs")).unwrap();
    let mut pages: Vec<PathBuf> = directory.map(|entry| entry.unwrap().path()).collect();
    pages.retain(|path| path.extension().is_some_and(|ending| ending == "md"));
    pages.push(Path::new(ROOT).join("README.md"));
    pages.sort();
    pages
}

#[test]
fn commands_of_the_documents_run_and_print_what_is_said() {
    let pages = pages();
    assert!(pages.len() >= 8, "{pages:?}");
    let wrong: Vec<String> = pages.iter().flat_map(|page| run(page)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

#[test]
fn links_of_the_documents_lead_to_files() {
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        for link in text.split("](").skip(1) {
            let target = link.split([')', '#', ' ']).next().unwrap();
            if !target.is_empty() && !target.contains("://") {
                assert!(page.parent().unwrap().join(target).exists(), "{}: {target}", page.display());
            }
        }
    }
}

#[test]
fn the_readme_is_short() {
    let lines = fs::read_to_string(Path::new(ROOT).join("README.md")).unwrap().lines().count();
    assert!(lines <= 200, "{lines} lines");
}

#[test]
fn outputs_are_compared_line_by_line() {
    assert!(is_alike("output     a.png: ... KiB, in ... s", "output     a.png: 1.5 KiB, in 0.0 s"));
    assert!(!is_alike("output     a.png: ... KiB, in ... s", "output     b.png: 1.5 KiB, in 0.0 s"));
    assert!(
        is_alike("a ...", "a b")
            && is_alike("...", "a")
            && !is_alike("a", "a b")
            && !is_alike("... a", "a b")
    );
    assert!(
        are_alike(&["a", "...", "c"], &["a", "b", "b", "c"]) && are_alike(&["a", "...", "c"], &["a", "c"])
    );
    assert!(!are_alike(&["a", "...", "c"], &["a", "b"]) && !are_alike(&["a"], &["a", "b"]));
}
