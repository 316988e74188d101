//! Connection to an MQTT broker (version 3.1.1): QoS 1 with a persistent session, so that messages of a time without
//! connection are delivered once it is back.
//!
//! A message that a broker had acknowledged but not delivered when it was killed is in neither session. So after every
//! reconnection the messages of the last [`REPEATED`] are sent again; the receiver drops those that it has by their
//! times.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rumqttc::{
    Client, ConnectReturnCode, Connection, ConnectionError, Event, MqttOptions, Packet, PublishOptions, QoS,
    TlsConfiguration, TlsError, Transport,
};
use thiserror::Error;

use crate::broker::{Broker, Login};

/// Age of the messages that are sent again after a reconnection.
pub const REPEATED: Duration = Duration::from_secs(3);
/// Number of messages of the queue in either direction.
const QUEUE: usize = 1000;
/// Pause before the next attempt to connect.
const RETRY: Duration = Duration::from_millis(200);
/// Seconds after which a silent connection is tested.
const KEEP_ALIVE: u16 = 15;
/// Largest packet, bytes: the protocol's. A broker would deliver a packet that was refused again and again.
const LARGEST: usize = 268_435_455;
/// Time in which what was published must reach the broker at the end.
const FAREWELL: Duration = Duration::from_secs(10);

/// Reason why there is no connection.
#[derive(Debug, Error)]
pub enum MqttError {
    /// Topic that cannot be used.
    #[error("topic `{0}`: is empty, too long or has wildcards; expected a name such as robot/joints")]
    Topic(String),
    /// The broker does not answer.
    #[error("{address}: no broker answers ({reason}); start one with `mosquitto -p PORT`, or give another address")]
    Unreachable {
        /// Address.
        address: String,
        /// Last error.
        reason: String,
    },
    /// The broker refuses user and password.
    #[error(
        "{0}: the broker refuses the login; expected user and password in DELTATWIN_MQTT_USER and \
         DELTATWIN_MQTT_PASSWORD or in the file of --mqtt-login"
    )]
    Login(String),
    /// The broker is not the one that was meant.
    #[error(
        "{address}: the certificate of the broker is not accepted ({reason}); expected one for this host, signed by an \
         authority in the file of --ca, without it by one that this system trusts"
    )]
    Certificate {
        /// Address.
        address: String,
        /// What is wrong with the certificate.
        reason: String,
    },
    /// The connection has ended.
    #[error("the connection to the broker has ended")]
    Ended,
}

/// What a connection reports.
#[derive(Clone, Debug, PartialEq)]
pub enum Report {
    /// Payload of a message of the subscribed topic.
    Message(Vec<u8>),
    /// A message of the subscribed topic that the broker has kept from an earlier time.
    Retained,
    /// Connected again.
    Connected,
    /// The connection was lost; it is tried again.
    Lost(Loss),
}

/// Reason why a connection is missing.
#[derive(Clone, Debug, PartialEq)]
pub enum Loss {
    /// Nobody answers as a broker does.
    Silent(String),
    /// The login is refused.
    Login,
    /// The certificate is not accepted.
    Certificate(String),
}

impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Silent(reason) => f.write_str(reason),
            Self::Login => f.write_str("the login is refused"),
            Self::Certificate(reason) => write!(f, "the certificate is not accepted ({reason})"),
        }
    }
}

impl From<&ConnectionError> for Loss {
    fn from(e: &ConnectionError) -> Self {
        use ConnectReturnCode::{BadUserNamePassword, NotAuthorized};
        let verification = match e {
            ConnectionError::ConnectionRefused(BadUserNamePassword | NotAuthorized) => return Self::Login,
            ConnectionError::Tls(TlsError::TLS(e)) => Some(e),
            ConnectionError::Tls(TlsError::Io(e)) => e.get_ref().and_then(|e| e.downcast_ref()),
            _ => None,
        };
        match verification {
            Some(e @ rustls::Error::InvalidCertificate(_)) => Self::Certificate(e.to_string()),
            _ => Self::Silent(e.to_string()),
        }
    }
}

/// Messages published recently.
#[derive(Default)]
struct Recent {
    /// Time, topic and payload, the oldest first.
    messages: VecDeque<(Instant, String, Vec<u8>)>,
    /// Time since which there is no connection.
    lost: Option<Instant>,
}

impl Recent {
    /// Adds a message, and forgets those older than [`REPEATED`]: no message grows old while there is no connection.
    fn add(&mut self, now: Instant, topic: &str, payload: &[u8]) {
        let present = self.lost.unwrap_or(now);
        while self.messages.front().is_some_and(|(at, _, _)| present.saturating_duration_since(*at) > REPEATED) {
            self.messages.pop_front();
        }
        self.messages.push_back((now, topic.into(), payload.into()));
    }

