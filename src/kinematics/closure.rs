//! Loop closure of any number of limbs that carry any plate, and its solution for the plate.
//!
//! Closure of limb i: f = (|l|² − l₂²)/2 = 0 with l = p + b(ψ) − e(q), b the middle of its lower ball pair relative to the
//! plate's origin. Unknown for given drives are the position p, ψ where the plate turns, and the common angle of passive arms,
//! which are coupled: all have the same angle.

use nalgebra::{Matrix4, Vector3, Vector4};

use super::arm::Arm;
use super::delta::{JointState, KinematicsError, PlatformState};
use super::motion::Motion;
use crate::machine::bodies::arm;
use crate::machine::plate::PartPlace;
use crate::machine::{Geometry, Limb, PerAxis, PerLimb, each};

/// Middle of a limb's lower ball pair relative to the plate's origin.
#[derive(Clone, Copy, Default)]
pub(crate) struct Pair {
    /// m.
    pub offset: Vector3<f64>,
    /// First derivative with respect to ψ, m/rad.
    pub slope: Vector3<f64>,
    /// Second derivative with respect to ψ, m/rad².
    pub curvature: Vector3<f64>,
}

impl Pair {
    /// The pair of `limb` where the part that carries it is at `place`.
    #[inline]
    fn on(limb: &Limb, place: &PartPlace) -> Self {
        let point = place.rotation * limb.point;
        let across = Vector3::z().cross(&point) * place.turning;
        Self {
            offset: place.origin + point,
            slope: place.slope + across,
            curvature: place.curvature + Vector3::z().cross(&across) * place.turning,
        }
    }

    /// Third derivative with respect to ψ, m/rad³: only what turns has a second one.
    pub fn third(&self) -> Vector3<f64> {
        Vector3::z().cross(&self.curvature)
    }
}

/// The plate and the passive arms at given drives, or their rates.
#[derive(Clone, Copy, Default)]
pub(crate) struct Closed {
    /// Origin of the plate, m.
    pub position: Vector3<f64>,
    /// Coordinate of the plate, rad.
    pub psi: f64,
    /// Common angle of the passive arms, rad or m.
    pub passive: f64,
}

/// Linearised closure: rows of limbs, columns of as many unknowns.
struct Rows {
    matrix: Matrix4<f64>,
    unknowns: usize,
    turns: bool,
}

/// The machine at given drives: its arms, and the plate at a pose at which the closure is linearised.
struct Linkage<'a> {
    geometry: &'a Geometry,
    /// Angles of all arms, rad or m.
    q: PerAxis<f64>,
    arms: PerLimb<Arm>,
    at: Closed,
    pairs: PerLimb<Pair>,
    /// Strut vectors l, m.
    struts: PerLimb<Vector3<f64>>,
    rows: Rows,
    /// (|l|² − l₂²)/2 of every limb, m².
    values: Vector4<f64>,
}

/// Newton steps, far beyond the few that a regular pose takes.
const MOST_STEPS: usize = 50;
/// Poses between equal arms and the given ones, where the direct way leads to another assembly.
const STAGES: usize = 16;
/// Length of a last step relative to the struts: the convergence is quadratic, so that the step leaves far less than rounding.
const CONVERGED: f64 = 1e-10;

impl Geometry {
    /// The lower ball pair of `limb` at ψ (rad).
    #[inline]
    pub(crate) fn pair(&self, limb: &Limb, psi: f64) -> Pair {
        if !self.plate.turns() {
            return Pair { offset: limb.point, ..Pair::default() };
        }
        Pair::on(limb, &self.plate.part(limb.part).at(psi))
    }

    /// Sets the lower ball pairs of all limbs at ψ (rad).
    #[inline]
    fn set_pairs(&self, psi: f64, pairs: &mut PerLimb<Pair>) {
        if !self.plate.turns() {
            self.limbs.iter().zip(pairs).for_each(|(limb, pair)| pair.offset = limb.point);
            return;
        }
        let (first, second) = (self.plate.part(0).at(psi), self.plate.part(1).at(psi));
        for (limb, pair) in self.limbs.iter().zip(pairs) {
            *pair = Pair::on(limb, if limb.part == 0 { &first } else { &second });
        }
    }

