//! What is known about the machine, told on the terminal and published.

use serde_json::{Value, json};

use super::Args;
use super::cause::Finding;
use super::source::Source;
use crate::terminal::{command, say};
use deltatwin::identification::residuals::rms;
use deltatwin::machine::Setup;
use deltatwin::model::Model;
use deltatwin::monitoring::{Alarm, Healthy, Loads, Observation};
use deltatwin::twin::sockets::socket_name;
use deltatwin_watch::inbox::Counts;

/// What is known.
pub struct State<'a> {
    args: &'a Args,
    /// Whether the healthy residual is known.
    watches: bool,
    alarm: Option<Alarm>,
    cause: Option<Value>,
    /// Time on the machine's clock from which times count, s.
    pub origin: f64,
    /// Time of the last window, s.
    t: f64,
    windows: u64,
    highest: f64,
    weakest: Option<(String, f64)>,
    /// Counts of the samples, once the last one has come.
    samples: Value,
    #[cfg(feature = "viewer")]
    viewer: Option<deltatwin_rerun::watch::Broadcast>,
}

impl<'a> State<'a> {
    /// Nothing is known, but what was `healthy` if that is.
    pub fn new(args: &'a Args, model: &Model, setup: &Setup, healthy: Option<&Healthy>) -> Self {
        #[cfg(not(feature = "viewer"))]
        let _ = (model, setup);
        Self {
            args,
            watches: healthy.is_some(),
            alarm: None,
            cause: None,
            origin: 0.0,
            t: 0.0,
            windows: 0,
            highest: 0.0,
            weakest: None,
            samples: Value::Null,
            #[cfg(feature = "viewer")]
            viewer: args.viewer.viewer().and_then(|viewer| {
                let opened = deltatwin_rerun::watch::Broadcast::open(&viewer, model, setup);
                opened.inspect_err(|problem| args.viewer.refuse(problem)).ok()
            }),
        }
    }

    /// Tells what a window shows.
    pub fn observed(
        &mut self,
        observation: &Observation,
        healthy: Option<&Healthy>,
        source: &Source,
    ) -> miette::Result<()> {
        let window = &observation.window;
        self.t = window.t[1];
        self.windows += 1;
        let mut residual = json!({
            "t": window.t.map(|t| self.origin + t),
            "channels": window.dataset.channels.iter().map(ToString::to_string).collect::<Vec<_>>(),
            "rms": window.residual.iter().map(|series| rms(series)).collect::<Vec<f64>>(),
            "healthy_rms": healthy.map(|h| h.rms.clone()),
        });
        if let Some((statistic, level)) = observation.level {
            residual["level"] = json!(level);
            residual["statistic"] = json!(statistic.to_string());
            self.highest = self.highest.max(level);
        }
        if let Some(learning) = observation.learning {
            residual["learned"] = json!([learning.done, learning.needed]);
        }
        source.publish("residual", &residual)?;
        #[cfg(feature = "viewer")]
        if let Some(viewer) = &self.viewer {
            viewer.observed(observation, healthy.map_or(&[], |h| &h.rms_of_means));
        }
        if let Some(loads) = &window.loads {
            self.loads(loads, source)?;
        }
        if !self.watches
            && let Some(healthy) = healthy
        {
            self.watches = true;
            self.say(&format!("learned from {} s; {} charts watch from now on", healthy.windows, healthy.charts()))?;
            self.publish(source)?;
        }
        if observation.is_new
            && let Some(alarm) = observation.alarm
        {
            self.alarm = Some(alarm);
            self.say(&format!("ALARM: {}; since about {:.1} s", alarm.statistic, self.origin + alarm.onset))?;
            self.publish(source)?;
        } else if self.windows == 1 {
            self.publish(source)?;
        }
        Ok(())
    }

    fn loads(&mut self, loads: &Loads, source: &Source) -> miette::Result<()> {
        let least = loads.margin.iter().copied().enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let weakest = least.map(|(socket, margin)| (socket_name(socket, loads.strut_upper.len()), margin));
        if let Some((_, margin)) = weakest
            && self.weakest.as_ref().is_none_or(|(_, least)| margin < *least)
        {
            self.weakest.clone_from(&weakest);
        }
        let name = weakest.map(|(socket, margin)| json!({ "socket": socket, "margin": margin }));
        let margins = json!({
            "t": self.origin + self.t,
            "strut_upper": loads.strut_upper,
            "strut_lower": loads.strut_lower,
            "margin": loads.margin,
            "weakest": name,
        });
        source.publish("margins", &margins)
    }

