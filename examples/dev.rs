#![allow(warnings)]
pub use deltatwin::{constraint_forces, dynamics, effects, kinematics, model, recording, scenario, twin, terminal, report};
#[path = "../src/planner/mod.rs"]
mod planner;
use planner::*;
use planner::rows::*;
use std::time::Instant;
fn main() {
    let arg = |k: usize, d: f64| std::env::args().nth(k).map_or(d, |a| a.parse().unwrap());
    let name = std::env::args().nth(1).unwrap_or("irb360-6-1600".into());
    let n = arg(2, 200.0) as usize;
    let model = model::Model::read(std::path::Path::new(&format!("models/{name}.toml"))).unwrap();
    let mut setup = recording::Setup::default();
    setup.payload.mass = 2.5;
    setup.payload.com.z = -0.03;
    setup.payload.inertia_zz = 0.01;
    let plant = dynamics::Plant::new(&model, &setup);
    let mut limits = Limits::of(&model);
    limits.strut_upper = 120.0;
    limits.bearing_force = 140.0;
    limits.bearing_moment = 10.0;
    limits.detail = if arg(3, 0.0) > 0.5 { constraint_forces::Detail::Reduced } else { constraint_forces::Detail::Complete };
    if arg(4, 1.0) < 0.5 { limits.jerk = [f64::INFINITY; 4]; }
    let z = arg(5, -1.05);
    let blend = arg(6, 0.12);
    let curve = if blend > 0.0 { Shape::arch([0.0, -0.4, z, 0.0], [0.0, 0.4, z, 0.0], 0.18, blend, 0.1).curve() } else {
        let h = arg(7, 0.18);
        let w = arg(8, 0.4);
        let p = |y: f64, dz: f64| [0.0, y, z + dz, 0.0];
        let pts = match (-blend) as i32 { 
            1 => vec![p(-0.4, 0.0), p(-0.4, 0.06), p(-w, h), p(-0.2, h), p(0.0, h), p(0.2, h), p(w, h), p(0.4, 0.06), p(0.4, 0.0)],
            2 => vec![p(-0.4, 0.0), p(-0.4, 0.08), p(-0.4, h), p(-0.1, h), p(0.1, h), p(0.4, h), p(0.4, 0.08), p(0.4, 0.0)],
            _ => vec![p(-0.4, 0.0), p(-0.4, h), p(-w, h), p(w, h), p(0.4, h), p(0.4, 0.0)] };
        Shape::BSpline { points: pts, degree: 5 }.curve() };
    let top = (0..1000).map(|k| curve.at(k as f64 / 1e3)[0].z).fold(-9.0, f64::max);
    println!("height {:.4}", top - z);
    let machine = Machine::new(&plant, limits.detail);
    let t = Instant::now();
    let found = plan(&machine, &curve, &limits, &Options { intervals: n, ..Options::default() });
    println!("{:?}", t.elapsed());
    match found { Err(e) => println!("{e}"), Ok(p) => {
        println!("T {:.5} bound {:.5} gap {:.2e}  no jerk {:.5} bound {:.5} ({:.3} %), solve {:.4} verify {:.4} its {}", p.time, p.bound, p.optimality_gap(), p.time_without_jerk, p.bound_without_jerk, 100.0 * (1.0 - p.bound_without_jerk / p.time_without_jerk), p.solve_s, p.verify_s, p.iterations);
        println!("{:?}", p.worst().iter().filter(|(_, r)| **r > 0.9).map(|(l, r)| format!("{l} {r:.5}")).collect::<Vec<_>>());
        for (l, s) in p.active() { print!("{l} {:.3}..{:.3}, ", s[0], s[1]); }
        println!();
    } }
}
