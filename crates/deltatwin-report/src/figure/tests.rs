use super::axis::Axis;
use super::curve::{MAX_PIECES, decimate};
use super::legend::colours;
use super::numbers::significant;
use super::*;

fn series(n: usize, f: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = (0..n).map(|k| k as f64 * 20.0 / n as f64).collect();
    let y = x.iter().map(|&t| f(t)).collect();
    (x, y)
}

/// Deterministic noise of unit size.
fn noise(t: f64, seed: f64) -> f64 {
    let f = |s: f64| ((t * 91.73 + s) * 43_758.545_3).sin().fract() * 999.7;
    (f(seed).fract() + f(seed + 1.3).fract() + f(seed + 2.1).fract()) / 1.2
}

pub(super) fn well_formed(figure: &Figure) {
    let svg = figure.svg();
    assert!(svg.starts_with("<svg ") && svg.trim_end().ends_with("</svg>"));
    for word in ["NaN", "inf"] {
        assert!(!svg.contains(word), "{:?}", svg.find(word).map(|k| &svg[k.saturating_sub(200)..k + 20]));
    }
    assert!(svg.len() < 200_000, "{} bytes", svg.len());
}

fn axis_panels(n: usize) -> Vec<Panel> {
    (1..=4)
        .map(|axis| {
            let a = f64::from(axis);
            let gain = if axis == 4 { 0.05 } else { 1.0 };
            let model = move |t: f64| gain * 38.0 * (1.7 * t + a).sin() * (0.6 * t).cos();
            let miss = move |t: f64| gain * 4.0 * (1.7 * t + a).cos().signum();
            let (x, measured) = series(n, |t| model(t) + miss(t) + gain * noise(t, a));
            let (_, modelled) = series(n, model);
            let residual = measured.iter().zip(&modelled).map(|(m, p)| m - p).collect();
            Panel {
                title: format!("axis {axis}"),
                y_label: "torque / Nm".into(),
                curves: vec![
                    Curve::new("measured", x.clone(), measured).color(Color::MEASURED),
                    Curve::new("model", x.clone(), modelled).color(Color::BLUE),
                    Curve::new("residual", x, residual).color(Color::VERMILION),
                ],
            }
        })
        .collect()
}

fn groups() -> Vec<ErrorGroup> {
    let rows = [("axis 1", 4.31, 0.214), ("axis 2", 4.02, 0.208), ("axis 3", 4.55, 0.231)];
    let mut all: Vec<ErrorGroup> =
        rows.iter().map(|r| ErrorGroup { name: r.0.into(), values: vec![r.1, r.2], floor: Some(0.2) }).collect();
    all.push(ErrorGroup { name: "axis 4".into(), values: vec![0.113, 0.0172], floor: Some(0.0151) });
    all
}

fn candidates() -> Vec<RankRow> {
    [
        ("Stribeck friction in the drives", 0.913, "F = 812, p < 10⁻¹²", true),
        ("Coulomb friction, asymmetric", 0.804, "F = 344, p < 10⁻¹²", false),
        ("payload mass error", 0.121, "F = 11.2, p = 0.0009", false),
        ("torque ripple, 12th harmonic", 0.004, "F = 1.1, p = 0.30", false),
        ("base tilt", -0.002, "p = 0.97", false),
    ]
    .map(|(name, share, note, highlight)| RankRow { name: name.into(), share, note: note.into(), highlight })
    .into()
}

fn spectra() -> Vec<Curve> {
    let f: Vec<f64> = (0..25_000).map(|k| f64::from(k) * 0.02).collect();
    let peak = |f: f64, at: f64, q: f64| 1.0 / (1.0 + (q * (f / at - at / f.max(1e-9))).powi(2));
    let shape = |s: f64, ripple: f64| -> Vec<f64> {
        f.iter()
            .map(|&v| {
                let level = 0.004 + 0.3 / (1.0 + v * v) * s + ripple * peak(v, 31.0, 40.0);
                level * (0.3 + noise(v, s).abs())
            })
            .collect()
    };
    vec![Curve::new("before", f.clone(), shape(1.0, 0.5)), Curve::new("after", f.clone(), shape(0.05, 0.02))]
}

