//! Effects of the options of all commands: the lines of `option_effects.txt`, each run with its
//! option and without.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

const TABLE: &str = include_str!("option_effects.txt");

/// Files by name.
type Files = BTreeMap<PathBuf, Vec<u8>>;

/// Returns the words of a command, as a shell splits them.
fn words(text: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
    for letter in text.chars() {
        match (quote, letter) {
            (None, '\'') => quote = Some(letter),
            (None, ' ') => words.extend(Some(std::mem::take(&mut word)).filter(|word| !word.is_empty())),
            (Some(end), _) if letter == end => quote = None,
            _ => word.push(letter),
        }
    }
    words.extend(Some(word).filter(|word| !word.is_empty()));
    words
}

/// Returns the bytes of a string with `\n` and `\xNN`.
fn unescaped(text: &str) -> Vec<u8> {
    let (mut bytes, mut rest) = (Vec::new(), text.as_bytes());
    while let [first, tail @ ..] = rest {
        let (byte, length) = match (first, tail) {
            (b'\\', [b'n', ..]) => (b'\n', 2),
            (b'\\', [b'x', high, low, ..]) => {
                let digits = [*high, *low];
                (u8::from_str_radix(std::str::from_utf8(&digits).unwrap(), 16).unwrap(), 4)
            }
            (byte, _) => (*byte, 1),
        };
        bytes.push(byte);
        rest = &rest[length..];
    }
    bytes
}

/// Returns the next number of a linear congruential generator.
fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    *state >> 40
}

/// Adds all files of a directory, recursively, by their relative paths.
fn read_all(directory: &Path, prefix: &Path, files: &mut Files) {
    for entry in fs::read_dir(directory).unwrap() {
        let entry = entry.unwrap();
        let name = prefix.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            read_all(&entry.path(), &name, files);
            continue;
        }
        let mut bytes = fs::read(entry.path()).unwrap();
        if name.extension().is_some_and(|extension| extension == "autumn") {
            // Editors leave a note in the file (formats.md), which differs each time.
            bytes[2048..2304].fill(0);
        }
        files.insert(name, bytes);
    }
}

/// The result of a run: everything that an option may change.
#[derive(PartialEq)]
struct Outcome {
    succeeded: bool,
    stdout: Vec<u8>,
    stderr: String,
    /// Files that are new or changed, and, without bytes, those that were removed.
    files: Files,
    /// Bytes written to files, including unnamed ones; `None` if the system does not count them.
    written: Option<u64>,
}

/// Waits for a process and returns how many bytes it has written. The system keeps the count until
/// the process is waited for.
fn written(process: u32) -> Option<u64> {
    while cfg!(target_os = "linux") {
        let state = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
        if state.rsplit(") ").next()?.starts_with('Z') {
            let counts = fs::read_to_string(format!("/proc/{process}/io")).ok()?;
            return counts.lines().find_map(|line| line.strip_prefix("wchar: "))?.parse().ok();
        }
        thread::sleep(std::time::Duration::from_millis(1));
    }
    None
}

/// Runs the program in a directory.
fn run(directory: &Path, arguments: &[String]) -> (std::process::ExitStatus, Vec<u8>, String, Option<u64>) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_spinney"));
    for variable in ["SOURCE_DATE_EPOCH", "SPINNEY_AUTHOR", "SPINNEY_REMOTE_TIMEOUT", "SPINNEY_SIGNED_URLS"] {
        command.env_remove(variable);
    }
    command.args(arguments).current_dir(directory).stdin(Stdio::null());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
    let (mut out, mut err) = (child.stdout.take().unwrap(), child.stderr.take().unwrap());
    let other = thread::spawn(move || err.read_to_end(&mut stderr).map(|_| stderr).unwrap());
    out.read_to_end(&mut stdout).unwrap();
    let stderr = other.join().unwrap();
    let written = written(child.id());
    let status = child.wait().unwrap();
    (status, stdout, String::from_utf8_lossy(&stderr).into_owned(), written)
}

/// A line of the table.
struct Row {
    line: usize,
    effect: &'static str,
    what: &'static str,
    command: &'static str,
}

impl Row {
    /// Returns the words with the option in brackets, or without.
    fn words(&self, with: bool) -> Vec<String> {
        let (before, rest) = self.command.split_once("[--").expect("an option in brackets");
        let (option, after) = rest.split_once(']').unwrap();
        match with {
            true => words(&format!("{before}--{option}{after}")),
            false => words(&format!("{before}{after}")),
        }
    }
}