    /// Tells the cause so far.
    pub fn found(&mut self, mut finding: Finding, source: &Source) -> miette::Result<()> {
        finding.data = finding.data.map(|t| self.origin + t);
        let known = finding.to_json();
        if self.cause.as_ref() != Some(&known) {
            let [from, to] = finding.data;
            self.say(&format!("cause so far, from {from:.1} to {to:.1} s:"))?;
            for line in finding.lines() {
                #[cfg(feature = "viewer")]
                if let Some(viewer) = &self.viewer {
                    viewer.say(self.t, &line, true);
                }
                if !self.args.is_for_machines() {
                    say(crate::terminal::hanging(&line, "      ", "        "))?;
                }
            }
        }
        self.cause = Some(known);
        self.publish(source)
    }

    /// The verdict as JSON.
    fn verdict(&self) -> Value {
        let state = match (self.watches, self.alarm) {
            (_, Some(_)) => "changed",
            (true, None) => "healthy",
            (false, None) => "learning",
        };
        let clock = |t: f64| self.origin + t;
        let alarm =
            |a: Alarm| json!({ "t": clock(a.t), "onset": clock(a.onset), "statistic": a.statistic.to_string() });
        let mut verdict = json!({
            "state": state,
            "t": clock(self.t),
            "alarm": self.alarm.map(alarm),
            "cause": self.cause,
            "highest_level": self.highest,
            "false_alarms_per_hour": self.args.false_alarms,
            "weakest_socket": self.weakest.as_ref().map(|(socket, margin)| json!({ "socket": socket, "margin": margin })),
        });
        if !self.samples.is_null() {
            verdict["samples"] = self.samples.clone();
            verdict["windows"] = json!(self.windows);
            verdict["recording"] = self.args.output.as_deref().map_or(Value::Null, crate::terminal::path);
        }
        verdict
    }

    fn publish(&self, source: &Source) -> miette::Result<()> {
        source.publish("verdict", &self.verdict())
    }

    /// Shows the verdict after the last sample, with the cause so far.
    pub fn complete(&mut self, counts: Counts, impossible: u64, source: &Source) -> miette::Result<()> {
        self.samples = json!({
            "taken": counts.taken, "doubled": counts.doubled, "missing": counts.missing, "astray": counts.astray,
            "clock_restarts": counts.restarts, "unusable_messages": source.faults(), "impossible_windows": impossible,
        });
        let verdict = self.verdict();
        source.publish("verdict", &verdict)?;
        if self.args.is_for_machines() {
            return Ok(());
        }
        let state = verdict["state"].as_str().unwrap_or_default();
        say(format!(
            "\n{state} after {:.1} s: {} samples, {} missing, {} doubled or late, {} astray, {} unusable messages",
            self.t,
            counts.taken,
            counts.missing,
            counts.doubled,
            counts.astray,
            source.faults()
        ))?;
        if let Some((socket, margin)) = &self.weakest {
            say(format!("  least margin {margin:.1} N, at socket {socket}"))?;
        }
        if state == "learning" {
            say("  Not enough to learn from: shorten --learn, or give a recording with --healthy")?;
        }
        Ok(())
    }

    /// Prints the verdict as JSON, or the name of the recording.
    pub fn end(&self) -> miette::Result<()> {
        if self.args.json {
            return say(self.verdict());
        }
        if let Some(output) = self.args.output.as_ref().filter(|_| !self.args.answers) {
            say(format!("  Wrote {}", output.display()))?;
            let model = self.args.model.display().to_string();
            let words = ["deltatwin", "compare", &model, &output.display().to_string()].map(String::from);
            say(format!("  Next:\n{}", command(&words, 4)))?;
        }
        Ok(())
    }

    fn say(&self, what: &str) -> miette::Result<()> {
        #[cfg(feature = "viewer")]
        if let Some(viewer) = &self.viewer {
            viewer.say(self.t, what, self.alarm.is_some());
        }
        if self.args.is_for_machines() { Ok(()) } else { say(format!("{:9.1} s  {what}", self.origin + self.t)) }
    }
}
