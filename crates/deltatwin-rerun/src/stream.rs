//! Streaming of a run to a viewer while it is simulated.
//!
//! Frames pass through a queue of bounded length to a separate thread, which sends all waiting frames as one piece.
//! With a slow viewer frames are dropped, and the rest is dropped if the viewer disconnects; the run is not affected.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use crate::scene::{Live, Scene, Viewer, drives};
use crate::show;
use deltatwin::dynamics::Plant;
use deltatwin::recording::Signals;
use deltatwin::twin::{Event, Frame, Options, Watcher};

/// Capacity of the queue, frames.
const QUEUE: usize = 1000;
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
    /// Opens a stream to `viewer` with a frame every `spacing` s; also returns the watcher of the run.
    ///
    /// # Errors
    /// If no viewer answers or none can be started, or the URL is not valid.
    pub fn open(
        viewer: &Viewer,
        name: &str,
        plant: &Plant,
        options: &Options,
        spacing: f64,
    ) -> Result<(Self, Watcher), String> {
        let (plant, options) = (plant.clone(), options.clone());
        let live = Live::open(viewer, name, &piece(&plant, &options, &[])).map_err(|e| e.to_string())?;
        let (queue, waiting) = sync_channel::<Update>(QUEUE);
        let (answer, done) = sync_channel(1);
        let over = Arc::new(AtomicBool::new(false));
        let ended = over.clone();
        let work = move || forward(live, &plant, &options, &waiting, &ended, &answer);
        std::thread::Builder::new().name("viewer".into()).spawn(work).map_err(|e| e.to_string())?;
        let lost = Arc::new(AtomicUsize::new(0));
        Ok((Self { done, over, lost: lost.clone() }, watcher(queue, lost, spacing)))
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

/// Sends updates until the run is over, then reports whether the viewer has received everything.
fn forward(
    mut live: Live,
    plant: &Plant,
    options: &Options,
    waiting: &Receiver<Update>,
    over: &AtomicBool,
    answer: &SyncSender<Result<(), String>>,
) {
    let mut sent = Ok(());
    loop {
        match waiting.recv_timeout(PAUSE) {
            Ok(first) => {
                let updates: Vec<Update> = std::iter::once(first).chain(waiting.try_iter()).collect();
                if sent.is_ok() {
                    sent = live.send(&piece(plant, options, &updates));
                }
            }
            Err(RecvTimeoutError::Timeout) if !over.load(Ordering::Relaxed) => {}
            Err(_) => break,
        }
    }
    let ended = sent.and_then(|()| live.finish()).map_err(|e| e.to_string());
    // Dropping the stream may block on a viewer that does not answer; the result has already been reported.
    answer.send(ended).ok();
}

fn watcher(queue: SyncSender<Update>, lost: Arc<AtomicUsize>, spacing: f64) -> Watcher {
    Watcher::new(spacing, move |frame: Option<&Frame>, events: &[Event]| {
        if queue.try_send((frame.cloned(), events.to_vec())).is_err() {
            lost.fetch_add(1, Ordering::Relaxed);
        }
    })
}

fn piece<'a>(plant: &'a Plant, options: &'a Options, updates: &[Update]) -> Scene<'a> {
    let frames: Vec<Frame> = updates.iter().filter_map(|(frame, _)| frame.clone()).collect();
    let events: Vec<Event> = updates.iter().flat_map(|(_, events)| events.clone()).collect();
    let mut scene = show::scene(plant, options, &frames, &events);
    scene.series = drives(plant.mechanism, &scene.times, |k| {
        (frames.iter().map(|f| f.tau[k]).collect(), frames.iter().map(|f| f.q[k]).collect())
    });
    scene.series.extend(show::loads(plant, &frames, &Signals::default()));
    scene.eventful = true;
    scene
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;
    use deltatwin::kinematics::SocketSet;
    use deltatwin::kinematics::motion::SOCKETS;
    use deltatwin::machine::bodies::BODIES;
    use deltatwin::machine::{AXES, STRUTS};

    fn frame(t: f64) -> Frame {
        Frame {
            t,
            q: [0.0; AXES],
            tau: [0.0; AXES],
            bodies: [Isometry3::identity(); BODIES],
            objects: Vec::new(),
            closed: SocketSet::ALL,
            strut_force: [[0.0; STRUTS]; 2],
            socket_margin: [0.0; SOCKETS],
        }
    }

    #[test]
    fn a_viewer_that_takes_nothing_costs_frames_and_no_time() {
        let (queue, waiting) = sync_channel(3);
        let lost = Arc::new(AtomicUsize::new(0));
        let watcher = watcher(queue, lost.clone(), 0.01);
        (0..10).for_each(|k| watcher.see(Some(&frame(0.01 * f64::from(k))), &[]));
        assert_eq!((waiting.try_iter().count(), lost.load(Ordering::Relaxed)), (3, 7));
        drop(waiting);
        watcher.see(Some(&frame(1.0)), &[]);
        assert_eq!(lost.load(Ordering::Relaxed), 8);
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
