//! Joints of a machine with their rows, and the fronts in which the rows are eliminated.

use std::ops::Range;

use nalgebra::Vector3;

use crate::dynamics::Plant;
use crate::machine::bodies::{END_EFFECTOR, PLATFORM, ROTOR, SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER, arm, strut};
use crate::machine::{Geometry, PerSocket, Pivot, Plate, each};

/// Most rows of a machine, with the numbers that a robot without a telescope leaves out.
pub const MAX_ROWS: usize = 88;

/// What a joint holds; its rows are in [`Rows`](super::rows::Rows).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    /// Shaft or guide of the arm of a limb on the base.
    Bearing(usize),
    /// Ball socket, numbered as in `SocketSet`.
    Socket(usize),
    /// A point of each body in one place, and their z axes parallel.
    Hinge([Vector3<f64>; 2]),
    /// A point of each body in one place, and y of the first perpendicular to x of the second.
    Hooke([Vector3<f64>; 2]),
    /// Both bodies parallel, the origin of the first on a line of the second; the two directions across it.
    Rail([Vector3<f64>; 2]),
    /// A point of each body in one place, seen along z of the second.
    Pin([Vector3<f64>; 2]),
    /// Rack on the second of three bodies, along `along` of the first, and pinion of `radius` on the third.
    Pinion { along: Vector3<f64>, radius: f64 },
    /// Equal coordinates of the arms of two limbs.
    Coupling([usize; 2]),
}

impl Kind {
    fn rows(self) -> usize {
        match self {
            Self::Bearing(_) | Self::Hinge(_) | Self::Rail(_) => 5,
            Self::Hooke(_) => 4,
            Self::Socket(_) => 3,
            Self::Pin(_) => 2,
            Self::Pinion { .. } | Self::Coupling(_) => 1,
        }
    }
}

/// A joint of up to three bodies.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    pub kind: Kind,
    /// Its bodies; one alone is joined to the base.
    pub bodies: Vec<usize>,
    /// First block row on each body.
    pub blocks: Vec<usize>,
    /// First row.
    pub row: usize,
    /// Front in which its rows are inner ones; the hub is the last.
    front: usize,
}

/// Block rows that follow each other on a body and in a front.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    /// First block row.
    pub block: usize,
    pub len: usize,
    /// Position of the first one in the front.
    pub at: usize,
}

/// Layout of a front: rows of some joints, inner ones first.
#[derive(Clone, Debug, Default)]
pub(super) struct Layout {
    /// Row at every position.
    pub rows: Vec<usize>,
    /// Number of inner rows.
    pub inner: usize,
    /// Number of rows of each inner joint, and one past the last row reached by its elimination.
    pub panels: Vec<(usize, usize)>,
    /// Runs of the block rows of each body.
    pub bodies: Vec<Vec<Run>>,
    /// Sockets in the front with the position of their first row.
    pub sockets: Vec<(usize, usize)>,
}

/// Donor, block rows of one row on donor and end effector, and share of the donor's inertia along it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shift {
    pub donor: usize,
    pub from: usize,
    pub to: usize,
    pub share: f64,
}

/// Fraction of the donor's inertia shifted along each row: the platform donates along five rows, for which 1/(2·5) each
/// is safe.
const PLATFORM_SHARE: f64 = 0.1;
const TELESCOPE_SHARE: f64 = 0.5;

/// The joints of a machine.
pub(super) struct Structure {
    /// Bodies with joints.
    pub bodies: Vec<usize>,
    /// In the order of their rows.
    pub joints: Vec<Joint>,
    /// Block rows of every body.
    pub blocks: [Range<usize>; SLOTS],
    /// Row of every block row.
    pub row: Vec<usize>,
    /// Number of struts.
    pub struts: usize,
    /// First row of every socket.
    pub socket: PerSocket<usize>,
    /// Shifts of inertia to the end effector of a telescope, and the bodies that they change.
    pub shifts: Vec<Shift>,
    pub shifted: &'static [usize],
    /// Limbs and the chain of axis 4.
    pub branches: Vec<Layout>,
    /// Joints of the plate, where the branches meet.
    pub hub: Layout,
}

