//! The server: who may ask, what is answered.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Component, Path};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use deltatwin_report::html;
use miette::miette;
use serde_json::{Value, json};
use tiny_http::{Header, Method, Request, Response, StatusCode};

use crate::studio::Studio;
use crate::view;

/// Number of requests that are answered at the same time.
const THREADS: usize = 4;
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
     img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// A server on this machine.
pub struct Server {
    http: Arc<tiny_http::Server>,
    studio: Arc<Studio>,
    token: String,
    address: SocketAddr,
    stopped: Arc<AtomicBool>,
}

type Answer = Response<Box<dyn Read + Send>>;

/// Server of `studio` on 127.0.0.1 and `port`, or a free port for 0.
///
/// # Errors
/// If the port is in use, or the system has no random numbers.
pub fn serve(studio: Studio, port: u16) -> miette::Result<Server> {
    let http = tiny_http::Server::http((Ipv4Addr::LOCALHOST, port)).map_err(|e| miette!("127.0.0.1:{port}: {e}"))?;
    let address = http.server_addr().to_ip().ok_or_else(|| miette!("the server has no address"))?;
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|e| miette!("no random number: {e}"))?;
    let token = bytes.iter().map(|b| format!("{b:02x}")).collect();
    Ok(Server { http: Arc::new(http), studio: Arc::new(studio), token, address, stopped: Arc::default() })
}

impl Server {
    /// Address for a browser, with the token.
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.address, self.token)
    }

    /// Answers requests until [`Self::stop`].
    pub fn run(&self) {
        std::thread::scope(|scope| {
            for _ in 0..THREADS {
                scope.spawn(|| {
                    while let Ok(request) = self.http.recv() {
                        self.answer(request);
                    }
                });
            }
        });
    }

    /// Ends [`Self::run`] once the requests that came are answered.
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
        (0..THREADS).for_each(|_| self.http.unblock());
    }

    fn answer(&self, mut request: Request) {
        if request.url().starts_with("/api/events?") && self.may_listen(&request) {
            return self.listen(request);
        }
        let answer = self.route(&mut request);
        // A window that has gone needs no answer.
        let _ = request.respond(answer);
    }

    fn route(&self, request: &mut Request) -> Answer {
        let url = request.url().to_string();
        let (path, query) = url.split_once('?').unwrap_or((&url, ""));
        if !self.is_local(request) {
            return refusal(403, "expected the address 127.0.0.1");
        }
        match (request.method(), path) {
            (Method::Get, "/studio.js") => text(SCRIPT, "text/javascript"),
            (Method::Get, "/uplot.js") => text(html::UPLOT, "text/javascript"),
            (Method::Get, "/page.js") => text(html::PAGE, "text/javascript"),
            (Method::Get, "/studio.css") => text(&[html::CSS, html::CURVES_CSS, STYLE].concat(), "text/css"),
            (Method::Get, "/favicon.ico") => refusal(404, "there is none"),
            _ if !self.knows_token(request, query) => {
                refusal(403, "expected the token; open the address that `deltatwin studio` has printed")
            }
            (Method::Get, "/") => text(PAGE, "text/html"),
            (Method::Get, "/api/state") => answer(Ok(view::state(&self.studio))),
            (Method::Get, "/api/formula") => {
                answer(Ok(view::formula(&self.studio, &parameter(query, "at"), &parameter(query, "law"))))
            }
            (Method::Get, "/api/columns") => answer(view::columns(&self.studio, number(query, "recording"))),
            (Method::Get, "/api/difference") => answer(view::difference(&self.studio, number(query, "version"))),
            (Method::Get, "/api/stage") => self.stage(&parameter(query, "name")),
            (Method::Get, "/api/file") => self.file(&parameter(query, "name")),
            (Method::Post, "/api/do") => answer(self.act(request)),
            (Method::Post, "/api/file") => answer(self.upload(request, &parameter(query, "name"))),
            _ => refusal(404, "there is nothing here"),
        }
    }

    /// Whether a request for events comes from this machine with the token, and there is room for one more.
    fn may_listen(&self, request: &Request) -> bool {
        let query = request.url().split_once('?').map_or("", |(_, query)| query);
        self.is_local(request) && self.knows_token(request, query) && Arc::strong_count(&self.studio) < MOST_WINDOWS
    }

    /// Sends the state to a window whenever it has changed, on a thread of its own, until the window goes or the server
    /// stops.
    fn listen(&self, request: Request) {
        let (studio, stopped) = (self.studio.clone(), self.stopped.clone());
        std::thread::spawn(move || {
            // The window's going ends it.
            let _ = events(request.into_writer(), &studio, &stopped);
        });
    }

    /// Whether the request names this machine: a name that another page has made to point here is not answered.
    fn is_local(&self, request: &Request) -> bool {
        let hosts = [format!("127.0.0.1:{}", self.address.port()), format!("localhost:{}", self.address.port())];
        header(request, "host").is_some_and(|h| hosts.contains(&h))
    }

    fn knows_token(&self, request: &Request, query: &str) -> bool {
        header(request, "x-token").is_some_and(|t| t == self.token) || parameter(query, "token") == self.token
    }

    fn act(&self, request: &mut Request) -> miette::Result<Value> {
        let mut body = String::new();
        let read = request.as_reader().take(LARGEST + 1).read_to_string(&mut body);
        if read.is_err() || body.len() as u64 > LARGEST {
            return Err(miette!("the request is no text or too long"));
        }
        let wanted: Value = serde_json::from_str(&body).map_err(|e| miette!("the request is no JSON: {e}"))?;
        self.studio.act(&wanted)?;
        Ok(view::state(&self.studio))
    }

    fn upload(&self, request: &mut Request, name: &str) -> miette::Result<Value> {
        if request.body_length().is_some_and(|n| n as u64 > crate::MOST_BYTES) {
            return Err(miette!("{}: larger than {} MB", crate::safe_name(name), crate::MOST_BYTES >> 20));
        }
        self.studio.take(name, request.as_reader())?;
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
                let mut response =
                    Response::from_data(content).with_header(field("Content-Type", &format!("{kind}; charset=utf-8")));
                response.add_header(field("X-Content-Type-Options", "nosniff"));
                response.boxed()
            }
            _ => refusal(404, "there is no such file"),
        }
    }
}

