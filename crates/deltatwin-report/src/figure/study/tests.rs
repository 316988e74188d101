use super::super::tests::well_formed;
use super::super::{Curve, Figure, Rate, Style};
use super::*;
use crate::study::{FmeaRow, KeyNumber, StudyPage, StudySection, study_page};
use crate::{Callout, Color};

/// Margins in the manner of the robot over the offset (mm) and the mass (kg): socket, drive torque, telescope.
fn point(offset: f64, mass: f64) -> CausePoint {
    let tilt = mass * (9.81 + 55.0) * offset / 1e3;
    let socket = 1.0 - (70.0 + 14.0 * mass + tilt / 0.24) / 200.0;
    let torque = 1.0 - (0.25 + 0.098 * mass);
    let telescope = 0.42 - 0.0003 * offset - 0.015 * mass;
    let margins = [socket, torque, telescope];
    let cause = (0..3).min_by(|&a, &b| margins[a].total_cmp(&margins[b])).unwrap_or(0);
    CausePoint { x: offset, y: mass, margin: margins[cause], cause }
}

fn causes() -> Vec<String> {
    ["socket", "drive torque", "telescope"].map(String::from).into()
}

fn map(points: Vec<CausePoint>) -> CauseMap {
    let offsets: Vec<f64> = (20..=200).map(f64::from).collect();
    let hand = offsets.iter().map(|o| 130.0 * 0.24 / (64.81 * o / 1e3)).collect();
    CauseMap {
        title: "What limits the pick-and-place cycle at 150 picks per minute".into(),
        x_label: "offset of the centre of mass / mm".into(),
        y_label: "mass / kg".into(),
        points,
        causes: causes(),
        curves: vec![Curve::new("by hand: tilting torque over pair distance", offsets, hand).style(Style::Dashed)],
    }
}

fn grid(columns: usize, rows: usize) -> CauseMap {
    let x = |k: usize| 200.0 * k as f64 / (columns - 1) as f64;
    let y = |i: usize| 8.0 * i as f64 / (rows - 1) as f64;
    map((0..rows).flat_map(|i| (0..columns).map(move |k| point(x(k), y(i)))).collect())
}

/// Points of a rank-1 lattice, in no grid.
fn scattered(n: usize) -> CauseMap {
    let part = |k: usize, a: f64| (k as f64 * a).fract();
    map((0..n).map(|k| point(200.0 * part(k, 0.754_877_666), 8.0 * part(k, 0.569_840_291))).collect())
}

fn diagram(panels: usize) -> PayloadDiagram {
    let line = |mass: f64, scale: f64| -> Vec<(f64, f64)> {
        let at = |k: i32| {
            let rate = 60.0 + 5.0 * f64::from(k);
            (rate, scale * 5400.0 / mass / (9.81 + 55.0 * (rate / 150.0).powi(2)))
        };
        (0..=28).map(at).collect()
    };
    let panel = |k: usize| {
        let mass = 1.5 * (k + 1) as f64;
        let name = format!("{mass} kg");
        PayloadPanel { name, nominal: line(mass, 1.0), likely: line(mass, 0.88), worst: line(mass, 0.71) }
    };
    PayloadDiagram {
        title: "Permissible offset of the payload over picks per minute".into(),
        x_label: "picks per minute".into(),
        y_label: "offset of the centre of mass / mm".into(),
        panels: (0..panels).map(panel).collect(),
        reference: Some(("20 N·m of tilting torque at rest, 6 kg".into(), vec![(60.0, 340.0), (200.0, 340.0)])),
    }
}

fn normal(z: f64) -> f64 {
    // Logistic approximation, enough for a picture.
    1.0 / (1.0 + (-1.702 * z).exp())
}

