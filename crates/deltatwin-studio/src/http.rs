//! The server: who may ask, what is answered.

use std::io::Read;
use std::path::{Component, Path};
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use deltatwin_report::html;
use http_body_util::{BodyExt, StreamBody};
use hyper::body::{Bytes, Frame};
use hyper::header::{
    CACHE_CONTROL, CONTENT_LENGTH, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderValue, ORIGIN, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS,
};
use hyper::{Method, StatusCode};
use miette::{IntoDiagnostic, miette};
use serde_json::{Value, json};
use tokio::sync::watch;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::WatchStream;

use crate::server::{Answer, Listener, Request, answer, streamed};
use crate::session::STAGES;
use crate::studio::Studio;
use crate::view;
#[cfg(feature = "viewer")]
use crate::viewer;

/// Largest size of a request that is no file, bytes.
const LARGEST: u64 = 1 << 20;

/// Number of windows that are told at the same time what changes.
const MOST_WINDOWS: usize = 32;
/// Time between looks at the state, and after which a window is told that the server lives.
const LOOK: Duration = Duration::from_millis(60);
const ALIVE: Duration = Duration::from_secs(5);

const PAGE: &str = include_str!("../assets/studio.html");
const SCRIPT: &str = include_str!("../assets/studio.js");
const STYLE: &str = include_str!("../assets/studio.css");

pub(crate) const HTML: &str = "text/html; charset=utf-8";
pub(crate) const JAVASCRIPT: &str = "text/javascript; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const JSON: &str = "application/json; charset=utf-8";
const PLAIN: &str = "text/plain; charset=utf-8";
pub(crate) const BYTES: &str = "application/octet-stream";

/// What may be loaded and run by the studio's page: its own scripts from this server, and nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; \
     img-src 'self' data:; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What a page of the session's folder may run: the scripts of such pages, wherever the file has come from.
static OF_FILES: LazyLock<String> =
    LazyLock::new(|| html::policy(&[html::UPLOT, html::PAGE]) + "; frame-ancestors 'none'");

/// A server on this machine.
pub struct Server {
    listener: Listener,
    desk: Arc<Desk>,
}

/// What answers requests.
struct Desk {
    studio: Arc<Studio>,
    token: String,
    /// The names of this machine with the port.
    hosts: [String; 2],
    /// The state as the windows know it; `None` when the server ends.
    state: watch::Sender<Option<String>>,
}

/// Server of `studio` on 127.0.0.1 and `port`, or a free port for 0.
///
/// # Errors
/// If the port is in use, or the system has no random numbers.
pub fn serve(studio: Studio, port: u16) -> miette::Result<Server> {
    let listener = Listener::open(port).map_err(|e| miette!("127.0.0.1:{port}: {e}"))?;
    studio.note(listener.address)?;
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|e| miette!("no random number: {e}"))?;
    let token = bytes.iter().map(|b| format!("{b:02x}")).collect();
    let hosts = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", listener.address.port()));
    let state = watch::Sender::new(Some(String::new()));
    Ok(Server { listener, desk: Arc::new(Desk { studio: Arc::new(studio), token, hosts, state }) })
}

impl Server {
    /// Address for a browser, with the token.
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.listener.address, self.desk.token)
    }

    /// Answers requests until [`Self::stop`].
    ///
    /// # Errors
    /// If the system does not let the server wait for requests.
    pub fn run(&self) -> miette::Result<()> {
        let (desk, watched) = (self.desk.clone(), self.desk.clone());
        std::thread::spawn(move || {
            while watched.state.borrow().is_some() {
                std::thread::sleep(LOOK);
                if watched.state.receiver_count() > 0 {
                    watched.look();
                }
            }
        });
        let served = self.listener.run(move |request| desk.reply(request)).into_diagnostic();
        self.stop();
        served
    }

    /// Ends [`Self::run`].
    pub fn stop(&self) {
        self.desk.state.send_replace(None);
        self.listener.stopped.cancel();
    }
}

