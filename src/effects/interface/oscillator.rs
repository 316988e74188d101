//! Damped oscillators on an accelerated support.

use std::f64::consts::TAU;

/// Damped oscillator ẍ = −ω²·x − 2ζω·ẋ − a, ζ < 1: a mass on a spring and a damper whose support has the acceleration
/// a.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oscillator {
    /// ω, rad/s.
    omega: f64,
    /// Damping ratio ζ.
    ratio: f64,
}

impl Oscillator {
    /// Oscillator with the undamped natural `frequency` ω/2π (Hz) and the damping ratio `ratio`.
    pub fn new(frequency: f64, ratio: f64) -> Self {
        Self { omega: TAU * frequency, ratio }
    }

    /// ẍ at the state (x, ẋ) for the support's acceleration a.
    pub fn acceleration(&self, [x, rate]: [f64; 2], support: f64) -> f64 {
        -self.omega * (self.omega * x + 2.0 * self.ratio * rate) - support
    }

    /// The state (x, ẋ) of equilibrium with a constant acceleration of the support: x = −a/ω².
    pub fn at_rest(&self, support: f64) -> [f64; 2] {
        [-support / (self.omega * self.omega), 0.0]
    }

    /// The state (x, ẋ) after a step `h` (s) in which the support's acceleration is linear between two values: exact
    /// for any step ([Nigam 1969]).
    ///
    /// With a = a₀ + b·t a particular solution is x_p = −a/ω² + 2ζ·b/ω³. The rest decays as e^(−ζωt) with the frequency
    /// ν = ω·√(1 − ζ²).
    pub fn after(&self, [x, rate]: [f64; 2], h: f64, support: [f64; 2]) -> [f64; 2] {
        let Self { omega, ratio } = *self;
        let change = (support[1] - support[0]) / h;
        let follow = |a: f64| (2.0 * ratio * change / omega - a) / (omega * omega);
        let (decay, nu) = (ratio * omega, omega * (1.0 - ratio * ratio).sqrt());
        let (free, free_rate) = (x - follow(support[0]), rate + change / (omega * omega));
        let (sin, cos) = (nu * h).sin_cos();
        let (fade, sin) = ((-decay * h).exp(), sin / nu);
        [
            follow(support[1]) + fade * (free * (cos + decay * sin) + free_rate * sin),
            fade * (free_rate * (cos - decay * sin) - free * omega * omega * sin) - change / (omega * omega),
        ]
    }
}

/// Two oscillators, in x and in y, as internal states x, y, ẋ, ẏ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sway(pub [Oscillator; 2]);

impl Sway {
    /// Number of internal states.
    pub const STATES: usize = 4;

    /// Accelerations in x and y in `state`.
    pub fn acceleration(&self, state: &[f64], support: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|i| self.0[i].acceleration([state[i], state[2 + i]], support[i]))
    }

    /// Writes the time derivative of `state`.
    pub fn state_rate(&self, state: &[f64], support: [f64; 2], rate: &mut [f64]) {
        rate[..2].copy_from_slice(&state[2..]);
        rate[2..].copy_from_slice(&self.acceleration(state, support));
    }

    /// The states of equilibrium.
    pub fn at_rest(&self, support: [f64; 2]) -> Vec<f64> {
        let [x, y] = std::array::from_fn(|i| self.0[i].at_rest(support[i]));
        vec![x[0], y[0], x[1], y[1]]
    }

    /// The states after a step of `h` (s) in which the support's acceleration goes from `before` to `after`.
    pub fn after(&self, state: &[f64], h: f64, before: [f64; 2], after: [f64; 2]) -> Vec<f64> {
        let step = |i: usize| self.0[i].after([state[i], state[2 + i]], h, [before[i], after[i]]);
        let [x, y] = std::array::from_fn(step);
        vec![x[0], y[0], x[1], y[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_of_any_length_is_that_of_many_short_ones() {
        // Classical Runge–Kutta at 1 µs: its error is below 1e-13 of the state.
        let oscillator = Oscillator::new(25.0, 0.05);
        let support = |t: f64| 30.0 - 4000.0 * t;
        let rates = |t: f64, s: [f64; 2]| [s[1], oscillator.acceleration(s, support(t))];
        let ahead = |s: [f64; 2], k: [f64; 2], h: f64| [s[0] + h * k[0], s[1] + h * k[1]];
        for length in [4e-4_f64, 4e-3, 0.1] {
            let start = [1e-3, -0.2];
            let (mut state, h) = (start, 1e-6_f64);
            for k in 0..(length / h).round() as usize {
                let t = k as f64 * h;
                let a = rates(t, state);
                let b = rates(t + 0.5 * h, ahead(state, a, 0.5 * h));
                let c = rates(t + 0.5 * h, ahead(state, b, 0.5 * h));
                let d = rates(t + h, ahead(state, c, h));
                state = std::array::from_fn(|i| state[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
            }
            let exact = oscillator.after(start, length, [support(0.0), support(length)]);
            approx::assert_relative_eq!(exact[0], state[0], epsilon = 1e-13, max_relative = 1e-10);
            approx::assert_relative_eq!(exact[1], state[1], epsilon = 1e-11, max_relative = 1e-10);
        }
    }

    #[test]
    fn a_released_mass_swings_at_its_frequency_and_decays() {
        // At 8 Hz and ζ = 0 after 1/8 s back at 1 mm; with ζ = 0.1 the period is 1/(8·√0.99) s and the
        // amplitude falls by exp(−2π·0.1/√0.99) = 0.531802.
        let free = Oscillator::new(8.0, 0.0).after([1e-3, 0.0], 0.125, [0.0; 2]);
        approx::assert_relative_eq!(free.as_slice(), [1e-3, 0.0].as_slice(), epsilon = 1e-15);
        let period = 0.125 / 0.99f64.sqrt();
        let damped = Oscillator::new(8.0, 0.1).after([1e-3, 0.0], period, [0.0; 2]);
        approx::assert_relative_eq!(damped[0], 0.531_802e-3, epsilon = 1e-9);
        assert!(damped[1].abs() < 1e-12);
    }

    #[test]
    fn at_rest_it_stays() {
        let oscillator = Oscillator::new(8.0, 0.1);
        let rest = oscillator.at_rest(3.0);
        // 3 m/s² at (2π·8)² 1/s²: 1.187 mm against the acceleration.
        approx::assert_relative_eq!(rest[0], -1.187_35e-3, epsilon = 1e-8);
        assert_eq!(oscillator.acceleration(rest, 3.0), 0.0);
        let later = oscillator.after(rest, 0.01, [3.0; 2]);
        approx::assert_relative_eq!(later.as_slice(), rest.as_slice(), epsilon = 1e-15);
    }
}
