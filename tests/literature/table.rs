//! The table of docs/literature.md, checked against the project: items, commands, library examples,
//! and tests.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::command::stdout;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// A row of the table.
struct Row {
    number: usize,
    /// Code spans in the cells of commands, of the library, and of tests.
    commands: Vec<String>,
    library: Vec<String>,
    tests: Vec<String>,
    /// Whether something is not built, with a reason.
    is_in_part: bool,
}

fn read(path: impl AsRef<Path>) -> String {
    let path = Path::new(ROOT).join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Returns the code spans in a cell.
fn code(cell: &str) -> Vec<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_string).collect()
}

fn rows() -> Vec<Row> {
    let page = read("docs/literature.md");
    let lines = page.lines().skip_while(|line| !line.starts_with("<!-- items:")).skip(3);
    let rows = lines.take_while(|line| line.starts_with('|')).map(|line| {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let [number, item, name, commands, library, reason, tests, _] = cells[..] else {
            panic!("eight cells: {line}")
        };
        assert!(!item.is_empty() && !name.is_empty(), "{line}");
        Row {
            number: number.parse().unwrap(),
            commands: code(commands),
            library: code(library),
            tests: code(tests),
            is_in_part: !reason.is_empty(),
        }
    });
    rows.collect()
}

#[test]
fn all_items_have_a_row_and_a_test() {
    let rows = rows();
    assert!(rows.iter().map(|row| row.number).eq(1..=66));
    for row in &rows {
        assert!(!row.tests.is_empty(), "item {}", row.number);
        assert!(!row.commands.is_empty() || row.is_in_part, "item {}: no command", row.number);
    }
}

/// Returns the file of a test: in this test program, in another one, or next to the code.
fn file_of(name: &str) -> PathBuf {
    let directory = match name {
        _ if name.starts_with("crates/") => "",
        _ if name.contains('/') => "tests",
        _ => "tests/literature",
    };
    let path = Path::new(directory).join(name);
    let inside = path.join("mod.rs");
    if Path::new(ROOT).join(&inside).exists() { inside } else { path.with_extension("rs") }
}

#[test]
fn tests_of_the_items_exist() {
    for Row { number, tests, .. } in rows() {
        for test in tests {
            let (file, function) = test.split_once("::").expect("FILE::FUNCTION");
            let text = read(file_of(file));
            let there = text.lines().zip(text.lines().skip(1)).any(|(before, line)| {
                before.trim() == "#[test]" && line.trim() == format!("fn {function}() {{")
            });
            assert!(there, "item {number}: {file} has no test {function}");
        }
    }
}

/// Returns the words of a string, options with their hyphens.
fn words(text: &str) -> Vec<&str> {
    text.split(|letter: char| !(letter.is_alphanumeric() || letter == '-' || letter == '_')).collect()
}

#[test]
fn commands_and_names_of_the_items_exist() {
    let public = read(".ci/public-api.txt");
    let is_public = |path: &str| public.lines().any(|line| line == path);
    for Row { number, commands, library, .. } in rows() {
        for name in library {
            if ["benches/", "examples/"].iter().any(|directory| name.starts_with(directory)) {
                read(&name);
            } else {
                let (module, item) = name.rsplit_once("::").unwrap();
                let is_of_it = public.lines().any(|line| {
                    words(line)
                        .windows(2)
                        .any(|pair| ["fn", "struct", "enum", "trait"].contains(&pair[0]) && pair[1] == item)
                });
                assert!(is_public(&name) || (is_public(module) && is_of_it), "item {number}: {name}");
            }
        }
        for name in commands {
            let mut parts = name.split(' ');
            let command = parts.next().unwrap();
            // Options of a topic are on its page only.
            let mut help = stdout(&["help", command]);
            let table = help.split_once("TOPIC`):\n").map_or("", |(_, table)| table).to_owned();
            for topic in table.lines().filter_map(|line| line.split_whitespace().next()) {
                help += &stdout(&["help", command, topic]);
            }
            let known = words(&help);
            for part in parts {
                assert!(known.contains(&part.trim_end_matches('=')), "item {number}: {part} of {command}");
            }
        }
    }
}