impl Desk {
    fn reply(&self, request: &mut Request) -> Answer {
        let (path, query) = (request.uri().path().to_string(), request.uri().query().unwrap_or_default().to_string());
        let query = query.as_str();
        if !self.is_local(request) {
            return refusal(StatusCode::FORBIDDEN, "expected the address 127.0.0.1");
        }
        if request.method() != Method::GET && !self.is_own(request) {
            return refusal(StatusCode::FORBIDDEN, "expected a request of the studio's own page");
        }
        match (request.method().as_str(), path.as_str()) {
            ("GET", "/studio.js") => text(SCRIPT, JAVASCRIPT),
            ("GET", "/uplot.js") => text(html::UPLOT, JAVASCRIPT),
            ("GET", "/page.js") => text(html::PAGE, JAVASCRIPT),
            ("GET", "/studio.css") => text(html::style() + STYLE, CSS),
            ("GET", "/favicon.ico") => refusal(StatusCode::NOT_FOUND, "there is none"),
            #[cfg(feature = "viewer")]
            ("GET", asset) if viewer::is_asset(asset) => viewer::asset(asset),
            _ if !self.knows_token(request, query) => refusal(
                StatusCode::FORBIDDEN,
                "expected the token; open the address that `deltatwin studio` has printed",
            ),
            ("GET", "/") => text(PAGE, HTML),
            #[cfg(feature = "viewer")]
            ("GET", "/viewer") => viewer::page(),
            #[cfg(feature = "viewer")]
            ("GET", "/api/rrd") => viewer::file(self.studio.folder()),
            ("GET", "/api/events") => self.events(),
            ("GET", "/api/state") => result(Ok(view::state(&self.studio))),
            ("GET", "/api/shipped") => result(Ok(view::shipped())),
            ("GET", "/api/formula") => {
                result(Ok(view::formula(&self.studio, &parameter(query, "at"), &parameter(query, "law"))))
            }
            ("GET", "/api/columns") => result(view::columns(&self.studio, number(query, "recording"))),
            ("GET", "/api/difference") => result(view::difference(&self.studio, number(query, "version"))),
            ("GET", "/api/watch") => {
                let heard = self.studio.lock().live.as_ref().map(|live| live.json(number(query, "from")));
                result(Ok(heard.unwrap_or_default()))
            }
            ("GET", "/api/stage") => self.stage(&parameter(query, "name")),
            ("GET", "/api/file") => self.file(&parameter(query, "name")),
            ("POST", "/api/do") => result(self.act(request)),
            ("POST", "/api/file") => result(self.upload(request, &parameter(query, "name"))),
            ("POST", "/api/bag") => result(self.upload_bag(request, query)),
            _ => refusal(StatusCode::NOT_FOUND, "there is nothing here"),
        }
    }

    /// Tells the windows the state if it has changed.
    fn look(&self) {
        // JSON has no line breaks, which would end the event.
        let state = view::state(&self.studio).to_string();
        self.state.send_if_modified(|known| match known {
            Some(known) if *known != state => {
                *known = state;
                true
            }
            _ => false,
        });
    }

    /// The state now and whenever it has changed, as events.
    fn events(&self) -> Answer {
        if self.state.receiver_count() >= MOST_WINDOWS {
            return refusal(StatusCode::SERVICE_UNAVAILABLE, "there are too many windows");
        }
        self.look();
        let states = WatchStream::new(self.state.subscribe()).map_while(|state| state);
        let events = states.timeout_repeating(tokio::time::interval(ALIVE)).map(|state| {
            let event = state.map_or(": alive\n\n".into(), |state| format!("data: {state}\n\n"));
            Ok(Frame::data(Bytes::from(event)))
        });
        streamed(
            StreamBody::new(events).boxed_unsync(),
            &[
                (CONTENT_TYPE, "text/event-stream; charset=utf-8"),
                (CACHE_CONTROL, "no-store"),
                (X_CONTENT_TYPE_OPTIONS, "nosniff"),
            ],
        )
    }

    /// Whether the request names this machine: a name that another page has made to point here is not answered.
    fn is_local(&self, request: &Request) -> bool {
        request.headers().get(HOST).is_some_and(|host| self.hosts.iter().any(|own| own == host))
    }

    /// Whether the request comes from a page of this server, or from no page.
    fn is_own(&self, request: &Request) -> bool {
        let own = |origin: &HeaderValue| {
            let host = origin.as_bytes().strip_prefix(b"http://");
            self.hosts.iter().any(|own| host == Some(own.as_bytes()))
        };
        request.headers().get(ORIGIN).is_none_or(own)
    }

    fn knows_token(&self, request: &Request, query: &str) -> bool {
        let known = |token: &[u8]| token == self.token.as_bytes();
        request.headers().get("x-token").is_some_and(|token| known(token.as_bytes()))
            || known(parameter(query, "token").as_bytes())
    }