    /// Number of driven limbs.
    pub(crate) fn driven(&self) -> usize {
        self.limbs.iter().filter(|limb| limb.driven).count()
    }

    /// Number of coordinates that the limbs must determine while the drives are locked: three of the place, ψ where the plate
    /// turns, and the common angle of passive arms.
    pub fn unknowns(&self) -> usize {
        3 + usize::from(self.plate.turns()) + usize::from(self.driven() < self.limbs.len())
    }

    /// Number of struts beyond those that hold plate and passive arms while the drives are locked: prestress of so many
    /// combinations of struts does not show outside.
    pub fn redundant_struts(&self) -> usize {
        let passive = usize::from(self.driven() < self.limbs.len());
        (2 * self.limbs.len()).saturating_sub(6 + self.plate.freedoms(0.0).len() + passive)
    }

    /// Determinant of the closure at a pose (m, rad) over the one at ψ = 0 at the same place: 0 where the drives lose the plate.
    /// It is 1 where the plate has no coordinate of its own.
    ///
    /// # Errors
    /// [`KinematicsError::OutOfReach`] as in [`Self::inverse`].
    pub fn determinacy(&self, position: &Vector3<f64>, psi: f64) -> Result<f64, KinematicsError> {
        if !self.plate.turns() {
            return Ok(1.0);
        }
        let at = |psi: f64| {
            let q = self.inverse(position, psi)?;
            Ok(self.determinant(&q, &Closed { position: *position, psi, passive: 0.0 }))
        };
        Ok(at(psi)? / at(0.0)?)
    }

    /// Determinant of the closure at the angles of all arms (rad or m) and the pose of the plate over the one with all drives at
    /// zero: zero where the drives lose the plate.
    pub fn closure_share(&self, q: &[f64], platform: &PlatformState) -> f64 {
        let passive = |q: &[f64]| self.limbs.iter().position(|limb| !limb.driven).map_or(0.0, |first| q[first]);
        let at = |q: &[f64], platform: &PlatformState| {
            let at = Closed { position: platform.position, psi: platform.psi[0], passive: passive(q) };
            self.determinant(q, &at)
        };
        let home = self.complete(&JointState::default()).map_or(1.0, |(joints, platform)| at(&joints.q, &platform));
        at(q, platform) / home
    }

    /// Angles of all arms (rad or m) with those of the passive ones equal to `passive`.
    fn with_passive(&self, q: &[f64], passive: f64) -> PerAxis<f64> {
        let mut all: PerAxis<f64> = each(0.0);
        for (i, limb) in self.limbs.iter().enumerate() {
            all[i] = if limb.driven { q[i] } else { passive };
        }
        all
    }

    /// Determinant of the closure at the given drives (rad or m) and a pose.
    fn determinant(&self, q: &[f64], at: &Closed) -> f64 {
        Linkage::new(self, q, *at).rows.determinant()
    }

    /// The plate and the passive arms at the given angles of the drives (rad or m), in the assembly with the plate below its
    /// elbows in which ψ = 0 at equal arms, or in that of the pose `near`, if it leads there.
    ///
    /// # Errors
    /// [`KinematicsError::NoClosure`] if the struts reach no common plate.
    pub(crate) fn closed(&self, q: &[f64], near: Option<&Closed>) -> Result<Closed, KinematicsError> {
        Ok(self.linkage(q, near)?.at)
    }

