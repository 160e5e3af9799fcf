//! `spinney serve`: responses, errors, and the effects of clients and changing files.

mod changes;
mod client;
#[path = "../common/mod.rs"]
mod common;
mod files;
mod malicious;
mod names;
mod responses;
mod tiles;

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use client::{Connection, Response};

/// The program as a server, until it is dropped.
pub(crate) struct Server {
    child: Child,
    /// Host and port.
    pub(crate) address: String,
}

impl Server {
    /// Serves a directory or a file at a free port.
    pub(crate) fn start(path: &Path, options: &[&str]) -> Server {
        Server::run(Command::new(env!("CARGO_BIN_EXE_spinney")), path, options)
    }

    pub(crate) fn run(mut program: Command, path: &Path, options: &[&str]) -> Server {
        program.args(["serve", "--port", "0", "--quiet"]).args(options).arg(path);
        let server = Server::of(program);
        assert!(!server.address.is_empty(), "no address");
        server
    }

    /// Returns the server that a command starts; without an address if it does not start.
    pub(crate) fn of(mut program: Command) -> Server {
        let mut child = program.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("http://").and_then(|rest| rest.strip_suffix('/'));
        Server { child, address: address.unwrap_or_default().to_owned() }
    }

    pub(crate) fn connect(&self) -> Connection {
        Connection::open(&self.address)
    }

    pub(crate) fn get(&self, target: &str) -> Response {
        self.get_with(target, &[])
    }

    pub(crate) fn get_with(&self, target: &str, headers: &[(&str, &str)]) -> Response {
        self.connect().request("GET", target, headers, b"").unwrap()
    }

    pub(crate) fn post(&self, target: &str, body: &[u8]) -> Response {
        self.connect().request("POST", target, &[], body).unwrap()
    }

    /// Returns the process, which this handle no longer ends.
    pub(crate) fn process(&mut self) -> &mut Child {
        &mut self.child
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Returns the path of a file in `fixtures`.
pub(crate) fn fixture(name: &str) -> String {
    format!("{}/fixtures/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// Returns a directory with trees of the island, `classes.goblin` and `heights.goblin`, and the
/// frozen files.
pub(crate) fn island() -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    spinney::build(fixture("island_classes.tif"), path("classes.goblin")).unwrap();
    spinney::build(fixture("island_elevation.tif"), path("heights.goblin")).unwrap();
    for name in ["history.autumn", "stack.goblin", "ball.goblin", "chapel.goblin"] {
        std::fs::copy(fixture(&format!("v1/{name}")), path(name)).unwrap();
    }
    directory
}
