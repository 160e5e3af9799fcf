//! Addresses and their handlers.

use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use http_body_util::{BodyExt as _, LengthLimitError, Limited};
use percent_encoding::percent_decode_str;
use spinney_site::PageContent;

use crate::catalog::{Catalog, ServedFile};
use crate::compression::compress;
use crate::failure::Failure;
use crate::hosts::Hosts;
use crate::opened::{OpenTree, OpenTrees};
use crate::origins::add_origin;
use crate::parameters::Parameters;
use crate::response::{QueryResponse, ResponseCache, has_tag};
use crate::sources::IndexSources;
use crate::tiles::{self, TileAddress};
use crate::work::{CancellationFlag, Executor};
use crate::{ServeOptions, file, page, point, window, zonal};

/// Maximum number of files whose headers are read for the page. It determines the contents of
/// further files when it opens them.
const MAX_CONTENTS: usize = 1000;

/// State that all requests share.
pub(crate) struct App {
    pub(crate) catalog: Catalog,
    pub(crate) work: Executor,
    /// Executor for reading files and directories, so that these do not wait for queries.
    pub(crate) reading: Executor,
    pub(crate) options: ServeOptions,
    hosts: Hosts,
    trees: OpenTrees,
    sources: IndexSources,
    responses: ResponseCache,
}

/// Path parameters of an address, or why they are invalid.
type Names<T> = Result<Path<T>, PathRejection>;

impl App {
    /// State for serving a catalog, with limits for concurrent queries and concurrent reads.
    pub(crate) fn new(
        catalog: Catalog,
        options: ServeOptions,
        hosts: Hosts,
        [work, reading]: [usize; 2],
    ) -> Arc<App> {
        let [work, reading] = [work, reading].map(|permits| Executor::new(permits, options.timeout));
        let trees = OpenTrees::new(matches!(catalog, Catalog::File(_)), &options.access);
        let sources = IndexSources::new(&options.access);
        Arc::new(App {
            catalog,
            work,
            reading,
            options,
            hosts,
            trees,
            sources,
            responses: ResponseCache::default(),
        })
    }

    /// Runs a query about a tree. Responds with 304 if the client has the current response.
    async fn run_query(
        self: &Arc<App>,
        name: Result<String, Failure>,
        (query, known): (Option<String>, &'static [&'static str]),
        head: RequestHead,
        respond: impl FnOnce(
            &App,
            &OpenTree,
            &Parameters,
            String,
            &CancellationFlag,
        ) -> Result<QueryResponse, Failure>
        + Send
        + 'static,
    ) -> Result<QueryResponse, Failure> {
        let app = self.clone();
        let name = name?;
        let parameters = Parameters::parse(query.as_deref(), known)?;
        let made = self.work.run(move |watch| {
            let commit = parameters.value("commit")?;
            let tree = app.trees.get(&app.catalog.tree(&name)?, commit)?;
            // Responses that depend on a body are not cached.
            let tag = tree.version.tag(&head.target);
            if head.method == Method::POST {
                let made = respond(&app, &tree, &parameters, tag, watch)?;
                return tree.check_unchanged().map(|()| made).map_err(Failure::from);
            }
            if has_tag(&head.headers, header::IF_NONE_MATCH, &tag, true) {
                return Ok(QueryResponse::not_modified(tag));
            }
            let key = (tag.clone(), head.target);
            if let Some(known) = app.responses.get(&key) {
                return Ok(known);
            }
            let made = respond(&app, &tree, &parameters, tag, watch)?;
            tree.check_unchanged()?;
            app.responses.insert(key, &made);
            Ok(made)
        });
        made.await.map_err(|failure| failure.without(self.catalog.directory()))
    }
}

/// Request without its body.
struct RequestHead {
    method: Method,
    target: String,
    headers: HeaderMap,
}

impl RequestHead {
    fn of(request: &Request) -> RequestHead {
        let target = request.uri().path_and_query().map_or("", |target| target.as_str());
        RequestHead {
            method: request.method().clone(),
            target: target.into(),
            headers: request.headers().clone(),
        }
    }
}

