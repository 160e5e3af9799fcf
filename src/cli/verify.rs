//! `spinney verify`: every checksum and every rule of the tree.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use super::{Session, open, print_text};

#[derive(Args)]
pub(crate) struct Verify {
    /// Tree files
    #[arg(required = true)]
    files: Vec<PathBuf>,
}

pub(crate) fn run(args: &Verify, session: &Session) -> Result<ExitCode> {
    let mut good = true;
    for file in &args.files {
        let tree = open(file)?;
        let findings = tree.verify(256 << 20, &session.progress("cells"))?;
        for finding in &findings {
            print_text(&format!("{}: {}: {}\n", file.display(), finding.place, finding.problem))?;
        }
        if findings.is_empty() && !session.quiet {
            print_text(&format!("{}: good\n", file.display()))?;
        }
        good &= findings.is_empty();
    }
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
