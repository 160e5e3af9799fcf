//! Files that change while they are served, and the server's shutdown.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use spinney::edit::{Edit, FillRegion, Note};
use spinney::{Bounds, DataKind, Rule, SampleType, Value};

use super::common::command::interruptible;
use super::common::{made, options, quad, write_cells};
use super::{Server, fixture, island};

/// Cells per side of the changing files.
const SIDE: u64 = 64;

/// Writes a file with one value in all cells.
fn write_version(path: &Path, number: u8) {
    let cells = made(quad(SampleType::U8, 1), [SIDE, SIDE, 1], |_| Some(Value::from([number])));
    write_cells(path, &cells, &options(Rule::Majority, DataKind::Categorical, cells.depth()));
}

/// Sets all cells of an edited file to one value.
fn edit_version(path: &Path, number: u8) {
    let region = FillRegion::Box(Bounds::of_extent([SIDE, SIDE, 1]));
    let edit = Edit::Fill(region, Some(vec![number.into()]));
    spinney::edit::edit(path, [Ok(edit)], Note::default(), 16 << 20, &()).unwrap();
}

/// Returns the one value of all cells of a window, from a JSON response.
fn value_of(response: &serde_json::Value) -> u64 {
    let rows = response["values"].as_array().unwrap();
    let all: Vec<u64> =
        rows.iter().flat_map(|row| row.as_array().unwrap()).map(|cell| cell.as_u64().unwrap()).collect();
    assert_eq!(all.len() as u64, SIDE * SIDE);
    assert!(all.iter().all(|value| *value == all[0]), "a response mixes several versions: {all:?}");
    all[0]
}

#[test]
fn files_are_published_and_edited_while_they_are_read() {
    const TIMES: u8 = 100;
    let directory = tempfile::tempdir().unwrap();
    let [published, edited] = ["published.goblin", "edited.autumn"].map(|name| directory.path().join(name));
    write_version(&published, 0);
    write_version(&edited, 0);
    let server = Server::start(directory.path(), &["--timeout", "60"]);
    let (is_over, requests) = (AtomicBool::new(false), AtomicUsize::new(0));
    // Bytes of published files by their tags: equal tags imply equal bytes.
    let tags: Mutex<HashMap<String, Vec<u8>>> = Mutex::default();
    std::thread::scope(|scope| {
        for number in 0..64 {
            let (server, is_over, requests, tags) = (&server, &is_over, &requests, &tags);
            scope.spawn(move || {
                let mut connection = server.connect();
                let name = if number % 2 == 0 { "published" } else { "edited" };
                let mut last = 0;
                while !is_over.load(Ordering::Relaxed) {
                    requests.fetch_add(1, Ordering::Relaxed);
                    if number % 8 == 6 {
                        let response = connection.get("/published.goblin").unwrap();
                        let tag = response.header("etag").unwrap().to_owned();
                        let bytes = response.good();
                        let mut tags = tags.lock().unwrap();
                        assert!(*tags.entry(tag).or_insert_with(|| bytes.clone()) == bytes);
                    } else if number % 8 == 7 {
                        let response = connection.get("/edited.autumn").unwrap().good();
                        let copy = tempfile::Builder::new().suffix(".autumn").tempfile().unwrap();
                        std::fs::write(copy.path(), response).unwrap();
                        let tree = spinney::open(copy.path()).unwrap();
                        assert!(tree.verify(1 << 24, &()).unwrap().is_empty());
                    } else {
                        let response = connection.get(&format!("/window/{name}?format=json")).unwrap();
                        let response = serde_json::from_slice(&response.good()).unwrap();
                        let value = value_of(&response);
                        assert!(value >= last, "version {value} after {last} of {name}");
                        last = value;
                    }
                }
            });
        }
        for number in 1..=TIMES {
            write_version(&published, number);
            edit_version(&edited, number);
            let before = requests.load(Ordering::Relaxed);
            while requests.load(Ordering::Relaxed) < before + 32 && scope_is_alive(&server) {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        // The newest version is served now.
        for name in ["published", "edited"] {
            assert_eq!(
                value_of(&server.get(&format!("/window/{name}?format=json")).json()),
                u64::from(TIMES)
            );
        }
        is_over.store(true, Ordering::Relaxed);
    });
    assert!(tags.into_inner().unwrap().len() > 1);
    // Older commits are available, too: the first is the original file.
    for number in [0, 1, 50] {
        let target = format!("/window/edited?format=json&commit={}", number + 1);
        assert_eq!(value_of(&server.get(&target).json()), number);
    }
}

/// Returns whether the server responds. Failed threads send no more requests.
fn scope_is_alive(server: &Server) -> bool {
    server.connect().get("/healthz").is_ok_and(|response| response.status == 200)
}

#[test]
fn removed_files_are_gone_and_come_again() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let path = directory.path().join("classes.goblin");
    let get_all = || {
        ["/classes.goblin", "/point/classes?x=1&y=1&crs=cells", "/window/classes?size=8"]
            .map(|target| server.get(target).status)
    };
    assert_eq!(get_all(), [200; 3]);
    std::fs::rename(&path, directory.path().join("kept")).unwrap();
    assert_eq!(get_all(), [404; 3]);
    std::fs::copy(directory.path().join("heights.goblin"), &path).unwrap();
    assert_eq!(get_all(), [200; 3]);
    // A file that is no longer a tree is reported, and served again when it is one.
    std::fs::write(directory.path().join("new"), b"no tree").unwrap();
    std::fs::rename(directory.path().join("new"), &path).unwrap();
    let [file, point, window] = get_all();
    assert!(file == 200 && point >= 400 && window >= 400);
    std::fs::rename(directory.path().join("kept"), &path).unwrap();
    assert_eq!(get_all(), [200; 3]);
}

#[test]
fn truncated_files_do_not_stop_the_server() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let path = directory.path().join("heights.goblin");
    let bytes = std::fs::read(&path).unwrap();
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for target in ["/window/heights?size=200", "/tiles/heights/0/0/0.png?grid=native", "/heights.goblin"]
        {
            let (server, is_over) = (&server, &is_over);
            scope.spawn(move || {
                while !is_over.load(Ordering::Relaxed) {
                    // If a file's bytes are gone, the response is truncated.
                    if let Ok(response) = server.connect().get(target) {
                        assert!(matches!(response.status, 200 | 500 | 503), "{target}: {response:?}");
                    }
                }
            });
        }
        for part in [1000, bytes.len() / 2, 0, bytes.len() - 1] {
            // Overwritten in place, as `cp` does.
            std::fs::write(&path, &bytes[..part]).unwrap();
            std::thread::sleep(Duration::from_millis(30));
            std::fs::write(&path, &bytes).unwrap();
            std::thread::sleep(Duration::from_millis(60));
        }
        is_over.store(true, Ordering::Relaxed);
    });
    server.get("/window/heights?size=200").good();
    assert!(server.get("/heights.goblin").good() == bytes);
}

