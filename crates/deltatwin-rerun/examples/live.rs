//! What streaming a run costs, and how late a viewer has what was simulated.
//!
//! ```sh
//! cargo run --release -p deltatwin-rerun --example live -- SCENARIO
//! ```
//!
//! The receiver is the server of the `rerun` in the path (`rerun --serve-web`), read as a viewer reads it. Cost: wall and
//! processor time of the run with the stream over those without, as fast as it goes, in turns. Latency: from the instant
//! at which the twin has made a frame to that at which the reader has the poses of this frame, in real time.

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use deltatwin::dynamics::Plant;
use deltatwin::scenario::Scenario;
use deltatwin::twin::{NewContacts, Options, Watcher, simulate};
use deltatwin_io::outside::Access;
use deltatwin_io::{model, scenario};
use deltatwin_rerun::scene::{Assets, Viewer};
use deltatwin_rerun::show::Stage;
use deltatwin_rerun::stream::{Pace, Stream};
use deltatwin_rerun::web::WebViewer;
use miette::{IntoDiagnostic, miette};
use rerun::external::{re_grpc_client, re_log_types};
use rerun::log::Chunk;

/// Turns with and without the stream.
const TURNS: usize = 5;

fn main() -> miette::Result<()> {
    let file = std::env::args().nth(1).unwrap_or_else(|| "scenarios/excitation.toml".into());
    let scenario = scenario::read_with(Path::new(&file), Access::with(deltatwin_cell::mesh::read))?;
    let server = || WebViewer::start().map_err(|e| miette!("{e}"));
    cost(&scenario, &server()?)?;
    latency(&scenario, &server()?)
}

/// Simulates with a stream to `server`, if there is one, and calls `made` with the time of every frame; returns wall and
/// processor time of the run, s.
fn run(
    scenario: &Scenario,
    server: Option<&WebViewer>,
    pace: bool,
    made: impl Fn(f64) + Send + Sync + 'static,
) -> miette::Result<[f64; 2]> {
    let machine = scenario.machine(&model::read(&scenario.model)?);
    let motion = scenario.motion(&machine).into_diagnostic()?;
    let plant = Plant::new(&machine, &scenario.setup);
    let contacts = Some(deltatwin_cell::contacts as NewContacts);
    let mut options = Options { contacts, ..Options::of(scenario, &machine) };
    let stream = match server {
        Some(server) => {
            let stage = Stage {
                plant: plant.clone(),
                options: options.clone(),
                desired: Some(motion.clone()),
                assets: Assets::default(),
            };
            let viewer = Viewer::Connect(server.stream());
            let (stream, watcher) = Stream::open(&viewer, "live", stage, if pace { Pace::Live } else { Pace::Fast })
                .map_err(|e| miette!("{e}"))?;
            let see = move |frame: Option<&_>, events: &[_]| {
                if let Some(deltatwin::twin::Frame { t, .. }) = frame {
                    made(*t);
                }
                watcher.see(frame, events);
            };
            options.watcher = Some(Watcher::new(deltatwin_rerun::stream::SPACING, see));
            Some(stream)
        }
        None => None,
    };
    let (begun, used) = (Instant::now(), processor());
    let mut progress = |t: f64| {
        if pace {
            std::thread::sleep(Duration::from_secs_f64(t).saturating_sub(begun.elapsed()));
        }
        true
    };
    simulate(&machine, &scenario.setup, &plant, &|t| motion.at(t), &options, &mut progress).into_diagnostic()?;
    let wall = begun.elapsed().as_secs_f64();
    if let Some(problem) = stream.and_then(Stream::finish) {
        println!("  {problem}");
    }
    Ok([wall, processor() - used])
}

/// Processor time of this process, s.
fn processor() -> f64 {
    let used = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    used.tv_sec as f64 + 1e-9 * used.tv_nsec as f64
}