fn curve(name: &str, median: f64, spread: f64, reference: f64) -> ProbabilityCurve {
    let p = |x: f64| normal((x / median).ln() / spread);
    let rate = |k: u32| {
        let x = 0.6 + 0.2 * f64::from(k);
        let share = (p(x) + 0.03 * (f64::from(k) * 2.4).sin()).clamp(0.0, 1.0);
        Rate { x, share, low: (share - 0.09).max(0.0), high: (share + 0.09).min(1.0), of: 40 }
    };
    let fit = |k: u32| {
        let x = 0.6 + 0.02 * f64::from(k);
        Banded { x, value: p(x), low: p(x * 0.96), high: p(x * 1.04) }
    };
    let at = median * (spread * (reference / (1.0 - reference)).ln() / 1.702).exp();
    let mark = Some([at, 0.96 * at, 1.04 * at]);
    ProbabilityCurve { name: name.into(), points: (0..9).map(rate).collect(), fit: (0..=80).map(fit).collect(), mark }
}

fn powers() -> Vec<ProbabilityCurve> {
    let stretch = |mut c: ProbabilityCurve| {
        let far = |x: &mut f64| *x = 0.02 * (2.2 * (*x - 0.6)).exp();
        c.points.iter_mut().for_each(|p| far(&mut p.x));
        c.fit.iter_mut().for_each(|p| far(&mut p.x));
        c.mark.iter_mut().flatten().for_each(far);
        c
    };
    [("10 s", 1.7), ("40 s", 1.35), ("160 s", 1.0)].map(|(n, m)| stretch(curve(n, m, 0.16, 0.8))).into()
}

fn factors() -> Vec<Importance> {
    let row = |name: &str, span: &str, swing: [f64; 2], first: f64, total: f64| {
        let estimate = |value: f64| Some(Estimate { value, low: value - 0.04, high: value + 0.05 });
        let (first, total) = (estimate(first), estimate(total));
        Importance { name: name.into(), span: span.into(), swing: Some(swing), first, total }
    };
    vec![
        row("offset of the centre of mass", "0 to 120 mm", [0.71, -0.42], 0.41, 0.62),
        row("mass", "1 to 6 kg", [0.55, -0.18], 0.22, 0.43),
        row("speed scale", "0.6 to 1", [0.38, 0.08], 0.09, 0.18),
        row("hold of strut 3 lower", "140 to 230 N", [-0.02, 0.21], 0.05, 0.06),
        row("friction of the sockets", "0 to 0.2", [0.12, 0.05], 0.01, 0.02),
        row("believed payload", "1 to 4 kg", [0.03, 0.04], -0.01, 0.01),
    ]
}

fn failure(sockets: usize) -> Timeline {
    let opened = [0.227_051, 0.227_051, 0.227_430, 0.227_9];
    let time: Vec<f64> = (0..=900).map(|k| 0.0003 * f64::from(k)).collect();
    let socket = |k: usize| {
        let opened = opened.get(k).copied();
        let load = |t: &f64| {
            let wave = 60.0 + 55.0 * (26.0 * t + k as f64).sin();
            let blow = if *t > 0.2268 { 2.4e5 * (t - 0.2268) } else { 0.0 };
            if opened.is_some_and(|o| *t > o) { f64::NAN } else { wave + blow / (1.0 + k as f64) }
        };
        let hold = |t: &f64| if opened.is_some_and(|o| *t > o) { 0.0 } else { 200.0 - 4.0 * k as f64 };
        let (load, hold) = (time.iter().map(load).collect(), time.iter().map(hold).collect());
        SocketTrace { name: format!("strut {} lower", k + 1), time: time.clone(), load, hold, opened }
    };
    let event = |time: f64, kind: EventKind, text: &str| FailureEvent { time, kind, text: text.into() };
    Timeline {
        title: "Platform hits a block at 2 m/s: four sockets within a millisecond".into(),
        sockets: (0..sockets).map(socket).collect(),
        events: vec![
            event(0.2072, EventKind::Noticed, "feedback torque above 25 % of the limit (customary threshold)"),
            event(0.226_8, EventKind::Contact, "platform touches block"),
            event(0.227_051, EventKind::Opened, "strut 1 lower leaves its ball: 194.4 N across, hold 194.3 of 200 N"),
            event(0.227_051, EventKind::Opened, "strut 2 lower follows: its spring is gone"),
            event(0.227_2, EventKind::Trip, "drives stop: a socket has left its ball"),
            event(0.227_430, EventKind::Opened, "strut 3 lower leaves its ball"),
            event(0.227_9, EventKind::Opened, "strut 4 lower leaves its ball"),
            event(0.262, EventKind::Landed, "payload lands on the table with 4.1 J"),
        ],
        instant: Some(0.227_051),
        zoom: 0.0015,
    }
}

