//! `spinney serve`: files and query results for browsers and other programs.

use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Result, ensure};
use spinney::raw::io::url_of;
use spinney::serve::{ServeOptions, Server};

use super::Global;
use super::args::{parse_bytes, parse_seconds};
use super::report::{print_text, warn};
use super::signals::{stop_in_good_order, stop_is_wanted};

const EXAMPLES: &str = "Examples:
  spinney serve maps
  spinney serve relief.goblin --open
  spinney serve maps --port 0 --timeout 10 --max-cells 1000000
  curl 'http://127.0.0.1:8000/point/relief?x=7.66&y=45.98'
  curl -H 'Range: bytes=0-4095' http://127.0.0.1:8000/relief.goblin -o start
  curl --data-binary @districts.geojson 'http://127.0.0.1:8000/zonal/landcover?edge=area'

The server prints its address when it listens, and runs until Ctrl-C or SIGTERM; it completes open
requests first. docs/serve.md describes all paths and their responses.

Any client that can reach the address can read the files: by default programs on this machine, and
pages of any origin in its browsers.";

/// Serve files and query results over HTTP
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Directory whose .goblin and .autumn files are served, or one file
    #[arg(value_name = "DIRECTORY|FILE")]
    path: PathBuf,
    /// Show the page in a browser
    #[arg(long)]
    open: bool,
    /// Port to listen at; 0 is any free port
    #[arg(long, value_name = "N", default_value_t = 8000)]
    port: u16,
    /// Address to listen at: by default only this machine can connect; 0.0.0.0 is all its addresses
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    host: IpAddr,
    /// Origin whose pages may read responses (CORS), as in https://maps.example.org; repeatable; *
    /// is all, none is only the server's own pages
    #[arg(long, value_name = "ORIGIN", default_value = "*")]
    allow_origin: Vec<String>,
    /// Host name that requests may use: in addition to those of the address; repeatable; * is any.
    /// Without it, a loopback address accepts only localhost and similar names (against DNS
    /// rebinding), others accept all names
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<String>,
    /// Address of the server as clients know it: for TileJSON with a proxy, as in
    /// https://maps.example.org/tiles [default: by X-Forwarded-Proto, -Host and -Prefix, Forwarded
    /// or Host of the request]
    #[arg(long, value_name = "URL")]
    public_url: Option<String>,
    /// Seconds that a response may take; also the time to wait for a client
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, value_parser = parse_seconds)]
    timeout: f64,
    /// Maximum pixels of a requested window
    #[arg(long, value_name = "N", default_value_t = 4 << 20, value_parser = clap::value_parser!(u64).range(1..))]
    max_cells: u64,
    /// Maximum bytes of polygons in a request
    #[arg(long, value_name = "BYTES", default_value = "8M", value_parser = parse_bytes)]
    max_body: u64,
    /// Maximum number of concurrent connections
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u16).range(1..))]
    connections: u16,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    ensure!(
        url_of(&args.path).is_none(),
        "{}: is a remote file, expected a local one; copy it to this machine first",
        args.path.display()
    );
    let mut options = ServeOptions::default();
    options.access = global.access().clone();
    (options.host, options.port) = (args.host, args.port);
    options.timeout = Duration::from_secs_f64(args.timeout);
    (options.max_cells, options.max_body) = (args.max_cells, args.max_body);
    options.connections = args.connections.into();
    options.allow_origins = args.allow_origin.iter().filter(|origin| *origin != "none").cloned().collect();
    options.allow_hosts.clone_from(&args.allow_host);
    options.public_url.clone_from(&args.public_url);
    stop_in_good_order()?;
    let server = Server::bind(&args.path, options)?;
    server.remarks()?.iter().for_each(|remark| warn(remark));
    let url = format!("http://{}/", server.address());
    print_text(&format!("{url}\n"))?;
    if args.open && !open_browser(&url) {
        warn("no browser was found; open the address in one");
    }
    server.run(&stop_is_wanted)?;
    global.report("stopped", "all requests are complete");
    Ok(())
}

/// Opens a URL in the system's browser.
fn open_browser(url: &str) -> bool {
    const LAUNCHERS: [&str; 4] = ["xdg-open", "open", "explorer", "wslview"];
    LAUNCHERS.iter().any(|launcher| {
        let mut command = Command::new(launcher);
        command.arg(url).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().is_ok()
    })
}
