//! Loop closure of any number of limbs that carry any plate, and its solution for the plate.
//!
//! Closure of limb i: f = (|l|² − l₂²)/2 = 0 with l = p + b(ψ) − e(q), b the middle of its lower ball pair relative to the
//! plate's origin. Unknown for given drives are the position p, ψ where the plate turns, and the common angle of passive arms,
//! which are coupled: all have the same angle.

use nalgebra::{Matrix4, Vector3, Vector4};

use super::arm::Arm;
use super::delta::{JointState, KinematicsError, PlatformState};
use crate::machine::{AXES, Geometry, Limb};

/// Middle of a limb's lower ball pair relative to the plate's origin.
#[derive(Clone, Copy)]
pub(crate) struct Pair {
    /// m.
    pub offset: Vector3<f64>,
    /// First derivative with respect to ψ, m/rad.
    pub slope: Vector3<f64>,
    /// Second derivative with respect to ψ, m/rad².
    pub curvature: Vector3<f64>,
}

impl Pair {
    /// Third derivative with respect to ψ, m/rad³: only what turns has a second one.
    pub fn third(&self) -> Vector3<f64> {
        Vector3::z().cross(&self.curvature)
    }
}

/// The plate and the passive arms at given drives.
#[derive(Clone, Copy, Default)]
pub(super) struct Closed {
    /// Origin of the plate, m.
    pub position: Vector3<f64>,
    /// Coordinate of the plate, rad.
    pub psi: f64,
    /// Common angle of the passive arms, rad or m.
    pub passive: f64,
}

/// Linearised closure: rows of limbs, columns of the unknowns.
struct Rows {
    matrix: Matrix4<f64>,
    limbs: usize,
    unknowns: usize,
}

/// Newton steps, far beyond the few that a regular pose takes.
const MOST_STEPS: usize = 50;
/// Poses between equal arms and the given ones, where the direct way leads to another assembly.
const STAGES: usize = 16;
/// Length of a last step relative to the struts.
const CONVERGED: f64 = 1e-15;

impl Geometry {
    /// The lower ball pair of `limb` at ψ (rad).
    #[inline]
    pub(crate) fn pair(&self, limb: &Limb, psi: f64) -> Pair {
        if !self.plate.turns() {
            let zero = Vector3::zeros();
            return Pair { offset: limb.point, slope: zero, curvature: zero };
        }
        let place = self.plate.part(limb.part).at(psi);
        let point = place.rotation * limb.point;
        let across = Vector3::z().cross(&point) * place.turning;
        Pair {
            offset: place.origin + point,
            slope: place.slope + across,
            curvature: place.curvature + Vector3::z().cross(&across) * place.turning,
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
            Ok(self.rows(&q, &Closed { position: *position, psi, passive: 0.0 }).0.determinant())
        };
        Ok(at(psi)? / at(0.0)?)
    }

    /// Determinant of the closure at the angles of all arms (rad or m) and the pose of the plate over the one with all drives at
    /// zero, of its normal matrix where there are more limbs than unknowns: zero where the drives lose the plate.
    pub fn closure_share(&self, q: &[f64], platform: &PlatformState) -> f64 {
        let passive = |q: &[f64]| self.limbs.iter().position(|limb| !limb.driven).map_or(0.0, |first| q[first]);
        let at = |q: &[f64], platform: &PlatformState| {
            let at = Closed { position: platform.position, psi: platform.psi[0], passive: passive(q) };
            self.rows(q, &at).0.determinant()
        };
        let home = self.complete(&JointState::default()).map_or(1.0, |(joints, platform)| at(&joints.q, &platform));
        at(q, platform) / home
    }

    /// Angles of all arms (rad or m) with those of the passive ones equal to `passive`.
    fn with_passive(&self, q: &[f64], passive: f64) -> [f64; AXES] {
        let mut all = [0.0; AXES];
        for (i, limb) in self.limbs.iter().enumerate() {
            all[i] = if limb.driven { q[i] } else { passive };
        }
        all
    }

