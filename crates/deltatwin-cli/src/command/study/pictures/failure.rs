//! How it fails: the timeline of a typical failure, and rows of a failure mode and effects analysis.

use std::collections::BTreeMap;

use deltatwin::text::significant;
use deltatwin::twin::sockets::socket_name;
use deltatwin::twin::{Event, EventKind as Happened};
use deltatwin_report::FmeaRow;
use deltatwin_report::figure::study::{EventKind, FailureEvent, SocketTrace, Timeline, timeline};
use deltatwin_study::conduct::Remade;

use super::{Picture, Shown, label};

/// Largest number of failure modes.
const MODES: usize = 12;
/// Sockets of a timeline besides those that leave.
const OTHERS: usize = 2;
/// Largest number of sockets and of events of a timeline.
const SOCKETS: usize = 6;
const EVENTS: usize = 14;
/// Half width of the enlarged half of a timeline, s.
const ZOOM: f64 = 5e-3;

/// Examples of failures.
#[derive(Default)]
pub struct Examples {
    /// Timelines.
    pub pictures: Vec<Picture>,
    /// What the timeline is of.
    pub text: String,
    /// Failure modes.
    pub fmea: Vec<FmeaRow>,
}

/// The timeline of the failure in the middle of all by margin, and one row per cause and part.
pub fn examples(shown: &Shown) -> Examples {
    let failed = shown.failed();
    let rows: Vec<usize> = (0..failed.len()).filter(|row| failed[*row] == Some(true)).collect();
    let mut examples = Examples { fmea: modes(shown, &rows), ..Examples::default() };
    let (margins, sockets) = (shown.numbers("margin"), shown.texts("first_socket"));
    let mut apart: Vec<usize> = rows.iter().copied().filter(|row| !sockets[*row].is_empty()).collect();
    if apart.is_empty() {
        apart = rows;
    }
    apart.sort_by(|a, b| margins[*a].total_cmp(&margins[*b]));
    let Some(run) = apart.get(apart.len() / 2) else { return examples };
    let Ok(remade) = shown.conduct.remake(*run as u64) else { return examples };
    let study = &shown.conduct.study;
    let settings: Vec<String> = study
        .factors
        .iter()
        .zip(&remade.point.settings)
        .map(|(factor, setting)| {
            let text = shown.conduct.columns.text(factor, *setting);
            let text = text.parse::<f64>().map_or(text, |x| significant(x, 4));
            format!("{}: {text}", label(factor))
        })
        .collect();
    examples.text = format!(
        "Run {run} is the failure in the middle of all by margin ({}). {}",
        settings.join(", "),
        remade.outcome.verdict.fmea.end
    );
    let caption =
        "Force that a socket has to hold, against what holds it: the whole motion, and the instant of the failure.";
    let figure = timeline(&content(&remade));
    examples.pictures.push(Picture { name: "failure".into(), figure, caption: caption.into() });
    examples
}

/// One row per cause and part, those of most runs first.
fn modes(shown: &Shown, rows: &[usize]) -> Vec<FmeaRow> {
    let (causes, parts) = (shown.texts("cause"), shown.texts("part"));
    let mut groups: BTreeMap<(&str, &str), Vec<usize>> = BTreeMap::new();
    for &row in rows {
        groups.entry((causes[row], parts[row])).or_default().push(row);
    }
    let mut groups: Vec<Vec<usize>> = groups.into_values().collect();
    groups.sort_by_key(|rows| (std::cmp::Reverse(rows.len()), rows[0]));
    let row = |rows: Vec<usize>| {
        let run = rows[0] as u64;
        let fmea = shown.conduct.remake(run).ok()?.outcome.verdict.fmea;
        Some(FmeaRow {
            cause: fmea.cause,
            local: fmea.local,
            end: fmea.end,
            detection: fmea.detection,
            lead: fmea.lead,
            runs: rows.len(),
            example: Some(run),
        })
    };
    groups.into_iter().take(MODES).filter_map(row).collect()
}

/// Loads and holds of the sockets that left, or came closest, with all events.
fn content(remade: &Remade) -> Timeline {
    let (report, verdict) = (&remade.outcome.report, &remade.outcome.verdict);
    let holds = remade.case.scenario.socket_holds(&remade.case.model);
    let mut shown: Vec<usize> = verdict.opened.iter().map(|(_, socket)| *socket).collect();
    let mut rest: Vec<usize> = (0..verdict.sockets.len()).filter(|s| !shown.contains(s)).collect();
    rest.sort_by(|a, b| verdict.sockets[*a].total_cmp(&verdict.sockets[*b]));
    shown.extend(rest.into_iter().take(OTHERS));
    shown.truncate(SOCKETS);
    let first = verdict.opened.first().map(|(t, _)| *t);
    let last = report.trace.last().map_or(f64::NEG_INFINITY, |sample| sample.t);
    let traces = shown.iter().map(|&socket| {
        let left = report.dislocations.iter().find(|d| d.socket == socket);
        let before = |t: f64| left.is_none_or(|d| t < d.t);
        // Once the drives have tripped, only the frames go on.
        let sampled = report.trace.iter().map(|sample| (sample.t, sample.margin[socket]));
        let framed = report.frames.iter().filter(|f| f.t > last).map(|f| (f.t, f.socket_margin[socket]));
        let (mut time, mut load) = (Vec::new(), Vec::new());
        for (t, margin) in sampled.chain(framed).filter(|(t, _)| before(*t)) {
            time.push(t);
            load.push(holds[socket] - margin);
        }
        let mut hold = vec![holds[socket]; time.len()];
        if let Some(d) = left {
            time.push(d.t);
            load.push(d.across);
            hold.push(d.hold);
        }
        SocketTrace {
            name: socket_name(socket, verdict.sockets.len() / 2),
            time,
            load,
            hold,
            opened: left.map(|d| d.t),
        }
    });
    let sockets: Vec<SocketTrace> = traces.collect();
    let event = |e: &Event| FailureEvent { time: e.t, kind: kind(e.kind, e.t, first), text: e.what.clone() };
    let mut events: Vec<FailureEvent> = report.events.iter().map(event).collect();
    let notices = verdict.supervision.iter().filter_map(|n| {
        let time = n.time.filter(|t| *t >= 0.0)?;
        Some(FailureEvent { time, kind: EventKind::Noticed, text: n.what.clone() })
    });
    events.extend(notices);
    events.sort_by(|a, b| a.time.total_cmp(&b.time));
    events.truncate(EVENTS);
    Timeline {
        title: format!("Run {}: {} ({})", remade.run, verdict.cause.kind.name(), verdict.cause.part),
        sockets,
        events,
        instant: verdict.time,
        zoom: ZOOM,
    }
}

fn kind(kind: Happened, t: f64, first: Option<f64>) -> EventKind {
    match kind {
        Happened::Dislocation => EventKind::Opened,
        Happened::Trip => EventKind::Trip,
        Happened::Contact if first.is_some_and(|first| t > first) => EventKind::Landed,
        Happened::Contact | Happened::Stop => EventKind::Contact,
        _ => EventKind::Other,
    }
}