fn cost(scenario: &Scenario, server: &WebViewer) -> miette::Result<()> {
    let mut all = [[Vec::new(), Vec::new()], [Vec::new(), Vec::new()]];
    for _ in 0..TURNS {
        for (with, times) in all.iter_mut().enumerate() {
            let used = run(scenario, (with == 1).then_some(server), false, |_| {})?;
            times.iter_mut().zip(used).for_each(|(times, used)| times.push(used));
        }
    }
    for (what, k) in [("wall time of the run", 0), ("processor time of the program", 1)] {
        let [without, with] = [0, 1].map(|with| quantile(&mut all[with][k], 0.5));
        println!("{what}: {without:.3} s without, {with:.3} s with the stream: {:+.0} %", 1e2 * (with / without - 1.0));
    }
    Ok(())
}

fn latency(scenario: &Scenario, server: &WebViewer) -> miette::Result<()> {
    let [wall, alone] = run(scenario, None, true, |_| {})?;
    let [_, used] = run(scenario, Some(server), true, |_| {})?;
    println!("in real time: {:.1} % of a core without, {:.1} % with the stream", 1e2 * alone / wall, 1e2 * used / wall);

    let made: Arc<Mutex<Vec<(f64, Instant)>>> = Arc::default();
    let seen: Arc<Mutex<Vec<(f64, Instant)>>> = Arc::default();
    let server = &WebViewer::start().map_err(|e| miette!("{e}"))?;
    let (reading, uri) = (seen.clone(), server.stream());
    std::thread::spawn(move || read(&uri, &reading));
    std::thread::sleep(Duration::from_secs(2));
    let note = made.clone();
    run(scenario, Some(server), true, move |t| {
        if let Ok(mut made) = note.lock() {
            made.push((t, Instant::now()));
        }
    })?;
    std::thread::sleep(Duration::from_secs(1));
    let (made, seen) = (made.lock().map_err(|_| miette!("failed"))?, seen.lock().map_err(|_| miette!("failed"))?);
    let after = |(t, when): &(f64, Instant)| {
        let arrived = seen.iter().find(|(seen, _)| seen >= t).map(|(_, arrived)| *arrived);
        arrived.map(|arrived| arrived.saturating_duration_since(*when).as_secs_f64())
    };
    let mut late: Vec<f64> = made.iter().filter_map(after).collect();
    println!(
        "in real time: {:.0} % of a core, {} of {} frames have arrived",
        1e2 * used / wall,
        late.len(),
        made.len()
    );
    let [half, most, all] = [0.5, 0.95, 1.0].map(|share| 1e3 * quantile(&mut late, share));
    println!("latency: median {half:.0} ms, 95 % {most:.0} ms, largest {all:.0} ms");
    Ok(())
}

/// Notes when poses arrive, with the largest time in each piece.
fn read(uri: &str, seen: &Mutex<Vec<(f64, Instant)>>) {
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    let handle = re_async::AsyncRuntimeHandle::new_native(runtime.handle().clone());
    let uri = uri.parse().expect("the address of a server");
    let receiver = re_grpc_client::stream(&handle, uri);
    while let Ok(message) = receiver.recv() {
        let arrived = Instant::now();
        let Some(re_log_channel::DataSourceMessage::LogMsg(re_log_types::LogMsg::ArrowMsg(_, arrow))) =
            message.into_data()
        else {
            continue;
        };
        let Ok(chunk) = Chunk::from_arrow_msg(&arrow) else { continue };
        if *chunk.entity_path() != "world/poses".into() {
            continue;
        }
        for column in chunk.timelines().values() {
            let time = 1e-9 * column.time_range().max().as_i64() as f64;
            if let Ok(mut seen) = seen.lock() {
                seen.push((time, arrived));
            }
        }
    }
}

/// The value below which the given share of `values` is.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(((values.len().max(1) - 1) as f64 * share).round() as usize).copied().unwrap_or(f64::NAN)
}
