//! What is made: which format it has, that it is no input, and a line about it at the end.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, bail};
use spinney::export::image::{Format, format_of};
use spinney::store::split_commit;

use super::{Global, Result, quantity};

/// No input may be the output.
pub(super) fn check_output<'a>(inputs: impl IntoIterator<Item = &'a Path>, output: &Path) -> Result {
    // (A commit of a file is the file.)
    let same = |input: &Path| match (split_commit(input).0.canonicalize(), output.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    };
    match inputs.into_iter().find(|input| same(input)) {
        Some(input) => bail!("{}: is an input and the output; choose another output", input.display()),
        None => Ok(()),
    }
}

/// The format of a picture or array by what was asked for, or else by the output's name; `known` is said where neither tells.
pub(super) fn picture_format(output: &Path, asked: Option<&str>, known: &str) -> Result<Format> {
    let name = asked.map(|format| Path::new("x").with_extension(format));
    let format = format_of(name.as_deref().unwrap_or(output));
    format.with_context(|| format!("{}: unknown format; use {known}, or --format", output.display()))
}

/// A line about the file that was made, and how large it is beside so many bytes of samples.
pub(super) fn tell_output_of(global: &Global, path: &Path, start: Instant, raw: Option<u64>) {
    let time = format!("{:.1} s", start.elapsed().as_secs_f64());
    let Some(file) = std::fs::metadata(path).ok().filter(|_| path != Path::new("-")) else {
        return global.say(format_args!("{:<10} standard output, in {time}", "output"));
    };
    let (name, size) = (path.display(), quantity::bytes(file.len()));
    let share = raw.map_or(String::new(), |raw| {
        let percent = 100.0 * file.len() as f64 / raw as f64;
        format!(", {percent:.1} % of {} of samples", quantity::bytes(raw))
    });
    global.say(format_args!("{:<10} {name}: {size}{share}, in {time}", "output"));
}

/// A line about the file that was made.
pub(super) fn tell_output(global: &Global, path: &Path, start: Instant) {
    tell_output_of(global, path, start, None);
}
