//! Mapping from parameters to bodies: the entries of the pseudo-inertia of every kind of body.

use nalgebra::{DVector, Matrix3};

use crate::effects::ActiveEffect;
use crate::machine::bodies::Inertia;
use crate::machine::{Bodies, Payload};

use super::MARGIN;
use super::full::Full;

/// Bodies that share the same parameters.
#[derive(Clone, Debug)]
pub struct BodyClass {
    /// Place in the owners of the effect whose parameters they are.
    pub owner: usize,
    /// The bodies.
    pub bodies: Vec<usize>,
    /// Magnitudes of the shipped body, the reference of the margin.
    pub reference: Reference,
    /// Mapping from the parameters to the pseudo-inertia.
    pub shape: Shape,
}

/// Structure of a body's pseudo-inertia.
#[derive(Clone, Debug)]
pub enum Shape {
    /// No deviation moments are variables.
    Arrow(Arrow),
    /// All ten parameters are variables.
    Full(Full),
}

/// Mapping from parameters to D, h and m of a body without deviation moments.
///
/// Entries without a parameter of their own follow those that have one, so that they never restrict them: a body that
/// only rotates about one axis keeps the split of its moment, one that only translates its shape.
#[derive(Clone, Debug)]
pub struct Arrow {
    /// Positive sizes as combinations of variables: Σ factor·variable.
    pub sizes: Vec<Vec<(usize, f64)>>,
    /// The inverse, variables as combinations of sizes: Σ factor·size.
    pub moments: Vec<(usize, Vec<f64>)>,
    /// D: factor on a size or on the mass.
    pub second: [(Source, f64); 3],
    /// First moment h.
    pub first: [First; 3],
    /// Variable of the mass.
    pub mass: usize,
}

/// Quantity that an entry of D is proportional to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The size with this index.
    Size(usize),
    /// The mass.
    Mass,
    /// Unity: the entry is constant.
    Constant,
}

/// Source of an entry of h.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum First {
    /// The variable with this index.
    Own(usize),
    /// This factor (m) times the mass.
    Mass(f64),
    /// A constant, kg·m.
    Constant(f64),
}

/// Magnitudes of a body's entries.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    /// Largest second moment, kg·m².
    pub second: f64,
    /// Mass, kg.
    pub mass: f64,
}

impl BodyClass {
    /// All variables of the class.
    pub fn variables(&self) -> Vec<usize> {
        let mut all = match &self.shape {
            Shape::Arrow(arrow) => arrow.variables(),
            Shape::Full(full) => full.0.to_vec(),
        };
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Least size of a consistent body, kg·m².
    pub fn least_size(&self) -> f64 {
        MARGIN * self.reference.second
    }

    /// Least value of m − Σ hₖ²/Dₖ of a consistent body, kg.
    pub fn least_rest(&self) -> f64 {
        MARGIN * self.reference.mass
    }

    /// Distance of the body from the boundary of consistency, in units of the margin: 1 at the margin.
    pub fn slack(&self, x: &DVector<f64>) -> f64 {
        let least = (self.least_size(), self.least_rest());
        match &self.shape {
            Shape::Arrow(arrow) => arrow.slack(x, least),
            Shape::Full(full) => full.slack(x, least),
        }
    }

    /// The body with the variables `x`.
    pub fn inertia(&self, x: &DVector<f64>) -> Inertia {
        match &self.shape {
            Shape::Arrow(arrow) => {
                let d = arrow.second(x);
                Inertia::diagonal(x[arrow.mass], arrow.first(x), [d[1] + d[2], d[0] + d[2], d[0] + d[1]])
            }
            Shape::Full(full) => full.inertia(x),
        }
    }
}

impl Arrow {
    fn variables(&self) -> Vec<usize> {
        let own = self.first.iter().filter_map(|f| if let First::Own(i) = f { Some(*i) } else { None });
        self.sizes.iter().flatten().map(|(i, _)| *i).chain(own).chain(std::iter::once(self.mass)).collect()
    }

    /// Value of size `g`, kg·m².
    pub fn size(&self, g: usize, x: &DVector<f64>) -> f64 {
        self.sizes[g].iter().map(|(i, factor)| factor * x[*i]).sum()
    }

    /// Diagonal of D, kg·m².
    pub fn second(&self, x: &DVector<f64>) -> [f64; 3] {
        self.second.map(|(source, share)| match source {
            Source::Size(g) => share * self.size(g, x),
            Source::Mass => share * x[self.mass],
            Source::Constant => share,
        })
    }

