//! Accelerations and strut forces: [M Gᵀ; G 0]·[a; λ] = [f; γ] with 84 accelerations and 74 multipliers.
//!
//! The tree-like joints are eliminated in closed form. What remains are ten velocities ν (three arms, rotor, platform
//! twist) and six axial strut forces: every body's twist is N·ν (+ spin of the strut), the struts' lengths give
//! B·ν̇ = c, and M̂ = NᵀMN, M̂ν̇ + BᵀT = f̂. Struts are symmetric about their axis, so their spin decouples.

use nalgebra::{Cholesky, Const, SMatrix, SVector, Vector3};

use crate::dynamics::{Plant, inertial_wrench};
use crate::effects::{Instant, Wrenches};
use crate::kinematics::{Motion, Reactions, SocketSet};
use crate::model::bodies::{ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::model::{ARMS, Geometry, STRUTS};

/// Independent velocities of the opened mechanism: arms, rotor, platform velocity and angular velocity.
pub(super) const OPEN: usize = 10;
const ROTOR_RATE: usize = 3;
const PLATFORM_V: usize = 4;

type OpenVector = SVector<f64, OPEN>;
type Twist = (Vector3<f64>, Vector3<f64>);
const STILL: Twist = (Vector3::new(0., 0., 0.), Vector3::new(0., 0., 0.));

/// Linear damping treated implicitly by the integrator, N·m·s/rad.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Damping {
    /// Arms and rotor.
    pub drives: [f64; 4],
    /// Spin of each strut.
    pub spins: [f64; STRUTS],
}

/// Forces on the bodies apart from constraints.
#[derive(Clone)]
pub(super) struct Loads {
    /// Force and moment about each body's origin, world axes.
    pub wrenches: [Twist; BODIES],
    /// Power of each effect, W.
    pub powers: Vec<f64>,
}

/// Mass matrix and constraints of the opened mechanism at a pose, factored.
pub(super) struct Condensed {
    mass: Cholesky<f64, Const<OPEN>>,
    rows: SMatrix<f64, STRUTS, OPEN>,
    mass_inverse_rows: SMatrix<f64, OPEN, STRUTS>,
    schur: Cholesky<f64, Const<STRUTS>>,
}

/// What the equations yield at one stage.
#[derive(Clone)]
pub(super) struct Accelerations {
    /// Acceleration of the origin and angular acceleration of every body, world axes.
    pub bodies: [Twist; BODIES],
    /// Angular acceleration of each strut about its own axis, rad/s².
    pub spins: [f64; STRUTS],
    /// Axial strut forces, N.
    pub reactions: Reactions,
}

/// The mechanism has lost rank: a singular pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SingularPose;

/// Sums the wrenches of all effects at a motion.
pub(super) fn loads(plant: &Plant, t: f64, motion: &Motion, own: &[f64], reactions: &Reactions) -> Loads {
    let mut wrenches = [STILL; BODIES];
    let mut powers = Vec::with_capacity(plant.effects.len());
    let mut at = 0;
    for active in &plant.effects {
        let values = active.values();
        let n = active.states();
        let instant = Instant {
            t,
            motion,
            bodies: &plant.bodies,
            gravity: plant.gravity,
            reactions,
            state: &own[at..at + n],
            torque: [0.0; 4],
            closed: SocketSet::ALL,
        };
        at += n;
        let mut power = 0.0;
        active.effect.forces(
            &values,
            &instant,
            &mut Wrenches::new(&mut |k, body, force, moment| {
                let (force, moment) = (force * active.values[k], moment * active.values[k]);
                wrenches[body].0 += force;
                wrenches[body].1 += moment;
                let m = &motion.bodies[body];
                power += force.dot(&m.velocity) + moment.dot(&m.angular_velocity);
            }),
        );
        powers.push(power);
    }
    Loads { wrenches, powers }
}

