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

use rumqttc::{Client, Connection, Event, MqttOptions, Packet, PublishOptions, QoS};
use thiserror::Error;

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
/// Default port.
const PORT: u16 = 1883;

/// Reason why there is no connection.
#[derive(Debug, Error)]
pub enum MqttError {
    /// Not the address of a broker.
    #[error("{0}: is no address of a broker; expected mqtt://HOST, mqtt://HOST:PORT or mqtt://USER:PASSWORD@HOST:PORT")]
    Address(String),
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
    /// The connection has ended.
    #[error("the connection to the broker has ended")]
    Ended,
}

/// Address of a broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Host name or IP address.
    pub host: String,
    /// TCP port.
    pub port: u16,
    credentials: Option<(String, String)>,
}

impl std::str::FromStr for Address {
    type Err = MqttError;

    fn from_str(text: &str) -> Result<Self, MqttError> {
        let wrong = || MqttError::Address(text.into());
        let rest = text.strip_prefix("mqtt://").ok_or_else(wrong)?.trim_end_matches('/');
        let (credentials, place) = match rest.rsplit_once('@') {
            Some((who, place)) => {
                let (user, password) = who.split_once(':').unwrap_or((who, ""));
                (Some((user.to_string(), password.to_string())), place)
            }
            None => (None, rest),
        };
        // The colons of an IPv6 address stand in brackets.
        let (host, port) = match place.rsplit_once(':') {
            Some((host, port)) if !port.contains(']') => (host, port.parse().map_err(|_| wrong())?),
            _ => (place, PORT),
        };
        let host = host.trim_start_matches('[').trim_end_matches(']');
        if host.is_empty() || host.contains(['/', ' ']) {
            return Err(wrong());
        }
        Ok(Self { host: host.into(), port, credentials })
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "mqtt://{}:{}", self.host, self.port)
    }
}

/// What a connection reports.
#[derive(Clone, Debug, PartialEq)]
pub enum Report {
    /// Payload of a message of the subscribed topic.
    Message(Vec<u8>),
    /// Connected again.
    Connected,
    /// The connection was lost; it is tried again.
    Lost(String),
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
    /// [`MqttError::Topic`] or [`MqttError::Unreachable`].
    pub fn open(address: &Address, id: &str, topic: Option<&str>, patience: Duration) -> Result<Self, MqttError> {
        if let Some(topic) = topic {
            check_topic(topic)?;
        }
        let mut options = MqttOptions::new(id, (address.host.clone(), address.port));
        options.set_clean_session(false).set_keep_alive(KEEP_ALIVE).set_max_packet_size(LARGEST, LARGEST);
        if let Some((user, password)) = &address.credentials {
            options.set_credentials(user, password.clone());
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
        let start = Instant::now();
        let mut reason = "no answer".to_string();
        loop {
            match link.receive(Duration::from_millis(100)) {
                Ok(Some(Report::Connected)) => return Ok(link),
                Ok(Some(Report::Lost(why))) => reason = why,
                Ok(_) => {}
                Err(_) => break,
            }
            if start.elapsed() > patience {
                break;
            }
        }
        link.abandon();
        Err(unreachable(reason))
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
                    Some(Report::Lost(e.to_string()))
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
    fn addresses() {
        let parsed = |text: &str| text.parse::<Address>();
        let plain = parsed("mqtt://127.0.0.1").unwrap();
        assert_eq!((plain.host.as_str(), plain.port, plain.credentials), ("127.0.0.1", 1883, None));
        let full = parsed("mqtt://robot:se:cret@broker.example:2000/").unwrap();
        assert_eq!((full.host.as_str(), full.port), ("broker.example", 2000));
        assert_eq!(full.credentials, Some(("robot".into(), "se:cret".into())));
        assert_eq!(parsed("mqtt://[::1]:1999").unwrap().host, "::1");
        for wrong in ["", "127.0.0.1", "mqtts://a", "mqtt://", "mqtt://a:b", "mqtt://a:70000", "mqtt://a/b"] {
            assert!(parsed(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn nobody_answers() {
        // Port 9 of this machine discards, if it is open at all.
        let address = "mqtt://127.0.0.1:9".parse().unwrap();
        let refused = Link::open(&address, "test", None, Duration::from_millis(300));
        assert!(matches!(refused, Err(MqttError::Unreachable { .. })));
        assert!(matches!(Link::open(&address, "test", Some("a/#"), Duration::ZERO), Err(MqttError::Topic(_))));
    }
}
