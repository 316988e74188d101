use deltatwin::{dynamics::*, identification::*, model::Model, recording::Recording};
use std::{path::Path, time::Instant};
fn main() {
    let model = Model::read(Path::new("models/irb360-6-1600.toml")).unwrap();
    let (m, _) = Recording::read(Path::new("../shared/recordings/nothing_missing/measurement.csv"), None).unwrap();
    let trace = Trace::new(&m);
    let plant = Plant::new(&model, &trace.setup);
    for _ in 0..2 {
        let t = Instant::now();
        let motions: Vec<_> = trace.joints.iter().map(|j| plant.motion(j).unwrap()).collect();
        println!("motions {:.2?}", t.elapsed());
        let t = Instant::now();
        for m in &motions {
            std::hint::black_box(ChannelMap::new(&plant.geometry, m, true, &trace.channels).unwrap());
        }
        println!("maps {:.2?}", t.elapsed());
        let t = Instant::now();
        let p = predict(&plant, &trace).unwrap();
        println!("predict {:.2?} {}", t.elapsed(), p.len());
        let t = Instant::now();
        let c = columns(&plant, &trace, None).unwrap();
        println!("columns {:.2?} {}", t.elapsed(), c.len());
        let n = 27;
        let t = Instant::now();
        let mut info = nalgebra::DMatrix::<f64>::zeros(n, n);
        for b in 0..50 {
            for ch in 0..5 {
                let block = nalgebra::DMatrix::from_fn(990, n, |i, j| c[j][ch][b * 990 + i]);
                info += block.tr_mul(&block);
            }
        }
        println!("gram {:.2?}", t.elapsed());
    }
}
