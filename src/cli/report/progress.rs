//! Progress on the terminal, and the user's wish to stop.

use std::fmt::Write;
use std::io::{self, IsTerminal};
use std::path::Path;

use indicatif::{ProgressBar, ProgressState, ProgressStyle};

use super::super::Global;
use super::super::signals::{stop_in_good_order, stop_is_wanted};
use super::{quantity, warn};

/// Long work: a bar if standard error is a terminal, and a stop at the next good moment after Ctrl-C.
pub(crate) struct Work {
    bar: ProgressBar,
}

impl Work {
    /// Starts work: from here on Ctrl-C and termination end it in good order; a second one ends it at once.
    ///
    /// To be called before anything is created that an interrupted program would leave behind.
    ///
    /// `unit` is what is counted, in the plural.
    pub(crate) fn start(global: &Global, unit: &'static str) -> anyhow::Result<Work> {
        stop_in_good_order()?;
        let bar = if global.quiet || !io::stderr().is_terminal() {
            ProgressBar::hidden()
        } else {
            ProgressBar::new(0).with_style(style(unit))
        };
        Ok(Work { bar })
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        self.finish();
    }
}

/// A bar with the share that is done, so many units per second, and the time left.
fn style(unit: &'static str) -> ProgressStyle {
    let rate = move |state: &ProgressState, out: &mut dyn Write| {
        let _ = write!(out, "{} {unit}/s", quantity::count(state.per_sec()));
    };
    ProgressStyle::with_template("{wide_bar} {percent}%  {rate}, {eta} left")
        .expect("the template is right")
        .with_key("rate", rate)
}

impl spinney::Progress for Work {
    fn advance(&self, done: u64, total: u64) {
        self.bar.set_length(total);
        self.bar.inc(done);
    }

    fn warn(&self, file: &Path, text: &str) {
        // (The bar would be written over the line.)
        self.bar.suspend(|| warn(&format!("{}: {text}", file.display())));
    }

    fn interrupted(&self) -> bool {
        stop_is_wanted()
    }
}