    /// Closure of the limbs at `at`: its linearisation and its values.
    fn rows(&self, q: &[f64], at: &Closed) -> (Rows, Vector4<f64>) {
        let mut rows = Rows { matrix: Matrix4::zeros(), limbs: self.limbs.len(), unknowns: self.unknowns() };
        let mut values = Vector4::zeros();
        let all = self.with_passive(q, at.passive);
        for (i, limb) in self.limbs.iter().enumerate() {
            let (arm, pair) = (Arm::new(limb, all[i]), self.pair(limb, at.psi));
            let l = at.position + pair.offset - arm.elbow;
            rows.matrix.fixed_view_mut::<1, 3>(i, 0).copy_from(&l.transpose());
            let mut column = 3;
            if self.plate.turns() {
                rows.matrix[(i, column)] = l.dot(&pair.slope);
                column += 1;
            }
            if !limb.driven {
                rows.matrix[(i, column)] = -l.dot(&arm.slope);
            }
            values[i] = 0.5 * (l.norm_squared() - limb.strut_length * limb.strut_length);
        }
        (rows, values)
    }

    /// The plate in the middle of the elbows, below them.
    fn guess(&self, q: &[f64]) -> Closed {
        let driven = self.driven();
        let passive = q[..driven].iter().sum::<f64>() / driven as f64;
        let all = self.with_passive(q, passive);
        let centre = |(limb, q): (&Limb, &f64)| Arm::new(limb, *q).elbow - self.pair(limb, 0.0).offset;
        let centres = || self.limbs.iter().zip(&all).map(centre);
        let count = self.limbs.len() as f64;
        let middle = centres().sum::<Vector3<f64>>() / count;
        let away = centres().map(|c| (c - middle).xy().norm_squared()).sum::<f64>() / count;
        let length = self.limbs.iter().map(|limb| limb.strut_length).sum::<f64>() / count;
        let below = (length * length - away).max(0.01 * length * length).sqrt();
        Closed { position: middle - Vector3::z() * below, psi: 0.0, passive }
    }

    /// The plate and the passive arms at the given angles of the drives (rad or m), in the assembly with the plate below its
    /// elbows in which ψ = 0 at equal arms.
    ///
    /// # Errors
    /// [`KinematicsError::NoClosure`] if the struts reach no common plate.
    pub(super) fn closed(&self, q: &[f64]) -> Result<Closed, KinematicsError> {
        let start = self.guess(q);
        let side = |q: &[f64], at: &Closed| self.rows(q, at).0.determinant();
        let direct = self.newton(q, start).filter(|at| side(q, &start) * side(q, at) > 0.0);
        let stepwise = || {
            let driven = self.driven();
            let mean = q[..driven].iter().sum::<f64>() / driven as f64;
            let equal = [mean; AXES];
            let home = self.newton(&equal, self.guess(&equal))?;
            let end = (1..=STAGES).try_fold(home, |at, stage| {
                let share = stage as f64 / STAGES as f64;
                let between: [f64; AXES] =
                    std::array::from_fn(|i| mean + share * (q.get(i).copied().unwrap_or(mean) - mean));
                self.newton(&between, at)
            })?;
            (side(&equal, &home) * side(q, &end) > 0.0).then_some(end)
        };
        direct.or_else(stepwise).ok_or_else(|| KinematicsError::NoClosure { q: q[..self.driven()].into() })
    }

    fn newton(&self, q: &[f64], mut at: Closed) -> Option<Closed> {
        let length = self.limbs.iter().map(|limb| limb.strut_length).fold(0.0, f64::max);
        let mut best = f64::INFINITY;
        for _ in 0..MOST_STEPS {
            let (rows, values) = self.rows(q, &at);
            let step = rows.solve(&-values)?;
            // Far from the solution no step is longer than a fifth of a strut, or turns by more than half a radian.
            let (far, turn) = (step.fixed_rows::<3>(0).norm() / (0.2 * length), step[3].abs() / 0.5);
            let size = far.max(if rows.unknowns > 3 { turn } else { 0.0 });
            at.add(&(step / size.max(1.0)), self.plate.turns());
            if size < CONVERGED || (size < 1e-10 && size >= best) {
                let left = self.rows(q, &at).1.amax();
                return (left < 1e-9 * length * length).then_some(at);
            }
            best = best.min(size);
        }
        None
    }

