//! Server: accepts connections, and shuts down gracefully.

use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use futures_util::future::{Either, select};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use spinney_base::{Error, Result};
use spinney_container::FileHeader;
use spinney_engine::dataset::open;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, watch};
use tokio::time::{sleep, timeout};

use crate::ServeOptions;
use crate::catalog::Catalog;
use crate::connection::PatientStream;
use crate::failure::Failure;
use crate::hosts::Hosts;
use crate::routes::{App, routes};

/// HTTP server of tree files. It listens once bound, and responds once [`Server::run`] is called.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::serve::{ServeOptions, Server};
///
/// let mut options = ServeOptions::default();
/// options.port = 0;
/// let server = Server::bind("fixtures/v1".as_ref(), options)?;
/// println!("http://{}/", server.address());
/// // (Stops at once.)
/// server.run(&|| true)?;
/// # Ok::<(), spinney::Error>(())
/// ```
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    app: Arc<App>,
}

/// Interval between checks whether the server should stop.
const STOP_CHECK_INTERVAL: Duration = Duration::from_millis(50);

/// Time for running requests to finish when the server stops.
const GRACE: Duration = Duration::from_secs(10);

/// Minimum time that a client may stall.
const MIN_TIMEOUT: Duration = Duration::from_secs(1);

/// Maximum size of a request's head in bytes.
const LONGEST_HEAD: usize = 64 << 10;

/// Async threads; jobs run on blocking threads.
const THREADS: usize = 2;

/// Maximum number of concurrent file reads, in addition to jobs.
const READERS: usize = 32;

/// Maximum number of concurrent jobs: one more than the threads for parallel work, so that these
/// stay busy.
fn max_jobs() -> usize {
    spinney_base::parallel::threads() + 1
}

impl Server {
    /// Listens at an address, and serves a tree file, or all tree files of a directory.
    ///
    /// # Errors
    /// If there is no such file or directory, or the address is unavailable.
    pub fn bind(path: &Path, options: ServeOptions) -> Result<Server> {
        let catalog = Catalog::new(path)?;
        let address = SocketAddr::new(options.host, options.port);
        let refused = |cause: std::io::Error| {
            let advice = format!("a free address of this machine ({cause}); port 0 selects a free port");
            Error::invalid("host and port", address.to_string(), advice)
        };
        let listener = TcpListener::bind(address).map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let hosts = Hosts::new(&options, address)?;
        Ok(Server { listener, address, app: App::new(catalog, options, hosts, [max_jobs(), READERS]) })
    }

    /// Returns the address that the server listens at.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns remarks on the files: which ones queries must name in full, and why; and why a
    /// single file cannot be queried.
    ///
    /// # Errors
    /// If the directory cannot be read.
    pub fn remarks(&self) -> Result<Vec<String>> {
        let access = &self.app.options.access;
        if let Catalog::File(path) = &self.app.catalog
            && FileHeader::find(path, access)?.is_none()
            && let Err(error) = open(path, &access.into())
        {
            return Ok(vec![format!("{error}; the server only returns its bytes")]);
        }
        let files = self.app.catalog.list()?;
        let by_file = files.iter().filter(|file| file.name == file.file);
        let remarks = by_file.map(|file| {
            format!(
                "{}: another file has this stem, or the extension is unusual; request it by its full name",
                file.file
            )
        });
        let none = files.is_empty().then(|| "the directory has no .goblin or .autumn files yet".into());
        Ok(remarks.chain(none).collect())
    }

    /// Serves requests until `is_stopped` returns true. Then no connections are accepted, and
    /// running requests may finish within a grace period before they are cancelled.
    ///
    /// # Errors
    /// If the system cannot start threads.
    pub fn run(self, is_stopped: &(dyn Fn() -> bool + Sync)) -> Result<()> {
        let failed = |cause| Error::io("server", "start threads for")(cause);
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(THREADS)
            .max_blocking_threads(max_jobs() + READERS)
            .thread_name("spinney-serve")
            .enable_all()
            .build()
            .map_err(failed)?;
        let app = self.app.clone();
        let served = runtime.block_on(self.serve(is_stopped));
        app.work.end();
        // Jobs that ignore cancellation are abandoned.
        runtime.shutdown_timeout(Duration::from_secs(1));
        served.map_err(failed)
    }

    async fn serve(self, is_stopped: &(dyn Fn() -> bool + Sync)) -> std::io::Result<()> {
        let Server { listener, app, .. } = self;
        listener.set_nonblocking(true)?;
        let listener = tokio::net::TcpListener::from_std(listener)?;
        let router = routes(app.clone());
        let permits = Arc::new(Semaphore::new(app.options.connections));
        let (stop, is_over) = watch::channel(false);
        while !is_stopped() {
            // Failures such as too many open files, or a client that has already closed, are
            // transient.
            let stream = match timeout(STOP_CHECK_INTERVAL, listener.accept()).await {
                Err(_) => continue,
                Ok(Ok((stream, _))) => stream,
                Ok(Err(_)) => {
                    sleep(STOP_CHECK_INTERVAL).await;
                    continue;
                }
            };
            let (router, is_over) = (router.clone(), is_over.clone());
            let patience = app.options.timeout.max(MIN_TIMEOUT);
            match permits.clone().try_acquire_owned() {
                Ok(permit) => tokio::spawn(async move {
                    handle_connection(stream, router, patience, is_over).await;
                    drop(permit);
                }),
                Err(_) => tokio::spawn(refuse(stream, app.clone())),
            };
        }
        drop((listener, is_over));
        let _ = stop.send(true);
        let _ = timeout(GRACE, stop.closed()).await;
        Ok(())
    }
}

/// Serves the requests of a connection until it closes or the server stops.
async fn handle_connection(
    stream: TcpStream,
    router: Router,
    patience: Duration,
    mut is_over: watch::Receiver<bool>,
) {
    let _ = stream.set_nodelay(true);
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(patience)
        .max_buf_size(LONGEST_HEAD)
        .serve_connection(
            TokioIo::new(PatientStream::new(stream, patience)),
            TowerToHyperService::new(router),
        );
    let mut connection = std::pin::pin!(connection);
    let stopped = std::pin::pin!(is_over.wait_for(|is_over| *is_over));
    // Connection errors cannot be reported to the client.
    let is_stopped = matches!(select(connection.as_mut(), stopped).await, Either::Right(_));
    if is_stopped {
        connection.as_mut().graceful_shutdown();
        let _ = connection.await;
    }
}

/// Sends a response that the connection limit is reached.
async fn refuse(mut stream: TcpStream, app: Arc<App>) {
    let limit = app.options.connections;
    let is_open = app.options.allow_origins.iter().any(|origin| origin == "*");
    let origin = if is_open { "Access-Control-Allow-Origin: *\r\n" } else { "" };
    let failure = Failure::busy(format!("all {limit} connections are in use; try again later"));
    let body = failure.body();
    let head = format!(
        "HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/json\r\nContent-Length: {}\r\nRetry-After: 1\r\n\
         {origin}Connection: close\r\n\r\n{body}",
        body.len()
    );
    let _ = timeout(Duration::from_secs(1), stream.write_all(head.as_bytes())).await;
    // Closing a connection with unread input may discard the response, so the input is drained.
    let drained = async {
        let _ = stream.shutdown().await;
        let mut rest = [0; 1024];
        while stream.read(&mut rest).await.is_ok_and(|read| read > 0) {}
    };
    let _ = timeout(Duration::from_secs(1), drained).await;
}
