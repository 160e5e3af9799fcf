//! Options of the server: its address, and the limits of requests.

use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

use spinney_base::io::FileAccess;

/// Address of a server, and its limits.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ServeOptions {
    /// Address to listen at. The default is loopback.
    pub host: IpAddr,
    /// Port to listen at; 0 chooses a free one.
    pub port: u16,
    /// Maximum time for a response, including the wait for other work, and maximum time that a
    /// client may stall.
    pub timeout: Duration,
    /// Maximum number of cells of a window, or of pixels of an image.
    pub max_cells: u64,
    /// Maximum size of a request's body in bytes.
    pub max_body: u64,
    /// Maximum number of concurrent connections.
    pub connections: usize,
    /// Origins whose pages may read responses (CORS): `*` allows all. If empty, only pages of the
    /// server itself may.
    pub allow_origins: Vec<String>,
    /// Host names that requests may use, in addition to the server's address; `*` allows any. If
    /// empty, a server at a loopback address accepts only local names, and others accept all.
    pub allow_hosts: Vec<String>,
    /// URL of the server as clients see it, if they connect through a proxy.
    pub public_url: Option<String>,
    /// Access to the files that a served manifest lists.
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