fn comparisons(n: usize) -> Vec<Comparison> {
    let run = |k: usize| {
        let hand = 8.0 + 290.0 * ((k * 37) % n) as f64 / n as f64;
        let (twin, reason) = match k % 5 {
            0 => (hand * 1.35 + 20.0, "weight and inertia of the platform"),
            1 => (hand * 0.72, "torque shared by all three pairs"),
            2 if hand < 80.0 => (hand + 30.0, "friction of the sockets"),
            _ => (hand * (1.0 + 0.08 * ((k % 17) as f64 / 8.0 - 1.0)), ""),
        };
        Comparison { hand, twin, reason: reason.into() }
    };
    (0..n).map(run).collect()
}

fn examples() -> Vec<(&'static str, Figure, &'static str)> {
    vec![
        ("cause-map", cause_map(&grid(41, 33)), "Every cell is one run. Below the bold line the robot stays together."),
        ("cause-map-points", cause_map(&scattered(600)), "The same from a Latin hypercube."),
        ("payload-diagram", payload_diagram(&diagram(3)), "One diagram per mass."),
        ("payload-diagram-one", payload_diagram(&diagram(1)), "A single mass."),
        (
            "fragility",
            fragility(
                "Loss of a socket over speed",
                "speed scale",
                &[curve("new sockets", 1.7, 0.14, 0.5), curve("worn by 30 %", 1.25, 0.2, 0.5)],
            ),
            "Dots: runs with Wilson intervals. Lines: fitted lognormal with 95 % band.",
        ),
        (
            "importance",
            importance("What the margin depends on", "margin", Some(0.21), &factors()),
            "Left: one factor at a time. Right: shares of the variance.",
        ),
        ("timeline", timeline(&failure(5)), "Run 4002."),
        (
            "power",
            power("What would be found", "size of the effect: RMS over noise", &powers()),
            "One curve per length of the recording.",
        ),
        (
            "hand-formula",
            hand_formula("Largest strut force: the hand formula beside the twin", "force / N", &comparisons(600)),
            "Tilting torque over pair distance.",
        ),
    ]
}

fn page() -> StudyPage {
    let number = |value: &str, label: &str, note: &str| KeyNumber {
        value: value.into(),
        label: label.into(),
        note: note.into(),
    };
    let section = |(name, figure, caption): (&str, Figure, &str)| StudySection {
        heading: name.replace('-', " "),
        text: "A paragraph of text about what follows, long enough to wrap once on the page.".into(),
        figures: vec![(figure, caption.into())],
        table: None,
    };
    let row = |cause: &str, local: &str, end: &str, detection: &str, lead, runs| FmeaRow {
        cause: cause.into(),
        local: local.into(),
        end: end.into(),
        detection: detection.into(),
        lead,
        runs,
        example: Some(4002),
    };
    StudyPage {
        title: "Bulky payloads".into(),
        subtitle: "irb360-6-1600, 1353 runs on a grid of offset and mass".into(),
        numbers: vec![
            number("31.2 %", "of the runs fail", "28.8–33.7 %, 422 of 1353"),
            number(
                "1.2·10⁻⁴",
                "probability of losing a socket at 4 kg",
                "0.8–1.7·10⁻⁴, subset simulation, 18 500 runs",
            ),
            number("12.3 ms", "median lead of the first supervision", "feedback torque"),
        ],
        answers: vec![
            (Callout::Bad, "4 kg at 90 mm falls apart within the rated 6 kg: strut 3 lower leaves its ball.".into()),
            (
                Callout::Good,
                "With strut limits in the plan it survives, at 118 instead of 142 picks per minute.".into(),
            ),
        ],
        sections: examples().into_iter().map(section).collect(),
        fmea: vec![
            row(
                "tilting torque of the payload, 4 kg at 90 mm",
                "strut 3 lower leaves its ball at 0.227 s, its pair partner at once",
                "platform tilts, payload lands at 0.41 m beside the belt with 4.1 J",
                "feedback torque above 25 % of the limit",
                Some(0.0198),
                391,
            ),
            row("worn socket, 40 %", "strut 5 upper leaves", "platform hangs on four struts", "nothing", None, 31),
        ],
        commands: vec![
            ("the study again".into(), "deltatwin study scenarios/studies/bulky.toml -o bulky".into()),
            ("one run of it, with pictures".into(), "deltatwin study bulky.toml --run 4002 --rrd r.rrd".into()),
        ],
    }
}