fn names(n: usize) -> Vec<String> {
    (0..n).map(|k| format!("an_effect_{k}")).collect()
}

fn cells(rows: usize, columns: usize) -> Vec<Vec<Cell>> {
    let cell =
        |i: usize, k: usize| Cell { share: ((i + 2 * k) % 5) as f64 / 4.0, text: k.to_string(), color: Color::GREEN };
    (0..rows).map(|i| (0..columns).map(|k| cell(i, k)).collect()).collect()
}

fn shares() -> Vec<Rate> {
    let rate = |k: u32| {
        let x = f64::from(k) / 5.0;
        Rate { x, share: x * x, low: (x * x - 0.1).max(0.0), high: (x * x + 0.1).min(1.0), of: 10 * k as usize }
    };
    (0..=5).map(rate).collect()
}

fn examples() -> Vec<(&'static str, Figure)> {
    let stack = axis_panels(50_000);
    let one: Vec<Curve> = stack[0].curves.clone();
    let (_, speed) = series(50_000, |t| 6.0 * (1.7 * t + 1.0).cos());
    let stribeck = |v: f64| v.signum() * (2.0 + 1.8 * (-(v / 0.8).powi(2)).exp()) + 0.3 * v;
    let before: Vec<f64> = speed.iter().enumerate().map(|(k, &v)| stribeck(v) + noise(k as f64, 0.3)).collect();
    let after = (0..50_000).map(|k| noise(f64::from(k), 0.7)).collect();
    let scatter = [Curve::new("before", speed.clone(), before), Curve::new("after", speed, after)];
    let markers = [
        Marker { at: 1.7, label: "motion".into() },
        Marker { at: 31.0, label: "ripple 31 Hz".into() },
        Marker { at: 33.0, label: "hidden neighbour".into() },
    ];
    let mut gap = Curve::new("with a gap", vec![], vec![]).style(Style::Dashed);
    (gap.x, gap.y) = series(400, |t| if (8.0..10.0).contains(&t) { f64::NAN } else { 1e-5 * t.sin() });
    let (x, y) = series(400, |t| 1e-5 * (t.cos() + 0.1 * noise(t, 0.1)));
    let dots = Curve::new("dots", x, y).style(Style::Points);
    let stages = [
        (Role::Nominal, "nominal"),
        (Role::Identified, "identified"),
        (Role::Earlier, "+ payload"),
        (Role::Added, "+ delay"),
    ];
    let many: Vec<ErrorGroup> = (1..=4)
        .map(|k| ErrorGroup {
            name: format!("axis {k}"),
            values: (0..4).map(|s| 4.0 / f64::from(s * k + 1)).collect(),
            floor: Some(0.25),
        })
        .collect();
    vec![
        ("time", time_series("Torque of axis 1", "time / s", "torque / Nm", &one)),
        ("styles", time_series("Styles and tiny numbers", "time / s", "deviation / m", &[gap, dots])),
        ("panels", panels("Measured and modelled torques", "time / s", &stack)),
        (
            "error",
            falling_error(
                "RMS of the residual",
                "RMS torque / Nm",
                &[(Role::Nominal, "before"), (Role::Added, "after")],
                &groups(),
            ),
        ),
        ("stages", falling_error("RMS through four stages", "RMS torque / Nm", &stages, &many)),
        ("scatter", scatter_binned("Residual against speed", "speed / rad/s", "residual / Nm", &scatter, 40)),
        ("spectrum", spectrum("Amplitude spectrum", "frequency / Hz", "amplitude / Nm", &spectra(), &markers)),
        ("ranking", ranking("Candidates", "share of the residual explained / %", &candidates())),
        ("matrix", matrix("What was said", &names(6), &names(9), &cells(6, 9))),
        ("narrow", matrix("Short names", &names(3), &["a".into(), "b".into()], &cells(3, 2))),
        ("rates", rates("Reliability", "claimed", "share right", &shares(), true)),
        ("empty", time_series("Nothing", "time / s", "torque / Nm", &[])),
    ]
}