/// Geometry of one pose that both the mass matrix and the accelerations need.
struct Levers {
    /// Velocity of each upper ball per unit arm rate.
    elbow: [Vector3<f64>; STRUTS],
    /// Lower ball relative to the platform's origin.
    ball: [Vector3<f64>; STRUTS],
    /// Twists of end effector, telescope upper and lower part per unit of rotor rate and platform twist.
    chain: [[Twist; 3]; 7],
}

const CHAIN: [usize; 3] = [END_EFFECTOR, TELESCOPE_UPPER, TELESCOPE_LOWER];

impl Levers {
    fn new(motion: &Motion) -> Self {
        let platform = &motion.bodies[PLATFORM];
        let elbow = std::array::from_fn(|s| {
            let arm = &motion.bodies[ARM + s / 2];
            Geometry::tangential(s / 2).cross(&(motion.bodies[STRUT + s].position - arm.position))
        });
        let ball = std::array::from_fn(|s| {
            motion.bodies[STRUT + s].position + motion.strut_axis[s] * motion.strut_length[s] - platform.position
        });
        let chain = std::array::from_fn(|c| {
            let unit = |i: usize| Vector3::ith(i % 3, 1.0);
            match c {
                0 => chain_twists(motion, 1.0, &STILL),
                1..=3 => chain_twists(motion, 0.0, &(unit(c - 1), Vector3::zeros())),
                _ => chain_twists(motion, 0.0, &(Vector3::zeros(), unit(c - 4))),
            }
        });
        Self { elbow, ball, chain }
    }
}

/// Twists of end effector and telescope parts for a rotor rate and a platform twist (see `dynamics::channels`).
fn chain_twists(motion: &Motion, rotor: f64, platform: &Twist) -> [Twist; 3] {
    let xi = crate::dynamics::spread_chain(motion, rotor, platform);
    CHAIN.map(|b| xi[b - END_EFFECTOR])
}

impl Condensed {
    /// Factors the equations at a pose; `implicit` is h·γ times the damping of drives.
    pub fn new(plant: &Plant, motion: &Motion, implicit: &[f64; 4]) -> Result<Self, SingularPose> {
        let levers = Levers::new(motion);
        let mut mass = SMatrix::<f64, OPEN, OPEN>::zeros();
        for i in 0..ARMS {
            mass[(i, i)] += plant.bodies[ARM + i].tensor[(1, 1)] + implicit[i];
        }
        mass[(ROTOR_RATE, ROTOR_RATE)] += plant.bodies[ROTOR].tensor[(2, 2)] + implicit[ROTOR_RATE];
        let mut rows = SMatrix::<f64, STRUTS, OPEN>::zeros();
        for s in 0..STRUTS {
            let u = motion.strut_axis[s];
            let (e, r) = (levers.elbow[s], levers.ball[s]);
            rows[(s, s / 2)] = -u.dot(&e);
            rows.fixed_view_mut::<1, 3>(s, PLATFORM_V).copy_from(&u.transpose());
            rows.fixed_view_mut::<1, 3>(s, PLATFORM_V + 3).copy_from(&r.cross(&u).transpose());
            let mut columns = [STILL; 7];
            columns[0] = (e, -u.cross(&e) / motion.strut_length[s]);
            for k in 0..3 {
                let x = Vector3::ith(k, 1.0);
                columns[1 + k].1 = u.cross(&x) / motion.strut_length[s];
                columns[4 + k].1 = u.cross(&x.cross(&r)) / motion.strut_length[s];
            }
            let index = [s / 2, 4, 5, 6, 7, 8, 9];
            add_mass(&mut mass, plant, motion, STRUT + s, &columns, &index);
        }
        let index = [ROTOR_RATE, 4, 5, 6, 7, 8, 9];
        for (b, body) in CHAIN.into_iter().enumerate() {
            let columns: [Twist; 7] = std::array::from_fn(|c| levers.chain[c][b]);
            add_mass(&mut mass, plant, motion, body, &columns, &index);
        }
        let columns: [Twist; 7] = std::array::from_fn(|c| match c {
            0 => STILL,
            1..=3 => (Vector3::ith(c - 1, 1.0), Vector3::zeros()),
            _ => (Vector3::zeros(), Vector3::ith(c - 4, 1.0)),
        });
        add_mass(&mut mass, plant, motion, PLATFORM, &columns, &index);
        Self::factor(mass, rows)
    }

