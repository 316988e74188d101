//! `deltatwin watch`.

mod cause;
mod source;
mod state;
mod tape;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use miette::{IntoDiagnostic, miette};

use self::cause::{Investigation, Investigations};
use self::source::{Arrival, Source};
use self::state::State;
use self::tape::Tape;
use crate::broker::{Access, Given};
use crate::data::positive;
use crate::terminal::{
    BAD_ANSWER, DONE, INTERRUPTED, catch_interrupt, check_output, complain, interrupted, say, spinner, warn,
};
use deltatwin::machine::Setup;
use deltatwin::model::Model;
use deltatwin::monitoring::{Monitor, Observation, Sample, Settings};
use deltatwin_io::{model, recording};
use deltatwin_watch::inbox::Inbox;
use deltatwin_watch::stamped::SECOND;

/// Watch a running machine: residual, alarm, cause, and loads that no sensor sees.
///
/// The first minute is taken as healthy, or a recording given with --healthy. From then on, a residual that is no longer
/// that of the healthy machine raises an alarm, and the cause so far is what has changed in the model since. Messages are
/// JSON, {"t": s, "q": [angles], "tau": [torques]}, one sample or lists of them (docs/watch.md). Ctrl-C, {"end": true}
/// and --idle end it with the verdict. Exit status 1: the machine has changed.
#[derive(clap::Args, Clone, Debug)]
#[command(
    after_help = "Example: deltatwin watch mine.toml --mqtt mqtt://127.0.0.1:1883 --topic robot/joints -o shift.mcap"
)]
pub struct Args {
    /// Model file, identified on the healthy machine.
    pub model: PathBuf,
    /// Broker that the machine sends its samples to: mqtt://HOST, with TLS mqtts://HOST.
    #[arg(long, value_name = "URL", requires = "topic", required_unless_present = "follow")]
    pub mqtt: Option<Given>,
    /// Topic of the samples.
    #[arg(long, value_name = "TOPIC", requires = "mqtt")]
    pub topic: Option<String>,
    #[command(flatten)]
    pub access: Access,
    /// File that grows, instead of a broker: CSV with the columns t, q1…, tau1…, or MCAP.
    #[arg(long, value_name = "FILE", conflicts_with = "mqtt")]
    pub follow: Option<PathBuf>,
    /// Healthy time at the beginning, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, value_parser = positive)]
    pub learn: f64,
    /// Recording of the healthy machine, instead of its first samples.
    #[arg(long, value_name = "REC", conflicts_with = "learn")]
    pub healthy: Option<PathBuf>,
    /// False alarms per hour of a healthy machine, at most.
    #[arg(long, value_name = "PER_HOUR", default_value_t = 0.01, value_parser = positive)]
    pub false_alarms: f64,
    /// Time before now in which the cause is looked for, s; its last third is held out.
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, value_parser = positive)]
    pub last: f64,
    /// Recording to write while it runs, .mcap or .csv.
    #[arg(short, long, value_name = "REC")]
    pub output: Option<PathBuf>,
    /// First part of the topics of the answers: PREFIX/residual, PREFIX/margins, PREFIX/verdict.
    #[arg(long, value_name = "PREFIX", default_value = "deltatwin")]
    pub publish: String,
    /// Name at the broker; a watch that is started again under its name gets what it has missed.
    #[arg(long, value_name = "ID")]
    pub client_id: Option<String>,
    /// Time of later samples for which missing ones are waited for, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 5.0, value_parser = positive)]
    pub patience: f64,
    /// End after this time without a sample, s.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    pub idle: Option<f64>,
    /// Setup of the machine: payload, configuration.
    #[arg(long, value_name = "FILE")]
    pub setup: Option<PathBuf>,
    #[cfg(feature = "viewer")]
    #[command(flatten)]
    viewer: super::view::View,
    /// One JSON object on stdout, at the end.
    #[arg(long)]
    pub json: bool,
    /// Every answer as a line of JSON on stdout as it comes, {"topic": …, "answer": …}, for another program: the watch ends
    /// with its standard input.
    #[arg(long, conflicts_with = "json")]
    pub answers: bool,
}