    /// Motion of all arms, passive ones included, and of the plate for a motion of the drives.
    ///
    /// # Errors
    /// [`KinematicsError::NoClosure`] as in [`Self::forward`]; [`KinematicsError::Singular`] if the drives do not determine
    /// the motion of the plate.
    pub fn complete(&self, joints: &JointState) -> Result<(JointState, PlatformState), KinematicsError> {
        if self.has_platform_of_three() {
            return Ok((*joints, self.forward_motion(joints)?));
        }
        let at = self.closed(&joints.q)?;
        let singular = || KinematicsError::Singular { q: joints.q[..self.driven()].into() };
        let (rows, _) = self.rows(&joints.q, &at);
        let all = JointState { q: self.with_passive(&joints.q, at.passive), ..*joints };
        let arms = |i: usize| (Arm::new(&self.limbs[i], all.q[i]), self.pair(&self.limbs[i], at.psi));
        let strut = |i: usize| at.position + arms(i).1.offset - arms(i).0.elbow;
        let right = |value: &dyn Fn(usize) -> f64| {
            let mut out = Vector4::zeros();
            (0..self.limbs.len()).for_each(|i| out[i] = value(i));
            out
        };
        let driving = |i: usize, rate: &[f64; AXES]| if self.limbs[i].driven { rate[i] } else { 0.0 };
        let rates =
            rows.solve(&right(&|i| strut(i).dot(&arms(i).0.slope) * driving(i, &joints.qd))).ok_or_else(singular)?;
        let mut first = Closed::default();
        first.add(&rates, self.plate.turns());
        let qd = self.with_passive(&joints.qd, first.passive);
        let second = right(&|i| {
            let ((arm, pair), l) = (arms(i), strut(i));
            let ld = first.position + pair.slope * first.psi - arm.slope * qd[i];
            let own = arm.slope * driving(i, &joints.qdd) + arm.curvature * (qd[i] * qd[i]);
            l.dot(&(own - pair.curvature * (first.psi * first.psi))) - ld.norm_squared()
        });
        let mut accelerations = Closed::default();
        accelerations.add(&rows.solve(&second).ok_or_else(singular)?, self.plate.turns());
        let platform = PlatformState {
            position: at.position,
            velocity: first.position,
            acceleration: accelerations.position,
            psi: [at.psi, first.psi, accelerations.psi],
        };
        Ok((JointState { qd, qdd: self.with_passive(&joints.qdd, accelerations.passive), ..all }, platform))
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
        let both = |out: &PlatformState, q: &[f64; AXES]| [first, first + 1].map(|i| self.limb_step(i, q[i], out));
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
    /// Adds a step of the unknowns.
    fn add(&mut self, step: &Vector4<f64>, turns: bool) {
        self.position += step.fixed_rows::<3>(0);
        if turns { self.psi += step[3] } else { self.passive += step[3] }
    }
}

impl Rows {
    /// Solution of the rows: exact for as many limbs as unknowns, of least squares for more.
    fn solve(&self, right: &Vector4<f64>) -> Option<Vector4<f64>> {
        if self.limbs == self.unknowns {
            return self.padded(self.matrix).lu().solve(right);
        }
        let square = self.padded(self.matrix.tr_mul(&self.matrix));
        square.cholesky().map(|c| c.solve(&self.matrix.tr_mul(right)))
    }

    /// The matrix with ones on the diagonal after the last unknown.
    fn padded(&self, mut matrix: Matrix4<f64>) -> Matrix4<f64> {
        (self.unknowns..4).for_each(|i| matrix[(i, i)] += 1.0);
        matrix
    }

    /// Its sign distinguishes assemblies.
    fn determinant(&self) -> f64 {
        match self.limbs == self.unknowns {
            true => self.padded(self.matrix).determinant(),
            false => self.padded(self.matrix.tr_mul(&self.matrix)).determinant(),
        }
    }
}
