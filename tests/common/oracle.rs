//! The rows of our grid given to copp: oracle of tests, yardstick of benches.

use copp::constraints::Constraints;
use copp::solver::topp2_ra::{ReachSet2OptionsBuilder, Topp2ProblemBuilder, topp2_ra};
use copp::solver::topp3_lp::{ClarabelOptionsBuilder, Topp3ProblemBuilder, Topp3Profile, topp3_lp};
use copp::solver::topp3_socp::topp3_socp;
use deltatwin::planner::Limits;
use deltatwin::planner::rows::{Grid, Row};
use nalgebra::DMatrix;

/// Programme of copp with jerk limits.
#[derive(Clone, Copy, Debug)]
pub enum Programme {
    /// ∫ z ds.
    Linear,
    /// The time.
    Cone,
}

/// A problem as copp poses it. It has no D √z: rows are given without it.
pub struct Oracle {
    constraints: Constraints,
    s: Vec<f64>,
}

impl Oracle {
    /// The rows of `grid` and the jerk limits.
    pub fn new(grid: &Grid, limits: &Limits) -> Self {
        let n = grid.points.len();
        let s: Vec<f64> = grid.points.iter().map(|x| x.point.s).collect();
        let mut constraints = Constraints::with_capacity(4, n);
        constraints.with_s(s.as_slice()).expect("increasing");
        let caps: Vec<f64> = grid.points.iter().map(|x| x.cap).collect();
        constraints.with_constraint_1order(caps.as_slice(), 0).expect("positive");
        let mut second = |rows: &[Vec<Row>], at: usize| {
            let of = |f: fn(&Row) -> f64| DMatrix::from_fn(rows[0].len(), rows.len(), |r, i| f(&rows[i][r]));
            let (a, b, c) = (of(|r| r.a), of(|r| r.b), of(|r| r.c));
            for sign in [1.0, -1.0] {
                let right = c.map(|c| 1.0 - sign * c);
                constraints
                    .with_constraint_2order(&(&b * sign).as_view(), &(&a * sign).as_view(), &right.as_view(), at, false)
                    .expect("of equal shape");
            }
        };
        second(&grid.points.iter().map(|x| x.rows.clone()).collect::<Vec<_>>(), 0);
        for end in [0, n - 1] {
            second(&[grid.points[end].rest.clone()], end);
        }
        if limits.has_jerk() {
            let of = |order: usize, factor: f64| {
                DMatrix::from_fn(4, n, |axis, i| factor * grid.points[i].point.q[order][axis] / limits.jerk[axis])
            };
            let (third, second, first) = (of(3, 1.0), of(2, 3.0), of(1, 1.0));
            let (none, one) = (DMatrix::zeros(4, n), DMatrix::from_element(4, n, 1.0));
            for sign in [1.0, -1.0] {
                let [third, second, first] = [&third, &second, &first].map(|m| m * sign);
                constraints
                    .with_constraint_3order(
                        &third.as_view(),
                        &second.as_view(),
                        &first.as_view(),
                        &none.as_view(),
                        &one.as_view(),
                        0,
                        false,
                    )
                    .expect("of equal shape");
            }
        }
        Self { constraints, s }
    }

    /// z of TOPP2-RA.
    pub fn without_jerk(&self) -> Vec<f64> {
        let problem = Topp2ProblemBuilder::with_constraint(&self.constraints, (0, self.s.len() - 1), (0.0, 0.0));
        topp2_ra(&problem.build().expect("complete"), &ReachSet2OptionsBuilder::new().build().expect("defaults"))
            .expect("a motion")
    }

    /// z and s̈ of `rounds` programmes, each about what the last one found, the first about `from`.
    pub fn with_jerk(&mut self, from: &[f64], programme: Programme, rounds: usize) -> Topp3Profile {
        let options = ClarabelOptionsBuilder::new().allow_almost_solved(true).build().expect("defaults");
        let mut at = from.to_vec();
        let mut found = None;
        for _ in 0..rounds {
            let problem = Topp3ProblemBuilder::with_constraint(&mut self.constraints, 0, &at, (0.0, 0.0), (0.0, 0.0))
                .build_with_linearization()
                .expect("complete");
            let next = match programme {
                Programme::Linear => topp3_lp(&problem, &options),
                Programme::Cone => topp3_socp(&problem, &options),
            }
            .expect("a motion");
            at.clone_from(&next.a);
            found = Some(next);
        }
        found.expect("one round")
    }
}
