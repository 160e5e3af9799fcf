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
    let region = FillRegion::Box(Bounds::picture([SIDE, SIDE, 1]));
    let edit = Edit::Fill(region, Some(vec![number.into()]));
    spinney::edit::edit(path, [Ok(edit)], Note::default(), 16 << 20, &()).unwrap();
}

/// Returns the one value of all cells of a window, from a JSON response.
fn value_of(answer: &serde_json::Value) -> u64 {
    let rows = answer["values"].as_array().unwrap();
    let all: Vec<u64> =
        rows.iter().flat_map(|row| row.as_array().unwrap()).map(|cell| cell.as_u64().unwrap()).collect();
    assert_eq!(all.len() as u64, SIDE * SIDE);
    assert!(all.iter().all(|value| *value == all[0]), "an answer of several versions: {all:?}");
    all[0]
}

#[test]
fn files_are_published_and_edited_while_they_are_read() {
    const TIMES: u8 = 100;
    let folder = tempfile::tempdir().unwrap();
    let [published, edited] = ["published.goblin", "edited.autumn"].map(|name| folder.path().join(name));
    write_version(&published, 0);
    write_version(&edited, 0);
    let server = Server::start(folder.path(), &["--timeout", "60"]);
    let (is_over, asked) = (AtomicBool::new(false), AtomicUsize::new(0));
    // Bytes of published files by their tags: equal tags imply equal bytes.
    let tags: Mutex<HashMap<String, Vec<u8>>> = Mutex::default();
    std::thread::scope(|scope| {
        for number in 0..64 {
            let (server, is_over, asked, tags) = (&server, &is_over, &asked, &tags);
            scope.spawn(move || {
                let mut connection = server.connect();
                let name = if number % 2 == 0 { "published" } else { "edited" };
                let mut last = 0;
                while !is_over.load(Ordering::Relaxed) {
                    asked.fetch_add(1, Ordering::Relaxed);
                    if number % 8 == 6 {
                        let answer = connection.get("/published.goblin").unwrap();
                        let tag = answer.header("etag").unwrap().to_owned();
                        let bytes = answer.good();
                        let mut tags = tags.lock().unwrap();
                        assert!(*tags.entry(tag).or_insert_with(|| bytes.clone()) == bytes);
                    } else if number % 8 == 7 {
                        let answer = connection.get("/edited.autumn").unwrap().good();
                        let copy = tempfile::Builder::new().suffix(".autumn").tempfile().unwrap();
                        std::fs::write(copy.path(), answer).unwrap();
                        let tree = spinney::open(copy.path()).unwrap();
                        assert!(tree.verify(1 << 24, &()).unwrap().is_empty());
                    } else {
                        let answer = connection.get(&format!("/window/{name}?format=json")).unwrap();
                        let answer = serde_json::from_slice(&answer.good()).unwrap();
                        let value = value_of(&answer);
                        assert!(value >= last, "version {value} after {last} of {name}");
                        last = value;
                    }
                }
            });
        }
        for number in 1..=TIMES {
            write_version(&published, number);
            edit_version(&edited, number);
            let before = asked.load(Ordering::Relaxed);
            while asked.load(Ordering::Relaxed) < before + 32 && scope_is_alive(&server) {
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
    server.connect().get("/healthz").is_ok_and(|answer| answer.status == 200)
}

#[test]
fn removed_files_are_gone_and_come_again() {
    let folder = island();
    let server = Server::start(folder.path(), &[]);
    let path = folder.path().join("classes.goblin");
    let ask = || {
        ["/classes.goblin", "/point/classes?x=1&y=1&crs=cells", "/window/classes?size=8"]
            .map(|target| server.get(target).status)
    };
    assert_eq!(ask(), [200; 3]);
    std::fs::rename(&path, folder.path().join("kept")).unwrap();
    assert_eq!(ask(), [404; 3]);
    std::fs::copy(folder.path().join("heights.goblin"), &path).unwrap();
    assert_eq!(ask(), [200; 3]);
    // A file that is no longer a tree is reported, and served again when it is one.
    std::fs::write(folder.path().join("new"), b"no tree").unwrap();
    std::fs::rename(folder.path().join("new"), &path).unwrap();
    let [file, point, window] = ask();
    assert!(file == 200 && point >= 400 && window >= 400);
    std::fs::rename(folder.path().join("kept"), &path).unwrap();
    assert_eq!(ask(), [200; 3]);
}

#[test]
fn files_that_are_cut_short_end_nothing() {
    let folder = island();
    let server = Server::start(folder.path(), &[]);
    let path = folder.path().join("heights.goblin");
    let bytes = std::fs::read(&path).unwrap();
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for target in ["/window/heights?size=200", "/tiles/heights/0/0/0.png?grid=native", "/heights.goblin"]
        {
            let (server, is_over) = (&server, &is_over);
            scope.spawn(move || {
                while !is_over.load(Ordering::Relaxed) {
                    // If a file's bytes are gone, the response is truncated.
                    if let Ok(answer) = server.connect().get(target) {
                        assert!(matches!(answer.status, 200 | 500 | 503), "{target}: {answer:?}");
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
    let folder = island();
    let districts = std::fs::read(fixture("island_districts.geojson")).unwrap();
    for signal in [Signal::TERM, Signal::INT] {
        let Some(command) = interruptible(program) else { return };
        let mut server = Server::run(command, folder.path(), &[]);
        let address = server.address.clone();
        let (answered, refused) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for number in 0..16 {
                let (address, districts, answered, refused) = (&address, &districts, &answered, &refused);
                scope.spawn(move || {
                    loop {
                        let Ok(stream) = std::net::TcpStream::connect(address) else { break };
                        drop(stream);
                        let asked = std::panic::catch_unwind(|| {
                            let mut connection = super::Connection::open(address);
                            match number % 2 {
                                0 => connection.get("/window/heights?size=500&style=hillshade"),
                                _ => connection.ask("POST", "/zonal/heights?measure=median", &[], districts),
                            }
                        });
                        match asked {
                            Ok(Ok(answer)) => {
                                // A response that has begun is completed.
                                answer.good();
                                answered.fetch_add(1, Ordering::Relaxed);
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
            while answered.load(Ordering::Relaxed) < 32 {
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
