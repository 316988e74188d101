//! HTTP/1.1 for this machine: a thread per connection, one request per connection.
//!
//! Windows hold streams of events open for hours, beside uploads that take minutes: with a thread for each none of them
//! waits for another, and a connection that ends after its answer occupies nothing in between.

use std::io::{self, Cursor, Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

/// Number of connections that are served at the same time; more are turned away.
const MOST_CONNECTIONS: usize = 128;
/// Size of the longest head of a request, bytes, and number of its fields.
const LONGEST_HEAD: usize = 32 << 10;
const MOST_FIELDS: usize = 64;
/// Time in which the other side must say or take something, s.
const PATIENCE: Duration = Duration::from_secs(30);
/// Time for what an answered request still sends.
const REST: Duration = Duration::from_secs(2);

/// A request.
pub(crate) struct Request {
    pub method: String,
    /// Path with query.
    pub url: String,
    fields: Vec<(String, String)>,
    /// Size of the body, bytes.
    pub length: u64,
    body: io::Take<io::Chain<Cursor<Vec<u8>>, TcpStream>>,
}

impl Request {
    /// Value of a field of the head, whose name has small letters.
    pub fn field(&self, name: &str) -> Option<&str> {
        self.fields.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// The body.
    pub fn body(&mut self) -> &mut dyn Read {
        &mut self.body
    }

    /// Reads the head of a request; `None` if the other side says nothing.
    ///
    /// # Errors
    /// The status of the answer to what is no request.
    fn read(stream: &TcpStream) -> Result<Option<Self>, u16> {
        let mut reader = stream.try_clone().map_err(|_| 500u16)?;
        let (mut head, mut piece) = (Vec::new(), [0; 4096]);
        loop {
            let mut fields = [httparse::EMPTY_HEADER; MOST_FIELDS];
            let mut parsed = httparse::Request::new(&mut fields);
            if let httparse::Status::Complete(end) = parsed.parse(&head).map_err(|_| 400u16)? {
                let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_string();
                let fields: Vec<(String, String)> =
                    parsed.headers.iter().map(|f| (f.name.to_ascii_lowercase(), text(f.value))).collect();
                let (method, url) = (parsed.method.unwrap_or_default().into(), parsed.path.unwrap_or_default().into());
                let of = |name: &str| fields.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str());
                let length = of("content-length").map_or(Ok(0), |n| n.parse::<u64>().map_err(|_| 400u16))?;
                if of("transfer-encoding").is_some() {
                    return Err(411);
                }
                if of("expect").is_some_and(|e| e.eq_ignore_ascii_case("100-continue")) {
                    (&*stream).write_all(b"HTTP/1.1 100 Continue\r\n\r\n").map_err(|_| 400u16)?;
                }
                let body = Cursor::new(head.split_off(end)).chain(reader).take(length);
                return Ok(Some(Self { method, url, fields, length, body }));
            }
            if head.len() > LONGEST_HEAD {
                return Err(431);
            }
            match reader.read(&mut piece) {
                Ok(0) | Err(_) => return Ok(None),
                Ok(n) => head.extend_from_slice(&piece[..n]),
            }
        }
    }
}

/// An answer.
pub(crate) struct Answer {
    status: u16,
    fields: Vec<(String, String)>,
    length: u64,
    body: Box<dyn Read + Send>,
}

impl Answer {
    /// An answer with `length` bytes of `body`.
    pub fn new(status: u16, length: u64, body: impl Read + Send + 'static) -> Self {
        Self { status, fields: Vec::new(), length, body: Box::new(body) }
    }

    /// An answer with `content`.
    pub fn of(status: u16, content: Vec<u8>) -> Self {
        Self::new(status, content.len() as u64, Cursor::new(content))
    }

    /// The answer with a field, which has no line breaks.
    pub fn with(mut self, name: &str, value: &str) -> Self {
        self.fields.push((name.into(), value.into()));
        self
    }

    /// The answer with another status.
    pub fn with_status(mut self, status: u16) -> Self {
        self.status = status;
        self
    }

    fn write(mut self, mut out: &TcpStream) -> io::Result<()> {
        let mut head = format!("HTTP/1.1 {} {}\r\n", self.status, reason(self.status));
        self.fields.iter().for_each(|(name, value)| head += &format!("{name}: {value}\r\n"));
        head += &format!("Content-Length: {}\r\nConnection: close\r\n\r\n", self.length);
        out.write_all(head.as_bytes())?;
        io::copy(&mut self.body.by_ref().take(self.length), &mut out)?;
        out.flush()
    }
}

fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        400 => "Bad Request",
        403 => "Forbidden",
        404 => "Not Found",
        411 => "Length Required",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        _ => "Error",
    }
}

/// What is done with a request.
pub(crate) enum Reply {
    /// It is answered.
    Answer(Answer),
    /// The connection is written to for as long as both sides wish.
    Stream(Box<dyn FnOnce(TcpStream) + Send>),
}

/// A listener on this machine.
pub(crate) struct Listener {
    listener: TcpListener,
    pub address: SocketAddr,
    connections: Arc<AtomicUsize>,
    stopped: AtomicBool,
}

impl Listener {
    /// A listener on 127.0.0.1 and `port`, or a free port for 0.
    ///
    /// # Errors
    /// If the port is in use.
    pub fn open(port: u16) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        let address = listener.local_addr()?;
        Ok(Self { listener, address, connections: Arc::default(), stopped: AtomicBool::new(false) })
    }

    /// Serves connections with `reply`, each on a thread of its own, until [`Self::stop`].
    pub fn run(&self, reply: impl Fn(&mut Request) -> Reply + Send + Sync + 'static) {
        let reply = Arc::new(reply);
        for stream in self.listener.incoming() {
            if self.stopped.load(Ordering::Relaxed) {
                return;
            }
            // A connection that has ended before it was accepted.
            let Ok(stream) = stream else { continue };
            let (reply, place) = (reply.clone(), Place::new(&self.connections));
            if place.number > MOST_CONNECTIONS {
                let _ = Answer::of(503, b"there are too many windows".to_vec()).write(&stream);
                continue;
            }
            std::thread::spawn(move || {
                let _place = place;
                // The other side's going ends it.
                let _ = serve(stream, &*reply);
            });
        }
    }

    /// Ends [`Self::run`].
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
        // It waits for a connection.
        let _ = TcpStream::connect(self.address);
    }
}

/// A connection that is counted.
struct Place {
    connections: Arc<AtomicUsize>,
    number: usize,
}

impl Place {
    fn new(connections: &Arc<AtomicUsize>) -> Self {
        Self { number: connections.fetch_add(1, Ordering::Relaxed) + 1, connections: connections.clone() }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.connections.fetch_sub(1, Ordering::Relaxed);
    }
}

fn serve(stream: TcpStream, reply: &dyn Fn(&mut Request) -> Reply) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let answer = match Request::read(&stream) {
        Ok(None) => return Ok(()),
        Err(status) => Answer::of(status, b"this is no request".to_vec()),
        Ok(Some(mut request)) => match reply(&mut request) {
            Reply::Answer(answer) => answer,
            Reply::Stream(write) => {
                write(stream);
                return Ok(());
            }
        },
    };
    answer.write(&stream)?;
    // A socket that is closed with unread data takes the answer with it.
    stream.shutdown(Shutdown::Write)?;
    stream.set_read_timeout(Some(REST))?;
    let begun = std::time::Instant::now();
    let (mut rest, mut reader) = ([0; 65536], &stream);
    while begun.elapsed() < REST && reader.read(&mut rest)? > 0 {}
    Ok(())
}
