//! The server: who may ask, what is answered.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Component, Path};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use deltatwin_report::html;
use miette::miette;
use serde_json::{Value, json};

use crate::server::{Answer, Listener, Reply, Request};
use crate::studio::Studio;
use crate::view;
#[cfg(feature = "viewer")]
use crate::viewer;

/// Largest size of a request that is no file, bytes.
const LARGEST: u64 = 1 << 20;

/// Number of windows, and of work in the background, that are served at the same time.
const MOST_WINDOWS: usize = 32;
/// Time between looks at the state, and after which a window is told that the server lives.
const LOOK: Duration = Duration::from_millis(60);
const ALIVE: Duration = Duration::from_secs(5);

const PAGE: &str = include_str!("../assets/studio.html");
const SCRIPT: &str = include_str!("../assets/studio.js");
const STYLE: &str = include_str!("../assets/studio.css");

/// What may be loaded and run by the studio's page: its own scripts from this server, and nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; \
     img-src 'self' data:; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

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
    stopped: Arc<AtomicBool>,
}

/// Server of `studio` on 127.0.0.1 and `port`, or a free port for 0.
///
/// # Errors
/// If the port is in use, or the system has no random numbers.
pub fn serve(studio: Studio, port: u16) -> miette::Result<Server> {
    let listener = Listener::open(port).map_err(|e| miette!("127.0.0.1:{port}: {e}"))?;
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|e| miette!("no random number: {e}"))?;
    let token = bytes.iter().map(|b| format!("{b:02x}")).collect();
    let hosts = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", listener.address.port()));
    Ok(Server { listener, desk: Arc::new(Desk { studio: Arc::new(studio), token, hosts, stopped: Arc::default() }) })
}

impl Server {
    /// Address for a browser, with the token.
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.listener.address, self.desk.token)
    }

    /// Answers requests until [`Self::stop`].
    pub fn run(&self) {
        let desk = self.desk.clone();
        self.listener.run(move |request| desk.reply(request));
    }

    /// Ends [`Self::run`].
    pub fn stop(&self) {
        self.desk.stopped.store(true, Ordering::Relaxed);
        self.listener.stop();
    }
}

impl Desk {
    fn reply(&self, request: &mut Request) -> Reply {
        if request.url.starts_with("/api/events?") && self.may_listen(request) {
            let (studio, stopped) = (self.studio.clone(), self.stopped.clone());
            // The window's going ends it.
            return Reply::Stream(Box::new(move |out| drop(events(out, &studio, &stopped))));
        }
        Reply::Answer(self.route(request))
    }

    fn route(&self, request: &mut Request) -> Answer {
        let url = request.url.clone();
        let (path, query) = url.split_once('?').unwrap_or((&url, ""));
        if !self.is_local(request) {
            return refusal(403, "expected the address 127.0.0.1");
        }
        match (request.method.as_str(), path) {
            ("GET", "/studio.js") => text(SCRIPT, "text/javascript"),
            ("GET", "/uplot.js") => text(html::UPLOT, "text/javascript"),
            ("GET", "/page.js") => text(html::PAGE, "text/javascript"),
            ("GET", "/studio.css") => text(&[html::CSS, html::CURVES_CSS, STYLE].concat(), "text/css"),
            ("GET", "/favicon.ico") => refusal(404, "there is none"),
            #[cfg(feature = "viewer")]
            ("GET", asset) if viewer::is_asset(asset) => viewer::asset(asset),
            _ if !self.knows_token(request, query) => {
                refusal(403, "expected the token; open the address that `deltatwin studio` has printed")
            }
            ("GET", "/") => text(PAGE, "text/html"),
            #[cfg(feature = "viewer")]
            ("GET", "/viewer") => viewer::page(),
            #[cfg(feature = "viewer")]
            ("GET", "/api/rrd") => viewer::file(self.studio.folder()),
            ("GET", "/api/state") => answer(Ok(view::state(&self.studio))),
            ("GET", "/api/formula") => {
                answer(Ok(view::formula(&self.studio, &parameter(query, "at"), &parameter(query, "law"))))
            }
            ("GET", "/api/columns") => answer(view::columns(&self.studio, number(query, "recording"))),
            ("GET", "/api/difference") => answer(view::difference(&self.studio, number(query, "version"))),
            ("GET", "/api/stage") => self.stage(&parameter(query, "name")),
            ("GET", "/api/file") => self.file(&parameter(query, "name")),
            ("POST", "/api/do") => answer(self.act(request)),
            ("POST", "/api/file") => answer(self.upload(request, &parameter(query, "name"))),
            ("POST", "/api/bag") => answer(self.upload_bag(request, query)),
            _ => refusal(404, "there is nothing here"),
        }
    }

    /// Whether a request for events comes from this machine with the token, and there is room for one more.
    fn may_listen(&self, request: &Request) -> bool {
        let query = request.url.split_once('?').map_or("", |(_, query)| query);
        self.is_local(request) && self.knows_token(request, query) && Arc::strong_count(&self.studio) < MOST_WINDOWS
    }

    /// Whether the request names this machine: a name that another page has made to point here is not answered.
    fn is_local(&self, request: &Request) -> bool {
        request.field("host").is_some_and(|host| self.hosts.iter().any(|own| own == host))
    }

    fn knows_token(&self, request: &Request, query: &str) -> bool {
        request.field("x-token").is_some_and(|t| t == self.token) || parameter(query, "token") == self.token
    }

