//! A web server for the tests: files in memory, ranges, counts, and faults.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Faults of the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    None,
    /// Responds with status 500 to this many requests.
    Busy(usize),
    /// Truncates this many bodies.
    CutBodies(usize),
    /// Ignores ranges.
    NoRanges,
    /// Reports a length that differs from the range.
    WrongLength,
    /// Claims that bytes are compressed.
    Compresses,
    /// Redirects to the file of another name.
    Redirects,
    /// Redirects to another host, without a query: `localhost` at this port.
    Leaves(u16),
    /// Serves other bytes, with another tag, after this many requests.
    Changes(usize),
    /// Delays responses.
    Slow(Duration),
    /// Denies access.
    Forbidden,
}

pub(crate) struct Server {
    pub(crate) address: String,
    state: Arc<State>,
}

struct State {
    files: Mutex<HashMap<String, Arc<Vec<u8>>>>,
    fault: Mutex<Fault>,
    requests: AtomicUsize,
    bytes: AtomicU64,
    /// Heads of requests.
    heads: Mutex<Vec<String>>,
}

impl Server {
    /// Starts a server that runs as long as the process.
    pub(crate) fn start() -> Server {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let state = Arc::new(State {
            files: Mutex::default(),
            fault: Mutex::new(Fault::None),
            requests: AtomicUsize::new(0),
            bytes: AtomicU64::new(0),
            heads: Mutex::default(),
        });
        let shared = state.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let state = shared.clone();
                std::thread::spawn(move || state.serve(stream));
            }
        });
        Server { address, state }
    }

    /// Adds a file. Returns its URL.
    pub(crate) fn put(&self, name: &str, bytes: Vec<u8>) -> String {
        self.state.files.lock().unwrap().insert(format!("/{name}"), Arc::new(bytes));
        format!("{}/{name}", self.address)
    }

    pub(crate) fn set_fault(&self, fault: Fault) {
        self.state.requests.store(0, Ordering::SeqCst);
        *self.state.fault.lock().unwrap() = fault;
    }

    /// Returns heads of requests since the last call.
    pub(crate) fn take_heads(&self) -> Vec<String> {
        std::mem::take(&mut *self.state.heads.lock().unwrap())
    }

    /// Returns requests and bytes since the last call.
    pub(crate) fn take_counts(&self) -> (usize, u64) {
        (self.state.requests.swap(0, Ordering::SeqCst), self.state.bytes.swap(0, Ordering::SeqCst))
    }
}

impl State {
    /// Serves requests of a connection until it ends.
    fn serve(&self, stream: TcpStream) {
        let _ = stream.set_nodelay(true);
        let mut reader = BufReader::new(stream.try_clone().unwrap());
        let mut writer = stream;
        while let Some((head, (has_body, path, range))) = request(&mut reader) {
            self.heads.lock().unwrap().push(head);
            if self.respond(&mut writer, (&path, has_body), range).is_none() {
                return;
            }
        }
    }

    /// Responds to a request. Returns `None` if the connection is to be closed.
    fn respond(
        &self,
        out: &mut TcpStream,
        (path, has_body): (&str, bool),
        range: Option<String>,
    ) -> Option<()> {
        let number = self.requests.fetch_add(1, Ordering::SeqCst);
        let fault = *self.fault.lock().unwrap();
        let path = path.split('?').next().unwrap();
        let plain = |out: &mut TcpStream, status: &str, more: &str| {
            write!(out, "HTTP/1.1 {status}\r\nContent-Length: 0\r\n{more}\r\n").ok()
        };
        match fault {
            Fault::Busy(times) if number < times => return plain(out, "500 Internal Server Error", ""),
            Fault::Forbidden => return plain(out, "403 Forbidden", ""),
            Fault::Slow(time) => std::thread::sleep(time),
            Fault::Leaves(port) => {
                return plain(out, "302 Found", &format!("Location: http://localhost:{port}{path}\r\n"));
            }
            Fault::Redirects if !path.starts_with("/moved/") => {
                return plain(out, "302 Found", &format!("Location: /moved{path}\r\n"));
            }
            _ => {}
        }
        let name = path.strip_prefix("/moved").unwrap_or(path);
        let Some(file) = self.files.lock().unwrap().get(name).cloned() else {
            return plain(out, "404 Not Found", "");
        };
        let has_changed = matches!(fault, Fault::Changes(after) if number >= after);
        let tag = format!("\"{:x}-{has_changed}\"", file.len());
        let all = file.len();
        let (first, last) = match range.filter(|_| fault != Fault::NoRanges).as_deref().map(str::trim) {
            None => {
                let head = format!("HTTP/1.1 200 OK\r\nContent-Length: {all}\r\nETag: {tag}\r\n\r\n");
                out.write_all(head.as_bytes()).ok()?;
                return if has_body { out.write_all(&file).ok() } else { Some(()) };
            }
            Some(range) => match range.split_once('-').unwrap() {
                ("", suffix) => (all.saturating_sub(suffix.parse().unwrap()), all),
                (first, last) => {
                    (first.parse().unwrap(), last.parse().map_or(all, |last: usize| (last + 1).min(all)))
                }
            },
        };
        if first >= all {
            return plain(out, "416 Range Not Satisfiable", "");
        }
        let mut body = file[first..last].to_vec();
        if has_changed {
            body.iter_mut().for_each(|byte| *byte ^= 0x55);
        }
        let length = if fault == Fault::WrongLength { (last - first) / 2 + 1 } else { last - first };
        let more = if fault == Fault::Compresses { "Content-Encoding: gzip\r\n" } else { "" };
        let head = format!(
            "HTTP/1.1 206 Partial Content\r\nContent-Length: {length}\r\nETag: {tag}\r\n{more}Content-Range: bytes {first}-{}/{all}\r\n\r\n",
            last - 1
        );
        out.write_all(head.as_bytes()).ok()?;
        if matches!(fault, Fault::CutBodies(times) if number < times) {
            out.write_all(&body[..body.len() / 2]).ok()?;
            return None;
        }
        self.bytes.fetch_add(body.len() as u64, Ordering::SeqCst);
        out.write_all(&body[..length.min(body.len())]).ok()
    }
}

/// The path of a request, whether its response has a body, and its range.
type Request = (bool, String, Option<String>);

/// Reads the head of the next request, with header fields in lower case, and its contents.
fn request(reader: &mut BufReader<TcpStream>) -> Option<(String, Request)> {
    let mut line = String::new();
    reader.read_line(&mut line).ok().filter(|read| *read > 0)?;
    let mut head = line.clone();
    let (has_body, path) = (!line.starts_with("HEAD "), line.split(' ').nth(1)?.to_string());
    let mut range = None;
    let mut length = 0;
    loop {
        let mut header = String::new();
        reader.read_line(&mut header).ok().filter(|read| *read > 0)?;
        head += &header.to_ascii_lowercase();
        let Some((name, value)) = header.trim_end().split_once(':') else { break };
        match name.to_ascii_lowercase().as_str() {
            "range" => range = value.trim().strip_prefix("bytes=").map(str::to_string),
            "content-length" => length = value.trim().parse().ok()?,
            _ => {}
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).ok()?;
    Some((head, (has_body, path, range)))
}