#[test]
fn a_server_ends_in_good_order() {
    let program = env!("CARGO_BIN_EXE_spinney");
    let directory = island();
    let districts = std::fs::read(fixture("island_districts.geojson")).unwrap();
    for signal in [Signal::TERM, Signal::INT] {
        let Some(command) = interruptible(program) else { return };
        let mut server = Server::run(command, directory.path(), &[]);
        let address = server.address.clone();
        let (completed, refused) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for number in 0..16 {
                let (address, districts, completed, refused) = (&address, &districts, &completed, &refused);
                scope.spawn(move || {
                    loop {
                        let Ok(stream) = std::net::TcpStream::connect(address) else { break };
                        drop(stream);
                        let result = std::panic::catch_unwind(|| {
                            let mut connection = super::Connection::open(address);
                            match number % 2 {
                                0 => connection.get("/window/heights?size=500&style=hillshade"),
                                _ => connection.request(
                                    "POST",
                                    "/zonal/heights?measure=median",
                                    &[],
                                    districts,
                                ),
                            }
                        });
                        match result {
                            Ok(Ok(response)) => {
                                // A response that has begun is completed.
                                response.good();
                                completed.fetch_add(1, Ordering::Relaxed);
                            }
                            // The connection was rejected, or closed before its request was read.
                            _ => {
                                refused.fetch_add(1, Ordering::Relaxed);
                                break;
                            }
                        }
                    }
                });
            }
            while completed.load(Ordering::Relaxed) < 32 {
                std::thread::sleep(Duration::from_millis(1));
            }
            let child = server.process();
            kill_process(Pid::from_child(child), signal).unwrap();
            let status = child.wait().unwrap();
            assert!(status.success(), "{status}");
        });
        assert!(std::net::TcpStream::connect(&address).is_err());
    }
}