    /// [`Self::closed`] with the arms and the closure there.
    fn linkage(&self, q: &[f64], near: Option<&Closed>) -> Result<Linkage<'_>, KinematicsError> {
        let starts = near.map(|at| Linkage::new(self, q, *at)).into_iter();
        for mut linkage in starts.chain(std::iter::once_with(|| Linkage::guess(self, q))) {
            let side = linkage.rows.determinant();
            if linkage.close() && side * linkage.rows.determinant() > 0.0 {
                return Ok(linkage);
            }
        }
        self.stepwise(q).ok_or_else(|| KinematicsError::NoClosure { q: q[..self.driven()].into() })
    }

    /// [`Self::linkage`] by way of poses that start at equal arms.
    fn stepwise(&self, q: &[f64]) -> Option<Linkage<'_>> {
        let driven = self.driven();
        let mean = q[..driven].iter().sum::<f64>() / driven as f64;
        let means: PerAxis<f64> = each(mean);
        let mut linkage = Linkage::guess(self, &means);
        linkage.close().then_some(())?;
        let side = linkage.rows.determinant();
        for stage in 1..=STAGES {
            let share = stage as f64 / STAGES as f64;
            let between: PerAxis<f64> =
                std::array::from_fn(|i| mean + share * (q.get(i).copied().unwrap_or(mean) - mean));
            linkage = Linkage::new(self, &between, linkage.at);
            linkage.close().then_some(())?;
        }
        (side * linkage.rows.determinant() > 0.0).then_some(linkage)
    }

    /// Motion of all arms, passive ones included, and of the plate for a motion of the drives.
    ///
    /// # Errors
    /// [`KinematicsError::NoClosure`] as in [`Self::forward`]; [`KinematicsError::Singular`] if the drives do not determine
    /// the motion of the plate.
    pub fn complete(&self, joints: &JointState) -> Result<(JointState, PlatformState), KinematicsError> {
        self.complete_near(joints, None)
    }

    /// [`Self::complete`] in the assembly of the pose `near`, if it leads to the given drives.
    ///
    /// # Errors
    /// As [`Self::complete`].
    #[inline]
    pub(super) fn complete_near(
        &self,
        joints: &JointState,
        near: Option<&Closed>,
    ) -> Result<(JointState, PlatformState), KinematicsError> {
        match self.has_platform_of_three() {
            true => Ok((*joints, self.forward_motion(joints)?)),
            false => self.complete_any(joints, near),
        }
    }

    fn complete_any(
        &self,
        joints: &JointState,
        near: Option<&Closed>,
    ) -> Result<(JointState, PlatformState), KinematicsError> {
        let linkage = self.linkage(&joints.q, near)?;
        let Linkage { q, arms, at, pairs, struts, rows, .. } = &linkage;
        let inverse =
            rows.inverse().ok_or_else(|| KinematicsError::Singular { q: joints.q[..self.driven()].into() })?;
        let solve = |right: &dyn Fn(usize) -> f64| {
            let mut out = Closed::default();
            let right = Vector4::from_fn(|i, _| if i < rows.unknowns { right(i) } else { 0.0 });
            out.add(&(inverse * right), self.plate.turns());
            out
        };
        let driving = |i: usize, rate: &PerAxis<f64>| if self.limbs[i].driven { rate[i] } else { 0.0 };
        let first = solve(&|i| struts[i].dot(&arms[i].slope) * driving(i, &joints.qd));
        let qd = self.with_passive(&joints.qd, first.passive);
        let second = solve(&|i| {
            let (arm, pair, l) = (&arms[i], &pairs[i], &struts[i]);
            let ld = first.position + pair.slope * first.psi - arm.slope * qd[i];
            let own = arm.slope * driving(i, &joints.qdd) + arm.curvature * (qd[i] * qd[i]);
            l.dot(&(own - pair.curvature * (first.psi * first.psi))) - ld.norm_squared()
        });
        let platform = PlatformState {
            position: at.position,
            velocity: first.position,
            acceleration: second.position,
            psi: [at.psi, first.psi, second.psi],
        };
        Ok((JointState { q: *q, qd, qdd: self.with_passive(&joints.qdd, second.passive) }, platform))
    }

    /// Rates of the plate and of the passive arms per unit rate of each drive, at a pose of an assembled machine.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] if the drives do not determine the motion of the plate.
    pub(crate) fn rates_per_drive(&self, motion: &Motion) -> Result<PerLimb<Closed>, KinematicsError> {
        let mut pairs: PerLimb<_> = each(Pair::default());
        self.set_pairs(motion.plate_angle(), &mut pairs);
        let mut rows = Rows::new(self);
        let mut levers: PerLimb<f64> = each(0.0);
        for (i, limb) in self.limbs.iter().enumerate() {
            let arm = Arm::of(limb, &motion.bodies[arm(i)]);
            let l = motion.strut_axis[2 * i] * motion.strut_length[2 * i];
            levers[i] = l.dot(&arm.slope);
            rows.set(i, &l, l.dot(&pairs[i].slope), if limb.driven { 0.0 } else { levers[i] });
        }
        let inverse =
            rows.inverse().ok_or_else(|| KinematicsError::Singular { q: motion.q[..motion.driven].into() })?;
        let mut rates: PerLimb<_> = each(Closed::default());
        for (i, rate) in rates.iter_mut().enumerate().take(motion.driven) {
            rate.add(&(inverse.column(i) * levers[i]), self.plate.turns());
        }
        Ok(rates)
    }

    /// The motion with the platform where coupled passive arms hold it: displaced from `platform` along the difference of their
    /// limbs' radial axes until both passive arms have the same angle. Without passive arms it is `platform`.
    ///
    /// # Errors
    /// [`KinematicsError::OutOfReach`] as in [`Self::inverse`].
    pub fn settled(&self, platform: &PlatformState) -> Result<PlatformState, KinematicsError> {
        let mut out = *platform;
        // All limbs before `first` are driven, and two at most are not.
        let (first, count) = (self.driven(), self.limbs.len());
        if count < first + 2 {
            return Ok(out);
        }
        let way = (self.limbs[first].radial() - self.limbs[first + 1].radial()).normalize();
        let both = |out: &PlatformState, q: &PerAxis<f64>| [first, first + 1].map(|i| self.limb_step(i, q[i], out));
        let mut q = self.inverse(&out.position, out.psi[0])?;
        // Difference of both angles per displacement along the way.
        let mut slope = f64::NAN;
        for _ in 0..MOST_STEPS {
            let [a, b] = both(&out, &q);
            slope = way.dot(&(a.strut / a.serial - b.strut / b.serial));
            let step = (q[first] - q[first + 1]) / slope;
            out.position -= way * step;
            q = self.inverse(&out.position, out.psi[0])?;
            if step.abs() <= 1e-15 {
                break;
            }
        }
        let [a, b] = both(&out, &q);
        out.velocity -= way * ((a.rate - b.rate) / slope);
        let [a, b] = both(&out, &q);
        out.acceleration -= way * ((a.acceleration - b.acceleration) / slope);
        Ok(out)
    }
}