/// Router for all addresses.
pub(crate) fn routes(app: Arc<App>) -> Router {
    Router::new()
        .route("/", get(root))
        .route("/healthz", get(health))
        .route("/files.json", get(list))
        .route("/assets/{*name}", get(asset))
        .route("/tiles/{file}", get(tiles_of))
        .route("/tiles/{name}/{zoom}/{column}/{row}", get(tile_of))
        .route("/point/{name}", get(point_of))
        .route("/window/{name}", get(window_of))
        .route("/zonal/{name}", post(zonal_of))
        .route("/{file}", get(file_of))
        .fallback(not_found)
        .method_not_allowed_fallback(method_not_allowed)
        .layer(middleware::from_fn_with_state(app.clone(), add_sources))
        .layer(middleware::from_fn(compress))
        .layer(middleware::from_fn_with_state(app.clone(), add_origin))
        .layer(middleware::from_fn_with_state(app.clone(), check_host))
        .with_state(app)
}

async fn not_found(request: Request) -> Failure {
    Failure::missing(format!("`{}`: not found", request.uri().path().escape_debug()))
}

async fn method_not_allowed(request: Request) -> Failure {
    Failure::new(
        StatusCode::METHOD_NOT_ALLOWED,
        format!("{}: this address does not support the method", request.method()),
    )
}

/// Middleware that responds with a source of a served index where nothing else has the address. (A
/// source may be in a directory, whose name may be that of a query.)
async fn add_sources(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let path = request.uri().path().trim_start_matches('/');
    let name = percent_decode_str(path).decode_utf8().map(|name| name.into_owned());
    let head = RequestHead::of(&request);
    let response = next.run(request).await;
    let is_read = head.method == Method::GET || head.method == Method::HEAD;
    let (StatusCode::NOT_FOUND, true, Ok(name)) = (response.status(), is_read, name) else { return response };
    let shared = app.clone();
    let made = app.reading.run(move |_| {
        let found = shared.sources.find(&shared.catalog, &name)?;
        found.map(|path| file::respond(&path, &head.method, &head.headers)).transpose()
    });
    match made.await {
        Ok(None) => response,
        Ok(Some(source)) => source.into_response(),
        Err(failure) => failure.without(app.catalog.directory()).into_response(),
    }
}

/// Middleware that rejects requests with another host name, or without one.
async fn check_host(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    match app.hosts.check(request.uri(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err(failure) => failure.into_response(),
    }
}

/// Response with content that is created for each request.
fn text(content_type: &'static str, text: impl Into<Body>) -> Response {
    let mut response = Response::new(text.into());
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(content_type));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    response
}

async fn health() -> Response {
    text("application/json", "{\"status\":\"ok\"}\n")
}

async fn root(State(app): State<Arc<App>>) -> Result<Response, Failure> {
    let shared = app.clone();
    let made = app.reading.run(move |_| {
        let content = |number: usize, file: &ServedFile| match shared.catalog.file(&file.file) {
            Ok(path) if number < MAX_CONTENTS => PageContent::of(&path),
            _ => PageContent::Unknown,
        };
        let files = shared.catalog.list()?.into_iter().enumerate();
        let files = files.map(|(number, file)| {
            let content = content(number, &file);
            (file, content)
        });
        let files: Vec<(ServedFile, PageContent)> = files.collect();
        Ok(page::index(&files))
    });
    Ok(text(
        "text/html; charset=utf-8",
        made.await.map_err(|failure| failure.without(app.catalog.directory()))?,
    ))
}

async fn list(State(app): State<Arc<App>>) -> Result<Response, Failure> {
    let shared = app.clone();
    let made = app.reading.run(move |_| Ok(page::as_json(&shared.catalog.list()?)));
    Ok(text("application/json", made.await.map_err(|failure| failure.without(app.catalog.directory()))?))
}

async fn asset(names: Names<String>, request: Request) -> Result<QueryResponse, Failure> {
    let (tag, asset) = page::asset(&read(names)?)?;
    let has_it = has_tag(request.headers(), header::IF_NONE_MATCH, &tag, true);
    Ok(if has_it { QueryResponse::not_modified(tag) } else { asset })
}

async fn file_of(
    State(app): State<Arc<App>>,
    names: Names<String>,
    request: Request,
) -> Result<Response, Failure> {
    let name = read(names)?;
    let head = RequestHead::of(&request);
    let shared = app.clone();
    let made = app.reading.run(move |_| {
        let path = shared.catalog.file(&name)?;
        file::respond(&path, &head.method, &head.headers)
    });
    Ok(made.await.map_err(|failure| failure.without(app.catalog.directory()))?.into_response())
}

