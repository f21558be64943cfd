//! The HTTP server: the embedded page, and the WebSocket of each page. It refuses requests with another host name, and connections
//! from pages of other sites, so that no web page that the user visits can reach the viewer.

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, Request, State};
use axum::http::StatusCode;
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderMap, HeaderName, HeaderValue, ORIGIN,
    REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use axum::http::uri::{Authority, Uri};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use taugate::Error;
use tokio::sync::Semaphore;

use super::client::{self, Shared};
use super::page;

/// Where the page is served unless the user says otherwise.
const DEFAULT: SocketAddr = SocketAddr::new(IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 8642);
/// Maximum size of a message of the page in bytes.
pub const MAX_MESSAGE: usize = 16 << 10;
/// Maximum number of pages.
const MAX_PAGES: usize = 64;
/// Maximum number of connections that have not sent the token yet. Each has [`client::Patience::hello`] for that.
const MAX_STRANGERS: usize = 256;
/// Maximum number of connections without a WebSocket. Further ones wait, so that file handles are left for images.
const MAX_PLAIN: usize = 256;
/// A connection that sends no whole request within this time is closed.
const REQUEST: Duration = Duration::from_secs(10);
/// Time before the next attempt if no connection can be accepted, for example because no file handle is left.
const PAUSE: Duration = Duration::from_millis(100);

/// What the page may load: only files of this server, and its own WebSocket.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Opens the port: `wanted`, else the default port, or a free port if the default one is taken.
pub fn bind(wanted: Option<SocketAddr>) -> Result<TcpListener, Error> {
    let opened = match wanted {
        Some(address) => TcpListener::bind(address),
        None => TcpListener::bind(DEFAULT).or_else(|_| TcpListener::bind(SocketAddr::new(DEFAULT.ip(), 0))),
    };
    opened.map_err(|e| {
        let address = wanted.unwrap_or(DEFAULT);
        Error::advice(
            format!("cannot serve the page at {address}: {e}; "),
            "give another --listen, such as 127.0.0.1:0 for a free port",
        )
    })
}

/// Serves pages until the future is dropped.
pub async fn serve(listener: TcpListener, shared: Arc<Shared>) -> std::io::Result<()> {
    listener.set_nonblocking(true)?;
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let router = Router::new()
        .route("/", get(|| async { file("index.html") }))
        .route("/ws", get(socket))
        .route("/{name}", get(|Path(name): Path<String>| async move { file(&name) }))
        .layer(middleware::from_fn(guard))
        .with_state(shared);
    let places = Arc::new(Semaphore::new(MAX_PLAIN));
    loop {
        let place = places.clone().acquire_owned().await.expect("nobody closes the semaphore");
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(async move {
            let mut http = http1::Builder::new();
            http.timer(TokioTimer::new()).header_read_timeout(REQUEST);
            // Also ends when the connection becomes a WebSocket. An error concerns only this connection.
            let _ = http.serve_connection(TokioIo::new(stream), service).with_upgrades().await;
            drop(place);
        });
    }
}

