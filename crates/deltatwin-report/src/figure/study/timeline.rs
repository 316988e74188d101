//! Timeline of a failure: loads against holds, and what happened when.

use super::super::axis::{Axis, Rect, axes, left_margin, no_data, range};
use super::super::canvas::{Align, Canvas, Lettering, draw, shorten, text_width};
use super::super::color::{Color, QUIET, TEXT};
use super::super::curve::{Curve, Style, plot};
use super::super::legend::{Entry, Swatch, head, legend};
use super::super::numbers::fixed;
use super::super::{Figure, LABEL_SIZE, RIGHT, TICK_SIZE, WIDTH};
use super::on_ground;

/// Load of one ball socket.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SocketTrace {
    /// Name.
    pub name: String,
    /// Times, s.
    pub time: Vec<f64>,
    /// Force that pulls it off, N.
    pub load: Vec<f64>,
    /// Force that holds it, N.
    pub hold: Vec<f64>,
    /// Time at which it left its ball, s.
    pub opened: Option<f64>,
}

/// Kind of an event of a failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventKind {
    /// A supervision notices.
    Noticed,
    /// Something touches.
    Contact,
    /// A socket leaves its ball.
    Opened,
    /// The drives stop.
    Trip,
    /// Something lands.
    Landed,
    /// Anything else.
    Other,
}

impl EventKind {
    fn color(self) -> Color {
        match self {
            Self::Noticed => Color::GOOD,
            Self::Contact => Color::OCHRE,
            Self::Opened => Color::BAD,
            Self::Trip => Color::NOISE,
            Self::Landed => Color::PURPLE,
            Self::Other => Color::SKY,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Noticed => "noticed",
            Self::Contact => "contact",
            Self::Opened => "socket opens",
            Self::Trip => "drives stop",
            Self::Landed => "lands",
            Self::Other => "other",
        }
    }
}

/// One event of a failure.
#[derive(Debug, Clone, PartialEq)]
pub struct FailureEvent {
    /// Time, s.
    pub time: f64,
    /// Kind.
    pub kind: EventKind,
    /// What happened.
    pub text: String,
}

/// Content of the timeline of a failure.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timeline {
    /// Title.
    pub title: String,
    /// Sockets, in the order in which they are shown; those beyond [`MOST_SOCKETS`] are left out.
    pub sockets: Vec<SocketTrace>,
    /// Events.
    pub events: Vec<FailureEvent>,
    /// Time around which the right half is enlarged, s, usually that of the first socket; `None`: no right half.
    pub instant: Option<f64>,
    /// Half width of the enlarged half, s.
    pub zoom: f64,
}

/// Largest number of sockets of a timeline.
pub const MOST_SOCKETS: usize = 8;
const HEIGHT: f64 = 62.0;
/// Above every panel is the name of its socket.
const GAP: f64 = 20.0;
const LINE: f64 = 17.0;
/// Number of usual steps from which on a step counts as a gap of the recording.
const GAPS: f64 = 20.0;
const LOAD: Color = Color::MEASURED;
const HOLD: Color = Color::MUTED;

/// Load of every socket against its hold over time, the whole motion and the instant of failure, with numbered events
/// and their list.
pub fn timeline(content: &Timeline) -> Figure {
    let sockets = &content.sockets[..content.sockets.len().min(MOST_SOCKETS)];
    let mut events: Vec<&FailureEvent> = content.events.iter().filter(|e| e.time.abs() < 1e9).collect();
    events.sort_by(|a, b| a.time.total_cmp(&b.time));
    let entries = entries(sockets, &events);
    let rows = sockets.len().max(1);
    // The numbers of the events are above the name of the first panel.
    let top = head(&entries) + 24.0 + GAP;
    let bottom = top + rows as f64 * (HEIGHT + GAP) - GAP;
    let list = bottom + 52.0;
    let full = list + LINE * events.len() as f64 + if content.sockets.len() > MOST_SOCKETS { LINE } else { 0.0 };
    draw(&content.title, full + 6.0, |c| {
        legend(c, &entries);
        let place = (top, bottom);
        panels(c, content, sockets, (&events, place));
        let first = instant(content).or(events.first().map(|e| e.time));
        for (k, event) in events.iter().enumerate() {
            listed(c, (k, event), first, list + LINE * k as f64);
        }
        if content.sockets.len() > MOST_SOCKETS {
            let text = format!("{} more sockets are not shown", content.sockets.len() - MOST_SOCKETS);
            c.write(&text, (12.0, full - 0.5 * LINE), TICK_SIZE, QUIET, Align::Left);
        }
    })
}

