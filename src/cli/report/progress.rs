//! Progress on the terminal, and cancellation by the user.

use std::fmt::Write;
use std::io::{self, IsTerminal};
use std::path::Path;

use indicatif::{ProgressBar, ProgressState, ProgressStyle};

use super::super::Global;
use super::super::signals::{stop_in_good_order, stop_is_wanted};
use super::{quantity, warn};

/// The progress of long work: a bar if standard error is a terminal. Ctrl-C cancels the work at the
/// next safe point.
pub(crate) struct Work {
    bar: ProgressBar,
}

impl Work {
    /// Starts work. From now on Ctrl-C and termination cancel it cleanly; a second signal ends the
    /// program at once.
    ///
    /// Call this before creating anything that an aborted program would leave.
    ///
    /// `unit` is the counted unit, in the plural.
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

/// Returns a bar with the percentage done, the rate in units per second, and the remaining time.
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
        // (Suspend the bar, so that it does not overwrite the line.)
        self.bar.suspend(|| warn(&format!("{}: {text}", file.display())));
    }

    fn interrupted(&self) -> bool {
        stop_is_wanted()
    }
}