impl Closed {
    /// Number of its coordinates.
    pub const LENGTH: usize = 5;

    /// Of its coordinates, or their rates, in a state.
    ///
    /// # Panics
    /// If there are fewer than [`Self::LENGTH`].
    pub fn of(y: &[f64]) -> Self {
        Self { position: Vector3::new(y[0], y[1], y[2]), psi: y[3], passive: y[4] }
    }

    /// Its coordinates, or their rates, for a state.
    pub fn coordinates(&self) -> [f64; Self::LENGTH] {
        [self.position.x, self.position.y, self.position.z, self.psi, self.passive]
    }

    /// Adds a step of the unknowns.
    fn add(&mut self, step: &Vector4<f64>, turns: bool) {
        self.position += step.fixed_rows::<3>(0);
        if turns { self.psi += step[3] } else { self.passive += step[3] }
    }
}

impl<'a> Linkage<'a> {
    /// The machine with its drives at `q` (rad or m) and its plate at `at`.
    fn new(geometry: &'a Geometry, q: &[f64], at: Closed) -> Self {
        let q = geometry.with_passive(q, at.passive);
        let mut linkage = Self {
            geometry,
            q,
            arms: each(Arm::new(&geometry.limbs[0], q[0])),
            at,
            pairs: each(Pair::default()),
            struts: each(Vector3::zeros()),
            rows: Rows::new(geometry),
            values: Vector4::zeros(),
        };
        for (i, limb) in geometry.limbs.iter().enumerate().skip(1) {
            linkage.arms[i] = Arm::new(limb, q[i]);
        }
        linkage.linearise();
        linkage
    }

