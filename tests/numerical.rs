//! Numbers at the edges of what they may be: a run has finite samples, or an error with time and cause.

use std::sync::LazyLock;
use std::time::Instant;

use crate::common::model;
use deltatwin::dynamics::Plant;
use deltatwin::machine::{Payload, Setup};
use deltatwin::model::Model;
use deltatwin::scenario::{Course, FourierMotion};
use deltatwin::twin::{Gains, Options, simulate_until_failure};
use proptest::prelude::*;

static ROBOT: LazyLock<Model> = LazyLock::new(|| model("irb360-6-1600-truth"));

/// A number of any magnitude from subnormal ones on, or one of its edges.
fn extreme(largest: f64) -> impl Strategy<Value = f64> {
    let decades = largest.log10();
    prop_oneof![
        4 => (-300.0..decades).prop_map(|e: f64| 10f64.powf(e)),
        2 => (-3.0..decades).prop_map(|e: f64| 10f64.powf(e)),
        1 => Just(0.0),
        1 => Just(5e-324),
        1 => Just(largest),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn runs_are_finite_or_end_with_time_and_cause(
        centre in prop_oneof![
            // Well inside, at the edge where arms and struts align, and beyond.
            [-0.3..0.3f64, -0.3..0.3f64, -1.2..-0.75f64],
            [-0.9..0.9f64, -0.9..0.9f64, -1.5..-0.5f64],
        ],
        amplitude in extreme(0.3),
        frequency in extreme(20.0),
        mass in extreme(100.0),
        lever in -1.0..1.0f64,
        gain in extreme(1e9),
        sample_time in (1e-5f64..0.05),
        substeps in 1usize..4,
    ) {
        let mut robot = ROBOT.clone();
        robot.sample_time = sample_time;
        let setup = Setup { payload: Payload::new(mass, [lever, 0.0, -lever], 0.0), ..Setup::default() };
        let [x, y, z] = centre;
        let motion = FourierMotion {
            frequency: frequency.max(1e-3),
            centre: [x, y, z, 0.0],
            sine: vec![[amplitude; 4]],
            cosine: vec![[0.0; 4]],
        };
        let Ok(motion) = Course::Fourier(motion).unchecked(&robot, &setup) else { return Ok(()) };
        let options = Options {
            duration: 40.0 * sample_time,
            substeps,
            gains: Some(Gains { proportional: [gain; 4], derivative: [gain / 50.0; 4], ..Gains::default() }),
            ..Options::default()
        };
        let controller = Plant::new(&robot, &setup);
        let start = Instant::now();
        let run = simulate_until_failure(&robot, &setup, &controller, &|t| motion.at(t), &options, &mut |_| true);
        prop_assert!(start.elapsed().as_secs() < 10);
        let failure = match run {
            Ok((recording, report, failure)) => {
                let s = &recording.signals;
                prop_assert!(s.series().flat_map(|(_, values)| values).chain(&s.t).all(|v| v.is_finite()));
                prop_assert!(report.max_loop_gap.is_finite() && report.kinetic_energy.is_finite());
                // Without a failure, the balance says whether the steps were short enough.
                prop_assert!(failure.is_some() || report.energy_error.is_finite());
                failure
            }
            Err(refused) => Some(refused),
        };
        if let Some(failure) = failure {
            let said = failure.to_string();
            prop_assert!(said.contains("t = ") || said.contains("inertia that no body has"), "{said}");
            prop_assert!(!said.contains("NaN") || said.contains("pose"), "{said}");
        }
    }
}