impl Structure {
    /// The joints of a machine in its configuration.
    ///
    /// A robot with three limbs numbers its rows as if it had a telescope, see
    /// [`constraints`](crate::twin::constraints).
    pub fn new(plant: &Plant) -> Self {
        let (geometry, machine) = (&plant.geometry, plant.mechanism);
        let mut out = Self {
            bodies: Vec::new(),
            joints: Vec::new(),
            blocks: std::array::from_fn(|_| 0..0),
            row: Vec::new(),
            struts: if plant.assembled { machine.struts() } else { 0 },
            socket: each(0),
            shifts: Vec::new(),
            shifted: &[],
            branches: Vec::new(),
            hub: Layout::default(),
        };
        let limbs = if plant.assembled { machine.limbs() } else { machine.arms() };
        let (chain, hub) = (limbs, limbs + 1);
        for i in 0..limbs {
            out.add(Kind::Bearing(i), &[arm(i)], i);
        }
        let hooke = geometry.upper_hooke();
        let telescope = machine.has_telescope();
        if telescope {
            out.add(Kind::Hinge([Vector3::zeros(), hooke]), &[ROTOR], chain);
        }
        if plant.assembled {
            let skipped = if machine.is_delta() && !telescope { 5 } else { 0 };
            for s in 0..out.struts {
                let carrier = geometry.plate.bodies()[geometry.limbs[s / 2].part];
                out.add(Kind::Socket(s), &[strut(s), arm(s / 2)], s / 2);
                out.add(Kind::Socket(out.struts + s), &[strut(s), carrier], hub);
            }
            out.joints.iter_mut().filter(|j| matches!(j.kind, Kind::Socket(_))).for_each(|j| j.row += skipped);
            if telescope {
                out.telescope(geometry, chain, hub);
            }
            out.plate(geometry, hub);
            for i in (machine.arms()..limbs).skip(1) {
                out.add(Kind::Coupling([i - 1, i]), &[arm(i - 1), arm(i)], hub);
            }
        }
        out.number();
        if plant.assembled && telescope {
            out.shift();
        }
        let on_plate = |b: usize| plant.assembled && machine.is_part_of_plate(b);
        out.branches = (0..hub).map(|f| out.front(f, false, &on_plate)).filter(|f| f.inner > 0).collect();
        out.hub = out.front(hub, true, &on_plate);
        out
    }

    /// First row of the lower ball of strut `s`.
    pub fn ball(&self, s: usize) -> usize {
        self.socket[self.struts + s]
    }

    fn add(&mut self, kind: Kind, bodies: &[usize], front: usize) {
        let row = self.joints.last().map_or(0, |last| last.row + last.kind.rows());
        self.joints.push(Joint { kind, bodies: bodies.to_vec(), blocks: Vec::new(), row, front });
    }

    /// Adds the pivot of the end effector, both Hooke joints and the slide.
    fn telescope(&mut self, geometry: &Geometry, chain: usize, hub: usize) {
        let origin = Vector3::zeros();
        let flange = Vector3::new(0.0, 0.0, geometry.flange_height);
        let cross = Vector3::new(0.0, 0.0, geometry.lower_hooke_height - geometry.flange_height);
        self.add(Kind::Hinge([origin, flange]), &[END_EFFECTOR, PLATFORM], hub);
        self.add(Kind::Hooke([origin; 2]), &[TELESCOPE_UPPER, ROTOR], chain);
        self.add(Kind::Rail([Vector3::x(), Vector3::y()]), &[TELESCOPE_LOWER, TELESCOPE_UPPER], chain);
        self.add(Kind::Hooke([origin, cross]), &[TELESCOPE_LOWER, END_EFFECTOR], chain);
    }

    /// Adds the joints between the parts of the plate: as many rows as hold it, none of which is redundant.
    fn plate(&mut self, geometry: &Geometry, hub: usize) {
        let bodies = geometry.plate.bodies();
        let mut held = vec![0];
        for Pivot { parts, points } in geometry.plate.pivots() {
            let at = [0, 1].map(|k| {
                let is_tool = bodies[parts[k]] == END_EFFECTOR;
                points[k] - if is_tool { Vector3::z() * geometry.flange_height } else { Vector3::zeros() }
            });
            // A pivot that closes a loop of bars need not keep them in their plane.
            let closes = parts.iter().all(|part| held.contains(part));
            self.add(if closes { Kind::Pin(at) } else { Kind::Hinge(at) }, &parts.map(|part| bodies[part]), hub);
            held.extend(parts);
        }
        if let Plate::I4 { azimuth, radius } = geometry.plate {
            let along = Vector3::new(azimuth.cos(), azimuth.sin(), 0.0);
            self.add(Kind::Rail([Vector3::z().cross(&along), Vector3::z()]), &[bodies[1], bodies[0]], hub);
            self.add(Kind::Pinion { along, radius }, &bodies[..3], hub);
        }
    }

    /// Numbers the block rows: body by body, on each in the order of elimination.
    fn number(&mut self) {
        let mut order: Vec<usize> = (0..self.joints.len()).collect();
        order.sort_by_key(|&j| (self.joints[j].front, j));
        let has = |b: usize| self.joints.iter().any(|joint| joint.bodies.contains(&b));
        self.bodies = (0..SLOTS).filter(|&b| has(b)).collect();
        self.joints.iter_mut().for_each(|joint| joint.blocks = vec![0; joint.bodies.len()]);
        for &b in &self.bodies {
            let start = self.row.len();
            for &j in &order {
                let joint = &mut self.joints[j];
                let Some(k) = joint.bodies.iter().position(|&body| body == b) else { continue };
                joint.blocks[k] = self.row.len();
                self.row.extend(joint.row..joint.row + joint.kind.rows());
            }
            self.blocks[b] = start..self.row.len();
        }
        for joint in &self.joints {
            if let Kind::Socket(k) = joint.kind {
                self.socket[k] = joint.row;
            }
        }
    }