/// The environment variable `REPORT_EXAMPLES` names a folder to which the figures are written.
#[test]
fn examples_are_small_and_well_formed() {
    let all = examples();
    all.iter().for_each(|(_, figure, _)| well_formed(figure));
    let page = study_page(&page());
    assert!(!page.render().contains("NaN"));
    if let Some(folder) = std::env::var_os("REPORT_EXAMPLES") {
        let folder = std::path::PathBuf::from(folder);
        for (name, figure, _) in &all {
            std::fs::write(folder.join(format!("study-{name}.svg")), figure.svg()).unwrap();
        }
        page.write(folder.join("study.html")).unwrap();
    }
}

fn count(svg: &str, what: &str) -> usize {
    svg.matches(what).count()
}

#[test]
fn a_grid_has_cells_contours_and_names() {
    let svg = cause_map(&grid(41, 33)).svg().to_string();
    // One polygon per cause and outcome, not 1353 cells: the telescope never fails here.
    assert_eq!(count(&svg, "<polygon"), 5);
    for text in ["socket fails", "socket nearest", "limit", "0.25", "strong: fails"] {
        assert!(svg.contains(text), "{text}");
    }
    let points = cause_map(&scattered(600)).svg().to_string();
    assert_eq!(count(&points, "<circle"), 600);
    assert!(points.contains("ring: survives") && !points.contains("socket fails"));
    // A grid with a few runs missing is still one.
    let mut holes = grid(20, 20);
    holes.points.retain(|p| !(p.x > 100.0 && p.x < 125.0 && p.y < 1.0));
    assert!(cause_map(&holes).svg().contains("strong: fails"));
}

#[test]
fn causes_keep_their_colours_and_differ() {
    let names = |list: &[&str]| list.iter().map(|s| s.to_string()).collect::<Vec<_>>();
    let all =
        names(&["socket", "drive torque", "speed", "telescope", "workspace", "contact", "trip", "following error"]);
    let colors = cause_colors(&all);
    for (k, color) in colors.iter().enumerate() {
        assert!(!colors[..k].contains(color), "{k}");
        assert_eq!(cause_colors(&all[k..=k]), [*color]);
    }
    let own = cause_colors(&names(&["strut 1 lower", "socket", "strut 2 upper"]));
    assert!(own[1] == Color::VERMILION && own[0] != own[1] && own[2] != own[1] && own[0] != own[2]);
}

#[test]
fn a_timeline_numbers_its_events_and_shows_the_instant() {
    let svg = timeline(&failure(5)).svg().to_string();
    for text in ["ms from the failure", "platform touches block", "−0.251 ms", "+0.379 ms", "strut 5 lower", "2–7"]
    {
        assert!(svg.contains(text), "{text}");
    }
    // Names of sockets stand above their panels, where no curve is.
    let attribute = |element: &str, name: &str| -> f64 {
        let rest = element.split_once(&format!(" {name}=\"")).expect("an attribute").1;
        rest.split_once('"').and_then(|(value, _)| value.parse().ok()).expect("a number")
    };
    let names: Vec<f64> = svg.split('<').filter(|e| e.contains("strut 5 lower")).map(|e| attribute(e, "y")).collect();
    let curves =
        svg.split('<').filter_map(|e| e.strip_prefix("polyline ")?.split_once("points=\"")).flat_map(|(_, points)| {
            let end = points.find('"').expect("an end");
            points[..end]
                .split_whitespace()
                .map(|p| p.split_once(',').unwrap().1.parse().unwrap())
                .collect::<Vec<f64>>()
        });
    let nearest = curves.map(|y| (y - names[0]).abs()).fold(f64::INFINITY, f64::min);
    assert!(nearest > 8.0, "{nearest}");
    // Where nothing was recorded there is no line.
    let mut gap = Timeline { instant: None, events: vec![], ..failure(1) };
    gap.sockets[0].opened = None;
    gap.sockets[0].hold.fill(f64::NAN);
    gap.sockets[0].load.fill(50.0);
    let pieces = |content: &Timeline| count(timeline(content).svg(), "<polyline");
    let whole = pieces(&gap);
    gap.sockets[0].time.iter_mut().skip(500).for_each(|t| *t += 0.1);
    assert_eq!(pieces(&gap), whole + 1);
    assert!(timeline(&failure(12)).svg().contains("4 more sockets are not shown"));
    let mut plain = failure(2);
    (plain.instant, plain.events) = (None, vec![]);
    assert!(!timeline(&plain).svg().contains("ms from the failure"));
}

