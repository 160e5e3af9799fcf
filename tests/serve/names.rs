//! Server names, page origins, proxies, and compressed responses.

use std::io::Read as _;

use super::{Server, island};

#[test]
fn a_local_server_has_local_names() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let status = |server: &Server, hosts: &str| {
        let mut connection = server.connect();
        connection.send(format!("GET /files.json HTTP/1.1\r\n{hosts}\r\n").as_bytes()).unwrap();
        connection.receive(false).unwrap().status
    };
    for host in ["localhost", "localhost:1234", "127.0.0.1", "[::1]:80", &server.address] {
        assert_eq!(status(&server, &format!("Host: {host}\r\n")), 200, "{host}");
    }
    assert_eq!(status(&server, ""), 400);
    assert_eq!(status(&server, "Host: localhost\r\nHost: localhost\r\n"), 400);
    for host in ["evil.example", "127.0.0.1.evil.example", "10.0.0.1"] {
        assert_eq!(status(&server, &format!("Host: {host}\r\n")), 421, "{host}");
    }
    let named = Server::start(directory.path(), &["--allow-host", "maps.example"]);
    assert_eq!(status(&named, "Host: maps.example:8080\r\n"), 200);
    assert_eq!(status(&named, "Host: localhost\r\n"), 200);
    assert_eq!(status(&named, "Host: other.example\r\n"), 421);
}

#[test]
fn pages_of_named_origins_alone_may_read_responses() {
    let directory = island();
    let open = Server::start(directory.path(), &[]);
    let origin = ("Origin", "https://maps.example");
    assert_eq!(open.get_with("/healthz", &[origin]).header("access-control-allow-origin"), Some("*"));
    let named = Server::start(directory.path(), &["--allow-origin", "https://maps.example"]);
    let response = named.get_with("/healthz", &[origin]);
    assert_eq!(response.header("access-control-allow-origin"), Some("https://maps.example"));
    assert!(response.headers.iter().any(|(name, value)| name == "vary" && value.contains("Origin")));
    let none = Server::start(directory.path(), &["--allow-origin", "none"]);
    for (server, origin) in [(&named, "https://evil.example"), (&none, "https://maps.example")] {
        for method in ["GET", "OPTIONS"] {
            let response = server.connect().request(method, "/healthz", &[("Origin", origin)], b"").unwrap();
            assert_eq!(response.header("access-control-allow-origin"), None);
            assert_eq!(response.header("access-control-allow-methods"), None);
        }
    }
}

#[test]
fn tiles_of_a_proxied_server_have_its_public_address() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let tiles = |server: &Server, headers: &[(&str, &str)]| {
        let response = server.get_with("/tiles/classes.json", headers).json();
        response["tiles"][0].as_str().unwrap().split("/tiles/").next().unwrap().to_owned()
    };
    assert_eq!(tiles(&server, &[]), format!("http://{}", server.address));
    let proxy =
        [("X-Forwarded-Proto", "https"), ("X-Forwarded-Host", "maps.example"), ("X-Forwarded-Prefix", "/a")];
    assert_eq!(tiles(&server, &proxy), "https://maps.example/a");
    assert_eq!(tiles(&server, &[("Forwarded", "proto=https;host=maps.example")]), "https://maps.example");
    let public = Server::start(directory.path(), &["--public-url", "https://maps.example/b/"]);
    assert_eq!(tiles(&public, &proxy), "https://maps.example/b");
    // One client's responses are not used for another.
    assert_eq!(tiles(&server, &[]), format!("http://{}", server.address));
}

#[test]
fn responses_are_compressed_where_that_pays() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let gzip = ("Accept-Encoding", "gzip");
    for target in ["/window/heights?format=json&size=64", "/window/heights?format=npy", "/"] {
        let plain = server.get(target);
        assert_eq!(plain.header("content-encoding"), None);
        let packed = server.get_with(target, &[gzip]);
        assert_eq!(packed.header("content-encoding"), Some("gzip"), "{target}");
        assert!(packed.header("vary").is_some_and(|vary| vary.contains("Accept-Encoding")), "{target}");
        let mut bytes = Vec::new();
        flate2::read::GzDecoder::new(&packed.body[..]).read_to_end(&mut bytes).unwrap();
        assert!(bytes == plain.body && packed.body.len() < plain.body.len(), "{target}");
        if let Some(tag) = packed.header("etag") {
            assert_ne!(Some(tag), plain.header("etag"));
            let again = server.get_with(target, &[gzip, ("If-None-Match", tag)]);
            assert_eq!((again.status, again.header("etag")), (304, Some(tag)));
        }
    }
    // Images, small responses and files are not compressed.
    for target in ["/tiles/heights/0/0/0.png?grid=native", "/healthz", "/heights.goblin"] {
        assert_eq!(server.get_with(target, &[gzip]).header("content-encoding"), None, "{target}");
    }
    let part = server.get_with("/heights.goblin", &[gzip, ("Range", "bytes=0-99999")]);
    assert_eq!((part.status, part.header("content-encoding")), (206, None));
}

/// Host and port follow the options, and a browser shows the page.
#[test]
#[cfg(target_os = "linux")]
fn addresses_are_chosen_and_shown() {
    use std::os::unix::fs::PermissionsExt as _;

    let (directory, programs) = (island(), tempfile::tempdir().unwrap());
    let browser = programs.path().join("xdg-open");
    std::fs::write(&browser, "#!/bin/sh\necho \"$1\" > \"${0%/*}/shown\"\n").unwrap();
    std::fs::set_permissions(&browser, std::fs::Permissions::from_mode(0o755)).unwrap();
    // A port that was free a moment ago may be in use by now.
    let started = (0..20).find_map(|_| {
        let port = std::net::TcpListener::bind("127.0.0.2:0").unwrap().local_addr().unwrap().port();
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_spinney"));
        let path = format!("{}:{}", programs.path().display(), std::env::var("PATH").unwrap_or_default());
        command.env("PATH", path).args(["serve", "--host", "127.0.0.2", "--open", "-q", "--port"]);
        command.arg(port.to_string()).arg(directory.path());
        let server = Server::of(command);
        (!server.address.is_empty()).then_some((port, server))
    });
    let (port, server) = started.expect("a port that stays free");
    assert_eq!(server.address, format!("127.0.0.2:{port}"));
    assert_eq!(server.get("/healthz").status, 200);
    let shown = programs.path().join("shown");
    super::malicious::wait_until("the browser is started", || {
        std::fs::read_to_string(&shown).is_ok_and(|url| url == format!("http://127.0.0.2:{port}/\n"))
    });
}