    fn factor(mass: SMatrix<f64, OPEN, OPEN>, rows: SMatrix<f64, STRUTS, OPEN>) -> Result<Self, SingularPose> {
        let mass = Cholesky::new(mass).ok_or(SingularPose)?;
        let mass_inverse_rows = mass.solve(&rows.transpose());
        let schur = Cholesky::new(rows * mass_inverse_rows).ok_or(SingularPose)?;
        Ok(Self { mass, rows, mass_inverse_rows, schur })
    }

    /// Solves M̂x + BᵀT = f, Bx = c.
    pub fn solve(&self, f: &OpenVector, c: &SVector<f64, STRUTS>) -> (OpenVector, SVector<f64, STRUTS>) {
        let free = self.mass.solve(f);
        let tension = self.schur.solve(&(self.rows * free - c));
        (free - self.mass_inverse_rows * tension, tension)
    }

    /// Row residual B·x.
    pub fn rates(&self, x: &OpenVector) -> SVector<f64, STRUTS> {
        self.rows * x
    }
}

fn add_mass(
    mass: &mut SMatrix<f64, OPEN, OPEN>,
    plant: &Plant,
    motion: &Motion,
    body: usize,
    columns: &[Twist; 7],
    index: &[usize; 7],
) {
    let (inertia, rotation) = (&plant.bodies[body], &motion.bodies[body].rotation);
    let h = rotation * inertia.first_moment;
    let tensor = rotation * inertia.tensor * rotation.transpose();
    for c in 0..7 {
        let (v, omega) = &columns[c];
        let p = v * inertia.mass + omega.cross(&h);
        let l = h.cross(v) + tensor * omega;
        for r in 0..=c {
            let x = columns[r].0.dot(&p) + columns[r].1.dot(&l);
            mass[(index[r], index[c])] += x;
            if r != c {
                mass[(index[c], index[r])] += x;
            }
        }
    }
}

/// Twists of all bodies for velocities of the opened mechanism and strut spins.
pub(super) fn twists(motion: &Motion, nu: &OpenVector, spins: &[f64; STRUTS]) -> [Twist; BODIES] {
    let arms = [nu[0], nu[1], nu[2]];
    let platform = (nu.fixed_rows::<3>(PLATFORM_V).into_owned(), nu.fixed_rows::<3>(PLATFORM_V + 3).into_owned());
    let mut xi = crate::dynamics::spread(motion, &arms, nu[ROTOR_RATE], &platform);
    for s in 0..STRUTS {
        xi[STRUT + s].1 += motion.strut_axis[s] * spins[s];
    }
    xi
}

/// Velocities of the opened mechanism.
pub(super) fn open_velocities(motion: &Motion) -> OpenVector {
    let platform = &motion.bodies[PLATFORM];
    let mut nu = OpenVector::zeros();
    nu.fixed_rows_mut::<4>(0).copy_from_slice(&motion.qd);
    nu.fixed_rows_mut::<3>(PLATFORM_V).copy_from(&platform.velocity);
    nu.fixed_rows_mut::<3>(PLATFORM_V + 3).copy_from(&platform.angular_velocity);
    nu
}