/// Writes the state as an event whenever it has changed.
fn events(mut out: Box<dyn Write + Send>, studio: &Studio, stopped: &AtomicBool) -> std::io::Result<()> {
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

fn header(request: &Request, name: &'static str) -> Option<String> {
    let found = request.headers().iter().find(|h| h.field.equiv(name));
    found.map(|h| h.value.as_str().to_string())
}

fn field(name: &str, value: &str) -> Header {
    Header::from_bytes(name.as_bytes(), value.as_bytes()).expect("a header of ASCII")
}

fn text(content: &str, kind: &str) -> Answer {
    let mut response = Response::from_data(content.as_bytes().to_vec())
        .with_header(field("Content-Type", &format!("{kind}; charset=utf-8")));
    for (name, value) in [
        ("Content-Security-Policy", POLICY),
        ("X-Content-Type-Options", "nosniff"),
        ("Referrer-Policy", "no-referrer"),
        ("Cache-Control", "no-store"),
    ] {
        response.add_header(field(name, value));
    }
    response.boxed()
}

/// The value, or `{"error": …}` with the causes.
fn answer(value: miette::Result<Value>) -> Answer {
    match value {
        Ok(value) => text(&value.to_string(), "application/json"),
        Err(error) => {
            let causes: Vec<String> = error.chain().map(ToString::to_string).collect();
            text(&json!({"error": causes.join(": ")}).to_string(), "application/json").with_status_code(StatusCode(400))
        }
    }
}

fn refusal(code: u16, why: &str) -> Answer {
    text(why, "text/plain").with_status_code(StatusCode(code))
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