impl Args {
    /// Whether stdout has JSON and no text.
    fn is_for_machines(&self) -> bool {
        self.json || self.answers
    }
}

/// Longest healthy time that the cause is compared with, s.
const HEALTHY: f64 = 60.0;
/// Pause between looks at a source, s.
const PAUSE: Duration = Duration::from_millis(50);

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = model::read(&args.model)?;
    if let Some(output) = &args.output {
        let inputs: Vec<&Path> = [Some(&args.model), args.follow.as_ref(), args.healthy.as_ref()]
            .into_iter()
            .flatten()
            .map(PathBuf::as_path)
            .collect();
        check_output(output, &inputs, &["mcap", "csv"])?;
        if output.exists() {
            return Err(miette!("{} exists; expected another name for the recording", output.display()));
        }
    }
    let setup = match &args.setup {
        Some(file) => recording::setup::read(file)?,
        None => Setup::default(),
    };
    let mut watch = Watch::new(args, &model, setup)?;
    catch_interrupt()?;
    let mut source = Source::open(args, &model)?;
    if !args.is_for_machines() {
        say(format!("Watching {}; Ctrl-C ends it with the verdict", source.name()))?;
    }
    let input_ended = if args.answers { end_of_input() } else { Arc::default() };
    loop {
        let arrival = source.next(PAUSE)?;
        let has_ended = matches!(arrival, Arrival::End) || interrupted() || input_ended.load(Ordering::Relaxed);
        watch.arrived(arrival, &source)?;
        if has_ended {
            break;
        }
    }
    let status = watch.end(&source)?;
    source.close()?;
    Ok(if interrupted() { INTERRUPTED } else { status })
}

/// Set once standard input has ended: the program that reads the answers is done with them, or gone.
fn end_of_input() -> Arc<AtomicBool> {
    let ended = Arc::<AtomicBool>::default();
    let set = ended.clone();
    std::thread::spawn(move || {
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        set.store(true, Ordering::Relaxed);
    });
    ended
}

/// A watch in progress.
struct Watch<'a> {
    args: &'a Args,
    model: &'a Model,
    setup: Setup,
    inbox: Inbox,
    monitor: Monitor,
    /// The last healthy samples.
    healthy: VecDeque<Sample>,
    /// The last samples.
    recent: VecDeque<Sample>,
    investigations: Investigations,
    tape: Option<Tape>,
    state: State<'a>,
    /// Windows that could not be computed.
    impossible: u64,
}

impl<'a> Watch<'a> {
    fn new(args: &'a Args, model: &'a Model, setup: Setup) -> miette::Result<Self> {
        let settings = Settings { learn: args.learn, false_alarms: args.false_alarms };
        let mut monitor = Monitor::new(model, &setup, settings);
        let mut healthy = VecDeque::new();
        if let Some(file) = &args.healthy {
            let (known, warnings) = recording::read_of(file, args.setup.as_deref(), model.mechanism)?;
            warn(&warnings);
            let signals = &known.signals;
            let samples =
                (0..signals.len()).map(|k| Sample { t: signals.t[k], q: signals.q().at(k), tau: signals.tau().at(k) });
            healthy.extend(samples);
            let windows = monitor.learn(healthy.make_contiguous()).into_diagnostic()?;
            if monitor.healthy().is_none() {
                let short = "expected at least ten seconds without gaps in which the machine moves";
                return Err(miette!("{}: has {windows} whole seconds to learn from; {short}", file.display()));
            }
            forget(&mut healthy, HEALTHY);
        }
        let tape = args.output.as_deref().map(|file| Tape::create(file, model, &setup)).transpose()?;
        let state = State::new(args, model, &setup, monitor.healthy());
        let (inbox, recent) = (Inbox::new(args.patience), VecDeque::new());
        let investigations = Investigations::default();
        Ok(Self { args, model, setup, inbox, monitor, healthy, recent, investigations, tape, state, impossible: 0 })
    }