    /// First moment, kg·m.
    pub fn first(&self, x: &DVector<f64>) -> [f64; 3] {
        self.first.map(|f| match f {
            First::Own(i) => x[i],
            First::Mass(arm) => arm * x[self.mass],
            First::Constant(h) => h,
        })
    }

    fn slack(&self, x: &DVector<f64>, (least_size, least_rest): (f64, f64)) -> f64 {
        let (second, first) = (self.second(x), self.first(x));
        let sizes = (0..self.sizes.len()).map(|g| self.size(g, x) / least_size).fold(f64::INFINITY, f64::min);
        if sizes <= 0.0 {
            return sizes;
        }
        let load: f64 = (0..3).filter(|&k| first[k] != 0.0).map(|k| first[k] * first[k] / second[k]).sum();
        sizes.min((x[self.mass] - load) / least_rest)
    }
}

/// Writes the bodies with the variables `x`. Differences between bodies of one class and deviation moments are kept
/// as far as they leave a body consistent.
pub fn complete(classes: &[BodyClass], x: &DVector<f64>, bodies: &mut Bodies) -> bool {
    let mut stayed = true;
    for class in classes {
        let found = class.inertia(x);
        let mut change = found;
        let mut first = bodies[class.bodies[0]];
        if matches!(class.shape, Shape::Arrow(_)) {
            first.tensor = Matrix3::from_diagonal(&first.tensor.diagonal());
        }
        change += first * -1.0;
        for &b in &class.bodies {
            let mut own = bodies[b];
            own += change;
            let is_possible = own.min_eigenvalue() > 0.0;
            bodies[b] = if is_possible { own } else { found };
            stayed &= is_possible;
        }
    }
    stayed
}

/// An effect whose parameters are inertia.
#[derive(Clone, Copy)]
pub struct Owner<'a> {
    /// Index of its first parameter among those of the plant.
    pub first: usize,
    /// The effect.
    pub effect: &'a ActiveEffect,
    /// The bodies that its parameters describe, with their present inertia.
    pub bodies: &'a Bodies,
}

/// Classes of the bodies whose parameters are among `free` (indices of the plant's parameters): those of the links and
/// those of a payload, whichever link carries it.
///
/// Variables are the positions in `free`; masses without a parameter get variables of their own from `free.len()` on,
/// whose present values are returned.
pub fn classes(owners: &[Owner], free: &[usize]) -> (Vec<BodyClass>, Vec<f64>) {
    let (mut out, mut masses) = (Vec::new(), Vec::new());
    for (k, owner) in owners.iter().enumerate() {
        let first = out.len();
        for (body, units) in owner.units(free).into_iter().enumerate().filter(|(_, u)| !u.is_empty()) {
            let mut variables: Vec<usize> = units.iter().map(|(v, _)| *v).collect();
            variables.sort_unstable();
            let parameters = |c: &BodyClass| c.variables().into_iter().filter(|v| *v < free.len()).collect::<Vec<_>>();
            match out[first..].iter_mut().find(|c| parameters(c) == variables) {
                Some(class) => class.bodies.push(body),
                None => {
                    let now = &owner.bodies[body];
                    let (shape, reference) = shape(now, &units, || {
                        masses.push(now.mass.max(1e-3));
                        free.len() + masses.len() - 1
                    });
                    out.push(BodyClass { owner: k, bodies: vec![body], reference, shape });
                }
            }
        }
    }
    (out, masses)
}

impl Owner<'_> {
    /// Unit inertia of each variable by body.
    fn units(&self, free: &[usize]) -> Vec<Vec<(usize, Inertia)>> {
        let mut units = vec![Vec::new(); self.bodies.0.len()];
        self.effect.effect.inertia(&self.effect.values(), &Payload::default(), &mut |k, body, unit| {
            if let Some(variable) = free.iter().position(|&f| f == self.first + k) {
                units[body].push((variable, unit));
            }
        });
        units
    }
}

