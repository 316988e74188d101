//! Mass model of a strut as a rod between its balls, shared by both formulations of an elastic strut.

use crate::dynamics::Plant;
use crate::kinematics::Motion;
use crate::machine::Inertia;
use crate::machine::bodies::strut;

/// Masses of a rod whose velocity is linear from the upper ball a to the lower ball b:
/// T = ½·m_aa·v_a² + m_ab·v_a·v_b + ½·m_bb·v_b², the integrals of (1 − ξ)², ξ·(1 − ξ) and ξ² over its mass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rod {
    /// Unloaded length, m.
    pub length: f64,
    /// m_aa, kg.
    pub aa: f64,
    /// m_ab, kg.
    pub ab: f64,
    /// m_bb, kg.
    pub bb: f64,
    /// Inertia about its own axis, kg·m².
    pub axial: f64,
    /// Masses whose weight acts at the two ends, kg.
    pub weight: [f64; 2],
}

impl Rod {
    /// Rod of a body symmetric about its x axis, in the frame at its upper ball; `length` in m.
    pub fn new(inertia: &Inertia, length: f64) -> Self {
        let (h, i) = (inertia.first_moment.x / length, inertia.tensor[(1, 1)] / (length * length));
        Self {
            length,
            aa: inertia.mass - 2.0 * h + i,
            ab: h - i,
            bb: i,
            axial: inertia.tensor[(0, 0)],
            weight: [inertia.mass - h, h],
        }
    }

    /// Inertia about the upper ball at another length (m), in the strut's frame.
    pub fn stretched(&self, length: f64) -> Inertia {
        let lateral = self.bb * length * length;
        Inertia::diagonal(
            self.weight[0] + self.weight[1],
            [self.weight[1] * length, 0.0, 0.0],
            [self.axial, lateral, lateral],
        )
    }
}

/// Energy of stretched rods in excess of rigid ones with the same motion of the bodies, J; `rates` are the rates of
/// their lengths, m/s.
pub(super) fn stretch_energy(rods: &[Rod], plant: &Plant, motion: &Motion, rates: &[f64]) -> f64 {
    let of_rod = |(s, (rod, rate)): (usize, (&Rod, &f64))| {
        let (u, length) = (motion.strut_axis[s], motion.strut_length[s]);
        let upper = &motion.bodies[strut(s)];
        // Velocity of ball b relative to ball a.
        let swing = upper.angular_velocity.cross(&u);
        let (stretch, rigid) = (swing * length + u * *rate, swing * rod.length);
        let kinetic = upper.velocity.dot(&(stretch - rigid)) * (rod.ab + rod.bb)
            + 0.5 * rod.bb * (stretch.norm_squared() - rigid.norm_squared());
        kinetic - rod.weight[1] * plant.gravity_vector().dot(&u) * (length - rod.length)
    };
    rods.iter().zip(rates).enumerate().map(of_rod).sum()
}

/// Rate of the length of strut `s` while both balls are held, m/s.
pub(super) fn length_rate(motion: &Motion, s: usize) -> f64 {
    let (u, upper, carrier) = (motion.strut_axis[s], &motion.bodies[strut(s)], &motion.bodies[motion.carrier[s]]);
    let ball = motion.lower_ball(s) - carrier.position;
    u.dot(&(carrier.velocity + carrier.angular_velocity.cross(&ball) - upper.velocity))
}
