//! Progress on the terminal, and the user's wish to stop.

use std::fmt::Write;
use std::io::{self, IsTerminal};
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};

use super::{Global, Result, quantity};

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Long work: a bar if somebody looks, and an ear for Ctrl-C.
pub(crate) struct Work {
    bar: ProgressBar,
}

impl Work {
    /// From here on Ctrl-C and termination end the work in good order; a second one ends it at once.
    ///
    /// `unit` is what is counted, in the plural.
    pub(crate) fn start(global: &Global, unit: &'static str) -> Result<Work> {
        let handler = || {
            if INTERRUPTED.swap(true, Ordering::Relaxed) {
                process::exit(130);
            }
        };
        match ctrlc::try_set_handler(handler) {
            // Whoever started the program in the background wants Ctrl-C ignored: leave it so.
            Ok(()) | Err(ctrlc::Error::MultipleHandlers) => {}
            Err(error) => return Err(error.into()),
        }
        let bar = if global.quiet || !io::stderr().is_terminal() {
            ProgressBar::hidden()
        } else {
            ProgressBar::new(0).with_style(style(unit))
        };
        Ok(Work { bar })
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        self.finish();
    }
}

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

    fn interrupted(&self) -> bool {
        INTERRUPTED.load(Ordering::Relaxed)
    }
}