    fn act(&self, request: &mut Request) -> miette::Result<Value> {
        let mut body = String::new();
        let read = request.body().take(LARGEST + 1).read_to_string(&mut body);
        if read.is_err() || body.len() as u64 > LARGEST {
            return Err(miette!("the request is no text or too long"));
        }
        let wanted: Value = serde_json::from_str(&body).map_err(|e| miette!("the request is no JSON: {e}"))?;
        self.studio.act(&wanted)?;
        Ok(view::state(&self.studio))
    }

    fn upload(&self, request: &mut Request, name: &str) -> miette::Result<Value> {
        if request.length > crate::MOST_BYTES {
            return Err(miette!("{}: larger than {} MB", crate::safe_name(name), crate::MOST_BYTES >> 20));
        }
        self.studio.take(name, request.body())?;
        Ok(view::state(&self.studio))
    }

    /// The files of a bag, one after the other, with their names and sizes in the address.
    fn upload_bag(&self, request: &mut Request, query: &str) -> miette::Result<Value> {
        let parts: Vec<(String, u64)> =
            serde_json::from_str(&parameter(query, "parts")).map_err(|e| miette!("the parts of the bag: {e}"))?;
        self.studio.take_bag(&parameter(query, "name"), &parts, request.body())?;
        Ok(view::state(&self.studio))
    }

    /// The result of a stage as a part of a page.
    fn stage(&self, name: &str) -> Answer {
        if !view::STAGES.contains(&name) {
            return refusal(404, "there is no such stage");
        }
        let file = self.studio.folder().join("stages").join(format!("{name}.html"));
        match std::fs::read_to_string(file) {
            Ok(part) => text(&part, "text/html"),
            Err(_) => text("", "text/html"),
        }
    }

    /// A file of the session to be kept.
    fn file(&self, name: &str) -> Answer {
        let path = Path::new(name);
        let inside = path.components().all(|c| matches!(c, Component::Normal(_)));
        let wanted = ["toml", "html", "json"].iter().any(|e| path.extension().is_some_and(|x| x == *e));
        let file = self.studio.folder().join(path);
        let real = file.canonicalize().ok().filter(|real| real.starts_with(self.studio.folder()));
        match (inside && wanted, real.and_then(|real| std::fs::read(real).ok())) {
            (true, Some(content)) => {
                let page = name.ends_with(".html");
                let kind = if page { "text/html" } else { "application/octet-stream" };
                Answer::of(200, content)
                    .with("Content-Type", &format!("{kind}; charset=utf-8"))
                    .with("X-Content-Type-Options", "nosniff")
            }
            _ => refusal(404, "there is no such file"),
        }
    }
}

/// Writes the state as an event whenever it has changed.
fn events(mut out: TcpStream, studio: &Studio, stopped: &AtomicBool) -> std::io::Result<()> {
    write!(
        out,
        "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream; charset=utf-8\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n"
    )?;
    let (mut sent, mut at) = (String::new(), Instant::now());
    while !stopped.load(Ordering::Relaxed) {
        // JSON has no line breaks, which would end the event.
        let state = view::state(studio).to_string();
        if state != sent {
            write!(out, "data: {state}\n\n")?;
            out.flush()?;
            (sent, at) = (state, Instant::now());
        } else if at.elapsed() > ALIVE {
            write!(out, ": alive\n\n")?;
            out.flush()?;
            at = Instant::now();
        }
        std::thread::sleep(LOOK);
    }
    Ok(())
}

/// Value of a query's parameter, decoded; empty if it has none.
fn parameter(query: &str, name: &str) -> String {
    let value = query.split('&').filter_map(|p| p.split_once('=')).find(|(key, _)| *key == name).map(|(_, v)| v);
    decoded(value.unwrap_or_default())
}

/// A number of a query; one that no list has if it is none.
fn number(query: &str, name: &str) -> usize {
    parameter(query, name).parse().unwrap_or(usize::MAX)
}

/// A text in which bytes may be written as `%41`.
fn decoded(text: &str) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let raw = text.as_bytes();
    let mut k = 0;
    while k < raw.len() {
        let hex = (raw[k] == b'%').then(|| text.get(k + 1..k + 3)).flatten();
        match hex.and_then(|h| u8::from_str_radix(h, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                k += 3;
            }
            None => {
                bytes.push(if raw[k] == b'+' { b' ' } else { raw[k] });
                k += 1;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn text(content: &str, kind: &str) -> Answer {
    within(POLICY, content, kind)
}

/// A text with the policy `policy`.
pub(crate) fn within(policy: &str, content: &str, kind: &str) -> Answer {
    Answer::of(200, content.as_bytes().to_vec())
        .with("Content-Type", &format!("{kind}; charset=utf-8"))
        .with("Content-Security-Policy", policy)
        .with("X-Content-Type-Options", "nosniff")
        .with("Referrer-Policy", "no-referrer")
        .with("Cache-Control", "no-store")
}

/// The value, or `{"error": …}` with the causes.
fn answer(value: miette::Result<Value>) -> Answer {
    match value {
        Ok(value) => text(&value.to_string(), "application/json"),
        Err(error) => {
            let causes: Vec<String> = error.chain().map(ToString::to_string).collect();
            text(&json!({"error": causes.join(": ")}).to_string(), "application/json").with_status(400)
        }
    }
}

pub(crate) fn refusal(code: u16, why: &str) -> Answer {
    text(why, "text/plain").with_status(code)
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
