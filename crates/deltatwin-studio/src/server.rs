//! HTTP/1.1 for this machine: one request per connection, each answered on a thread of its own.
//!
//! Windows hold streams of events open for hours, beside uploads that take minutes: none of them waits for another, and a
//! connection that ends after its answer occupies nothing in between.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use http_body_util::combinators::UnsyncBoxBody;
use http_body_util::{BodyExt, Full};
use hyper::StatusCode;
use hyper::body::{Bytes, Incoming};
use hyper::header::HeaderName;
use hyper::http::HeaderValue;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use tokio::sync::Semaphore;
use tokio::time::timeout;
use tokio_io_timeout::TimeoutWriter;
use tokio_stream::{Stream, StreamExt};
use tokio_util::io::{StreamReader, SyncIoBridge};
use tokio_util::sync::CancellationToken;

/// Number of connections that are served at the same time. One more takes the place of the oldest that has sent no
/// request yet; where there is none, it waits.
const MOST_CONNECTIONS: usize = 128;
/// Size of the longest head of a request, bytes.
const LONGEST_HEAD: usize = 64 << 10;
/// Time for the head of a request.
const HEAD: Duration = Duration::from_secs(5);
/// Time in which the other side must say or take something.
const PATIENCE: Duration = Duration::from_secs(30);
/// Time for what an answered request still sends.
const REST: Duration = Duration::from_secs(2);
/// Time for answers that are on their way when the server ends: the program gives less than a second to its end.
const ENDING: Duration = Duration::from_millis(400);

/// A request; its body is read as it comes.
pub(crate) type Request = hyper::Request<SyncIoBridge<StreamReader<Pieces, Bytes>>>;
/// The pieces of a body.
type Pieces = Pin<Box<dyn Stream<Item = io::Result<Bytes>> + Send>>;
/// An answer.
pub(crate) type Answer = hyper::Response<UnsyncBoxBody<Bytes, io::Error>>;

/// An answer with `content` and the fields `fields` in its head.
pub(crate) fn answer(content: impl Into<Bytes>, fields: &[(HeaderName, &'static str)]) -> Answer {
    streamed(Full::new(content.into()).map_err(|never: Infallible| match never {}).boxed_unsync(), fields)
}

/// An answer that is sent as it comes.
pub(crate) fn streamed(body: UnsyncBoxBody<Bytes, io::Error>, fields: &[(HeaderName, &'static str)]) -> Answer {
    let mut answer = Answer::new(body);
    let fields = fields.iter().map(|(name, value)| (name.clone(), HeaderValue::from_static(value)));
    answer.headers_mut().extend(fields);
    answer
}

/// A listener on this machine.
pub(crate) struct Listener {
    listener: TcpListener,
    pub address: SocketAddr,
    pub stopped: CancellationToken,
}

impl Listener {
    /// A listener on 127.0.0.1 and `port`, or a free port for 0.
    ///
    /// # Errors
    /// If the port is in use.
    pub fn open(port: u16) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        Ok(Self { listener, address, stopped: CancellationToken::new() })
    }

    /// Serves connections with `reply`, which may wait for files, until `stopped` is cancelled.
    ///
    /// # Errors
    /// If the system lets nothing be waited for.
    pub fn run(&self, reply: impl Fn(&mut Request) -> Answer + Send + Sync + 'static) -> io::Result<()> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let result = runtime.block_on(self.serve(Arc::new(reply)));
        // A thread that reads a large file does not hold the end up.
        runtime.shutdown_background();
        result
    }

    async fn serve(&self, reply: Arc<impl Fn(&mut Request) -> Answer + Send + Sync + 'static>) -> io::Result<()> {
        let listener = tokio::net::TcpListener::from_std(self.listener.try_clone()?)?;
        let (places, open) = (Arc::new(Semaphore::new(MOST_CONNECTIONS)), GracefulShutdown::new());
        let silent = Arc::new(Silent::default());
        let mut http = http1::Builder::new();
        http.keep_alive(false).timer(TokioTimer::new()).header_read_timeout(HEAD).max_buf_size(LONGEST_HEAD);
        for number in 0.. {
            let next = async {
                let (stream, _) = listener.accept().await?;
                if places.available_permits() == 0 {
                    silent.end_oldest();
                }
                let place = places.clone().acquire_owned().await.map_err(io::Error::other)?;
                Ok::<_, io::Error>((place, stream))
            };
            let accepted = tokio::select! {
                accepted = next => accepted,
                () = self.stopped.cancelled() => break,
            };
            let Ok((place, stream)) = accepted else {
                // A connection that has ended before it was accepted, or the system has no room for more.
                tokio::time::sleep(Duration::from_millis(20)).await;
                continue;
            };
            let mut stream = Box::pin(TimeoutWriter::new(stream));
            stream.as_mut().set_timeout_pinned(Some(PATIENCE));
            let (reply, heard) = (reply.clone(), silent.clone());
            let service = service_fn(move |request| {
                heard.forget(number);
                let reply = reply.clone();
                async move { Ok::<_, Infallible>(respond(request, reply).await) }
            });
            let connection = open.watch(http.serve_connection(TokioIo::new(stream), service));
            let (ended, silent) = (silent.add(number), silent.clone());
            tokio::spawn(async move {
                let _place = place;
                // The other side's going ends it.
                tokio::select! {
                    _ = connection => {}
                    () = ended.cancelled() => {}
                }
                silent.forget(number);
            });
        }
        let _ = timeout(ENDING, open.shutdown()).await;
        Ok(())
    }
}

/// Connections that have sent no request yet, by the order in which they came, with what ends them.
#[derive(Default)]
struct Silent(Mutex<BTreeMap<u64, CancellationToken>>);

impl Silent {
    fn all(&self) -> MutexGuard<'_, BTreeMap<u64, CancellationToken>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add(&self, number: u64) -> CancellationToken {
        self.all().entry(number).or_default().clone()
    }

    fn forget(&self, number: u64) {
        self.all().remove(&number);
    }

    fn end_oldest(&self) {
        if let Some((_, oldest)) = self.all().pop_first() {
            oldest.cancel();
        }
    }
}

/// The answer of `reply` to a request, made on another thread.
async fn respond(
    request: hyper::Request<Incoming>,
    reply: Arc<impl Fn(&mut Request) -> Answer + Send + Sync + 'static>,
) -> Answer {
    let mut request = request.map(|body| {
        let pieces = body.into_data_stream().timeout(PATIENCE).map(|piece| match piece {
            Ok(piece) => piece.map_err(io::Error::other),
            Err(_) => Err(io::ErrorKind::TimedOut.into()),
        });
        SyncIoBridge::new(StreamReader::new(Box::pin(pieces) as Pieces))
    });
    let answered = tokio::task::spawn_blocking(move || (reply(&mut request), request.into_body().into_inner())).await;
    let Ok((answer, mut rest)) = answered else {
        let mut failed = self::answer("the answer failed unexpectedly", &[]);
        *failed.status_mut() = StatusCode::INTERNAL_SERVER_ERROR;
        return failed;
    };
    // A socket that is closed with unread data takes the answer with it.
    let _ = timeout(REST, tokio::io::copy(&mut rest, &mut tokio::io::sink())).await;
    answer
}