fn shape(now: &Inertia, units: &[(usize, Inertia)], new_mass: impl FnOnce() -> usize) -> (Shape, Reference) {
    let pseudo = now.pseudo_inertia();
    let d = [pseudo[(0, 0)], pseudo[(1, 1)], pseudo[(2, 2)]];
    if let Some(full) = Full::of(units) {
        // A payload without stated values gets the magnitudes of a small one.
        let least = if *now == Inertia::ZERO { SMALL_PAYLOAD } else { Reference { second: 1e-9, mass: 1e-3 } };
        let second = d.iter().fold(least.second, |a: f64, b| a.max(*b));
        let reference = Reference { second, mass: now.mass.max(least.mass) };
        return (Shape::Full(full), reference);
    }
    let own_mass = units.iter().find(|(_, u)| u.mass != 0.0).map(|(v, _)| *v);
    let mass = own_mass.unwrap_or_else(new_mass);
    let own_first: [Option<usize>; 3] =
        std::array::from_fn(|k| units.iter().find(|(_, u)| u.first_moment[k] != 0.0).map(|(v, _)| *v));
    let tensors: Vec<(usize, [bool; 3])> = units
        .iter()
        .filter(|(_, u)| u.tensor.trace() != 0.0)
        .map(|(v, u)| (*v, std::array::from_fn(|k| u.tensor[(k, k)] != 0.0)))
        .collect();
    let single = tensors.iter().find(|(_, axes)| axes.iter().filter(|a| **a).count() == 1);
    let double = tensors.iter().find(|(_, axes)| axes.iter().filter(|a| **a).count() == 2);
    // A first moment without a parameter shows in the loads of the sockets, so that it stays.
    let by_mass = |k: usize| {
        if own_first[k].is_some() || now.first_moment[k] != 0.0 {
            (Source::Constant, if d[k] > 0.0 { d[k] } else { POINT_SECOND_MOMENT })
        } else {
            (Source::Mass, if now.mass > 0.0 && d[k] > 0.0 { d[k] / now.mass } else { POINT_SECOND_MOMENT })
        }
    };
    let of_axis = |k: usize| tensors.iter().find(|(_, axes)| *axes == std::array::from_fn(|j| j == k)).map(|(v, _)| *v);
    let (sizes, moments, second) = match (single, double) {
        _ if (0..3).all(|k| of_axis(k).is_some()) => {
            // D_x = ½(Θ_yy + Θ_zz − Θ_xx), Θ_xx = D_y + D_z and so on.
            let axes: Vec<usize> = (0..3).filter_map(of_axis).collect();
            let size = |k: usize| (0..3).map(|j| (axes[j], if j == k { -0.5 } else { 0.5 })).collect();
            let moment = |k: usize| (axes[k], (0..3).map(|j| f64::from(u8::from(j != k))).collect());
            let second = std::array::from_fn(|k| (Source::Size(k), 1.0));
            ((0..3).map(size).collect(), (0..3).map(moment).collect(), second)
        }
        (Some((axial, axes)), Some((lateral, _))) => (
            // Θ_axis = 2·D_lateral, Θ_lateral = D_axis + D_lateral.
            vec![vec![(*lateral, 1.0), (*axial, -0.5)], vec![(*axial, 0.5)]],
            vec![(*axial, vec![0.0, 2.0]), (*lateral, vec![1.0, 1.0])],
            std::array::from_fn(|k| (Source::Size(usize::from(!axes[k])), 1.0)),
        ),
        (Some((about, axes)), None) => {
            // Θ_axis = D_b + D_c, with the present split.
            let across: f64 = (0..3).filter(|&k| !axes[k]).map(|k| d[k].max(0.0)).sum();
            let split = |k: usize| if across > 0.0 { (d[k] / across).clamp(0.05, 0.95) } else { 0.5 };
            let second = std::array::from_fn(|k| if axes[k] { by_mass(k) } else { (Source::Size(0), split(k)) });
            (vec![vec![(*about, 1.0)]], vec![(*about, vec![1.0])], second)
        }
        _ => (Vec::new(), Vec::new(), std::array::from_fn(by_mass)),
    };
    let first = std::array::from_fn(|k| match (own_first[k], second[k].0) {
        (Some(v), _) => First::Own(v),
        (None, Source::Mass) if now.mass > 0.0 => First::Mass(now.first_moment[k] / now.mass),
        _ => First::Constant(now.first_moment[k]),
    });
    let reference = Reference { second: d.iter().fold(1e-9, |a: f64, b| a.max(*b)), mass: now.mass.max(1e-3) };
    (Shape::Arrow(Arrow { sizes, moments, second, first, mass }), reference)
}

/// Second moment per kilogram of a body without one, m².
const POINT_SECOND_MOMENT: f64 = 1e-2;
/// Magnitudes of a small payload.
const SMALL_PAYLOAD: Reference = Reference { second: 1e-4, mass: 0.1 };
