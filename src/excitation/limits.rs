//! Limits on the motion: joints, telescope and its Hooke joints, singularities, drives, sockets and optionally a hemisphere.

use nalgebra::{Matrix3, Vector3};

use crate::dynamics::SocketLoads;
use crate::kinematics::{JointState, Motion, PlatformState, Reactions, SocketSet};
use crate::machine::{Geometry, PerAxis, axes_from, limbs_from, sockets_from, struts_from};
use crate::model::Model;
use crate::twin::Clamps;

/// Lower half of a ball to which the platform is confined (Fig. 5 of the paper), m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hemisphere {
    /// Centre of the flat top, m.
    pub centre: Vector3<f64>,
    /// Radius, m.
    pub radius: f64,
}

/// Number of limits per sample.
pub const LIMITS: usize = HEMISPHERE + 1;

const ARM_HIGH: usize = 0;
const ARM_LOW: usize = limbs_from(ARM_HIGH).end;
const TELESCOPE: usize = limbs_from(ARM_LOW).end;
const HOOKE: usize = TELESCOPE + 2;
const SERIAL: usize = HOOKE + 1;
const PARALLEL: usize = limbs_from(SERIAL).end;
const SPEED: usize = PARALLEL + 1;
const ACCELERATION: usize = axes_from(SPEED).end;
const TORQUE: usize = axes_from(ACCELERATION).end;
const STRUT_FORCE: usize = axes_from(TORQUE).end;
const SOCKET: usize = struts_from(STRUT_FORCE).end;
const HEMISPHERE: usize = sockets_from(SOCKET).end;

/// Kinds of limits by name, with the index range of each.
pub const KINDS: [(&str, std::ops::Range<usize>); 11] = [
    ("arm_angle", ARM_HIGH..TELESCOPE),
    ("telescope_length", TELESCOPE..HOOKE),
    ("hooke_angle", HOOKE..SERIAL),
    ("arm_strut_singularity", SERIAL..PARALLEL),
    ("parallel_singularity", PARALLEL..SPEED),
    ("speed", SPEED..ACCELERATION),
    ("acceleration", ACCELERATION..TORQUE),
    ("torque", TORQUE..STRUT_FORCE),
    ("strut_force", STRUT_FORCE..SOCKET),
    ("socket", SOCKET..HEMISPHERE),
    ("hemisphere", HEMISPHERE..LIMITS),
];

/// Least sine of the angle between strut and arm, seen along the motor axis.
const MIN_SERIAL: f64 = 0.15;
/// Least volume spanned by the unit vectors along the struts of three limbs; with another plate or number of limbs, least
/// determinant of the closure over the one at the home pose.
const MIN_PARALLEL: f64 = 0.05;
const MIN_CLOSURE: f64 = 0.3;
/// Share of the range of arm angle and telescope length kept free at either end for the tracking error.
const ROOM: f64 = 0.01;

/// Limits of a machine.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Usable share of speed, acceleration, torque and hold of the sockets.
    pub share: f64,
    /// Additional restriction of the workspace.
    pub hemisphere: Option<Hemisphere>,
    speed: PerAxis<f64>,
    acceleration: PerAxis<f64>,
    torque: PerAxis<f64>,
    clamps: Clamps,
    telescope: bool,
    /// Angle of the Hooke joints at their stops, rad; infinite without.
    hooke: f64,
    axes: usize,
}

impl Limits {
    /// Whether the kind of limit `name` applies.
    pub fn apply(&self, name: &str) -> bool {
        match name {
            "hemisphere" => self.hemisphere.is_some(),
            "hooke_angle" => self.hooke.is_finite(),
            "telescope_length" => self.telescope,
            _ => true,
        }
    }

    /// Limits of `model`, of whose drives and sockets the share `share` may be used.
    pub fn of(model: &Model, share: f64, hemisphere: Option<Hemisphere>) -> Self {
        Self {
            share,
            hemisphere,
            axes: model.mechanism.axes(),
            telescope: model.mechanism.has_telescope(),
            speed: model.drives.map(|d| d.max_speed),
            acceleration: model.drives.map(|d| d.max_acceleration),
            torque: model.drives.map(|d| d.max_torque),
            clamps: if model.assembled { Clamps::watched(&model.sockets) } else { Clamps::none() },
            hooke: if model.stops.hooke_stiffness > 0.0 { model.stops.hooke } else { f64::INFINITY },
        }
    }

    /// Normalised limits at one instant, none of which may exceed 1.
    ///
    /// Speed, acceleration, torque, strut force (as if it acted across its sockets alone) and load of the sockets
    /// (`loads` along `motion`) are in units of the usable share. Angles and telescope length are measured from the
    /// middle of their range, angles of Hooke joints from zero, in units of the distance to the limit minus a margin for
    /// the tracking error.
    pub fn values(
        &self,
        geometry: &Geometry,
        platform: &PlatformState,
        joints: &JointState,
        (motion, loads): (&Motion, &SocketLoads),
    ) -> [f64; LIMITS] {
        let mut out = [0.0; LIMITS];
        let within = |value: f64, [min, max]: [f64; 2]| {
            (value - 0.5 * (min + max)) / ((0.5 - ROOM) * (max - min)).max(f64::MIN_POSITIVE)
        };
        let mut directions = Matrix3::zeros();
        for (i, limb) in geometry.limbs.iter().enumerate() {
            let share = within(joints.q[i], limb.limits);
            (out[ARM_HIGH + i], out[ARM_LOW + i]) = (share, -share);
            let (strut, sine) = geometry.transmission(i, joints.q[i], platform);
            if limb.driven {
                out[SERIAL + i] = 1.0 + MIN_SERIAL - sine;
            }
            if i < directions.nrows() {
                directions.set_row(i, &strut.transpose());
            }
        }
        out[PARALLEL] = match geometry.has_platform_of_three() {
            true => 1.0 + MIN_PARALLEL - directions.determinant().abs(),
            false => 1.0 + MIN_CLOSURE - geometry.closure_share(&joints.q, platform),
        };
        if geometry.has_telescope() {
            let length = within(geometry.telescope_length(&platform.position), geometry.telescope_limits);
            (out[TELESCOPE], out[TELESCOPE + 1]) = (length, -length);
            out[HOOKE] = geometry.telescope_tilt(&platform.position) / ((1.0 - ROOM) * self.hooke);
        }
        for i in 0..self.axes {
            out[SPEED + i] = joints.qd[i].abs() / (self.share * self.speed[i]);
            out[ACCELERATION + i] = joints.qdd[i].abs() / (self.share * self.acceleration[i]);
            out[TORQUE + i] = loads.output.tau[i].abs() / (self.share * self.torque[i]);
        }
        let Reactions { upper, lower } = &loads.output.reactions;
        for s in 0..motion.struts() {
            out[STRUT_FORCE + s] = upper[s].abs().max(lower[s].abs()) / (self.share * self.clamps.hold[s]);
        }
        let used = self.clamps.used(&self.clamps.margins(motion, &loads.sockets, SocketSet::of(motion.struts())));
        for (limit, used) in out[SOCKET..HEMISPHERE].iter_mut().zip(used) {
            *limit = used / self.share;
        }
        if let Some(h) = &self.hemisphere {
            let d = platform.position - h.centre;
            out[HEMISPHERE] = (d.norm() / h.radius).max(1.0 + d.z / h.radius);
        }
        out
    }
}