    /// Topics and payloads to send again after a reconnection.
    fn repeat(&mut self) -> VecDeque<(String, Vec<u8>)> {
        self.lost = None;
        self.messages.iter().map(|(_, topic, payload)| (topic.clone(), payload.clone())).collect()
    }
}

/// A connection that is restored by itself.
pub struct Link {
    client: Client,
    reports: Receiver<Report>,
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    recent: Arc<Mutex<Recent>>,
}

impl Link {
    /// Connects as `id`, and subscribes to `topic` if there is one; waits at most `patience` for the broker.
    ///
    /// # Errors
    /// [`MqttError::Topic`], [`MqttError::Unreachable`], [`MqttError::Login`] or [`MqttError::Certificate`].
    pub fn open(broker: &Broker, id: &str, topic: Option<&str>, patience: Duration) -> Result<Self, MqttError> {
        if let Some(topic) = topic {
            check_topic(topic)?;
        }
        let address = &broker.address;
        let mut options = MqttOptions::new(id, (address.host.clone(), address.port));
        options.set_clean_session(false).set_keep_alive(KEEP_ALIVE).set_max_packet_size(LARGEST, LARGEST);
        if let Some(Login { user, password }) = &address.login {
            options.set_credentials(user.reveal(), password.reveal().to_string());
        }
        if let Some(tls) = &broker.tls {
            options.set_transport(Transport::tls_with_config(TlsConfiguration::Rustls(tls.clone())));
        }
        let (client, connection) = Client::builder(options).capacity(QUEUE).build();
        let (sender, reports) = sync_channel(QUEUE);
        let (ending, recent) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(Recent::default())));
        let work = Work {
            client: client.clone(),
            topic: topic.map(String::from),
            sender,
            ending: ending.clone(),
            recent: recent.clone(),
        };
        let thread = std::thread::Builder::new().name("mqtt".into()).spawn(move || work.run(connection));
        let unreachable = |reason: String| MqttError::Unreachable { address: address.to_string(), reason };
        let thread = Some(thread.map_err(|e| unreachable(e.to_string()))?);
        let mut link = Self { client, reports, ending, thread, recent };
        match link.connected(patience) {
            None => Ok(link),
            Some(loss) => {
                link.abandon();
                Err(match loss {
                    Loss::Silent(reason) => unreachable(reason),
                    Loss::Login => MqttError::Login(address.to_string()),
                    Loss::Certificate(reason) => MqttError::Certificate { address: address.to_string(), reason },
                })
            }
        }
    }

    /// Waits until there is a connection; returns why there is none within `patience`, or will never be.
    fn connected(&self, patience: Duration) -> Option<Loss> {
        let start = Instant::now();
        let mut reason = Loss::Silent("no answer".into());
        while start.elapsed() <= patience {
            match self.receive(Duration::from_millis(100)) {
                Ok(Some(Report::Connected)) => return None,
                Ok(Some(Report::Lost(loss @ (Loss::Login | Loss::Certificate(_))))) => return Some(loss),
                Ok(Some(Report::Lost(loss))) => reason = loss,
                Ok(_) => {}
                Err(_) => break,
            }
        }
        Some(reason)
    }

    /// The next report; `None` if there is none within `patience`.
    ///
    /// # Errors
    /// [`MqttError::Ended`].
    pub fn receive(&self, patience: Duration) -> Result<Option<Report>, MqttError> {
        match self.reports.recv_timeout(patience) {
            Ok(report) => Ok(Some(report)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(MqttError::Ended),
        }
    }

    /// Publishes a message with QoS 1; waits while the queue is full, as without a broker.
    ///
    /// # Errors
    /// [`MqttError::Topic`] or [`MqttError::Ended`].
    pub fn publish(&self, topic: &str, payload: Vec<u8>) -> Result<(), MqttError> {
        check_topic(topic)?;
        lock(&self.recent).add(Instant::now(), topic, &payload);
        let options = PublishOptions::new(QoS::AtLeastOnce);
        self.client.publish(topic, payload, options).map_err(|_| MqttError::Ended)
    }

    /// Publishes a message that the broker keeps for later subscribers; it is dropped while the queue is full. Returns
    /// whether it was queued.
    ///
    /// # Errors
    /// [`MqttError::Topic`].
    pub fn state(&self, topic: &str, payload: Vec<u8>) -> Result<bool, MqttError> {
        check_topic(topic)?;
        let options = PublishOptions::new(QoS::AtLeastOnce).retained();
        Ok(self.client.try_publish(topic, payload, options).is_ok())
    }

    /// Ends the subscription and the connection after everything published has reached the broker.
    ///
    /// # Errors
    /// [`MqttError::Ended`] if that takes longer than ten seconds.
    pub fn close(mut self, topic: Option<&str>) -> Result<(), MqttError> {
        if let Some(topic) = topic {
            self.client.try_unsubscribe(topic).ok();
        }
        self.ending.store(true, Ordering::Relaxed);
        self.client.try_disconnect_with_timeout(FAREWELL).map_err(|_| MqttError::Ended)?;
        let Some(thread) = self.thread.take() else { return Ok(()) };
        let start = Instant::now();
        while !thread.is_finished() {
            // Reports are not needed any more, but a full queue would hold the thread.
            self.reports.recv_timeout(Duration::from_millis(20)).ok();
            if start.elapsed() > FAREWELL {
                return Err(MqttError::Ended);
            }
        }
        thread.join().map_err(|_| MqttError::Ended)
    }

    fn abandon(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        self.client.try_disconnect_now().ok();
    }
}