#[test]
fn marks_and_reasons_are_written() {
    let curves = [curve("", 1.7, 0.14, 0.5)];
    let svg = fragility("t", "speed", &curves).svg().to_string();
    assert!(svg.contains("1.70 (1.63–1.77)") && svg.contains("50 % at"));
    assert!(power("t", "size", &powers()).svg().contains("80 % at"));
    let svg = hand_formula("t", "force / N", &comparisons(600)).svg().to_string();
    assert!(svg.contains("weight and inertia of the platform: 120") && svg.contains("within 10 %: "));
    let half = importance("t", "margin", None, &factors()[..1]);
    assert!(half.svg().contains("0.71") && half.svg().contains("0.62"));
}

#[test]
fn degenerate_input_gives_a_figure() {
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, -1e308, 0.0, -1.0, 1e-300];
    well_formed(&cause_map(&CauseMap::default()));
    well_formed(&payload_diagram(&PayloadDiagram::default()));
    well_formed(&timeline(&Timeline::default()));
    well_formed(&fragility("t", "x", &[]));
    well_formed(&importance("t", "x", None, &[]));
    well_formed(&hand_formula("t", "x", &[]));
    for a in bad {
        for b in bad {
            let at = |x: f64, y: f64| CausePoint { x, y, margin: b, cause: 0 };
            let points = vec![at(a, b), at(b, a), at(0.0, 0.0), at(0.0, 1.0), at(1.0, 0.0), at(1.0, 1.0)];
            well_formed(&cause_map(&CauseMap { points: points.clone(), ..map(vec![]) }));
            well_formed(&cause_map(&CauseMap { points: points[2..].to_vec(), ..map(vec![]) }));
            let line = vec![(a, b), (b, a), (1.0, 1.0)];
            let panel = PayloadPanel { nominal: line.clone(), likely: line.clone(), worst: line, name: "n".into() };
            well_formed(&payload_diagram(&PayloadDiagram { panels: vec![panel; 4], ..diagram(0) }));
            let rate = Rate { x: a, share: b, low: a, high: b, of: 1 };
            let fit = vec![Banded { x: a, value: b, low: a, high: b }; 4];
            let curve = ProbabilityCurve { name: "c".into(), points: vec![rate], fit, mark: Some([a, b, a]) };
            well_formed(&power("t", "x", &[curve.clone(), ProbabilityCurve { fit: vec![], ..curve }]));
            let estimate = Some(Estimate { value: a, low: b, high: a });
            let row = Importance { swing: Some([a, b]), first: estimate, total: estimate, ..Importance::default() };
            well_formed(&importance("t", "x", Some(b), std::slice::from_ref(&row)));
            well_formed(&importance("t", "x", None, &[Importance { swing: None, ..row }]));
            let run = Comparison { hand: a, twin: b, reason: String::new() };
            well_formed(&hand_formula("t", "x", &[run]));
            let mut content = failure(1);
            (content.instant, content.zoom) = (Some(a), b);
            content.sockets[0].load[3] = a;
            content.sockets[0].opened = Some(b);
            content.events[0].time = a;
            well_formed(&timeline(&content));
        }
    }
}