fn instant(content: &Timeline) -> Option<f64> {
    content.instant.filter(|t| t.abs() < 1e9)
}

fn entries(sockets: &[SocketTrace], events: &[&FailureEvent]) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    if !sockets.is_empty() {
        entries.push(("force that pulls the socket off".into(), LOAD, Swatch::Curve(Style::Line)));
        entries.push(("force that holds it".into(), HOLD, Swatch::Curve(Style::Dashed)));
        if sockets.iter().any(|s| s.opened.is_some()) {
            entries.push(("open".into(), Color::BAD, Swatch::Band));
        }
    }
    for event in events {
        let entry: Entry = (event.kind.name().into(), event.kind.color(), Swatch::Curve(Style::Points));
        if !entries.contains(&entry) {
            entries.push(entry);
        }
    }
    entries
}

fn panels(
    c: &mut Canvas,
    content: &Timeline,
    sockets: &[SocketTrace],
    (events, (top, bottom)): (&[&FailureEvent], (f64, f64)),
) {
    let y: Vec<Option<Axis>> = sockets.iter().map(vertical).collect();
    let left = left_margin(y.iter().flatten().fold(0.0, |w, a| a.label_width().max(w)));
    let whole = range(sockets.iter().flat_map(|s| s.time.iter().copied()).chain(events.iter().map(|e| e.time)));
    let zoomed = instant(content).filter(|_| content.zoom > 0.0 && content.zoom < 1e3);
    let end = WIDTH - RIGHT;
    let middle = if zoomed.is_some() { left + 0.52 * (end - left) } else { end };
    let mut halves = vec![(left, middle, whole.map(|r| Axis::linear(r, 0.0, 6)), "time / s", 0.0, 1.0)];
    if let Some(instant) = zoomed {
        let zoom = 1e3 * content.zoom;
        halves.push((
            middle + 40.0,
            end,
            Some(Axis::linear((-zoom, zoom), 0.0, 6)),
            "ms from the failure",
            instant,
            1e3,
        ));
    }
    for (side, (x0, x1, x, x_label, origin, scale)) in halves.into_iter().enumerate() {
        let Some(x) = x else { continue };
        for (row, socket) in sockets.iter().enumerate() {
            let y0 = top + row as f64 * (HEIGHT + GAP);
            let r = Rect { x0, y0, x1, y1: y0 + HEIGHT };
            let label = (row + 1 == sockets.len()).then_some(x_label);
            let none = Axis { hi: 1.0, ..Axis::default() };
            let mut axis = y[row].clone().unwrap_or(none);
            if side > 0 {
                axis.ticks.iter_mut().for_each(|tick| tick.1.clear());
            }
            axes(c, r, &x, &axis, label, if side == 0 { "N" } else { "" });
            panel(c, (r, &x, &axis), socket, (origin, scale));
        }
        let r = Rect { x0, y0: top, x1, y1: bottom };
        if sockets.is_empty() {
            no_data(c, r);
        }
        numbered(c, (r, &x), events, (origin, scale));
        // On top of the lines of the events.
        for (row, socket) in sockets.iter().enumerate().filter(|_| side == 0) {
            let name = shorten(&socket.name, x1 - x0 - 8.0, LABEL_SIZE);
            let bold = Lettering::new(LABEL_SIZE, TEXT, Align::Left).bold(true);
            on_ground(c, &name, (x0, top + row as f64 * (HEIGHT + GAP) - 0.5 * GAP), bold);
        }
    }
}

/// Axis of one socket: its load, but at most far enough beyond the hold to see that it is exceeded.
fn vertical(socket: &SocketTrace) -> Option<Axis> {
    let hold = range(socket.hold.iter().copied()).map_or(0.0, |(_, high)| high);
    let (low, high) = range(socket.load.iter().chain(&socket.hold).copied())?;
    let high = if hold > 0.0 { high.min(1.5 * hold) } else { high };
    Some(Axis::linear((low.clamp(-high.abs(), 0.0), 1.12 * high), 0.0, 3))
}