/// Creates the inputs of the table's lines in a directory. Returns the lines.
fn prepared(directory: &Path) -> Vec<Row> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let fixtures =
        |from: &str, to: &str| fs::copy(root.join("fixtures").join(from), directory.join(to)).unwrap();
    for entry in fs::read_dir(root.join("fixtures/v1")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        fixtures(&format!("v1/{name}"), &name.replace("elevation", "relief"));
    }
    for name in ["elevation.tif", "classes.tif", "rgb.png", "points.laz", "districts.geojson"] {
        fixtures(&format!("island_{name}"), &name.replace("elevation", "relief"));
    }
    let mut state = 1;
    let noise: Vec<u8> = (0..512 * 512).map(|_| (random(&mut state) & 15) as u8).collect();
    fs::write(directory.join("noise.pgm"), [&b"P5 512 512 255\n"[..], &noise].concat()).unwrap();
    let mut cell =
        || format!("{},{},{}\n", random(&mut state) % 512, random(&mut state) % 512, random(&mut state) % 9);
    fs::write(directory.join("many.csv"), (0..20_000).map(|_| cell()).collect::<String>()).unwrap();
    let mut rows = Vec::new();
    for (number, line) in
        TABLE.lines().enumerate().filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
    {
        let (kind, rest) = line.split_once(" | ").unwrap_or_else(|| panic!("line {}: {line}", number + 1));
        match kind {
            "file" => {
                let (name, text) = rest.split_once(" | ").unwrap();
                fs::write(directory.join(name), unescaped(text)).unwrap();
            }
            "corrupt" => {
                let [from, at, to] = rest.split(" | ").collect::<Vec<_>>()[..] else { panic!("{rest}") };
                let mut bytes = fs::read(directory.join(from)).unwrap();
                bytes[at.parse::<usize>().unwrap()] ^= 0x55;
                fs::write(directory.join(to), bytes).unwrap();
            }
            "setup" => {
                let (status, _, stderr, _) = run(directory, &words(rest));
                assert!(status.success(), "line {}: {rest}: {stderr}", number + 1);
            }
            _ => {
                let (effect, what) = kind.split_once(' ').unwrap_or((kind, ""));
                rows.push(Row { line: number + 1, effect, what, command: rest });
            }
        }
    }
    rows
}

/// Runs commands on copies of the inputs, each once.
struct Runner {
    inputs: Files,
    outcomes: Mutex<HashMap<Vec<String>, Arc<Outcome>>>,
}

impl Runner {
    fn outcome(&self, words: Vec<String>) -> Arc<Outcome> {
        if let Some(known) = self.outcomes.lock().unwrap().get(&words) {
            return known.clone();
        }
        let directory = tempfile::tempdir().unwrap();
        for (name, bytes) in &self.inputs {
            let path = directory.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
        let (status, stdout, stderr, written) = run(directory.path(), &words);
        assert!(!stderr.contains("panicked"), "{words:?}: {stderr}");
        let mut files = Files::new();
        read_all(directory.path(), Path::new(""), &mut files);
        let gone: Vec<_> = self.inputs.keys().filter(|name| !files.contains_key(*name)).cloned().collect();
        files.retain(|name, bytes| self.inputs.get(name) != Some(bytes));
        files.extend(gone.into_iter().map(|name| (name, Vec::new())));
        let outcome = Arc::new(Outcome { succeeded: status.success(), stdout, stderr, files, written });
        self.outcomes.lock().unwrap().insert(words, outcome.clone());
        outcome
    }

    /// Checks a line. Returns why it is false, if it is.
    fn check(&self, row: &Row) -> Result<(), String> {
        if row.effect == "test" {
            let (file, name) = row.what.split_once(' ').ok_or("a file and a test")?;
            let text =
                fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap_or_default();
            return match text.contains(&format!("fn {name}(")) {
                true => Ok(()),
                false => Err(format!("{file} has no test {name}")),
            };
        }
        let (with, without) = (self.outcome(row.words(true)), self.outcome(row.words(false)));
        let shown = |outcome: &Outcome| {
            let names: Vec<_> = outcome.files.keys().collect();
            format!(
                "\n    {}: {} {names:?}",
                if outcome.succeeded { "good" } else { "failed" },
                outcome.stderr.trim()
            )
        };
        let both = with.succeeded && without.succeeded;
        let same = with.files == without.files && with.stdout == without.stdout;
        // The number before a word, as in `3 threads`.
        let counter = |outcome: &Outcome| {
            let (before, _) = outcome.stderr.split_once(&format!(" {}", row.what))?;
            before.rsplit(|letter: char| !letter.is_ascii_digit()).next()?.parse::<u64>().ok()
        };
        let is_true = match row.effect {
            "result" => both && with.stdout != without.stdout,
            "output" => both && with.files != without.files,
            "report" => both && with.stderr != without.stderr,
            "refused" => without.succeeded && !with.succeeded && with.stderr.contains(row.what),
            "needed" => with.succeeded && !without.succeeded && without.stderr.contains(row.what),
            "counter" => both && same && counter(&with).is_some() && counter(&with) != counter(&without),
            "spills" => both && same && (with.written.is_none() || with.written > without.written),
            other => return Err(format!("no effect is called {other}")),
        };
        if is_true { Ok(()) } else { Err(format!("with it{}\n  without{}", shown(&with), shown(&without))) }
    }
}

#[test]
fn every_option_has_the_effect_that_the_table_says() {
    let directory = tempfile::tempdir().unwrap();
    let rows = prepared(directory.path());
    let mut inputs = Files::new();
    read_all(directory.path(), Path::new(""), &mut inputs);
    let runner = Runner { inputs, outcomes: Mutex::default() };
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(String::new()));
    let work = || {
        while let Some(row) = rows.get(next.fetch_add(1, Ordering::Relaxed)) {
            if let Err(why) = runner.check(row) {
                let Row { line, effect, what, command } = row;
                *wrong.lock().unwrap() += &format!("line {line}: {effect} {what} | {command}\n  {why}\n");
            }
        }
    };
    let threads = thread::available_parallelism().map_or(2, usize::from);
    thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(work))));
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "tests/program/option_effects.txt:\n{wrong}");
}
