//! Work and precision of the twin's integrator: error against time per simulated second, over the step.
//!
//! One 10 s closed-loop motion, feed-forward plus PD held over each step; the error is taken against the same loop with
//! 16 steps per hold. Only the step calls are timed. Prints a table and draws `docs/work-precision.svg`.
//!
//! cargo bench -p deltatwin-benches --bench work_precision

use std::time::Instant;

use deltatwin::dynamics::{Plant, inverse_dynamics};
use deltatwin::kinematics::JointState;
use deltatwin::machine::Setup;
use deltatwin::scenario::{FourierMotion, MotionLimits};
use deltatwin::twin::constraints::rows;
use deltatwin::twin::{Torque, Twin};
use deltatwin_benches::common;
use plotters::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const DURATION: f64 = 10.0;

/// What a run left at the end of each hold.
struct Run {
    forces: Vec<[f64; 6]>,
    angles: Vec<[f64; 4]>,
    gap: f64,
    seconds: f64,
}

fn run(plant: &Plant, motion: &FourierMotion, hold: f64, substeps: usize) -> Run {
    let joints = |t: f64| plant.geometry.inverse_motion(&motion.at(t)).expect("a reachable motion");
    let own: Vec<Vec<f64>> = plant.effects.iter().map(|a| a.initial_state()).collect();
    let own: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
    let mut twin = Twin::new(plant.clone(), &plant.motion(&joints(0.0)).expect("reachable")).expect("regular");
    let mut out = Run { forces: Vec::new(), angles: Vec::new(), gap: 0.0, seconds: 0.0 };
    for k in 0..(DURATION / hold).round() as usize {
        let t = k as f64 * hold;
        let JointState { q, qd, .. } = joints(t);
        let ahead = plant.motion(&joints(t + 0.5 * hold)).expect("reachable");
        let feed = inverse_dynamics(plant, t, &ahead, &own, false).expect("regular").tau;
        let now = twin.motion();
        let torque = Torque::constant(std::array::from_fn(|i| {
            let (p, d) = if i < 3 { (2000.0, 40.0) } else { (20.0, 0.3) };
            feed[i] + p * (q[i] - now.q[i]) + d * (qd[i] - now.qd[i])
        }));
        let start = Instant::now();
        for _ in 0..substeps {
            twin.step(hold / substeps as f64, &torque).expect("regular");
        }
        out.seconds += start.elapsed().as_secs_f64();
        let end = twin.evaluate(&torque).expect("regular");
        out.forces.push(std::array::from_fn(|s| end.reactions.lower[s]));
        out.angles.push(end.motion.q);
        out.gap = rows(&plant.geometry, &end.motion).iter().fold(out.gap, |g, r| g.max(r.0.abs()));
    }
    out
}

fn rms<const N: usize>(a: &[[f64; N]], b: &[[f64; N]]) -> f64 {
    let sum: f64 = a.iter().flatten().zip(b.iter().flatten()).map(|(x, y)| (x - y).powi(2)).sum();
    (sum / (a.len() * N) as f64).sqrt()
}

/// Other codes on the same robot and task: step, CPU seconds per simulated second, RMS strut-force error in N.
const PEERS: [(&str, f64, f64); 7] = [
    ("MuJoCo implicit 1 ms", 0.020, 0.083),
    ("MuJoCo RK4 4 ms", 0.019, 0.029),
    ("Pinocchio RK4 4 ms", 0.027, 2.8e-3),
    ("Exudyn 4 ms", 0.062, 5.6e-3),
    ("Exudyn 1 ms", 0.194, 4e-4),
    ("Drake SAP 1 ms", 0.24, 0.084),
    ("Rapier joints 1 ms", 0.14, 0.079),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rigid = common::nominal_plant();
    let truth = Plant::new(&common::model("irb360-6-1600-truth"), &Setup::default());
    let limits = MotionLimits::of(&common::model("irb360-6-1600"), 0.8);
    let motion = FourierMotion::random(&truth, &limits, 0.1, 10, &mut ChaCha8Rng::seed_from_u64(1));
    let mut curves = Vec::new();
    for (name, plant, steps) in [
        ("no friction (RK4)", &rigid, [8e-3, 4e-3, 2e-3, 1e-3, 5e-4]),
        ("all friction (ROS34PW2)", &truth, [1.6e-3, 8e-4, 4e-4, 2e-4, 1e-4]),
    ] {
        println!("{name}\n  step ms   CPU s per s   strut force RMS N   angle RMS rad   loop gap m");
        let mut curve = Vec::new();
        for h in steps {
            let exact = run(plant, &motion, h, 16);
            // The fastest of three runs: everything slower is somebody else's work.
            let runs: Vec<Run> = (0..3).map(|_| run(plant, &motion, h, 1)).collect();
            let seconds = runs.iter().map(|r| r.seconds).fold(f64::MAX, f64::min) / DURATION;
            let force = rms(&runs[0].forces, &exact.forces);
            let angle = rms(&runs[0].angles, &exact.angles);
            println!("  {:7.2} {seconds:13.5} {force:19.2e} {angle:15.2e} {:12.1e}", h * 1e3, runs[0].gap);
            curve.push((seconds, force, h));
        }
        curves.push((name, curve));
    }
    draw(&curves)?;
    println!("drawn in docs/work-precision.svg");
    Ok(())
}

type Curve = Vec<(f64, f64, f64)>;

fn draw(curves: &[(&str, Curve)]) -> Result<(), Box<dyn std::error::Error>> {
    let file = common::shipped("docs/work-precision.svg");
    let root = SVGBackend::new(&file, (900, 560)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(16)
        .caption("Strut-force error against time, one core", ("sans-serif", 20))
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d((5e-4..1.0f64).log_scale(), (1e-12..1.0f64).log_scale())?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc("CPU seconds per simulated second (step calls)")
        .y_desc("RMS strut-force error, N")
        .x_label_formatter(&|x| format!("{x}"))
        .y_label_formatter(&|y| format!("{y:.0e}"))
        .label_style(("sans-serif", 14))
        .draw()?;
    for ((name, curve), colour) in curves.iter().zip([RGBColor(0, 90, 181), RGBColor(200, 70, 20)]) {
        let points = || curve.iter().map(|&(x, y, _)| (x, y));
        chart
            .draw_series(LineSeries::new(points(), colour.stroke_width(2)))?
            .label(format!("deltatwin, {name}"))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        chart.draw_series(points().map(|p| Circle::new(p, 4, colour.filled())))?;
        let text = ("sans-serif", 13).into_font().color(&colour);
        chart.draw_series(curve.iter().map(|&(x, y, h)| {
            EmptyElement::at((x, y)) + Text::new(format!("{} ms", h * 1e3), (8, -6), text.clone())
        }))?;
    }
    let grey = RGBColor(90, 90, 90);
    let text = ("sans-serif", 13).into_font().color(&grey);
    chart.draw_series(PEERS.iter().enumerate().map(|(i, &(name, x, y))| {
        // Neighbouring labels would cover each other.
        let shift = if i == 5 {
            -16
        } else if i == 6 {
            6
        } else {
            -6
        };
        EmptyElement::at((x, y))
            + Cross::new((0, 0), 5, grey.stroke_width(2))
            + Text::new(name, (9, shift), text.clone())
    }))?;
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .label_font(("sans-serif", 14))
        .draw()?;
    root.present()?;
    Ok(())
}
