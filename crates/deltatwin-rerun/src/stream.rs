//! Streaming of a run to a viewer while it is simulated.
//!
//! Frames pass through a queue of bounded length to a separate thread, which sends all waiting frames as one piece, at most
//! as often as a display shows them. With a slow viewer frames are dropped, and the rest is dropped if the viewer
//! disconnects; the run is not affected.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use crate::scene::{Live, Problem, Scene, Viewer, drives};
use crate::show::Stage;
use deltatwin::recording::Signals;
use deltatwin::twin::{Event, Frame, Watcher};

/// Capacity of the queue, frames.
const QUEUE: usize = 1000;
/// Time between frames of a stream, s: motion is smooth, at half the cost of every picture of a display.
pub const SPACING: f64 = 1.0 / 30.0;
/// How often a stream sends what has come: a piece costs nearly the same for one frame as for ten.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// For a run in real time: poses every 33 ms, curves every 100 ms.
    Live,
    /// Ten times per second, for a run that goes as fast as it can.
    Fast,
}

impl Pace {
    /// Shortest time between two pieces: what it adds to the latency of poses.
    fn piece(self) -> Duration {
        Duration::from_millis(match self {
            Self::Live => 33,
            Self::Fast => 100,
        })
    }

    /// Whether piece `k` has curves.
    fn has_curves(self, k: usize) -> bool {
        self == Self::Fast || k.is_multiple_of(3)
    }
}

/// Interval at which the thread checks for the end of the run, s.
const PAUSE: Duration = Duration::from_millis(50);
/// Time limit for the viewer at the end of a run, s: longer than that of [`Live::finish`].
const PATIENCE: Duration = Duration::from_secs(8);

/// A frame, and the events since the previous one.
type Update = (Option<Frame>, Vec<Event>);

/// A stream of one run to a viewer.
pub struct Stream {
    done: Receiver<Result<(), String>>,
    over: Arc<AtomicBool>,
    lost: Arc<AtomicUsize>,
}

impl Stream {
    /// Opens a stream called `name` to `viewer` at `pace`; also returns the watcher of the run.
    ///
    /// # Errors
    /// If no viewer answers or none can be started, or the URL is not valid.
    pub fn open(viewer: &Viewer, name: &str, stage: Stage, pace: Pace) -> Result<(Self, Watcher), String> {
        let live = Live::open(viewer, name, &piece(&stage, &[], Some(&[]))).map_err(|e| e.to_string())?;
        let (queue, waiting) = sync_channel::<Update>(QUEUE);
        let (answer, done) = sync_channel(1);
        let over = Arc::new(AtomicBool::new(false));
        let ended = over.clone();
        let shown = Shown { live, stage, pace, curves: Vec::new(), pieces: 0 };
        let work = move || shown.forward(&waiting, &ended, &answer);
        std::thread::Builder::new().name("viewer".into()).spawn(work).map_err(|e| e.to_string())?;
        let lost = Arc::new(AtomicUsize::new(0));
        Ok((Self { done, over, lost: lost.clone() }, watcher(queue, lost)))
    }

    /// Waits until the viewer has received the rest of a completed run; returns a warning if frames were lost.
    pub fn finish(self) -> Option<String> {
        self.over.store(true, Ordering::Relaxed);
        let answer = self.done.recv_timeout(PATIENCE);
        let lost = self.lost.load(Ordering::Relaxed);
        match answer {
            Ok(Ok(())) if lost == 0 => None,
            Ok(Ok(())) => Some(format!("the viewer was too slow for {lost} frames")),
            Ok(Err(problem)) => Some(format!("the viewer has not got everything: {problem}")),
            Err(_) => Some("the viewer does not answer and has not got everything".into()),
        }
    }
}

/// What the thread works with.
struct Shown {
    live: Live,
    stage: Stage,
    pace: Pace,
    /// Frames whose curves are still to be sent.
    curves: Vec<Frame>,
    /// Number of pieces so far.
    pieces: usize,
}

impl Shown {
    /// Sends updates until the run is over, then reports whether the viewer has received everything.
    fn forward(mut self, waiting: &Receiver<Update>, over: &AtomicBool, answer: &SyncSender<Result<(), String>>) {
        let mut sent = Ok(());
        let mut due = Instant::now();
        loop {
            match waiting.recv_timeout(PAUSE) {
                Ok(first) => {
                    // The first frame waits for the others of its piece.
                    std::thread::sleep(due.saturating_duration_since(Instant::now()));
                    due = Instant::now() + self.pace.piece();
                    let updates: Vec<Update> = std::iter::once(first).chain(waiting.try_iter()).collect();
                    if sent.is_ok() {
                        let curves = self.pace.has_curves(self.pieces);
                        sent = self.send(&updates, curves);
                    }
                }
                Err(RecvTimeoutError::Timeout) if !over.load(Ordering::Relaxed) => {}
                Err(_) => break,
            }
        }
        let rest = sent.and_then(|()| self.send(&[], true));
        let ended = rest.and_then(|()| self.live.finish()).map_err(|e| e.to_string());
        // Dropping the stream may block on a viewer that does not answer; the result has already been reported.
        answer.send(ended).ok();
    }

