//! Assembly and factorisation of S = G·M⁻¹·Gᵀ of all rows, in fronts.

use super::factor::{Columns, Front};
use super::flexible::Eliminated;
use super::structure::{Layout, MAX_ROWS, Structure};
use crate::kinematics::SocketSet;

/// A limb or the chain of axis 4.
struct Branch {
    front: Front,
    layout: Layout,
    /// Position in the hub of every row that is not an inner one.
    outer: Vec<usize>,
    /// Diagonal before the elimination.
    diagonal: Vec<f64>,
}

/// Factored S. Rows of open sockets are replaced by 1·λ = 0.
pub(super) struct Schur {
    branches: Vec<Branch>,
    hub: Branch,
    struts: usize,
}

impl Branch {
    fn new(layout: &Layout, hub: &Layout) -> Self {
        let place = |row: &usize| hub.rows.iter().position(|r| r == row).unwrap_or_default();
        Self {
            front: Front::new(layout.rows.len(), layout.inner, &layout.panels),
            outer: layout.rows[layout.inner..].iter().map(place).collect(),
            diagonal: vec![0.0; layout.rows.len()],
            layout: layout.clone(),
        }
    }

    fn assemble(&mut self, y: &Columns) {
        self.front.clear();
        self.layout.bodies.iter().for_each(|runs| self.front.gram(y, runs));
    }

    fn relax(&mut self, tikhonov: f64) {
        for (k, d) in self.diagonal.iter().enumerate() {
            self.front.column(k)[0] += tikhonov * d;
        }
    }

    /// Positions of the rows of open sockets among its first `n` rows.
    fn open(layout: &Layout, closed: SocketSet, n: usize) -> impl Iterator<Item = usize> {
        let open = layout.sockets.iter().filter(move |(socket, at)| *at < n && !closed.contains(*socket));
        open.flat_map(|&(_, at)| at..at + 3)
    }
}

impl Schur {
    pub fn new(structure: &Structure) -> Self {
        let branch = |layout: &Layout| Branch::new(layout, &structure.hub);
        Self {
            branches: structure.branches.iter().map(branch).collect(),
            hub: branch(&structure.hub),
            struts: structure.struts,
        }
    }

    /// Factors S + E + `tikhonov`·diag from the blocks of L⁻¹·Gᵀ (M = L·Lᵀ), with E from the elastic `struts`; returns
    /// false on loss of rank.
    pub fn factor(&mut self, y: &Columns, closed: SocketSet, struts: &[Eliminated], tikhonov: f64) -> bool {
        let Self { branches, hub, struts: count } = self;
        hub.assemble(y);
        hub.front.diagonal(&mut hub.diagonal);
        hub.relax(tikhonov);
        let all = hub.layout.inner;
        for k in Branch::open(&hub.layout, closed, all) {
            hub.diagonal[k] = 1.0;
            hub.front.column(k)[0] = 1.0;
        }
        for branch in branches {
            branch.assemble(y);
            let inner = branch.layout.inner;
            for &(socket, at) in &branch.layout.sockets {
                let Some(strut) = socket.checked_sub(*count).and_then(|s| struts.get(s)) else { continue };
                if closed.contains(socket) {
                    for j in 0..3 {
                        for i in j..3 {
                            branch.front.column(at + j)[i - j] += strut.inverse * strut.u[i] * strut.u[j];
                        }
                    }
                }
            }
            for k in Branch::open(&branch.layout, closed, inner) {
                branch.front.column(k)[0] = 1.0;
            }
            branch.front.diagonal(&mut branch.diagonal);
            branch.relax(tikhonov);
            for (&at, d) in branch.outer.iter().zip(&branch.diagonal[inner..]) {
                hub.diagonal[at] += d;
            }
            if !branch.front.eliminate(&branch.diagonal) {
                return false;
            }
            for (j, &column) in branch.outer.iter().enumerate() {
                let from = branch.front.column(inner + j);
                let target = hub.front.column(column);
                for (x, &row) in from.iter().zip(&branch.outer[j..]) {
                    target[row - column] += x;
                }
            }
        }
        hub.front.eliminate(&hub.diagonal)
    }

    /// Multiplies every row by its diagonal entry of S.
    pub fn weigh(&self, x: &mut [f64; MAX_ROWS]) {
        let inner = self.branches.iter().chain([&self.hub]);
        for (row, d) in inner.flat_map(|b| b.layout.rows[..b.layout.inner].iter().zip(&b.diagonal)) {
            x[*row] *= d;
        }
    }

    /// b := S⁻¹·b, rows numbered as in [`Structure`].
    pub fn solve(&self, b: &mut [f64; MAX_ROWS]) {
        let mut hub = [0.0; MAX_ROWS];
        let hub = &mut hub[..self.hub.layout.rows.len()];
        for (x, &row) in hub.iter_mut().zip(&self.hub.layout.rows) {
            *x = b[row];
        }
        let mut parts = [0.0; MAX_ROWS];
        for Branch { front, layout, outer, .. } in &self.branches {
            let x = &mut parts[..layout.rows.len()];
            let (inner, passed) = x.split_at_mut(layout.inner);
            inner.iter_mut().zip(&layout.rows).for_each(|(x, &row)| *x = b[row]);
            passed.fill(0.0);
            front.forward(x);
            let (inner, passed) = x.split_at(layout.inner);
            inner.iter().zip(&layout.rows).for_each(|(x, &row)| b[row] = *x);
            passed.iter().zip(outer).for_each(|(x, &at)| hub[at] += x);
        }
        self.hub.front.forward(hub);
        self.hub.front.backward(hub);
        for (x, &row) in hub.iter().zip(&self.hub.layout.rows) {
            b[row] = *x;
        }
        for Branch { front, layout, .. } in &self.branches {
            let x = &mut parts[..layout.rows.len()];
            x.iter_mut().zip(&layout.rows).for_each(|(x, &row)| *x = b[row]);
            front.backward(x);
            x[..layout.inner].iter().zip(&layout.rows).for_each(|(x, &row)| b[row] = *x);
        }
    }
}
