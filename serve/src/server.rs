//! Sockets, routes and shutdown.

use std::fmt;
use std::io::{self, Write};
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::extract::{Extension, Request, State, WebSocketUpgrade};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream, ToSocketAddrs};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, sleep, timeout};
use umo_core::{Engine, EngineConfig, EngineError, MAX_SESSIONS, Model, Priority};

use crate::config::Config;
use crate::door::{self, Seat};
use crate::hub::{Hub, Phase};
use crate::metrics::Metrics;
use crate::page;
use crate::session::{self, Client, Shared};
use crate::socket::bounded;

/// Time limit for closing connections after the last session.
const FAREWELL: Duration = Duration::from_secs(3);
/// Delay before accepting again after an error.
const RETRY: Duration = Duration::from_millis(50);
/// Number of threads for the sockets; they wait and copy frames.
const SOCKET_THREADS: usize = 2;

/// Reason why a server cannot start or has stopped.
#[derive(Debug)]
pub enum ServerError {
    /// An option is out of its range.
    Config(String),
    /// The engine could not be created.
    Engine(EngineError),
    /// The address cannot be used, or the system provides no threads or signals.
    System(String, io::Error),
}

impl fmt::Display for ServerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(problem) => f.write_str(problem),
            Self::Engine(error) => write!(f, "{error}"),
            Self::System(what, error) => write!(f, "{what}: {error}"),
        }
    }
}

impl std::error::Error for ServerError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Config(_) => None,
            Self::Engine(error) => Some(error),
            Self::System(_, error) => Some(error),
        }
    }
}

/// A listening server.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    shared: Arc<Shared>,
}

/// Resources of a connection, held until its last clone is dropped.
#[derive(Clone, Debug)]
struct Connection {
    peer: SocketAddr,
    /// Lobby seat, held until the connection has a session.
    seat: Arc<Mutex<Option<Seat>>>,
    _permit: Arc<OwnedSemaphorePermit>,
}

impl Connection {
    fn sit(&self, seat: Option<Seat>) {
        *self.seat.lock().unwrap_or_else(PoisonError::into_inner) = seat;
    }
}

impl Server {
    /// Binds to `address` and creates an engine for `model`.
    ///
    /// # Errors
    /// [`ServerError`] if an option is out of range, the address cannot be used, or the engine cannot get its
    /// threads, memory or priority.
    pub async fn bind(address: impl ToSocketAddrs, config: Config, model: Arc<Model>) -> Result<Self, ServerError> {
        config.check().map_err(ServerError::Config)?;
        // The engine keeps a closed session until the end of its batch.
        let max_sessions = (config.sessions + config.engine.max_batch).min(MAX_SESSIONS);
        let wanted = EngineConfig { max_sessions, ..config.engine.clone() };
        let engine = Engine::new(model, &wanted).map_err(ServerError::Engine)?;
        if engine.priority() != wanted.priority {
            let problem = format!("priority {}: the system refuses it: {}", wanted.priority, Priority::remedy());
            return Err(ServerError::Config(problem));
        }
        let unusable = |error| ServerError::System("cannot listen at this address".to_owned(), error);
        let listener = TcpListener::bind(address).await.map_err(unusable)?;
        let address = listener.local_addr().map_err(unusable)?;
        let hub = Hub::new(config.sessions, config.per_client);
        let is_loopback = address.ip().is_loopback();
        let lobby = Arc::default();
        let rooms = Arc::default();
        let shared = Arc::new(Shared { hub, lobby, rooms, is_loopback, engine, metrics: Metrics::new(), config });
        Ok(Self { listener, address, shared })
    }

    /// The address that the server listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until `stop` completes, then lets running sessions finish within [`Config::drain`].
    pub async fn run(self, stop: impl Future<Output = ()>) {
        let Self { listener, shared, .. } = self;
        let connections = shared.config.connections();
        let permits = Arc::new(Semaphore::new(connections));
        let accepting = accept(&listener, &shared, &permits);
        tokio::pin!(accepting);
        tokio::select! {
            () = stop => {}
            () = &mut accepting => {}
        }
        shared.hub.drain(Instant::now() + shared.config.drain);
        // New clients are still accepted, to be told why they are refused.
        tokio::select! {
            () = shared.hub.empty() => {}
            () = &mut accepting => {}
        }
        let all = u32::try_from(connections).unwrap_or(u32::MAX);
        let _ = timeout(FAREWELL, permits.acquire_many(all)).await;
    }
}