    /// Takes in what has arrived.
    fn arrived(&mut self, arrival: Arrival, source: &Source) -> miette::Result<()> {
        let samples = match arrival {
            Arrival::Samples(samples) => samples,
            Arrival::Nothing | Arrival::End => Vec::new(),
        };
        samples.into_iter().for_each(|sample| self.inbox.put(sample));
        let ordered = self.inbox.take();
        self.follow(&ordered, source)?;
        if let Some(tape) = &mut self.tape {
            tape.keep()?;
        }
        if let Some(found) = self.investigations.finished() {
            self.state.found(found, source)?;
        }
        Ok(())
    }

    /// Follows samples in order of time.
    fn follow(&mut self, samples: &[Sample], source: &Source) -> miette::Result<()> {
        self.state.origin = self.inbox.origin() as f64 / SECOND as f64;
        if let Some(tape) = self.tape.take_if(|_| !samples.is_empty()) {
            self.tape.insert(tape.since(self.inbox.origin())?).append(samples)?;
        }
        for &sample in samples {
            let is_learning = self.monitor.healthy().is_none();
            match self.monitor.push(sample) {
                Ok(None) => {}
                Ok(Some(observation)) => self.observed(&observation, source)?,
                Err(problem) => {
                    // A pose that the machine cannot have spoils its second only.
                    if self.impossible == 0 {
                        warn(&[format!("at {:.3} s: {problem}", self.state.origin + sample.t)]);
                    }
                    self.impossible += 1;
                }
            }
            let kept = if is_learning { &mut self.healthy } else { &mut self.recent };
            kept.push_back(sample);
            let longest = if is_learning { HEALTHY } else { self.args.last };
            while kept.front().is_some_and(|first| sample.t - first.t > longest) {
                kept.pop_front();
            }
        }
        Ok(())
    }

    fn observed(&mut self, observation: &Observation, source: &Source) -> miette::Result<()> {
        self.state.observed(observation, self.monitor.healthy(), source)?;
        let Some(alarm) = observation.alarm else { return Ok(()) };
        if self.investigations.is_due(alarm, observation.window.t[1]) {
            let question = self.investigation(alarm.onset);
            self.investigations.start(question);
        }
        Ok(())
    }

    /// The question for the cause of a change since `onset`, s.
    fn investigation(&self, onset: f64) -> Investigation {
        Investigation {
            model: self.model.clone(),
            setup: self.setup,
            healthy: self.healthy.iter().copied().collect(),
            later: self.recent.iter().filter(|s| s.t >= onset).copied().collect(),
        }
    }

    /// The verdict at once, then the cause from all samples unless Ctrl-C was pressed.
    fn end(mut self, source: &Source) -> miette::Result<u8> {
        let rest = self.inbox.rest();
        self.follow(&rest, source)?;
        if let Some(tape) = self.tape.take() {
            tape.finish()?;
        }
        self.state.complete(self.inbox.counts(), self.impossible, source)?;
        let alarm = self.monitor.alarm();
        if let Some(alarm) = alarm.filter(|_| !interrupted()) {
            let question = self.investigation(alarm.onset);
            let [from, to] = question.data();
            let length = format!("{:.0} s of samples", to - from);
            complain(format!("determining the cause from {length}; Ctrl-C ends with the cause so far"));
            self.investigations.start(question);
            let progress = spinner("cause");
            let found = self.investigations.wait(interrupted);
            progress.finish_and_clear();
            found.map_or(Ok(()), |found| self.state.found(found, source))?;
        }
        self.state.end()?;
        Ok(if alarm.is_some() { BAD_ANSWER } else { DONE })
    }
}

/// Keeps the last `seconds` of samples.
fn forget(samples: &mut VecDeque<Sample>, seconds: f64) {
    let Some(last) = samples.back().map(|s| s.t) else { return };
    while samples.front().is_some_and(|first| last - first.t > seconds) {
        samples.pop_front();
    }
}