/// The environment variable `REPORT_EXAMPLES` names a folder to which the figures are written.
#[test]
fn examples_are_small_and_well_formed() {
    let all = examples();
    let mut page = crate::Report::new("Example report", "Every kind of figure");
    page.paragraph("A paragraph of text about what follows, long enough to wrap once on the page so that its measure can be judged.");
    page.callout(crate::Callout::Good, "The residual fell to the noise floor.");
    page.callout(crate::Callout::Warning, "Axis 4 was hardly moved.");
    page.table(&["axis", "before / Nm", "after / Nm"], &[["1", "4.31", "0.214"], ["2", "4.02", "0.208"]]);
    page.heading("Figures");
    for (name, figure) in &all {
        well_formed(figure);
        page.figure(figure, &format!("Example of {name}."));
    }
    if let Some(folder) = std::env::var_os("REPORT_EXAMPLES") {
        let folder = std::path::PathBuf::from(folder);
        for (name, figure) in &all {
            std::fs::write(folder.join(format!("{name}.svg")), figure.svg()).unwrap();
        }
        page.write(folder.join("report.html")).unwrap();
    }
}

#[test]
fn decimation_keeps_extremes_and_order() {
    let n = 50_000;
    let mut points: Vec<Option<(f64, f64)>> =
        (0..n).map(|k| Some((f64::from(k) * 800.0 / f64::from(n), 100.0))).collect();
    points[12_345] = points[12_345].map(|p| (p.0, 3.0));
    points[40_001] = points[40_001].map(|p| (p.0, 197.0));
    let pieces = decimate(&points, 0.0, 800.0, 800);
    assert_eq!(pieces.len(), 1);
    assert!(pieces[0].len() <= 1602);
    assert!(pieces[0].iter().any(|p| p.1 == 3.0) && pieces[0].iter().any(|p| p.1 == 197.0));
    assert!(pieces[0].iter().map(|p| p.0).is_sorted());
    for p in &mut points[20_000..30_000] {
        *p = None;
    }
    assert_eq!(decimate(&points, 0.0, 800.0, 800).len(), 2);
    // The number of points of an unsorted curve is bounded as well.
    let wild: Vec<_> = (0..n).map(|k| Some((f64::from(k * 7919 % 800), f64::from(k % 91)))).collect();
    assert!(decimate(&wild, 0.0, 800.0, 800).concat().len() <= 1600);
    // Missing every second sample still gives a bounded number of pieces.
    let holes: Vec<_> = (0..1500).map(|k| (k % 2 == 0).then_some((f64::from(k) / 2.0, 1.0))).collect();
    assert!(decimate(&holes, 0.0, 800.0, 800).len() <= MAX_PIECES);
}

#[test]
fn degenerate_input_gives_a_figure() {
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, -1e308];
    let inputs: Vec<(Vec<f64>, Vec<f64>)> = vec![
        (vec![], vec![]),
        (vec![0.0], vec![1.0]),
        (vec![0.0; 5], vec![0.0; 5]),
        (vec![3.0; 5], bad.to_vec()),
        (bad.to_vec(), vec![1.0; 5]),
        (vec![0.0, 1.0, 2.0], vec![7.0; 3]),
        (vec![0.0, 1.0, 2.0], vec![1e-300, 2e-300, 0.0]),
        (vec![0.0, 1.0, 2.0], vec![1e199, -1e199, 0.0]),
        (vec![1.0, 2.0], vec![1e15, 1e15 + 1.0]),
        (vec![0.0, 1.0], vec![5.0]),
        (vec![-1.0, -2.0], vec![-1.0, -3.0]),
        ((0..3000).map(f64::from).collect(), (0..3000).map(|k| if k % 2 == 0 { 1.0 } else { f64::NAN }).collect()),
    ];
    for (x, y) in &inputs {
        for style in [Style::Line, Style::Thin, Style::Dashed, Style::Points] {
            let curve = Curve::new("c", x.clone(), y.clone()).style(style);
            let curves = [curve.clone(), curve];
            well_formed(&time_series("t", "x", "y", &curves));
            well_formed(&panels("t", "x", &[Panel::default(), Panel { curves: curves.to_vec(), ..Panel::default() }]));
            well_formed(&scatter_binned("t", "x", "y", &curves, 0));
            well_formed(&scatter_binned("t", "x", "y", &curves, 10));
            well_formed(&spectrum("t", "x", "y", &curves, &[Marker { at: f64::NAN, label: "m".into() }]));
        }
        let group = ErrorGroup { name: "g".into(), values: y.clone(), floor: x.first().copied() };
        well_formed(&falling_error(
            "t",
            "y",
            &[(Role::Nominal, "a"), (Role::Identified, "b"), (Role::Added, "c")],
            std::slice::from_ref(&group),
        ));
        well_formed(&falling_error("t", "y", &[(Role::Identified, "a")], &[group]));
        let row = |&share: &f64| RankRow { name: "n".into(), share, note: "p".into(), highlight: true };
        well_formed(&ranking("t", "x", &y.iter().take(20).map(row).collect::<Vec<_>>()));
        let rate = |(&x, &share): (&f64, &f64)| Rate { x, share, low: -share, high: 2.0 * share, of: 3 };
        let points: Vec<Rate> = x.iter().zip(y).take(20).map(rate).collect();
        well_formed(&rates("t", "x", "y", &points, true));
        well_formed(&rates("t", "x", "y", &points, false));
        let cell = |&share: &f64| Cell { share, text: "1".into(), color: Color::VERMILION };
        let row: Vec<Cell> = y.iter().take(20).map(cell).collect();
        well_formed(&matrix("t", &names(2), &names(row.len()), &[row]));
    }
    well_formed(&matrix("t", &[], &[], &[]));
    assert!(rates("t", "x", "y", &[], true).svg().contains("no data"));
    well_formed(&falling_error("t", "y", &[], &[]));
    well_formed(&panels("t", "x", &[]));
    assert!(time_series("t", "x", "y", &[]).svg().contains("no data"));
    assert!(ranking("t", "x", &[]).svg().contains("no data"));
}