    /// The plate in the middle of the elbows, below them.
    fn guess(geometry: &'a Geometry, q: &[f64]) -> Self {
        let driven = geometry.driven();
        let passive = q[..driven].iter().sum::<f64>() / driven as f64;
        let mut linkage = Self::new(geometry, q, Closed { passive, ..Closed::default() });
        // At the origin with ψ = 0 the strut vectors lead from the elbows to the pairs.
        let centres = || linkage.struts.iter().take(geometry.limbs.len()).map(|l| -l);
        let count = geometry.limbs.len() as f64;
        let middle = centres().sum::<Vector3<f64>>() / count;
        let away = centres().map(|c| (c - middle).xy().norm_squared()).sum::<f64>() / count;
        let length = geometry.limbs.iter().map(|limb| limb.strut_length).sum::<f64>() / count;
        let below = (length * length - away).max(0.01 * length * length).sqrt();
        linkage.at.position = middle - Vector3::z() * below;
        linkage.linearise();
        linkage
    }

    /// Sets passive arms and closure at the present pose of the plate.
    fn linearise(&mut self) {
        let Self { geometry, at, .. } = self;
        geometry.set_pairs(at.psi, &mut self.pairs);
        for (i, limb) in geometry.limbs.iter().enumerate() {
            if !limb.driven {
                self.q[i] = at.passive;
                self.arms[i] = Arm::new(limb, at.passive);
            }
            let (arm, pair) = (&self.arms[i], &self.pairs[i]);
            let l = at.position + pair.offset - arm.elbow;
            self.rows.set(i, &l, l.dot(&pair.slope), if limb.driven { 0.0 } else { l.dot(&arm.slope) });
            self.values[i] = 0.5 * (l.norm_squared() - limb.strut_length * limb.strut_length);
            self.struts[i] = l;
        }
    }

    /// Moves the plate by Newton's method until the loops are closed; false if they are not, or the pose is singular.
    fn close(&mut self) -> bool {
        let length = self.geometry.limbs.iter().map(|limb| limb.strut_length).fold(0.0, f64::max);
        for _ in 0..MOST_STEPS {
            let Some(inverse) = self.rows.inverse() else { return false };
            let step = inverse * -self.values;
            // Far from the solution no step is longer than a fifth of a strut, or turns by more than half a radian.
            let (far, turn) = (step.fixed_rows::<3>(0).norm() / (0.2 * length), step[3].abs() / 0.5);
            let size = far.max(if self.rows.unknowns > 3 { turn } else { 0.0 });
            self.at.add(&(step / size.max(1.0)), self.rows.turns);
            self.linearise();
            if size < CONVERGED {
                return self.values.amax() < 1e-9 * length * length;
            }
        }
        false
    }
}

impl Rows {
    fn new(geometry: &Geometry) -> Self {
        Self { matrix: Matrix4::zeros(), unknowns: geometry.unknowns(), turns: geometry.plate.turns() }
    }

    /// Sets row `i`: the strut vector l, l·∂b/∂ψ, and of a passive arm l·∂e/∂q, else zero.
    fn set(&mut self, i: usize, l: &Vector3<f64>, turning: f64, passive: f64) {
        self.matrix.fixed_view_mut::<1, 3>(i, 0).copy_from(&l.transpose());
        if self.turns {
            self.matrix[(i, 3)] = turning;
        }
        if self.unknowns > 3 + usize::from(self.turns) {
            self.matrix[(i, self.unknowns - 1)] = -passive;
        }
    }

    fn inverse(&self) -> Option<Matrix4<f64>> {
        self.padded().try_inverse()
    }

    /// The matrix with ones on the diagonal after the last unknown.
    fn padded(&self) -> Matrix4<f64> {
        let mut matrix = self.matrix;
        (self.unknowns..4).for_each(|i| matrix[(i, i)] += 1.0);
        matrix
    }

    /// Its sign distinguishes assemblies.
    fn determinant(&self) -> f64 {
        let matrix = self.padded();
        let row = |i: usize| matrix.fixed_view::<1, 3>(i % 4, 0).transpose();
        // Along the last column; the three rows after one, cyclically, are an even permutation of the rows that are left.
        let cofactor = |i: usize| row(i + 1).dot(&row(i + 2).cross(&row(i + 3)));
        (0..4).map(|i| if i % 2 == 0 { -1.0 } else { 1.0 } * matrix[(i, 3)] * cofactor(i)).sum()
    }
}
