//! Assembly and factorisation of S = G·M⁻¹·Gᵀ of all 74 rows, in fronts.

use super::factor::{Columns, Front};
use super::flexible::Eliminated;
use super::rows::*;
use crate::kinematics::SocketSet;
use crate::machine::bodies::{ARM, END_EFFECTOR, PLATFORM, ROTOR, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{ARMS, STRUTS};
use crate::twin::constraints::ROWS;

/// Number of rows of a limb: bearing, two elbows, and two balls on the platform. The inner ones are those of bearing
/// and elbows.
const LIMB: usize = 17;
const LIMB_INNER: usize = 11;
/// Number of rows of the chain of axis 4: rotor bearing, upper Hooke joint, telescope, lower Hooke joint, and the pivot
/// on the platform. All but the pivot are inner ones.
const CHAIN: usize = 23;
const CHAIN_INNER: usize = 18;
/// Number of rows on the platform: pivot and six balls.
const HUB: usize = 23;
const PIVOT_ROWS: usize = 5;

/// First row of elbow and ball of a limb's strut 0 or 1 within its front.
const ELBOW: [usize; 2] = [5, 8];
const BALL: [usize; 2] = [11, 14];

/// Factored S. Rows of open sockets are replaced by 1·λ = 0.
pub(super) struct Schur {
    limbs: [Front<LIMB, LIMB_INNER>; ARMS],
    chain: Front<CHAIN, CHAIN_INNER>,
    hub: Front<HUB, HUB>,
}

impl Schur {
    pub fn new() -> Self {
        Self {
            limbs: std::array::from_fn(|_| Front::new(&[(5, 11), (3, 14), (3, 17)])),
            chain: Front::new(&[(5, 9), (4, 14), (5, 18), (4, 23)]),
            hub: Front::new(&[(5, HUB), (3, HUB), (3, HUB), (3, HUB), (3, HUB), (3, HUB), (3, HUB)]),
        }
    }

    /// Factors S + E + `tikhonov`·diag from the blocks of L⁻¹·Gᵀ (M = L·Lᵀ), with E from the elastic `struts`; returns
    /// false on loss of rank.
    pub fn factor(&mut self, y: &Columns, closed: SocketSet, struts: &[Eliminated; STRUTS], tikhonov: f64) -> bool {
        self.hub.clear();
        self.hub.gram(y, BODY[PLATFORM], HUB, 0);
        let mut hub_diagonal = self.hub.diagonal();
        for s in (0..STRUTS).filter(|&s| !closed.contains(STRUTS + s)) {
            for k in 0..3 {
                hub_diagonal[ball_in_hub(s) + k] = 1.0;
            }
        }
        for (i, front) in self.limbs.iter_mut().enumerate() {
            front.clear();
            front.gram(y, BODY[ARM + i], LIMB_INNER, 0);
            for side in 0..2 {
                let s = 2 * i + side;
                let (elbow, ball) = (elbow_on_strut(s), ball_on_strut(s));
                front.gram(y, elbow, 3, ELBOW[side]);
                front.cross(y, [ball, elbow], [BALL[side], ELBOW[side]]);
                front.gram(y, ball, 3, BALL[side]);
                if closed.contains(STRUTS + s) {
                    let (at, Eliminated { u, inverse, .. }) = (BALL[side], &struts[s]);
                    for j in 0..3 {
                        for i in j..3 {
                            front.columns[at + j][at + i] += inverse * u[i] * u[j];
                        }
                    }
                }
                if !closed.contains(s) {
                    for k in ELBOW[side]..ELBOW[side] + 3 {
                        front.columns[k][k] = 1.0;
                    }
                }
            }
            let diagonal = front.diagonal();
            relax(front, &diagonal, tikhonov);
            for k in 0..LIMB - LIMB_INNER {
                hub_diagonal[ball_in_hub(2 * i) + k] += diagonal[LIMB_INNER + k];
            }
            if !front.eliminate(&diagonal) {
                return false;
            }
            pass_on(front, &mut self.hub, ball_in_hub(2 * i));
        }
        let chain = &mut self.chain;
        chain.clear();
        for (body, at) in [(ROTOR, 0), (TELESCOPE_UPPER, 5), (TELESCOPE_LOWER, 9), (END_EFFECTOR, 14)] {
            chain.gram(y, BODY[body], BODY[body + 1] - BODY[body], at);
        }
        let diagonal = chain.diagonal();
        relax(chain, &diagonal, tikhonov);
        for k in 0..PIVOT_ROWS {
            hub_diagonal[k] += diagonal[CHAIN_INNER + k];
        }
        if !chain.eliminate(&diagonal) {
            return false;
        }
        pass_on(chain, &mut self.hub, 0);
        for s in (0..STRUTS).filter(|&s| !closed.contains(STRUTS + s)) {
            for k in ball_in_hub(s)..ball_in_hub(s) + 3 {
                self.hub.columns[k][k] = 1.0;
            }
        }
        // The Schur complements of the branches are already regularised.
        let platform: [f64; HUB] = std::array::from_fn(|k| y.iter().map(|c| c[BODY[PLATFORM] + k].powi(2)).sum());
        relax(&mut self.hub, &platform, tikhonov);
        self.hub.eliminate(&hub_diagonal)
    }

    /// b := S⁻¹·b, rows numbered as in `constraints`.
    pub fn solve(&self, b: &mut [f64; ROWS]) {
        let mut hub: [f64; HUB] = std::array::from_fn(|k| b[HUB_ROWS[k]]);
        let mut limbs = [[0.0; LIMB]; ARMS];
        for (i, x) in limbs.iter_mut().enumerate() {
            for k in 0..LIMB_INNER {
                x[k] = b[ROW[BODY[ARM + i] + k]];
            }
            self.limbs[i].forward(x);
            for k in LIMB_INNER..LIMB {
                hub[ball_in_hub(2 * i) + k - LIMB_INNER] += x[k];
            }
        }
        let mut chain = [0.0; CHAIN];
        for k in 0..CHAIN_INNER {
            chain[k] = b[CHAIN_ROWS[k]];
        }
        self.chain.forward(&mut chain);
        for k in 0..PIVOT_ROWS {
            hub[k] += chain[CHAIN_INNER + k];
        }
        self.hub.forward(&mut hub);
        self.hub.backward(&mut hub);
        for k in 0..HUB {
            b[HUB_ROWS[k]] = hub[k];
        }
        chain[CHAIN_INNER..].copy_from_slice(&hub[..PIVOT_ROWS]);
        self.chain.backward(&mut chain);
        for k in 0..CHAIN_INNER {
            b[CHAIN_ROWS[k]] = chain[k];
        }
        for (i, x) in limbs.iter_mut().enumerate() {
            let at = ball_in_hub(2 * i);
            x[LIMB_INNER..].copy_from_slice(&hub[at..at + LIMB - LIMB_INNER]);
            self.limbs[i].backward(x);
            for k in 0..LIMB_INNER {
                b[ROW[BODY[ARM + i] + k]] = x[k];
            }
        }
    }
}

const fn ball_in_hub(strut: usize) -> usize {
    PIVOT_ROWS + 3 * strut
}

/// Rows of the hub: the platform's joints in the order of its blocks.
const HUB_ROWS: [usize; HUB] = {
    let mut out = [0; HUB];
    let mut k = 0;
    while k < HUB {
        out[k] = ROW[BODY[PLATFORM] + k];
        k += 1;
    }
    out
};

const CHAIN_ROWS: [usize; CHAIN_INNER] = {
    let mut out = [0; CHAIN_INNER];
    let mut k = 0;
    while k < CHAIN_INNER {
        out[k] = match k {
            0..5 => ROTOR_BEARING + k,
            5..9 => UPPER_HOOKE + k - 5,
            9..14 => SLIDE + k - 9,
            _ => LOWER_HOOKE + k - 14,
        };
        k += 1;
    }
    out
};

fn relax<const N: usize, const P: usize>(front: &mut Front<N, P>, diagonal: &[f64; N], tikhonov: f64) {
    for (k, d) in diagonal.iter().enumerate() {
        front.columns[k][k] += tikhonov * d;
    }
}

/// Adds the Schur complement of a branch to the hub.
fn pass_on<const N: usize, const P: usize>(from: &Front<N, P>, hub: &mut Front<HUB, HUB>, at: usize) {
    for j in P..N {
        for i in j..N {
            hub.columns[at + j - P][at + i - P] += from.columns[j][i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_body_reaches_its_rows() {
        assert!(ROW.iter().all(|&r| r < ROWS));
        let mut seen = [0; ROWS];
        for r in
            HUB_ROWS.into_iter().chain(CHAIN_ROWS).chain((0..ARMS).flat_map(|i| ROW[BODY[i]..BODY[i + 1]].to_vec()))
        {
            seen[r] += 1;
        }
        assert_eq!(seen, [1; ROWS]);
    }
}