async fn accept(listener: &TcpListener, shared: &Arc<Shared>, permits: &Arc<Semaphore>) {
    let routes = Router::new()
        .route("/v1/session", get(upgrade))
        .route("/healthz", get(health))
        .route("/metrics", get(metrics))
        .route("/", get(page::get))
        .route("/character", post(page::put_on))
        .route("/take/{what}", post(page::answer))
        .layer(middleware::from_fn_with_state(Arc::clone(shared), knock))
        .with_state(Arc::clone(shared));
    loop {
        let (socket, peer) = match listener.accept().await {
            Ok(accepted) => accepted,
            Err(_) => {
                // Out of file descriptors, or the client has already gone.
                sleep(RETRY).await;
                continue;
            }
        };
        // All connections of a proxy share its address: they are counted once the client is known.
        let is_behind_proxy = shared.config.is_behind_proxy;
        let seat = (!is_behind_proxy).then(|| shared.lobby.enter(&peer.ip().to_string()));
        let (Ok(permit), None | Some(Some(_))) = (Arc::clone(permits).try_acquire_owned(), &seat) else {
            shared.metrics.refused("connections");
            continue;
        };
        // Frames are small and urgent.
        let _ = socket.set_nodelay(true);
        let seat = Arc::new(Mutex::new(seat.flatten()));
        let connection = Connection { peer, seat, _permit: Arc::new(permit) };
        tokio::spawn(connected(socket, routes.clone().layer(Extension(connection)), shared.config.hello_within));
    }
}

/// Serves one connection until it closes or becomes a WebSocket.
async fn connected(socket: TcpStream, routes: Router, within: Duration) {
    let service = TowerToHyperService::new(routes);
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(within);
    // A client's protocol error ends only its own connection.
    let _ = http.serve_connection(TokioIo::new(socket), service).with_upgrades().await;
}

/// Refuses requests by their origin and host.
async fn knock(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    match door::check(request.headers(), &shared.config.origins, shared.is_loopback) {
        Ok(()) => next.run(request).await,
        Err((status, word, reason)) => {
            shared.metrics.refused(word);
            (status, reason).into_response()
        }
    }
}

async fn upgrade(
    State(shared): State<Arc<Shared>>,
    Extension(connection): Extension<Connection>,
    headers: HeaderMap,
    socket: WebSocketUpgrade,
) -> Response {
    let bearer = bearer(&headers);
    let name = bearer.and_then(|token| shared.config.tokens.name(token)).map(str::to_owned);
    if bearer.is_some() && name.is_none() && !shared.config.tokens.is_empty() {
        shared.metrics.refused("unauthorized");
        return (StatusCode::UNAUTHORIZED, "unknown token\n").into_response();
    }
    let client = Client { name, address: address(&headers, &connection, shared.config.is_behind_proxy) };
    if shared.config.is_behind_proxy {
        let Some(seat) = shared.lobby.enter(&client.address) else {
            shared.metrics.refused("connections");
            return (StatusCode::TOO_MANY_REQUESTS, "too many connections have not sent their hello\n").into_response();
        };
        connection.sit(Some(seat));
    }
    bounded(socket).on_upgrade(async move |socket| {
        session::run(socket, client, shared, || connection.sit(None)).await;
        drop(connection);
    })
}

/// Token in `Authorization: Bearer TOKEN`.
fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, token) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
}

/// Address of the client. Behind a proxy, this is the last address in the header: the client can forge the
/// earlier ones.
fn address(headers: &HeaderMap, connection: &Connection, is_behind_proxy: bool) -> String {
    let written = headers.get_all("x-forwarded-for").iter().next_back().and_then(|value| value.to_str().ok());
    let last = written.and_then(|list| list.rsplit(',').next()).map(str::trim).filter(|_| is_behind_proxy);
    last.map_or_else(|| connection.peer.ip().to_string(), str::to_owned)
}