/// Refuses requests for other hosts, and adds the security headers.
async fn guard(request: Request, next: Next) -> Response {
    if !is_for_this_machine(request.headers()) {
        return (StatusCode::FORBIDDEN, "this server answers only to localhost and to IP addresses\n").into_response();
    }
    let mut response = next.run(request).await;
    let headers: [(HeaderName, &str); 5] = [
        (CONTENT_SECURITY_POLICY, POLICY),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (X_FRAME_OPTIONS, "DENY"),
        (REFERRER_POLICY, "no-referrer"),
        (CACHE_CONTROL, "no-store"),
    ];
    for (name, value) in headers {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

fn file(name: &str) -> Response {
    match page::file(name) {
        Some((kind, text)) => ([(CONTENT_TYPE, kind)], text).into_response(),
        None => StatusCode::NOT_FOUND.into_response(),
    }
}

async fn socket(State(shared): State<Arc<Shared>>, headers: HeaderMap, upgrade: WebSocketUpgrade) -> Response {
    if !has_own_origin(&headers) {
        return (StatusCode::FORBIDDEN, "a page of another site may not connect\n").into_response();
    }
    let [pages, strangers] = shared.board.pages_and_strangers();
    if pages >= MAX_PAGES || strangers >= MAX_STRANGERS {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many pages are open; close some of them\n").into_response();
    }
    upgrade
        .max_message_size(MAX_MESSAGE)
        .max_frame_size(MAX_MESSAGE)
        .on_upgrade(move |socket| client::run(socket, shared))
}

/// Whether the Host of a request is `localhost` or an IP address, with any port, since `ssh -L` changes the port. The DNS name
/// of an attacker's page could point to this machine (DNS rebinding), so DNS names are refused.
fn is_for_this_machine(headers: &HeaderMap) -> bool {
    let mut hosts = headers.get_all(HOST).iter();
    match (hosts.next(), hosts.next()) {
        (Some(host), None) => host.to_str().is_ok_and(|host| name_of(host).is_some_and(|name| is_local_name(&name))),
        _ => false,
    }
}

/// Whether the Origin of a request has the name of its Host.
fn has_own_origin(headers: &HeaderMap) -> bool {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let (Some(origin), Some(host)) = (text(ORIGIN), text(HOST)) else { return false };
    let Ok(origin) = origin.parse::<Uri>() else { return false };
    let is_http = matches!(origin.scheme_str(), Some("http" | "https"));
    is_http && origin.authority().is_some_and(|origin| name_of(origin.as_str()) == name_of(host))
}

/// The name in `NAME:PORT`, in lower case; `None` if this is no host.
fn name_of(host: &str) -> Option<String> {
    let authority: Authority = host.parse().ok()?;
    (!host.contains('@')).then(|| authority.host().to_ascii_lowercase())
}

fn is_local_name(name: &str) -> bool {
    let inner = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    name == "localhost" || inner.parse::<IpAddr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(host: &str, origin: &str) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(HOST, HeaderValue::from_str(host).unwrap());
        headers.insert(ORIGIN, HeaderValue::from_str(origin).unwrap());
        headers
    }

    #[test]
    fn only_this_machine_is_served() {
        for host in [
            "localhost",
            "localhost:9000",
            "LOCALHOST:1",
            "127.0.0.1:8642",
            "[::1]:8642",
            "192.168.1.7:80",
            "[fe80::1]",
        ] {
            assert!(is_for_this_machine(&headers(host, "x")), "{host}");
        }
        for host in [
            "evil.example",
            "localhost.evil.example",
            "127.0.0.1.evil.example:80",
            "a@localhost",
            "localhost@b",
            "",
            "local host",
            "::1",
        ] {
            let value = HeaderValue::from_str(host).unwrap();
            let mut headers = HeaderMap::new();
            headers.insert(HOST, value);
            assert!(!is_for_this_machine(&headers), "{host}");
        }
        assert!(!is_for_this_machine(&HeaderMap::new()));
        let mut twice = headers("localhost", "x");
        twice.append(HOST, HeaderValue::from_static("evil.example"));
        assert!(!is_for_this_machine(&twice));
    }

    #[test]
    fn only_its_own_page_may_connect() {
        let good = [
            ("localhost:9000", "http://localhost:1234"),
            ("127.0.0.1:8642", "http://127.0.0.1:8642"),
            ("[::1]:1", "http://[::1]:2"),
        ];
        for (host, origin) in good {
            assert!(has_own_origin(&headers(host, origin)), "{host} {origin}");
        }
        for origin in [
            "http://evil.example",
            "null",
            "file://localhost",
            "http://127.0.0.1:9000",
            "localhost",
            "http://localhost@evil.example",
            "",
        ] {
            assert!(!has_own_origin(&headers("localhost:9000", origin)), "{origin}");
        }
        let mut none = headers("localhost", "x");
        none.remove(ORIGIN);
        assert!(!has_own_origin(&none));
    }
}
