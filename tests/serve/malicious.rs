//! Clients that request too much, are slow, disconnect, or send invalid data.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

use spinney::{DataKind, Rule, SampleType};

use super::common::{Cells, Random, options, quad, write_cells};
use super::{Server, fixture, island};

/// Waits until a condition holds, with a long timeout for busy machines.
pub(crate) fn wait_until(what: &str, holds: impl Fn() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn limits_are_reported() {
    let directory = island();
    let server = Server::start(directory.path(), &["--max-cells", "1000", "--max-body", "2K"]);
    server.get("/window/heights?size=31x32").good();
    let message = server.get("/window/heights?size=32x32").complaint(413);
    assert!(message.contains("1000") && message.contains("32 x 32"), "{message}");
    let long = vec![b' '; 3000];
    let message = server.post("/zonal/classes", &long).complaint(413);
    assert!(message.contains("2048"), "{message}");
    // Bodies without a length are limited, too.
    let mut connection = server.connect();
    let head = "POST /zonal/classes HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n";
    connection.send(head.as_bytes()).unwrap();
    let chunk = format!("{:x}\r\n{}\r\n", long.len(), " ".repeat(long.len()));
    let _ = connection.send(chunk.as_bytes());
    connection.receive(false).unwrap().complaint(413);
    drop(connection);
    // Overlong heads are rejected.
    let response = server.connect().request("GET", &format!("/{}", "a".repeat(1 << 20)), &[], b"");
    assert!(response.is_err() || (400..500).contains(&response.unwrap().status));
    let many: Vec<(&str, &str)> = vec![("A", "b"); 1000];
    let response = server.connect().request("GET", "/healthz", &many, b"");
    assert!(response.is_err() || (400..500).contains(&response.unwrap().status));
    let query = "x=1&".repeat(20_000);
    let response = server.connect().get(&format!("/point/classes?{query}"));
    assert!(response.is_err() || (400..500).contains(&response.unwrap().status));
    let server = Server::start(directory.path(), &["--connections", "3"]);
    // Earlier connections end soon.
    wait_until("connections are free", || {
        let mut all: Vec<_> = (0..3).map(|_| server.connect()).collect();
        let are_open =
            all.iter_mut().all(|one| one.get("/healthz").is_ok_and(|response| response.status == 200));
        if are_open {
            let message = server.connect().get("/healthz").unwrap().complaint(503);
            assert!(message.contains("3 connections"), "{message}");
        }
        are_open
    });
    wait_until("connections are free again", || {
        server.connect().get("/healthz").is_ok_and(|response| response.status == 200)
    });
}

#[test]
fn requests_that_take_too_long_are_aborted() {
    let directory = tempfile::tempdir().unwrap();
    let cells = Cells::noise(quad(SampleType::U8, 1), 5, [700, 700, 1], 200);
    write_cells(
        &directory.path().join("noise.goblin"),
        &cells,
        &options(Rule::Mean, DataKind::Continuous, cells.depth()),
    );
    let server = Server::start(directory.path(), &["--timeout", "0.05"]);
    let message = server.get("/window/noise?size=2000x2000&style=hillshade&format=webp").complaint(503);
    assert!(message.contains("0.05 seconds") || message.contains("interrupted"), "{message}");
    // Its slot is free again.
    wait_until("a response", || server.get("/point/noise?x=1&y=1").status == 200);
}

#[test]
fn slow_clients_are_not_waited_for() {
    let directory = island();
    let server = Server::start(directory.path(), &["--timeout", "0.5"]);
    // One that never ends its head, one that never sends its body, one that sends nothing.
    for begin in [
        "GET /healthz HTTP/1.1\r\nHo",
        "POST /zonal/classes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n{",
        "",
    ] {
        let mut stream = TcpStream::connect(&server.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream.write_all(begin.as_bytes()).unwrap();
        let mut response = Vec::new();
        let ended = stream.read_to_end(&mut response);
        assert!(
            ended.is_ok() || !matches!(ended.unwrap_err().kind(), std::io::ErrorKind::WouldBlock),
            "{begin}"
        );
        if begin.starts_with("POST") {
            assert!(response.starts_with(b"HTTP/1.1 408"), "{}", String::from_utf8_lossy(&response));
        }
    }
    // A client that does not read the response.
    std::fs::write(directory.path().join("long.goblin"), vec![7; 64 << 20]).unwrap();
    let mut connection = server.connect();
    connection.send(b"GET /long.goblin HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    std::thread::sleep(Duration::from_millis(3000));
    assert!(connection.receive(false).is_err(), "the connection ends before the body does");
    server.get("/healthz").good();
}

#[test]
fn clients_that_disconnect_leave_no_resources() {
    let directory = island();
    let server = Server::start(directory.path(), &["--connections", "8"]);
    std::fs::write(directory.path().join("long.goblin"), vec![7; 16 << 20]).unwrap();
    let districts = std::fs::read_to_string(fixture("island_districts.geojson")).unwrap();
    let zonal = format!(
        "POST /zonal/heights?measure=median HTTP/1.1\r\nHost: localhost\r\nContent-Length: {}\r\n\r\n{districts}",
        districts.len()
    );
    for round in 0..200 {
        let request = match round % 5 {
            0 => "GET /long.goblin HTTP/1.1\r\nHost: localhost\r\n\r\n",
            1 => "GET /window/heights?size=1000&style=hillshade HTTP/1.1\r\nHost: localhost\r\n\r\n",
            2 => &zonal,
            3 => &zonal[..zonal.len() / 2],
            _ => "GET /hea",
        };
        // The server may have rejected it while others were still open.
        let Ok(mut stream) = TcpStream::connect(&server.address) else { continue };
        let _ = stream.write_all(request.as_bytes());
        if round % 2 == 0 {
            let _ = stream.shutdown(Shutdown::Both);
        }
    }
    wait_until("all are gone", || {
        let response = server.connect().get("/window/heights?size=10");
        response.is_ok_and(|response| response.status == 200)
    });
}

#[test]
fn every_request_gets_a_response_or_is_rejected() {
    let directory = island();
    let server = Server::start(directory.path(), &["--timeout", "20"]);
    let mut random = Random(41);
    let targets = [
        "/",
        "/healthz",
        "/files.json",
        "/classes.goblin",
        "/point/classes?x=305000&y=3196000&crs=world&level=3",
        "/window/heights?bounds=303000,3194000,307000,3198000&size=40&format=json&style=terrain",
        "/window/heights?cells=1,2,30,40&level=7&format=npy",
        "/zonal/classes?edge=area&quantiles=0.5&measure=median",
        "/point/stack?x=1&y=2&crs=cells&layer=0&commit=1",
        "/tiles/classes.json",
        "/tiles/classes/9/236/213.png?style=viridis",
    ];
    let fragments = [
        "..",
        "%2e",
        "%00",
        "/",
        "?",
        "&",
        "=",
        "-1",
        "1e308",
        "NaN",
        "18446744073709551616",
        "%",
        "{",
        "\"",
        "é",
        "\\",
        "@",
        ":",
        ",",
        "0",
        "9",
        "commit",
        "[[",
        "a",
        "crs=EPSG:",
        "level=255",
        "size=9999999",
        "\u{7f}",
        ";",
        "+",
        "#",
    ];
    let headers = [
        "Range: bytes=0-9",
        "Range: bytes=-",
        "Range: bytes=9-0,5",
        "If-Range: \"x",
        "If-None-Match: W/\"",
        "Content-Length: 5",
        "Transfer-Encoding: chunked",
        "Expect: 100-continue",
        "Connection: close",
        "Host:",
        "Upgrade: h2c",
        "Accept-Encoding: gzip",
    ];
    let pick = |random: &mut Random, count: usize| random.below(count as u64) as usize;
    for _ in 0..1500 {
        let mut target = targets[pick(&mut random, targets.len())].to_owned();
        for _ in 0..random.below(4) {
            let offsets: Vec<usize> = target.char_indices().map(|(at, _)| at).skip(1).collect();
            let at = offsets.get(pick(&mut random, offsets.len().max(1))).copied().unwrap_or(target.len());
            match random.below(3) {
                0 => target.insert_str(at, fragments[pick(&mut random, fragments.len())]),
                1 => target.truncate(at),
                _ => target = format!("{}{}", &target[..at], fragments[pick(&mut random, fragments.len())]),
            }
        }
        let method = ["GET", "GET", "GET", "POST", "HEAD", "OPTIONS", "BREW"][pick(&mut random, 7)];
        let mut request = format!("{method} {target} HTTP/1.1\r\nHost: localhost\r\n");
        for _ in 0..random.below(3) {
            request += headers[pick(&mut random, headers.len())];
            request += "\r\n";
        }
        request += "\r\n{\"type\":\"Polygon\",\"coordinates\":[[[1,2],[3,4]]]}";
        let mut bytes = request.into_bytes();
        if random.below(4) == 0 {
            let at = pick(&mut random, bytes.len());
            bytes[at] = random.next() as u8;
        }
        let mut stream = TcpStream::connect(&server.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let _ = stream.write_all(&bytes);
        let _ = stream.shutdown(Shutdown::Write);
        let mut response = Vec::new();
        // A connection closed with unread request bytes is reset.
        if let Err(error) = stream.read_to_end(&mut response) {
            assert!(
                error.kind() == std::io::ErrorKind::ConnectionReset,
                "{error}: {}",
                String::from_utf8_lossy(&bytes)
            );
        }
        let status: Option<u16> =
            response.get(9..12).and_then(|text| std::str::from_utf8(text).ok()?.parse().ok());
        assert!(
            status.is_none_or(|status| status < 500 || status == 503),
            "{}\n{}",
            String::from_utf8_lossy(&bytes),
            String::from_utf8_lossy(&response)
        );
    }
    server.get("/healthz").good();
}