/// Load and hold of one socket, times as `(t − origin)·scale`.
fn panel(c: &mut Canvas, (r, x, y): (Rect, &Axis, &Axis), socket: &SocketTrace, (origin, scale): (f64, f64)) {
    let at = |t: f64| (t - origin) * scale;
    if let Some(opened) = socket.opened.and_then(|t| r.x(x, at(t))).filter(|px| *px < r.x1) {
        let px = opened.max(r.x0);
        c.bar((px, r.y0), (r.x1, r.y1), Color::BAD, 0.14);
        if r.x1 - px > 34.0 {
            c.write("open", (r.x1 - 5.0, r.y1 - 9.0), TICK_SIZE, TEXT, Align::Right);
        }
    }
    // Only what the panel shows, so that its resolution is used there, and only while the socket is closed.
    let end = socket.opened.unwrap_or(f64::INFINITY);
    let shown = |values: &[f64]| -> (Vec<f64>, Vec<f64>) {
        let pairs = socket.time.iter().zip(values).filter(|(t, _)| **t <= end).map(|(t, v)| (at(*t), *v));
        let margin = 0.02 * (x.hi - x.lo);
        pairs.filter(|(t, _)| *t >= x.lo - margin && *t <= x.hi + margin).unzip()
    };
    let steps: Vec<f64> = socket.time.windows(2).map(|w| w[1] - w[0]).collect();
    let longest = GAPS * median(steps).unwrap_or(f64::INFINITY) * scale;
    for (values, color, style) in [(&socket.hold, HOLD, Style::Dashed), (&socket.load, LOAD, Style::Line)] {
        let (times, values) = interrupted(shown(values), longest);
        plot(c, (r, x, y), &Curve::new("", times, values).style(style), color, MOST_SOCKETS);
    }
}

/// A curve without a line across steps of more than `longest`, where nothing was recorded.
fn interrupted((times, values): (Vec<f64>, Vec<f64>), longest: f64) -> (Vec<f64>, Vec<f64>) {
    let mut curve = (Vec::with_capacity(times.len()), Vec::with_capacity(times.len()));
    for (k, (t, v)) in times.iter().zip(values).enumerate() {
        if k > 0 && t - times[k - 1] > longest {
            curve.0.push(0.5 * (t + times[k - 1]));
            curve.1.push(f64::NAN);
        }
        curve.0.push(*t);
        curve.1.push(v);
    }
    curve
}

/// Middle one of the values.
fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Vertical lines at the events through all panels, with their numbers above; close ones share a number from–to.
fn numbered(c: &mut Canvas, (r, x): (Rect, &Axis), events: &[&FailureEvent], (origin, scale): (f64, f64)) {
    const ROOM: f64 = 17.0;
    let mut groups: Vec<(f64, usize, usize)> = Vec::new();
    for (k, event) in events.iter().enumerate() {
        let Some(px) = r.x(x, (event.time - origin) * scale).filter(|px| (r.x0 - 0.5..=r.x1 + 0.5).contains(px)) else {
            continue;
        };
        c.line((px, r.y0 - GAP), (px, r.y1), event.kind.color(), 1.0);
        match groups.last_mut() {
            Some((at, _, last)) if px - *at < ROOM => *last = k,
            _ => groups.push((px, k, k)),
        }
    }
    let mut free = f64::NEG_INFINITY;
    for (px, first, last) in groups {
        let text = if first == last { format!("{}", first + 1) } else { format!("{}–{}", first + 1, last + 1) };
        let half = (0.5 * text_width(&text, TICK_SIZE) + 4.0).max(8.0);
        let middle = px.max(free + half).min(WIDTH - half - 2.0);
        free = middle + half + 2.0;
        let (y, color) = (r.y0 - GAP - 10.0, events[first].kind.color());
        c.bar((middle - half, y - 8.0), (middle + half, y + 8.0), color, 1.0);
        c.styled(&text, (middle, y), Lettering::new(TICK_SIZE, color.ink(), Align::Middle).bold(true));
    }
}

/// One line of the list of events.
fn listed(c: &mut Canvas, (k, event): (usize, &FailureEvent), first: Option<f64>, y: f64) {
    c.bar((12.0, y - 7.5), (28.0, y + 7.5), event.kind.color(), 1.0);
    let ink = event.kind.color().ink();
    c.styled(&(k + 1).to_string(), (20.0, y), Lettering::new(TICK_SIZE, ink, Align::Middle).bold(true));
    c.write(&format!("{} s", fixed(event.time, 6)), (120.0, y), TICK_SIZE, TEXT, Align::Right);
    if let Some(first) = first {
        let ms = 1e3 * (event.time - first);
        let decimals = if ms.abs() < 10.0 { 3 } else { 1 };
        let sign = if ms > 0.0 { "+" } else { "" };
        let text = format!("{sign}{} ms", fixed(ms, decimals));
        c.write(&text, (210.0, y), TICK_SIZE, QUIET, Align::Right);
    }
    let text = shorten(&event.text, WIDTH - 224.0 - RIGHT, LABEL_SIZE);
    c.write(&text, (224.0, y), LABEL_SIZE, TEXT, Align::Left);
}