    fn act(&self, request: &mut Request) -> miette::Result<Value> {
        let mut body = String::new();
        let read = request.body_mut().take(LARGEST + 1).read_to_string(&mut body);
        if read.is_err() || body.len() as u64 > LARGEST {
            return Err(miette!("the request is no text or too long"));
        }
        let wanted: Value = serde_json::from_str(&body).map_err(|e| miette!("the request is no JSON: {e}"))?;
        self.studio.act(&wanted)?;
        Ok(view::state(&self.studio))
    }

    fn upload(&self, request: &mut Request, name: &str) -> miette::Result<Value> {
        let length = request.headers().get(CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
        if length.is_some_and(|length| length > crate::MOST_BYTES) {
            return Err(miette!("{}: larger than {} MB", crate::safe_name(name), crate::MOST_BYTES >> 20));
        }
        self.studio.take(name, request.body_mut())?;
        Ok(view::state(&self.studio))
    }

    /// The files of a bag, one after the other, with their names and sizes in the address.
    fn upload_bag(&self, request: &mut Request, query: &str) -> miette::Result<Value> {
        let parts: Vec<(String, u64)> =
            serde_json::from_str(&parameter(query, "parts")).map_err(|e| miette!("the parts of the bag: {e}"))?;
        self.studio.take_bag(&parameter(query, "name"), &parts, request.body_mut())?;
        Ok(view::state(&self.studio))
    }

    /// The result of a stage as a part of a page.
    fn stage(&self, name: &str) -> Answer {
        if !STAGES.contains(&name) {
            return refusal(StatusCode::NOT_FOUND, "there is no such stage");
        }
        let part = self.studio.lock().session.part(self.studio.folder(), name);
        text(part.and_then(|file| std::fs::read_to_string(file).ok()).unwrap_or_default(), HTML)
    }

    /// A file of the session to be kept.
    fn file(&self, name: &str) -> Answer {
        let path = Path::new(name);
        let inside = path.components().all(|c| matches!(c, Component::Normal(_)));
        let wanted = ["toml", "html", "json"].iter().any(|e| path.extension().is_some_and(|x| x == *e));
        let file = self.studio.folder().join(path);
        let real = file.canonicalize().ok().filter(|real| real.starts_with(self.studio.folder()));
        match (inside && wanted, real.and_then(|real| std::fs::read(real).ok())) {
            (true, Some(content)) => within(&OF_FILES, content, if name.ends_with(".html") { HTML } else { BYTES }),
            _ => refusal(StatusCode::NOT_FOUND, "there is no such file"),
        }
    }
}

/// Value of a query's parameter, decoded; empty if it has none.
fn parameter(query: &str, name: &str) -> String {
    let found = form_urlencoded::parse(query.as_bytes()).find(|(key, _)| key == name);
    found.map_or_else(String::new, |(_, value)| value.into_owned())
}

/// A number of a query; one that no list has if it is none.
fn number(query: &str, name: &str) -> usize {
    parameter(query, name).parse().unwrap_or(usize::MAX)
}

fn text(content: impl Into<Bytes>, kind: &'static str) -> Answer {
    within(POLICY, content, kind)
}

/// A text with the policy `policy`.
pub(crate) fn within(policy: &'static str, content: impl Into<Bytes>, kind: &'static str) -> Answer {
    answer(
        content,
        &[
            (CONTENT_TYPE, kind),
            (CONTENT_SECURITY_POLICY, policy),
            (X_CONTENT_TYPE_OPTIONS, "nosniff"),
            (REFERRER_POLICY, "no-referrer"),
            (CACHE_CONTROL, "no-store"),
        ],
    )
}

/// The value, or `{"error": …}` with the causes.
fn result(value: miette::Result<Value>) -> Answer {
    match value {
        Ok(value) => text(value.to_string(), JSON),
        Err(error) => {
            let causes: Vec<String> = error.chain().map(ToString::to_string).collect();
            let mut answer = text(json!({"error": causes.join(": ")}).to_string(), JSON);
            *answer.status_mut() = StatusCode::BAD_REQUEST;
            answer
        }
    }
}

/// An answer that says what was expected.
pub(crate) fn refusal(status: StatusCode, why: &str) -> Answer {
    let mut answer = text(why.to_string(), PLAIN);
    *answer.status_mut() = status;
    answer
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn queries_are_decoded() {
        assert_eq!(parameter("a=1&name=..%2Fx%20y+z&b", "name"), "../x y z");
        assert_eq!(parameter("name=%zz%", "name"), "%zz%");
        assert_eq!((parameter("", "name"), number("k=-1", "k")), (String::new(), usize::MAX));
    }
}