fn check_topic(topic: &str) -> Result<(), MqttError> {
    if topic.is_empty() || topic.len() > 1000 || topic.contains(['+', '#', '\0']) {
        return Err(MqttError::Topic(topic.into()));
    }
    Ok(())
}

/// The thread that keeps the connection.
struct Work {
    client: Client,
    topic: Option<String>,
    sender: SyncSender<Report>,
    ending: Arc<AtomicBool>,
    recent: Arc<Mutex<Recent>>,
}

impl Work {
    fn run(self, mut connection: Connection) {
        let mut is_first = true;
        // Messages to repeat, which wait for room in the queue.
        let mut repeated: VecDeque<(String, Vec<u8>)> = VecDeque::new();
        loop {
            // No time limit here: it would interrupt a connection that is being made.
            let report = match connection.recv() {
                Ok(Ok(Event::Incoming(Packet::Publish(message)))) if message.retain => Some(Report::Retained),
                Ok(Ok(Event::Incoming(Packet::Publish(message)))) => Some(Report::Message(message.payload.to_vec())),
                Ok(Ok(Event::Incoming(Packet::ConnAck(_)))) => {
                    if let Some(topic) = &self.topic {
                        self.client.try_subscribe(topic.as_str(), QoS::AtLeastOnce).ok();
                    }
                    if !std::mem::take(&mut is_first) {
                        repeated = lock(&self.recent).repeat();
                    }
                    Some(Report::Connected)
                }
                Ok(Ok(_)) => None,
                // The farewell is over.
                Err(_) => break,
                Ok(Err(_)) if self.ending.load(Ordering::Relaxed) => break,
                Ok(Err(e)) => {
                    lock(&self.recent).lost.get_or_insert_with(Instant::now);
                    std::thread::sleep(RETRY);
                    Some(Report::Lost(Loss::from(&e)))
                }
            };
            while let Some((topic, payload)) = repeated.pop_front() {
                let options = PublishOptions::new(QoS::AtLeastOnce);
                if self.client.try_publish(topic.as_str(), payload.clone(), options).is_err() {
                    repeated.push_front((topic, payload));
                    break;
                }
            }
            if let Some(report) = report
                && self.sender.send(report).is_err()
                && !self.ending.load(Ordering::Relaxed)
            {
                break;
            }
        }
    }
}

fn lock(recent: &Mutex<Recent>) -> std::sync::MutexGuard<'_, Recent> {
    recent.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_do_not_grow_old_without_a_connection() {
        let start = Instant::now();
        let at = |seconds: u64| start + Duration::from_secs(seconds);
        let mut recent = Recent::default();
        [0, 2, 4].into_iter().for_each(|s| recent.add(at(s), "robot", &[s as u8]));
        assert_eq!(recent.messages.len(), 2);
        recent.lost = Some(at(4));
        recent.add(at(30), "robot", &[30]);
        let payloads: Vec<u8> = recent.repeat().into_iter().map(|(_, payload)| payload[0]).collect();
        assert_eq!(payloads, [2, 4, 30]);
        recent.add(at(31), "robot", &[31]);
        assert_eq!(recent.repeat().len(), 2);
    }

    #[test]
    fn nobody_answers() {
        // Port 9 of this machine discards, if it is open at all.
        let broker = Broker::new("mqtt://127.0.0.1:9".parse().unwrap(), None, None).unwrap();
        let refused = Link::open(&broker, "test", None, Duration::from_millis(300));
        assert!(matches!(refused, Err(MqttError::Unreachable { .. })));
        assert!(matches!(Link::open(&broker, "test", Some("a/#"), Duration::ZERO), Err(MqttError::Topic(_))));
    }
}
