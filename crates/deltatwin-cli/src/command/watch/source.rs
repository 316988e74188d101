//! Where the samples come from, and where the answers go.

use std::time::{Duration, Instant};

use miette::{IntoDiagnostic, miette};
use serde_json::{Value, json};

use super::Args;
use crate::terminal::{say, warn};
use deltatwin::model::Model;
use deltatwin_watch::broker::Address;
use deltatwin_watch::follow::Follower;
use deltatwin_watch::message::{self, Message};
use deltatwin_watch::mqtt::{Link, Report};
use deltatwin_watch::stamped::Stamped;

/// Time in which a broker must answer at the start.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time without a sample after the message that no more follow: some may have been sent again behind it.
const AFTER_END: Duration = Duration::from_secs(1);
/// Number of faulty messages or lines that are told.
const TOLD: u64 = 5;

/// What has arrived.
pub enum Arrival {
    /// Samples.
    Samples(Vec<Stamped>),
    /// Nothing within the pause.
    Nothing,
    /// No more samples follow.
    End,
}

enum Channel {
    Broker { link: Link, address: Address, topic: String },
    File(Box<Follower>),
}

/// A machine that sends samples.
pub struct Source {
    channel: Channel,
    axes: usize,
    prefix: String,
    /// Whether answers are lines on stdout, too.
    is_printed: bool,
    name: String,
    idle: Option<Duration>,
    last: Instant,
    faults: u64,
    is_lost: bool,
}

impl Source {
    /// Opens what `args` name.
    pub fn open(args: &Args, model: &Model) -> miette::Result<Self> {
        let axes = model.mechanism.axes();
        let (channel, name) = match (&args.follow, &args.mqtt, &args.topic) {
            (Some(file), _, _) => {
                let follower = Follower::open(file, axes).into_diagnostic()?;
                (Channel::File(Box::new(follower)), file.display().to_string())
            }
            (_, Some(address), Some(topic)) => {
                let id =
                    args.client_id.clone().unwrap_or_else(|| format!("deltatwin-watch-{}", topic.replace('/', "-")));
                let broker = args.access.broker(address)?;
                let link = Link::open(&broker, &id, Some(topic), PATIENCE).into_diagnostic()?;
                let address = broker.address;
                let name = format!("{topic} at {address}");
                (Channel::Broker { link, address, topic: topic.clone() }, name)
            }
            _ => return Err(miette!("expected --mqtt URL --topic TOPIC, or --follow FILE")),
        };
        let idle = args.idle.map(Duration::from_secs_f64);
        Ok(Self {
            channel,
            axes,
            prefix: args.publish.clone(),
            is_printed: args.answers,
            name,
            idle,
            last: Instant::now(),
            faults: 0,
            is_lost: false,
        })
    }

    /// Name for the user.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What arrives within `pause`.
    pub fn next(&mut self, pause: Duration) -> miette::Result<Arrival> {
        let arrival = match &mut self.channel {
            Channel::File(follower) => {
                let samples = follower.poll().into_diagnostic()?;
                let faults = follower.faults();
                let has_ended = follower.has_ended();
                faults.into_iter().for_each(|fault| self.fault(&fault));
                match samples {
                    none if none.is_empty() && has_ended => Arrival::End,
                    none if none.is_empty() => {
                        std::thread::sleep(pause);
                        Arrival::Nothing
                    }
                    some => Arrival::Samples(some),
                }
            }
            Channel::Broker { link, address, .. } => match link.receive(pause).into_diagnostic()? {
                Some(Report::Retained) => {
                    let expected = "expected samples that are published without the flag `retain`";
                    self.fault(&format!("a retained message, older than this watch, is left out; {expected}"));
                    Arrival::Nothing
                }
                Some(Report::Message(payload)) => match message::parse(&payload, self.axes) {
                    Ok(Message::Samples(samples)) => Arrival::Samples(samples),
                    Ok(Message::End) => {
                        self.idle = Some(AFTER_END);
                        Arrival::Nothing
                    }
                    Err(problem) => {
                        self.fault(&format!("message of {} bytes: {problem}", payload.len()));
                        Arrival::Nothing
                    }
                },
                Some(Report::Lost(reason)) => {
                    // Told once for all attempts.
                    if !std::mem::replace(&mut self.is_lost, true) {
                        warn(&[format!("{address}: {reason}; trying again")]);
                    }
                    Arrival::Nothing
                }
                Some(Report::Connected) => {
                    self.is_lost = false;
                    Arrival::Nothing
                }
                None => Arrival::Nothing,
            },
        };
        match &arrival {
            Arrival::Samples(_) => self.last = Instant::now(),
            Arrival::Nothing if self.idle.is_some_and(|idle| self.last.elapsed() > idle) => return Ok(Arrival::End),
            _ => {}
        }
        Ok(arrival)
    }

    /// Counts a fault, and tells the first ones.
    fn fault(&mut self, fault: &str) {
        self.faults += 1;
        if self.faults <= TOLD {
            let more = if self.faults == TOLD { "; further ones are counted only" } else { "" };
            warn(&[format!("{}: {fault}{more}", self.name)]);
        }
    }

    /// Number of messages or lines that could not be used.
    pub fn faults(&self) -> u64 {
        self.faults
    }

    /// Publishes an answer that the broker keeps, files get none; and prints it where that is asked for.
    pub fn publish(&self, topic: &str, answer: &Value) -> miette::Result<()> {
        if self.is_printed {
            say(json!({"topic": topic, "answer": answer}))?;
        }
        if let Channel::Broker { link, .. } = &self.channel {
            link.state(&format!("{}/{topic}", self.prefix), answer.to_string().into_bytes()).into_diagnostic()?;
        }
        Ok(())
    }

    /// Ends the connection after the last answer has arrived.
    pub fn close(self) -> miette::Result<()> {
        match self.channel {
            Channel::Broker { link, topic, .. } => link.close(Some(&topic)).into_diagnostic(),
            Channel::File(_) => Ok(()),
        }
    }
}