/// Accelerations of all bodies for zero ν̇: the velocity-product terms.
fn bias(motion: &Motion) -> [Twist; BODIES] {
    let mut out = [STILL; BODIES];
    let platform = &motion.bodies[PLATFORM];
    let on_platform = |b: usize| {
        let r = motion.bodies[b].position - platform.position;
        platform.angular_velocity.cross(&platform.angular_velocity.cross(&r))
    };
    for s in 0..STRUTS {
        let strut = &motion.bodies[STRUT + s];
        let u = motion.strut_axis[s];
        let (upper, lower, axis_rate) = strut_ends(motion, s);
        out[STRUT + s].0 = upper;
        let spin = strut.angular_velocity.dot(&u);
        out[STRUT + s].1 = u.cross(&(lower - upper)) / motion.strut_length[s] + axis_rate * spin;
    }
    let hooke = on_platform(TELESCOPE_LOWER);
    let telescope = &motion.telescope;
    let upper = &motion.bodies[TELESCOPE_UPPER];
    let end_effector = &motion.bodies[END_EFFECTOR];
    let rotor = &motion.bodies[ROTOR];
    let w = telescope.axis;
    let w_rate = upper.angular_velocity.cross(&w);
    let spin = upper.angular_velocity.dot(&w);
    let swing = (-w.cross(&hooke) - w.cross(&w_rate) * (2.0 * telescope.rate)) / telescope.length;
    // (α_T − α_R)·n + (ω_T − ω_R)·ṅ = 0
    let bar = upper.rotation.column(1).into_owned();
    let bar_rate = upper.angular_velocity.cross(&bar);
    let yoke = rotor.rotation.column(0).into_owned();
    let n = yoke.cross(&bar);
    let n_rate = rotor.angular_velocity.cross(&yoke).cross(&bar) + yoke.cross(&bar_rate);
    let spin_acceleration =
        (-(swing + w_rate * spin).dot(&n) - (upper.angular_velocity - rotor.angular_velocity).dot(&n_rate)) / w.dot(&n);
    let alpha = swing + w_rate * spin + w * spin_acceleration;
    out[TELESCOPE_UPPER].1 = alpha;
    out[TELESCOPE_LOWER] = (hooke, alpha);
    // End effector: α_E = κ̇ z_P + κ ω_P × z_P with (α_E − α_T)·n₂ + (ω_E − ω_T)·ṅ₂ = 0
    let pivot = platform.rotation.column(2).into_owned();
    let kappa = (end_effector.angular_velocity - platform.angular_velocity).dot(&pivot);
    let precession = platform.angular_velocity.cross(&pivot) * kappa;
    let yoke = end_effector.rotation.column(0).into_owned();
    let n = yoke.cross(&bar);
    let n_rate = end_effector.angular_velocity.cross(&yoke).cross(&bar) + yoke.cross(&bar_rate);
    let kappa_rate = ((alpha - precession).dot(&n)
        - (end_effector.angular_velocity - upper.angular_velocity).dot(&n_rate))
        / pivot.dot(&n);
    out[END_EFFECTOR] = (on_platform(END_EFFECTOR), precession + pivot * kappa_rate);
    out
}

/// Velocity-product accelerations of both ends of a strut and the rate of its axis.
fn strut_ends(motion: &Motion, s: usize) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
    let platform = &motion.bodies[PLATFORM];
    let arm = &motion.bodies[ARM + s / 2];
    let strut = &motion.bodies[STRUT + s];
    let centripetal = |omega: &Vector3<f64>, r: &Vector3<f64>| omega.cross(&omega.cross(r));
    let ball = strut.position + motion.strut_axis[s] * motion.strut_length[s] - platform.position;
    (
        centripetal(&arm.angular_velocity, &(strut.position - arm.position)),
        centripetal(&platform.angular_velocity, &ball),
        strut.angular_velocity.cross(&motion.strut_axis[s]),
    )
}

