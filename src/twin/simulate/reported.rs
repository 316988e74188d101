//! What a run reports: its samples in pieces, with the errors of the sensors, while it goes on.

use super::Run;
use crate::dynamics::Plant;
use crate::recording::{Channel, Signals};
use crate::twin::{Event, Frame};

/// Number of samples of a piece.
const PIECE: usize = 256;
/// Number of samples that interpolation between samples reads beyond the nearest.
const STENCIL: usize = 4;

/// Consecutive part of a run.
pub struct Piece<'a> {
    /// Samples after those of the previous pieces.
    pub signals: Signals,
    /// Frames since the previous piece.
    pub frames: Vec<Frame>,
    /// Events since the previous piece.
    pub events: &'a [Event],
}

/// Receiver of a run in progress.
pub trait Receiver {
    /// Called with the simulated time (s) once per sample; false ends the run.
    fn progress(&mut self, t: f64) -> bool;

    /// Takes the next part of the run; false ends the run. The pieces do not depend on who receives them.
    fn piece(&mut self, piece: Piece) -> bool;
}

/// State of the sensors that report torques late, early or filtered.
pub(super) struct Reported {
    /// Number of ideal samples before and after a sample on which its report depends; none if no effect changes it.
    reach: Option<[usize; 2]>,
    /// Ideal times and torques before the signals that have not been passed on.
    past: Signals,
    /// Number of events passed on.
    events: usize,
}

impl Reported {
    /// Sensors of a `plant` with a sampling `period`, s.
    pub fn new(plant: &Plant, period: f64) -> Self {
        let reach = plant.observes().then(|| {
            let mut seconds = [0.0; 2];
            for own in plant.effects.iter().map(|active| active.sensor_reach()) {
                seconds = [seconds[0] + own[0], seconds[1] + own[1]];
            }
            seconds.map(|s| (s / period).ceil() as usize + STENCIL)
        });
        Self { reach, past: Signals::default(), events: 0 }
    }

    /// Removes the samples from `ideal` whose reports are known and returns them with the errors of the sensors; at the
    /// `end` of a run all.
    fn take(&mut self, plant: &Plant, ideal: &mut Signals, end: bool) -> Signals {
        let Some([before, after]) = self.reach else { return ideal.split_off_front(ideal.len()) };
        let known = if end { ideal.len() } else { ideal.len().saturating_sub(after) };
        let earlier = self.past.len();
        let mut torques = ideal.only(|channel| channel.drive().is_some());
        let mut window = self.past.clone();
        window.extend(torques.clone());
        for active in &plant.effects {
            active.observe(&mut window);
        }
        let mut out = ideal.split_off_front(known);
        for drive in Channel::of_drives(out.mechanism) {
            out.set(drive, window[drive][earlier..earlier + known].to_vec());
        }
        self.past.extend(torques.split_off_front(known));
        let forgotten = self.past.len().saturating_sub(before);
        self.past.split_off_front(forgotten);
        out
    }
}

impl Run<'_> {
    /// Passes the samples on that make a piece, at the `end` all; false if the receiver wants no more.
    pub(super) fn pass_on(&mut self, receiver: &mut dyn Receiver, end: bool) -> bool {
        let waiting = self.reported.reach.map_or(0, |[_, after]| after);
        if !end && self.signals.len() < PIECE + waiting {
            return true;
        }
        let mut signals = self.reported.take(self.twin.plant(), &mut self.signals, end);
        self.sensors.add_noise(&mut signals);
        let events = &self.report.events[self.reported.events..];
        self.reported.events = self.report.events.len();
        receiver.piece(Piece { signals, frames: std::mem::take(&mut self.kept), events })
    }
}
