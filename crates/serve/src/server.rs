//! The server: from the socket to its end in good order.

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

/// A server of files and answers, which listens and does not answer yet.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::serve::{ServeOptions, Server};
///
/// let mut options = ServeOptions::default();
/// options.port = 0;
/// let server = Server::bind("fixtures/v1".as_ref(), options)?;
/// println!("http://{}/", server.address());
/// // (This one ends at once.)
/// server.run(&|| true)?;
/// # Ok::<(), spinney::Error>(())
/// ```
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    app: Arc<App>,
}

/// Time between two looks at whether the server is to stop.
const LOOK: Duration = Duration::from_millis(50);

/// Time that requests have to come to their end when the server stops.
const GRACE: Duration = Duration::from_secs(10);

/// Time that every client has for its next step.
const MIN_TIMEOUT: Duration = Duration::from_secs(1);

/// Bytes of a request's head that are read.
const LONGEST_HEAD: usize = 64 << 10;

/// Threads for requests; their work is done by others.
const THREADS: usize = 2;

/// Files that are read for answers at the same time, besides the work for others.
const READERS: usize = 32;

/// Pieces of work that are done at the same time: one more than there are threads, so that none of these waits.
fn places() -> usize {
    spinney_base::parallel::threads() + 1
}

impl Server {
    /// Listens at an address, for requests for a tree file, or all in a folder.
    ///
    /// # Errors
    /// If there is no such file or folder, or the address cannot be had.
    pub fn bind(path: &Path, options: ServeOptions) -> Result<Server> {
        let catalog = Catalog::new(path)?;
        let address = SocketAddr::new(options.host, options.port);
        let refused = |cause: std::io::Error| {
            let advice = format!("an address of this machine that is free ({cause}); port 0 is any");
            Error::invalid("host and port", address.to_string(), advice)
        };
        let listener = TcpListener::bind(address).map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let hosts = Hosts::new(&options, address)?;
        Ok(Server { listener, address, app: App::new(catalog, options, hosts, [places(), READERS]) })
    }

    /// The address that the server listens at.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Remarks on the files: which ones are asked for by the whole of their names, and why.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn remarks(&self) -> Result<Vec<String>> {
        let files = self.app.catalog.list()?;
        let by_file = files.iter().filter(|file| file.name == file.file);
        let told = by_file.map(|file| {
            format!(
                "{}: has the stem of another file, or an unusual ending; ask for it by all of its name",
                file.file
            )
        });
        let none = files.is_empty().then(|| "no .goblin or .autumn file is there yet".into());
        Ok(told.chain(none).collect())
    }

    /// Answers requests until `is_stopped`; then nobody is let in, and requests that are answered come to their end, or are given up when
    /// the time for that is over.
    ///
    /// # Errors
    /// If the system has no thread left.
    pub fn run(self, is_stopped: &(dyn Fn() -> bool + Sync)) -> Result<()> {
        let failed = |cause| Error::io("server", "start threads for")(cause);
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(THREADS)
            .max_blocking_threads(places() + READERS)
            .thread_name("spinney-serve")
            .enable_all()
            .build()
            .map_err(failed)?;
        let app = self.app.clone();
        let served = runtime.block_on(self.serve(is_stopped));
        app.work.end();
        // (What does not heed its end is left behind.)
        runtime.shutdown_timeout(Duration::from_secs(1));
        served.map_err(failed)
    }

    async fn serve(self, is_stopped: &(dyn Fn() -> bool + Sync)) -> std::io::Result<()> {
        let Server { listener, app, .. } = self;
        listener.set_nonblocking(true)?;
        let listener = tokio::net::TcpListener::from_std(listener)?;
        let router = routes(app.clone());
        let rooms = Arc::new(Semaphore::new(app.options.connections));
        let (stop, is_over) = watch::channel(false);
        while !is_stopped() {
            // (Too many open files, or a client that is gone already, are over in a moment.)
            let stream = match timeout(LOOK, listener.accept()).await {
                Err(_) => continue,
                Ok(Ok((stream, _))) => stream,
                Ok(Err(_)) => {
                    sleep(LOOK).await;
                    continue;
                }
            };
            let (router, is_over) = (router.clone(), is_over.clone());
            let patience = app.options.timeout.max(MIN_TIMEOUT);
            match rooms.clone().try_acquire_owned() {
                Ok(room) => tokio::spawn(async move {
                    answer(stream, router, patience, is_over).await;
                    drop(room);
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

/// Answers the requests of a connection, until there are no more or the server stops.
async fn answer(stream: TcpStream, router: Router, patience: Duration, mut is_over: watch::Receiver<bool>) {
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
    // (Nobody is there to be told what was wrong with a connection.)
    let is_stopped = matches!(select(connection.as_mut(), stopped).await, Either::Right(_));
    if is_stopped {
        connection.as_mut().graceful_shutdown();
        let _ = connection.await;
    }
}

/// Tells a client that there is no room, and why.
async fn refuse(mut stream: TcpStream, app: Arc<App>) {
    let most = app.options.connections;
    let is_open = app.options.allow_origins.iter().any(|origin| origin == "*");
    let origin = if is_open { "Access-Control-Allow-Origin: *\r\n" } else { "" };
    let failure =
        Failure::busy(format!("{most} connections are open, as many as are allowed; try again later"));
    let body = failure.body();
    let head = format!(
        "HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/json\r\nContent-Length: {}\r\nRetry-After: 1\r\n\
         {origin}Connection: close\r\n\r\n{body}",
        body.len()
    );
    let _ = timeout(Duration::from_secs(1), stream.write_all(head.as_bytes())).await;
    // (A connection that is closed with something unread takes the answer with it.)
    let drained = async {
        let _ = stream.shutdown().await;
        let mut rest = [0; 1024];
        while stream.read(&mut rest).await.is_ok_and(|read| read > 0) {}
    };
    let _ = timeout(Duration::from_secs(1), drained).await;
}