/// Accelerations and strut forces for given loads and drive torques.
///
/// `extra` are additional generalised forces on arms, rotor and strut spins (the integrator's implicit terms), and
/// `spin_inertia` the struts' inertia about their axis including implicit damping.
pub(super) fn accelerations(
    plant: &Plant,
    motion: &Motion,
    condensed: &Condensed,
    loads: &Loads,
    tau: &[f64; 4],
    extra: &Damping,
    spin_inertia: &[f64; STRUTS],
    spin_damping: f64,
) -> Accelerations {
    let gravity = plant.gravity_vector();
    let bias = bias(motion);
    let levers = Levers::new(motion);
    let mut f = OpenVector::zeros();
    // Applied minus inertial wrench of each body at ν̇ = 0.
    let mut net = [STILL; BODIES];
    for b in 0..BODIES {
        let mut m = motion.bodies[b];
        (m.acceleration, m.angular_acceleration) = bias[b];
        let (force, moment) = inertial_wrench(&plant.bodies[b], &m, &gravity);
        net[b] = (loads.wrenches[b].0 - force, loads.wrenches[b].1 - moment);
    }
    for i in 0..ARMS {
        f[i] = net[ARM + i].1.dot(&Geometry::tangential(i)) + tau[i] + extra.drives[i];
    }
    f[ROTOR_RATE] = net[ROTOR].1.z + tau[3] + extra.drives[3];
    let mut c = SVector::<f64, STRUTS>::zeros();
    for s in 0..STRUTS {
        let u = motion.strut_axis[s];
        let (force, moment) = net[STRUT + s];
        // Moment about the upper ball acts on the swing ω = u × (v_l − v_u)/L.
        let lateral = moment.cross(&u) / motion.strut_length[s];
        f[s / 2] += force.dot(&levers.elbow[s]) - lateral.dot(&levers.elbow[s]);
        add_platform(&mut f, &lateral, &levers.ball[s].cross(&lateral));
        let (upper, lower, axis_rate) = strut_ends(motion, s);
        c[s] = -u.dot(&(lower - upper)) - motion.strut_length[s] * axis_rate.norm_squared();
    }
    add_platform(&mut f, &net[PLATFORM].0, &net[PLATFORM].1);
    for (k, column) in levers.chain.iter().enumerate() {
        let row = if k == 0 { ROTOR_RATE } else { ROTOR_RATE + k };
        for (b, body) in CHAIN.into_iter().enumerate() {
            f[row] += column[b].0.dot(&net[body].0) + column[b].1.dot(&net[body].1);
        }
    }
    let (nu_rate, tension) = condensed.solve(&f, &c);
    let mut spins = [0.0; STRUTS];
    for s in 0..STRUTS {
        let u = motion.strut_axis[s];
        let restraint = -spin_damping * motion.bodies[STRUT + s].angular_velocity.dot(&u);
        spins[s] = (net[STRUT + s].1.dot(&u) + restraint + extra.spins[s]) / spin_inertia[s];
    }
    let mut bodies = twists(motion, &nu_rate, &spins);
    for b in 0..BODIES {
        bodies[b].0 += bias[b].0;
        bodies[b].1 += bias[b].1;
    }
    let mut reactions = Reactions::default();
    for s in 0..STRUTS {
        let b = STRUT + s;
        let mut m = motion.bodies[b];
        (m.acceleration, m.angular_acceleration) = bodies[b];
        let (force, _) = inertial_wrench(&plant.bodies[b], &m, &gravity);
        let demand = (force - loads.wrenches[b].0).dot(&motion.strut_axis[s]);
        reactions.lower[s] = tension[s];
        reactions.upper[s] = tension[s] - demand;
    }
    Accelerations { bodies, spins, reactions }
}

fn add_platform(f: &mut OpenVector, force: &Vector3<f64>, moment: &Vector3<f64>) {
    let mut v = f.fixed_rows_mut::<3>(PLATFORM_V);
    v += force;
    let mut w = f.fixed_rows_mut::<3>(PLATFORM_V + 3);
    w += moment;
}
