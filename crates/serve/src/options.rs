//! Options of the server: where it listens, and the limits of requests.

use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

use spinney_base::io::FileAccess;

/// Address of a server, and its limits.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ServeOptions {
    /// Address that the server listens at; this machine's own alone if nothing is said.
    pub host: IpAddr,
    /// Port that it listens at; 0 is any that is free.
    pub port: u16,
    /// Time that an answer may take, the waiting for other work included, and that a client may make it wait.
    pub timeout: Duration,
    /// Most cells of a window, or pixels of a picture.
    pub max_cells: u64,
    /// Most bytes of a request's body.
    pub max_body: u64,
    /// Most connections at the same time.
    pub connections: usize,
    /// Origins whose pages may read responses (CORS): `*` is all; without any, pages of the server itself may.
    pub allow_origins: Vec<String>,
    /// Names by which requests may call the server, besides those of its address; `*` is any. Without any, a loopback address has the names of this
    /// machine alone, and others have all.
    pub allow_hosts: Vec<String>,
    /// Address of the server as clients know it, where a proxy is before it.
    pub public_url: Option<String>,
    /// How the files that a served manifest lists are opened.
    pub access: FileAccess,
}

impl Default for ServeOptions {
    fn default() -> ServeOptions {
        ServeOptions {
            host: Ipv4Addr::LOCALHOST.into(),
            port: 8000,
            timeout: Duration::from_secs(30),
            max_cells: 4 << 20,
            max_body: 8 << 20,
            connections: 256,
            allow_origins: vec!["*".into()],
            allow_hosts: Vec::new(),
            public_url: None,
            access: FileAccess::default(),
        }
    }
}