    fn send(&mut self, updates: &[Update], curves: bool) -> Result<(), Problem> {
        self.pieces += 1;
        self.curves.extend(updates.iter().filter_map(|(frame, _)| frame.clone()));
        self.live.send(&piece(&self.stage, updates, curves.then_some(self.curves.as_slice())))?;
        if curves {
            self.curves.clear();
        }
        Ok(())
    }
}

fn watcher(queue: SyncSender<Update>, lost: Arc<AtomicUsize>) -> Watcher {
    Watcher::new(SPACING, move |frame: Option<&Frame>, events: &[Event]| {
        if queue.try_send((frame.cloned(), events.to_vec())).is_err() {
            lost.fetch_add(1, Ordering::Relaxed);
        }
    })
}

/// A piece of a stream, with the curves of the frames `curves`.
fn piece<'a>(stage: &'a Stage, updates: &[Update], curves: Option<&[Frame]>) -> Scene<'a> {
    let frames: Vec<Frame> = updates.iter().filter_map(|(frame, _)| frame.clone()).collect();
    let events: Vec<Event> = updates.iter().flat_map(|(_, events)| events.clone()).collect();
    let mut scene = stage.scene(&frames, &events);
    if let Some(frames) = curves {
        let times: Vec<f64> = frames.iter().map(|f| f.t).collect();
        scene.series = drives(stage.plant.mechanism, &times, |k| {
            (frames.iter().map(|f| f.tau[k]).collect(), frames.iter().map(|f| f.q[k]).collect())
        });
        scene.series.extend(stage.loads(frames, &Signals::default()));
    }
    scene.eventful = true;
    scene
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use nalgebra::Isometry3;

    use super::*;
    use crate::scene::Assets;
    use deltatwin::dynamics::Plant;
    use deltatwin::kinematics::SocketSet;
    use deltatwin::machine::bodies::SLOTS;
    use deltatwin::machine::{Setup, each};
    use deltatwin::twin::Options;

    fn frame(t: f64) -> Frame {
        Frame {
            t,
            q: each(0.0),
            tau: each(0.0),
            bodies: [Isometry3::identity(); SLOTS],
            objects: Vec::new(),
            closed: SocketSet::ALL,
            strut_force: [each(0.0); 2],
            socket_margin: each(0.0),
            contacts: Vec::new(),
        }
    }

    #[test]
    fn a_viewer_that_takes_nothing_costs_frames_and_no_time() {
        let (queue, waiting) = sync_channel(3);
        let lost = Arc::new(AtomicUsize::new(0));
        let watcher = watcher(queue, lost.clone());
        (0..10).for_each(|k| watcher.see(Some(&frame(0.01 * f64::from(k))), &[]));
        assert_eq!((waiting.try_iter().count(), lost.load(Ordering::Relaxed)), (3, 7));
        drop(waiting);
        watcher.see(Some(&frame(1.0)), &[]);
        assert_eq!(lost.load(Ordering::Relaxed), 8);
    }

    /// A viewer that takes the connection and closes it, and one that never says anything.
    #[test]
    fn a_viewer_that_goes_away_does_not_stop_the_run() {
        for stays in [false, true] {
            let server = TcpListener::bind("127.0.0.1:0").unwrap();
            let url = format!("rerun+http://{}/proxy", server.local_addr().unwrap());
            std::thread::spawn(move || {
                let mut held = Vec::new();
                for stream in server.incoming().take(3) {
                    if stays {
                        held.push(stream);
                    }
                }
                std::thread::sleep(Duration::from_secs(20));
            });
            let model = deltatwin_io::model::read(std::path::Path::new("../../models/irb360-6-1600.toml")).unwrap();
            let plant = Plant::new(&model, &Setup::default());
            let stage = Stage { plant, options: Options::default(), desired: None, assets: Assets::default() };
            let (stream, watcher) = Stream::open(&Viewer::Connect(url), "gone", stage, Pace::Live).unwrap();
            let begun = Instant::now();
            for k in 0..5000 {
                watcher.see(Some(&frame(SPACING * f64::from(k))), &[]);
            }
            assert!(begun.elapsed() < Duration::from_secs(1), "{stays}: {:?}", begun.elapsed());
            assert!(stream.finish().is_some_and(|problem| problem.contains("has not got everything")), "{stays}");
            assert!(begun.elapsed() < PATIENCE + Duration::from_secs(2), "{stays}: {:?}", begun.elapsed());
        }
    }

    #[test]
    fn a_viewer_that_does_not_answer_is_not_waited_for() {
        let (answer, done) = sync_channel(1);
        let stream = || Stream { done, over: Arc::default(), lost: Arc::default() };
        answer.send(Err("gone".into())).unwrap();
        assert_eq!(stream().finish().as_deref(), Some("the viewer has not got everything: gone"));
        let (_, done) = sync_channel::<Result<(), String>>(1);
        let stream = Stream { done, over: Arc::default(), lost: Arc::default() };
        assert!(stream.finish().unwrap().contains("does not answer"));
    }
}
