//! Virtual motions of a plate and the strut forces that balance it, for any number of limbs and any plate.
//!
//! Coordinates: translation and rotation of the plate as a whole, then its inner freedoms ([`Plate::freedoms`]), then the common
//! coordinate of coupled passive arms. With G the rates of the gaps at all struts per coordinate and W the loads on the
//! coordinates, the axial forces T at the lower balls satisfy Gᵀ T = W. Where there are more struts than coordinates, they are
//! those of elastic struts, all equally stiff and without prestress, in the limit of infinite stiffness: T = G (GᵀG)⁻¹ W, the
//! solution with the least Σ T².
//!
//! [`Plate::freedoms`]: crate::machine::Plate::freedoms

use nalgebra::{Cholesky, SVector, U8, Vector3};

use super::motion::{STILL, Twist};
use super::{KinematicsError, Motion};
use crate::machine::bodies::{PLATFORM, SLOTS};
use crate::machine::plate::MAX_PARTS;
use crate::machine::{Geometry, PerLimb, PerStrut, StrutList, StrutMatrix, StrutVector, each, every_strut};

/// Rates of, or loads on, the coordinates, at most as many as struts; the ones after the last are zero.
pub(crate) type Coordinates = StrutVector;

/// Per coordinate the twists of the parts.
type Twists = StrutList<[Twist; MAX_PARTS]>;

/// What inverts the gap rates of the coordinates.
enum Inverse {
    /// G⁻¹ of as many coordinates as struts.
    Exact(StrutMatrix),
    /// Root of GᵀG, with ones for the coordinates after the last.
    Least(Cholesky<f64, U8>),
}

/// Virtual motions of plate and passive arms at one pose.
pub(crate) struct PlateMotions {
    bodies: &'static [usize],
    twists: Twists,
    /// Gap rate at each strut per rate of its arm, negated: velocity of the upper ball along the strut.
    pub lever: PerStrut<f64>,
    /// Limbs with a passive arm.
    passive: std::ops::Range<usize>,
    inverse: Inverse,
    /// Gap rates at each strut (rows) per rate of the coordinates (columns), G.
    gaps: StrutMatrix,
}

/// Axial forces, N, to add to those at the lower balls of an assembled robot so that redundant struts are without prestress:
/// (G (GᵀG)⁻¹ Gᵀ − 1) T.
///
/// # Errors
/// Those of [`PlateMotions::new`].
pub(crate) fn without_prestress(
    geometry: &Geometry,
    motion: &Motion,
    lower: &PerStrut<f64>,
) -> Result<PerStrut<f64>, KinematicsError> {
    let plate = PlateMotions::new(geometry, motion)?;
    let tensions = SVector::from(*lower);
    let added = plate.forces(&plate.gaps.tr_mul(&tensions)) - tensions;
    Ok(added.into())
}

impl PlateMotions {
    /// Virtual motions of an assembled robot at the pose of `motion`.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] if the struts do not hold the plate while the drives are locked.
    pub fn new(geometry: &Geometry, motion: &Motion) -> Result<Self, KinematicsError> {
        let bodies = geometry.plate.bodies();
        let passive = motion.driven..motion.limbs;
        let mut twists = of_parts(geometry, motion);
        let own = twists.len();
        let singular = || KinematicsError::Singular { q: motion.q[..motion.driven].into() };
        if !passive.is_empty() {
            twists.try_push([STILL; MAX_PARTS]).map_err(|_| singular())?;
        }
        let part = |body: usize| bodies.iter().position(|&b| b == body).unwrap_or(0);
        let (mut gaps, mut lever) = (StrutMatrix::zeros(), each(0.0));
        for s in 0..motion.struts() {
            let (u, limb) = (&motion.strut_axis[s], s / 2);
            lever[s] = motion.upper_rate(s);
            let carrier = motion.carrier[s];
            let ball = motion.lower_ball(s) - motion.bodies[carrier].position;
            for (c, parts) in twists.iter().enumerate().take(own) {
                let (v, omega) = &parts[part(carrier)];
                gaps[(s, c)] = u.dot(&(v + omega.cross(&ball)));
            }
            if passive.contains(&limb) {
                gaps[(s, own)] = -lever[s];
            }
        }
        let count = twists.len();
        (count <= motion.struts()).then_some(()).ok_or_else(singular)?;
        let mut normal = gaps.tr_mul(&gaps);
        (count..every_strut().end).for_each(|c| normal[(c, c)] = 1.0);
        let inverse = match count == every_strut().end {
            true => gaps.try_inverse().map(Inverse::Exact),
            false => normal.cholesky().map(Inverse::Least),
        };
        Ok(Self { bodies, twists, lever, passive, inverse: inverse.ok_or_else(singular)?, gaps })
    }

