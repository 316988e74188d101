//! Recordings as the samples of a running machine.

use std::time::{Duration, Instant};

use miette::{IntoDiagnostic, miette};
use serde_json::json;

use super::Args;
use crate::broker::Given;
use crate::terminal::{DONE, INTERRUPTED, bar, catch_interrupt, interrupted, say, warn};
use deltatwin::machine::Mechanism;
use deltatwin::monitoring::Sample;
use deltatwin_io::recording;
use deltatwin_watch::message;
use deltatwin_watch::mqtt::Link;

/// Time in which a broker must answer at the start.
const PATIENCE: Duration = Duration::from_secs(5);
/// Pause between two recordings, s.
const BETWEEN: f64 = 1.0;

/// Publishes the recordings; returns the exit status.
pub fn run(args: &Args, address: &Given, topic: &str) -> miette::Result<u8> {
    let broker = args.access.broker(address)?;
    let (samples, machine) = samples(args)?;
    catch_interrupt()?;
    let id = format!("deltatwin-replay-{}", std::process::id());
    let link = Link::open(&broker, &id, None, PATIENCE).into_diagnostic()?;
    let progress = bar("replay", samples.len() as u64);
    let (start, first) = (Instant::now(), samples.first().map_or(0.0, |s| s.t));
    let mut sent = 0;
    let mut messages = 0u64;
    while sent < samples.len() && !interrupted() {
        let from = samples[sent].t;
        let count = samples[sent..].iter().take_while(|s| s.t < from + args.batch).count().clamp(1, message::MOST);
        let batch = &samples[sent..sent + count];
        let due = Duration::from_secs_f64((batch[count - 1].t - first) / args.speed);
        std::thread::sleep(due.saturating_sub(start.elapsed()));
        let payload = message::batch(batch, machine.axes()).to_string().into_bytes();
        link.publish(topic, payload).into_diagnostic()?;
        sent += count;
        messages += 1;
        progress.set_position(sent as u64);
    }
    link.publish(topic, message::end().to_string().into_bytes()).into_diagnostic()?;
    link.close(None).into_diagnostic()?;
    progress.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    if args.json {
        say(json!({ "samples": sent, "messages": messages, "seconds": seconds }))?;
    } else {
        say(format!(
            "Sent {sent} samples in {messages} messages within {seconds:.1} s to {topic} at {}",
            broker.address
        ))?;
    }
    Ok(if interrupted() { INTERRUPTED } else { DONE })
}

/// Samples of all recordings, one second apart, and the machine that they are of.
fn samples(args: &Args) -> miette::Result<(Vec<Sample>, Mechanism)> {
    let mut all: Vec<Sample> = Vec::new();
    let mut machine = None;
    for file in &args.recordings {
        let (recording, warnings) = recording::read_as(file, &args.columns.reading(None, None))?;
        warn(&warnings);
        let signals = recording.signals;
        if machine.is_some_and(|m| m != signals.mechanism) {
            return Err(miette!("{}: is of another machine than {}", file.display(), args.recordings[0].display()));
        }
        machine = Some(signals.mechanism);
        // A recording that begins before the end of the previous one goes on after it.
        let begin = signals.t.first().copied().unwrap_or(0.0);
        let end = all.last().map(|s| s.t + BETWEEN);
        let shift = end.filter(|end| begin < *end).map_or(0.0, |end| end - begin);
        all.extend((0..signals.len()).map(|k| Sample {
            t: signals.t[k] + shift,
            q: signals.q().at(k),
            tau: signals.tau().at(k),
        }));
    }
    machine.map(|machine| (all, machine)).ok_or_else(|| miette!("no recording"))
}