async fn tiles_of(
    State(app): State<Arc<App>>,
    names: Names<String>,
    request: Request,
) -> Result<QueryResponse, Failure> {
    let parameters = (request.uri().query().map(String::from), &tiles::JSON_PARAMETERS[..]);
    let file = read(names)?;
    let Some(name) = file.strip_suffix(".json").map(String::from) else {
        return Err(Failure::missing("tiles: expected NAME.json, or NAME/ZOOM/COLUMN/ROW.png"));
    };
    let mut head = RequestHead::of(&request);
    let server = app.hosts.public(&head.headers);
    head.target += &server;
    let named = name.clone();
    app.run_query(Ok(name), parameters, head, move |_, tree, parameters, tag, _| {
        tiles::about(tree, parameters, (&server, &named), tag)
    })
    .await
}

async fn tile_of(
    State(app): State<Arc<App>>,
    names: Names<[String; 4]>,
    request: Request,
) -> Result<QueryResponse, Failure> {
    let parameters = (request.uri().query().map(String::from), &tiles::PARAMETERS[..]);
    let [name, zoom, column, row] = read(names)?;
    let tile = TileAddress::parse(&zoom, &column, &row)?;
    app.run_query(Ok(name), parameters, RequestHead::of(&request), move |_, tree, parameters, tag, watch| {
        tiles::respond(tree, parameters, tile, tag, watch)
    })
    .await
}

async fn point_of(
    State(app): State<Arc<App>>,
    names: Names<String>,
    request: Request,
) -> Result<QueryResponse, Failure> {
    let parameters = (request.uri().query().map(String::from), &point::PARAMETERS[..]);
    app.run_query(read(names), parameters, RequestHead::of(&request), |_, tree, parameters, tag, _| {
        point::respond(tree, parameters, tag)
    })
    .await
}

async fn window_of(
    State(app): State<Arc<App>>,
    names: Names<String>,
    request: Request,
) -> Result<QueryResponse, Failure> {
    let parameters = (request.uri().query().map(String::from), &window::PARAMETERS[..]);
    app.run_query(read(names), parameters, RequestHead::of(&request), |app, tree, parameters, tag, watch| {
        window::respond(tree, parameters, app.options.max_cells, tag, watch)
    })
    .await
}

async fn zonal_of(
    State(app): State<Arc<App>>,
    names: Names<String>,
    request: Request,
) -> Result<QueryResponse, Failure> {
    let parameters = (request.uri().query().map(String::from), &zonal::PARAMETERS[..]);
    let head = RequestHead::of(&request);
    let name = read(names)?;
    let body = body_of(&app.options, request).await?;
    app.run_query(Ok(name), parameters, head, |_, tree, parameters, _, watch| {
        zonal::respond(tree, parameters, body, watch)
    })
    .await
}

/// Path parameters of an address.
fn read<T>(names: Names<T>) -> Result<T, Failure> {
    names.map(|Path(name)| name).map_err(|error| Failure::bad(format!("address: {}", error.body_text())))
}

/// Body of a request, within the limits for size and time.
async fn body_of(options: &ServeOptions, request: Request) -> Result<Vec<u8>, Failure> {
    let max_bytes = options.max_body;
    let too_large = || {
        Failure::too_large(format!("body: is longer than {max_bytes} bytes; send fewer polygons per request"))
    };
    let length =
        request.headers().get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse().ok());
    if length.is_some_and(|length: u64| length > max_bytes) {
        return Err(too_large());
    }
    let body = Limited::new(request.into_body(), usize::try_from(max_bytes).unwrap_or(usize::MAX)).collect();
    match tokio::time::timeout(options.timeout, body).await {
        Ok(Ok(body)) => Ok(body.to_bytes().into()),
        Ok(Err(error)) if error.is::<LengthLimitError>() => Err(too_large()),
        Ok(Err(error)) => Err(Failure::bad(format!("body: {error}"))),
        Err(_) => Err(Failure::new(
            StatusCode::REQUEST_TIMEOUT,
            format!("body: was not received within {} seconds", options.timeout.as_secs_f64()),
        )),
    }
}