    /// Rates of the coordinates per unit gap at strut `s` while the drives are locked.
    pub fn gap(&self, s: usize) -> Coordinates {
        match &self.inverse {
            Inverse::Exact(inverse) => inverse.column(s).into_owned(),
            Inverse::Least(root) => root.solve(&self.gaps.row(s).transpose()),
        }
    }

    /// Rates of the coordinates per unit gap at both struts of a limb while the drives are locked.
    pub fn gaps_of(&self, limb: usize) -> Coordinates {
        let [one, other] = [2 * limb, 2 * limb + 1];
        match &self.inverse {
            Inverse::Exact(inverse) => inverse.column(one) + inverse.column(other),
            Inverse::Least(root) => root.solve(&(self.gaps.row(one) + self.gaps.row(other)).transpose()),
        }
    }

    /// Axial forces at the lower balls, N, for loads on the coordinates.
    fn forces(&self, loads: &Coordinates) -> Coordinates {
        match &self.inverse {
            Inverse::Exact(inverse) => inverse.tr_mul(loads),
            Inverse::Least(root) => self.gaps * root.solve(loads),
        }
    }

    /// Writes the twists of the parts of the plate, and the rates of passive arms, at rates of the coordinates.
    pub fn spread(&self, rates: &Coordinates, arms: &mut PerLimb<f64>, xi: &mut [Twist; SLOTS]) {
        for (k, &body) in self.bodies.iter().enumerate() {
            xi[body] = STILL;
            for (parts, rate) in self.twists.iter().zip(rates.iter()) {
                xi[body].0 += parts[k].0 * *rate;
                xi[body].1 += parts[k].1 * *rate;
            }
        }
        if !self.passive.is_empty() {
            arms[self.passive.clone()].fill(rates[self.twists.len() - 1]);
        }
    }

    /// Axial forces at the lower balls, N, in balance with the wrenches on the parts of the plate, which include those that
    /// struts hand on, and with the efforts on the arms.
    pub fn balance(&self, wrenches: &[Twist; SLOTS], arms: &PerLimb<f64>) -> StrutVector {
        let mut loads = Coordinates::zeros();
        for (parts, load) in self.twists.iter().zip(loads.iter_mut()) {
            for (twist, &body) in parts.iter().zip(self.bodies) {
                *load += twist.0.dot(&wrenches[body].0) + twist.1.dot(&wrenches[body].1);
            }
        }
        if !self.passive.is_empty() {
            loads[self.twists.len() - 1] += arms[self.passive.clone()].iter().sum::<f64>();
        }
        self.forces(&loads)
    }
}

/// Twists of the parts of the plate per coordinate: three translations, three rotations about the origin of the first part,
/// then the inner freedoms.
fn of_parts(geometry: &Geometry, motion: &Motion) -> Twists {
    let bodies = geometry.plate.bodies();
    let origin = motion.bodies[PLATFORM].position;
    let mut all = Twists::new();
    let unit = |k: usize| Vector3::from_fn(|i, _| f64::from(u8::from(i == k)));
    all.extend((0..3).map(|k| [(unit(k), Vector3::zeros()); MAX_PARTS]));
    for axis in (0..3).map(unit) {
        let mut parts = [STILL; MAX_PARTS];
        for (part, &body) in parts.iter_mut().zip(bodies) {
            *part = (axis.cross(&(motion.bodies[body].position - origin)), axis);
        }
        all.push(parts);
    }
    let inner = geometry.plate.freedoms(motion.plate_angle()).into_iter();
    all.extend(inner.map(|parts| parts.map(|(v, rate)| (v, Vector3::z() * rate))));
    all
}
