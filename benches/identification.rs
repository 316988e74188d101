//! What an identification costs: 20 s at 2.5 kHz, four torques.

#![allow(missing_docs)] // the macros below write public functions

use criterion::{Criterion, criterion_group, criterion_main};
use deltatwin::dynamics::Plant;
use deltatwin::identification::estimator::{Estimator, PRIOR_INFORMATION};
use deltatwin::identification::normal_equations::{NormalEquations, UNIT_WEIGHTS};
use deltatwin::identification::{Dataset, KeptColumns, fit, predict};
use deltatwin::machine::Setup;
use deltatwin::scenario::{FourierMotion, MotionLimits};
use deltatwin_benches::common;
use nalgebra::DVector;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

const SIGMA: [f64; 4] = [0.4, 0.4, 0.4, 0.05];
const DT: f64 = 4e-4;

fn dataset(samples: usize) -> Dataset {
    let model = common::model("irb360-6-1600");
    let mut robot = model.clone();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    deltatwin_validation::exam::perturb(&mut robot, &mut rng);
    let setup = Setup::default();
    let plant = Plant::new(&model, &setup);
    let motion = FourierMotion::random(&plant, &MotionLimits::of(&model, 0.45), 0.1, 10, &mut rng);
    let joints = (0..samples).map(|k| plant.geometry.inverse_motion(&motion.at(k as f64 * DT)).expect("reachable"));
    let t = (0..samples).map(|k| k as f64 * DT).collect();
    let mut dataset = Dataset { half_width: [10; 4], ..common::planned(setup, t, joints.collect(), DT) };
    dataset.set_measured(predict(&Plant::new(&robot, &setup), &dataset).expect("reachable"));
    for (series, sigma) in dataset.measured.iter_mut().zip(SIGMA) {
        series.iter_mut().for_each(|x| *x += sigma * rng.sample::<f64, _>(StandardNormal));
    }
    dataset
}

fn identification(c: &mut Criterion) {
    let model = common::model("irb360-6-1600");
    let (dataset, noise) = ([dataset(50_000)], [SIGMA.to_vec()]);
    let parameters = Plant::new(&model, &Setup::default()).parameters().len();
    let free: Vec<usize> = (0..parameters).collect();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let mut group = c.benchmark_group("identification of 50 000 samples");
    group.sample_size(10);
    let base = |kept: &[KeptColumns]| {
        let normal = NormalEquations::new(&model, kept, &noise, &free, UNIT_WEIGHTS).expect("a regular motion");
        let size = DVector::from_element(parameters, 1.0);
        let estimator = Estimator::new(&normal, &size, &size.map(|_| PRIOR_INFORMATION)).expect("finite");
        estimator.step(&normal, &DVector::zeros(parameters), &[])
    };
    group.bench_function("regressor and base parameters, one core", |b| {
        b.iter(|| one.install(|| base(&KeptColumns::of(&dataset))))
    });
    let kept = KeptColumns::of(&dataset);
    group.bench_function("the same with columns of an earlier model, one core", |b| {
        b.iter(|| one.install(|| base(&kept)));
    });
    group.bench_function("consistent parameters with standard errors, one core", |b| {
        b.iter(|| one.install(|| fit(&model, &dataset, &noise).expect("a fit")))
    });
    group.bench_function("consistent parameters with standard errors, all cores", |b| {
        b.iter(|| fit(&model, &dataset, &noise).expect("a fit"))
    });
    group.finish();
}

criterion_group!(benches, identification);
criterion_main!(benches);
