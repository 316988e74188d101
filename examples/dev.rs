#![allow(warnings)]
pub use deltatwin::{constraint_forces, dynamics, effects, kinematics, model, recording, scenario, twin, terminal, report};
#[path = "../src/planner/mod.rs"]
mod planner;
use planner::*;
use planner::rows::*;
use std::time::Instant;
fn main() {
    let name = std::env::args().nth(1).unwrap_or("irb360-6-1600".into());
    let n: usize = std::env::args().nth(2).map_or(1000, |a| a.parse().unwrap());
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
    limits.detail = match std::env::args().nth(3).as_deref() { Some("r") => constraint_forces::Detail::Reduced, _ => constraint_forces::Detail::Complete };
    if std::env::args().nth(4).as_deref() == Some("noe") { limits.bearing_force = f64::INFINITY; limits.bearing_moment = f64::INFINITY; }
    let curve = Shape::arch([0.0, -0.4, -1.05, 0.0], [0.0, 0.4, -1.05, 0.0], 0.18, 0.12, 0.1).curve();
    let machine = Machine::new(&plant, limits.detail);
    let grid: Vec<f64> = (0..=n).map(|i| i as f64 / n as f64).collect();
    let t = Instant::now();
    let mut stations = Stations::new(&machine, &curve, &limits, &grid).unwrap();
    println!("stations {:?}", t.elapsed());
    let room = Room::full(n + 1);
    let t = Instant::now();
    let (found, its) = without_jerk(&machine, &limits, &mut stations, &room).unwrap();
    println!("solve {:?} in {its}", t.elapsed());
    let t = Instant::now();
    let again = pass::solve(&stations, &room).unwrap();
    println!("passes {:?}", t.elapsed());
    let refs: Vec<Reference> = found.z.iter().map(|z| Reference { speed: z.sqrt().max(1e-3), acceleration: 0.0 }).collect();
    let t = Instant::now();
    for (st, r) in stations.list.iter().zip(&refs) { std::hint::black_box(machine.coefficients(&st.point, *r).unwrap()); }
    println!("coefficients single core {:?}", t.elapsed());
    let profile = Profile::linear(&grid, &found.z);
    println!("T = {}", profile.time());
    let t = Instant::now();
    let uses = verify::uses(&machine, &curve, &limits, &profile, 10).unwrap();
    println!("verify {:?}", t.elapsed());
    let mut worst = vec![(0.0f64, 0.0); verify::CHECKED];
    for u in &uses { for k in 0..verify::CHECKED { if u.ratio[k] > worst[k].0 { worst[k] = (u.ratio[k], u.s); } } }
    for k in 0..verify::CHECKED { if worst[k].0 > 0.5 && !matches!(verify::checked(k), Limit::Jerk(_)) { println!("{} {:.5} at {:.4}", verify::checked(k), worst[k].0, worst[k].1); } }
    for i in (0..=20).map(|j| j * n / 20) { println!("{:.3} z {:.3} mvc {:.3}", grid[i], found.z[i], found.mvc[i]); }
    let _ = again;
}