#[test]
fn many_long_curves_stay_small() {
    let curves: Vec<Curve> = (0..12)
        .map(|k| {
            let (x, y) = series(50_000, |t| noise(t, f64::from(k)) + f64::from(k));
            let style = if k % 3 == 0 { Style::Dashed } else { Style::Line };
            Curve::new(format!("a curve with quite a long name {k}"), x, y).style(style)
        })
        .collect();
    well_formed(&time_series("t", "x", "y", &curves));
    well_formed(&scatter_binned("t", "x", "y", &curves, 100));
}

#[test]
fn numbers_are_written_plainly() {
    assert_eq!(significant(4.312), "4.31");
    assert_eq!(significant(0.99961), "1.00");
    assert_eq!(significant(-0.0172), "−0.0172");
    assert_eq!(significant(1234.5), "1234");
    assert_eq!(significant(2.5e-7), "2.50·10⁻⁷");
    assert_eq!(significant(f64::NAN), "–");
    let labels = |a: Axis| a.ticks.into_iter().map(|t| t.1).collect::<Vec<_>>();
    assert_eq!(labels(Axis::linear((-1.0, 1.0), 0.0, 4)), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
    assert_eq!(labels(Axis::log((0.01, 100.0), 8)), ["0.01", "0.1", "1", "10", "100"]);
}

#[test]
fn colours_are_distinct_and_follow_the_label() {
    let c = |label: &str| Curve::new(label, vec![], vec![]);
    let curves = [c("a").color(Color::CYCLE[0]), c("b"), c("c"), c("b")];
    let (all, entries) = colours(curves.iter());
    assert_eq!(all[1], all[3]);
    assert!(all[0] != all[1] && all[1] != all[2] && all[0] != all[2]);
    assert_eq!(entries.len(), 3);
}

#[test]
fn rounding_errors_do_not_fill_a_panel() {
    let panel = |size: f64| {
        let values = vec![-size, 0.5 * size, size];
        Panel { y_label: "N·m".into(), curves: vec![Curve::new("c", vec![0.0, 1.0, 2.0], values)], ..Panel::default() }
    };
    let svg = |sizes: &[f64]| panels("t", "x", &sizes.iter().map(|s| panel(*s)).collect::<Vec<_>>()).svg().to_string();
    assert!(!svg(&[100.0, 5e-9]).contains("10⁻⁹"));
    assert!(svg(&[5e-9]).contains("10⁻⁹"), "alone it is what is shown");
    assert!(svg(&[100.0, 0.01]).contains("0.01"));
}