async fn health(State(shared): State<Arc<Shared>>) -> Response {
    let is_draining = is_draining(&shared);
    let status = if is_draining { StatusCode::SERVICE_UNAVAILABLE } else { StatusCode::OK };
    let health = serde_json::json!({
        "status": if is_draining { "draining" } else { "ok" },
        "sessions": shared.hub.sessions(),
        "places": shared.hub.places(),
        "version": env!("CARGO_PKG_VERSION"),
    });
    (status, [(header::CONTENT_TYPE, "application/json")], health.to_string()).into_response()
}

async fn metrics(State(shared): State<Arc<Shared>>) -> Response {
    let text = shared.metrics.text(shared.hub.sessions(), shared.hub.places(), is_draining(&shared));
    ([(header::CONTENT_TYPE, "application/openmetrics-text; version=1.0.0; charset=utf-8")], text).into_response()
}

fn is_draining(shared: &Shared) -> bool {
    *shared.hub.phase().borrow() != Phase::Open
}

/// Serves at `address` until SIGTERM or Ctrl-C, for `umo serve` and `umo live`; calls `ready` with the address that the
/// server listens on.
///
/// # Errors
/// The errors of [`Server::bind`], and [`ServerError::System`] if the system provides no threads or signals.
pub fn run(
    address: &str,
    config: Config,
    model: Arc<Model>,
    ready: impl FnOnce(SocketAddr),
) -> Result<(), ServerError> {
    let system = |what: &str| {
        let what = what.to_owned();
        move |error| ServerError::System(what, error)
    };
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    let runtime = runtime.worker_threads(SOCKET_THREADS).thread_name("umo-serve").enable_all().build();
    runtime.map_err(system("cannot start threads"))?.block_on(async {
        let stop = told_to_stop().map_err(system("cannot listen to signals"))?;
        let drain = config.drain;
        let server = Server::bind(address, config, model).await?;
        ready(server.address());
        server
            .run(async {
                stop.await;
                note(format_args!("stopping: running sessions have {} seconds", drain.as_secs_f64()));
            })
            .await;
        Ok(())
    })
}

/// Writes a line to standard error; ignores errors, as it may be closed.
pub fn note(line: fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// Returns a future that completes when the process is told to stop.
#[cfg(unix)]
fn told_to_stop() -> io::Result<impl Future<Output = ()>> {
    use tokio::signal::unix::{SignalKind, signal};
    let (mut terminate, mut interrupt) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
    Ok(async move {
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
    })
}

/// Returns a future that completes when the process is told to stop.
#[cfg(not(unix))]
fn told_to_stop() -> io::Result<impl Future<Output = ()>> {
    Ok(async {
        // Without signals the server runs until the process is killed.
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn addresses_are_the_proxys_word_only_where_there_is_one() {
        let permit = Arc::new(Semaphore::new(1)).try_acquire_owned().unwrap();
        let seat = Arc::default();
        let connection = Connection { peer: "192.0.2.1:5".parse().unwrap(), seat, _permit: Arc::new(permit) };
        let mut headers = HeaderMap::new();
        assert_eq!(address(&headers, &connection, true), "192.0.2.1");
        headers.append("x-forwarded-for", "10.0.0.1, 198.51.100.7".parse().unwrap());
        assert_eq!(address(&headers, &connection, true), "198.51.100.7");
        assert_eq!(address(&headers, &connection, false), "192.0.2.1");
    }

    #[test]
    fn bearer_tokens_are_read_and_nothing_else() {
        let read = |value: &str| {
            let headers = HeaderMap::from_iter([(header::AUTHORIZATION, value.parse().unwrap())]);
            bearer(&headers).map(str::to_owned)
        };
        assert_eq!(read("Bearer abc"), Some("abc".to_owned()));
        assert_eq!(read("bearer abc"), Some("abc".to_owned()));
        assert_eq!(read("Basic abc"), None);
        assert_eq!(read("abc"), None);
    }
}