    /// Five shifts along the pivot's rows from the platform, one about the lower Hooke joint's normal from the telescope.
    fn shift(&mut self) {
        let of = |donor: usize, rows: Range<usize>, share: f64| {
            let joint = self.joints.iter().find(|j| j.bodies.contains(&donor) && j.bodies.contains(&END_EFFECTOR));
            joint.into_iter().flat_map(move |joint| {
                let block = |body: usize| joint.bodies.iter().position(|b| *b == body).map(|k| joint.blocks[k]);
                let blocks = block(donor).zip(block(END_EFFECTOR));
                let at = move |k: usize| blocks.map(|(from, to)| Shift { donor, from: from + k, to: to + k, share });
                rows.clone().filter_map(at)
            })
        };
        self.shifts = of(PLATFORM, 0..5, PLATFORM_SHARE).chain(of(TELESCOPE_LOWER, 3..4, TELESCOPE_SHARE)).collect();
        self.shifted = &[PLATFORM, END_EFFECTOR, TELESCOPE_LOWER];
    }

    /// Rows of the joint that contains `row`, and its first block row on `body`.
    #[cfg(test)]
    pub fn on(&self, body: usize, row: usize) -> (Range<usize>, usize) {
        let joint = self.joints.iter().rev().find(|j| j.row <= row).unwrap();
        let k = joint.bodies.iter().position(|b| *b == body).unwrap();
        (joint.row..joint.row + joint.kind.rows(), joint.blocks[k])
    }

    fn front(&self, front: usize, is_hub: bool, on_plate: &dyn Fn(usize) -> bool) -> Layout {
        let inner: Vec<&Joint> = self.joints.iter().filter(|j| j.front == front).collect();
        let belongs = |b: usize| match is_hub {
            true => on_plate(b),
            false => !on_plate(b) && inner.iter().any(|j| j.bodies.contains(&b)),
        };
        let bodies: Vec<usize> = self.bodies.iter().copied().filter(|&b| belongs(b)).collect();
        let outer = self.joints.iter().filter(|j| j.front > front && j.bodies.iter().any(|b| bodies.contains(b)));
        let all: Vec<&Joint> = inner.iter().copied().chain(outer).collect();
        let mut layout = Layout { inner: inner.iter().map(|j| j.kind.rows()).sum(), ..Layout::default() };
        let mut starts = Vec::new();
        for joint in &all {
            starts.push(layout.rows.len());
            if let Kind::Socket(k) = joint.kind {
                layout.sockets.push((k, layout.rows.len()));
            }
            layout.rows.extend(joint.row..joint.row + joint.kind.rows());
        }
        for &b in &bodies {
            let mut runs: Vec<Run> = Vec::new();
            for block in self.blocks[b].clone() {
                let at = layout.rows.iter().position(|row| *row == self.row[block]).unwrap_or_default();
                match runs.last_mut() {
                    Some(run) if run.at + run.len == at => run.len += 1,
                    _ => runs.push(Run { block, len: 1, at }),
                }
            }
            layout.bodies.push(runs);
        }
        // Rows of a joint reach those of all joints on its bodies, and what rows before it reach.
        let end = |j: usize| starts[j] + all[j].kind.rows();
        let joined = |i: usize, j: usize| all[i].bodies.iter().any(|b| bodies.contains(b) && all[j].bodies.contains(b));
        for (i, joint) in inner.iter().enumerate() {
            let direct = (i..all.len()).filter(|&j| is_hub || joined(i, j)).map(end).max().unwrap_or_default();
            let before = layout.panels.iter().map(|&(_, reach)| reach).filter(|reach| *reach > starts[i]).max();
            layout.panels.push((joint.kind.rows(), direct.max(before.unwrap_or_default())));
        }
        layout
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{plant, relatives};
    use super::*;

    #[test]
    fn every_row_is_eliminated_once_and_every_block_row_has_its_place() {
        for plant in relatives().into_iter().chain([plant()]) {
            let structure = Structure::new(&plant);
            let fronts = || structure.branches.iter().chain([&structure.hub]);
            let mut rows: Vec<usize> = fronts().flat_map(|f| f.rows[..f.inner].to_vec()).collect();
            rows.sort_unstable();
            let own = |j: &Joint| j.row..j.row + j.kind.rows();
            let mut expected: Vec<usize> = structure.joints.iter().flat_map(own).collect();
            expected.sort_unstable();
            assert_eq!(rows, expected);
            assert!(rows.iter().all(|&row| row < MAX_ROWS));
            let placed: usize = fronts().flat_map(|f| f.bodies.iter().flatten()).map(|r| r.len).sum();
            assert_eq!(placed, structure.row.len());
        }
    }
}
