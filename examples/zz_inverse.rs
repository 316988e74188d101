//! x
use deltatwin::dynamics::{Plant, steady_inverse_dynamics};
use deltatwin::kinematics::JointState;
fn main() {
    let model = deltatwin_io::model::read(std::path::Path::new("models/irb360-6-1600.toml")).unwrap();
    let plant = Plant::new(&model, &Default::default());
    let states: Vec<JointState> = (0..50_000).map(|k| { let x = (k as f64 * 0.37).sin(); JointState { q: [0.3 + 0.3 * x, 0.3 - 0.2 * x, 0.4, x], qd: [x, 2.0, -x, 1.0], qdd: [10.0 * x, 5.0, 3.0, x] } }).collect();
    for _ in 0..7 {
        let begun = std::time::Instant::now();
        let all: Vec<[f64; 4]> = states.iter().map(|s| { let m = plant.motion(s).unwrap(); steady_inverse_dynamics(&plant, 0.0, &m, false).unwrap().tau }).collect();
        println!("{:.2} ms {}", begun.elapsed().as_secs_f64() * 1e3, all[7][0]);
    }
}
