use deltatwin::{identification::*, model::Model, recording::Recording};
use std::{path::Path, time::Instant};
fn main() {
    let model = Model::read(Path::new("models/irb360-6-1600.toml")).unwrap();
    for which in std::env::args().skip(1) {
        let t = Instant::now();
        let (m, w) = Recording::read(Path::new(&format!("{which}/measurement.csv")), None).unwrap();
        let (v, _) = Recording::read(Path::new(&format!("{which}/validation.csv")), None).unwrap();
        println!("{which} {w:?} read {:.2?}", t.elapsed());
        let t = Instant::now();
        let trace = Trace::new(&m);
        let held = Trace::new(&v);
        println!(
            "trace {:.2?} half {:?} noise {:?} diff {:?}",
            t.elapsed(),
            trace.half_width,
            trace.noise(&model),
            (0..trace.channels.len())
                .map(|c| deltatwin::evidence::noise::difference_sigma(&trace.measured[c], &trace.segments, 4))
                .collect::<Vec<_>>()
        );
        let before = fit::channel_rms(&fit::residuals(&model, &[trace.clone()]).unwrap());
        println!("before {before:.4?}");
        let t = Instant::now();
        let noise = trace.noise(&model);
        let f = fit(&model, &[trace], &[noise]).unwrap();
        println!("fit {:.2?} rms {:.4?}", t.elapsed(), f.rms);
        println!("held out {:.4?}", fit::channel_rms(&fit::residuals(&f.model, &[held]).unwrap()));
        for p in &f.parameters {
            println!("  {:45} {:10.5} ± {:.5} {}", p.name, p.value, p.std, p.unit);
        }
        for p in &f.base {
            println!("  {:10.5} ± {:.5}  {}", p.value, p.std, p.combination());
        }
    }
}
