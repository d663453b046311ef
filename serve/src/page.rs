//! A page for browsers on this machine, and the character on it.
//!
//! Other pages open in a browser must not reach it: the module `door` refuses their requests by `Host` and `Origin`.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};
use tokio::time::timeout;
use umo_core_rig::glb::Follower;

use crate::session::Shared;

/// Maximum size of a character, and of what a page of takes sends, in bytes.
const MOST_CHARACTER: usize = 256 << 20;
const MOST_REQUEST: usize = 16 << 20;
/// Time limit for receiving them.
const UPLOAD: Duration = Duration::from_secs(60);

/// Headers of the page: it is fetched anew each time, and no other page may frame or read it.
const HEADERS: [(HeaderName, &str); 7] = [
    (header::CONTENT_TYPE, "text/html; charset=utf-8"),
    (header::CONNECTION, "close"),
    (header::CACHE_CONTROL, "no-store"),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (header::REFERRER_POLICY, "no-referrer"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// A page that shows an avatar.
pub trait Page: fmt::Debug + Send + Sync {
    /// The page, HTML.
    fn html(&self) -> Arc<str>;

    /// Computes the values of the character's channels in a frame; `None` if the page shows no character.
    fn follower(&self) -> Option<Arc<Follower>>;

    /// Shows the character in this file from now on.
    ///
    /// # Errors
    /// A message for the person who sent the file.
    fn put_on(&self, file: Vec<u8>) -> Result<(), String>;

    /// Answers what a page of takes sends to `/take/WHAT`.
    ///
    /// # Errors
    /// A message for the person at the page. A page of anything else refuses all.
    fn answer(&self, what: &str, body: Vec<u8>) -> Result<Vec<u8>, String> {
        Err(format!("{what}: this page has no takes, and {} bytes are not read", body.len()))
    }
}

/// Answers a request for the page.
pub(crate) async fn get(State(shared): State<Arc<Shared>>) -> Response {
    match &shared.config.page {
        Some(page) => (HEADERS, page.html().to_string()).into_response(),
        None => StatusCode::NOT_FOUND.into_response(),
    }
}

/// Takes a character from the page.
pub(crate) async fn put_on(State(shared): State<Arc<Shared>>, headers: HeaderMap, body: Body) -> Response {
    let put_on = |page: &dyn Page, file| page.put_on(file).map(|()| b"reload the page\n".to_vec());
    received(&shared, &headers, body, MOST_CHARACTER, put_on).await
}

/// Answers a page of takes.
pub(crate) async fn answer(
    State(shared): State<Arc<Shared>>,
    Path(what): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Response {
    received(&shared, &headers, body, MOST_REQUEST, move |page, body| page.answer(&what, body)).await
}

/// Receives a body of at most this many bytes from the page alone, and returns what `answer` says to it.
async fn received(
    shared: &Shared,
    headers: &HeaderMap,
    body: Body,
    most: usize,
    answer: impl FnOnce(&dyn Page, Vec<u8>) -> Result<Vec<u8>, String> + Send + 'static,
) -> Response {
    let Some(page) = shared.config.page.clone() else { return StatusCode::NOT_FOUND.into_response() };
    // A browser names the page's origin in a request of this method.
    if !headers.contains_key(header::ORIGIN) {
        return (StatusCode::FORBIDDEN, "this comes from the page alone\n").into_response();
    }
    let length = headers.get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse::<usize>().ok());
    match length {
        None => return StatusCode::LENGTH_REQUIRED.into_response(),
        Some(length) if length > most => return StatusCode::PAYLOAD_TOO_LARGE.into_response(),
        Some(_) => {}
    }
    let Ok(Ok(body)) = timeout(UPLOAD, to_bytes(body, most)).await else {
        return (StatusCode::REQUEST_TIMEOUT, "the request did not come to its end\n").into_response();
    };
    match tokio::task::spawn_blocking(move || answer(&*page, body.into())).await {
        Ok(Ok(bytes)) => (StatusCode::OK, bytes).into_response(),
        Ok(Err(problem)) => (StatusCode::UNPROCESSABLE_ENTITY, format!("{problem}\n")).into_response(),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}
