//! Time of the inverse dynamics of all states in a file, one thread, the best of some repetitions, in seconds.
//!
//! `side_by_side MODEL STATES TORQUES REPETITIONS`: STATES holds q, q̇ and q̈ of four axes per state, TORQUES gets the
//! torques, both as float64 of this machine. `side_by_side.py` runs it beside the Python package.

use std::error::Error;
use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use deltatwin::dynamics::{Plant, steady_inverse_dynamics};
use deltatwin::kinematics::{JointState, KinematicsError};
use deltatwin::machine::{PerAxis, Setup, every_axis};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, states, torques, repetitions] = &arguments[..] else {
        return Err("expected MODEL STATES TORQUES REPETITIONS".into());
    };
    let plant = Plant::new(&deltatwin_io::model::read(&PathBuf::from(model))?, &Setup::default());
    let numbers: Vec<f64> =
        fs::read(states)?.as_chunks::<8>().0.iter().map(|bytes| f64::from_ne_bytes(*bytes)).collect();
    let states: Vec<JointState> = numbers
        .chunks_exact(3 * every_axis().len())
        .map(|row| {
            let three = |k: usize| std::array::from_fn(|axis| row[k * every_axis().len() + axis]);
            JointState { q: three(0), qd: three(1), qdd: three(2) }
        })
        .collect();
    let mut best = f64::INFINITY;
    let mut found = Vec::new();
    for _ in 0..repetitions.parse::<usize>()?.max(1) {
        let start = Instant::now();
        found = states
            .iter()
            .map(|state| Ok(steady_inverse_dynamics(&plant, 0.0, &plant.motion(state)?, false)?.tau))
            .collect::<Result<Vec<PerAxis<f64>>, KinematicsError>>()?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    let bytes: Vec<u8> = found.iter().flatten().flat_map(|x| x.to_ne_bytes()).collect();
    fs::write(torques, bytes)?;
    println!("{best}");
    Ok(())
}
