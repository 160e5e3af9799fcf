//! Reports about the output file.

use std::path::Path;
use std::time::Instant;

use super::super::Global;
use super::quantity;

/// Reports the output file, its size, and the elapsed time.
pub(crate) fn report_output(global: &Global, path: &Path, start: Instant) {
    report_built(global, path, start, None);
}

/// Reports the output file, its size compared with the inputs' size, and the elapsed time.
pub(crate) fn report_built(global: &Global, path: &Path, start: Instant, input: Option<u64>) {
    let time = format!("{:.1} s", start.elapsed().as_secs_f64());
    let stat = || global.access().stat(&[path]).ok()?.pop()?.ok()?;
    let there = if path == Path::new("-") { None } else { stat() };
    let Some(file) = there else {
        return global.report("output", format_args!("standard output, in {time}"));
    };
    let name = path.display();
    if path.is_dir() {
        return global.report("output", format_args!("{name}, in {time}"));
    }
    let size = quantity::bytes(file.length);
    let share = input.filter(|input| *input > 0).map_or(String::new(), |input| {
        let percent = 100.0 * file.length as f64 / input as f64;
        format!(", {percent:.1} % of the input's {}", quantity::bytes(input))
    });
    global.report("output", format_args!("{name}: {size}{share}, in {time}"));
}
