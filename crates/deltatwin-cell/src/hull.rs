//! Collision geometry: spheres joined by sphere-swept edges and, for objects, the exact convex solid.
//!
//! The compliant law requires penetrations that are continuous in the poses. Spheres against solids and edges against
//! edges have closed forms with this property; clipped contact manifolds and witness points of GJK are discontinuous.

use deltatwin::cell::{Mesh, Shape};
use nalgebra::{Isometry3, Matrix3, Rotation3, Vector3};
use parry3d::bounding_volume::{Aabb, BoundingVolume};
use parry3d::math::{Pose, Vector};
use parry3d::partitioning::{Bvh, BvhBuildStrategy};
use parry3d::query::{self, details};
use parry3d::shape::{Segment, SharedShape};

use super::mesh;
use super::placement::{Bounds, Placement};

/// Radius of the corners and edges of solids, m (at most a quarter of the smallest dimension).
const ROUNDING: f64 = 1e-3;
/// Length over which contacts of a solid's edges fade towards their ends, m (at most a quarter of the smallest
/// dimension, of a mesh's edge a quarter of its length).
///
/// The fading is not conservative; its work corresponds to friction with the coefficient penetration / (2 · length):
/// 0.01 at 0.1 mm.
const FADE: f64 = 5e-3;
/// Number of spheres on the rim of a cylinder.
const RIM: usize = 12;
/// Sine of the angle below which crossing edges count as parallel and have contact at their ends instead.
const PARALLEL: f64 = 0.05;
/// Distance of centre lines below which their common normal is undefined, m.
const COINCIDENT: f64 = 1e-9;

/// A corner: sphere about a point of the body.
#[derive(Clone, Copy, Debug)]
struct Ball {
    centre: Vector3<f64>,
    radius: f64,
}

/// A sphere swept along a segment.
#[derive(Clone, Copy, Debug)]
struct Edge {
    ends: [Vector3<f64>; 2],
    radius: f64,
    /// Length over which contacts fade towards the ends, where spheres take over, m.
    fade: f64,
    /// Whether it is the side of a cylinder, which has no spheres at its ends: parallel edges have contact at the ends
    /// of their overlap.
    side: bool,
}

/// Exact solid.
#[derive(Clone)]
struct Solid {
    /// Shape passed to Rapier.
    shape: SharedShape,
    /// Surface for exact projection of points.
    surface: SharedShape,
    /// Rotation from the body's axes to the shape's: parry's cylinders are along y.
    turn: Matrix3<f64>,
}

/// Collision geometry of a body or of a part of it, in its frame.
#[derive(Clone, Default)]
pub struct Hull {
    balls: Vec<Ball>,
    edges: Vec<Edge>,
    solid: Option<Solid>,
    sphere: bool,
    /// Bounding volume hierarchies of edges and of spheres, if there are many.
    trees: Option<[Bvh; 2]>,
}

/// A contact point between two bodies.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Middle of the overlap in the inertial frame, m.
    pub position: Vector3<f64>,
    /// Unit vector from the second body to the first.
    pub normal: Vector3<f64>,
    /// Penetration, m.
    pub depth: f64,
    /// Share of the contact stiffness, 0 to 1.
    pub weight: f64,
}

impl Hull {
    /// A chain of spheres of `radius` (m) about `centres` (m), joined by edges; `closed` joins the last to the first.
    pub fn chain(centres: &[Vector3<f64>], radius: f64, closed: bool) -> Self {
        let n = centres.len();
        let edges = if closed { n } else { n.saturating_sub(1) };
        Self {
            balls: centres.iter().map(|&centre| Ball { centre, radius }).collect(),
            edges: (0..edges)
                .map(|i| Edge { ends: [centres[i], centres[(i + 1) % n]], radius, fade: radius, side: false })
                .collect(),
            ..Self::default()
        }
    }

    /// Union of both hulls, neither of which may be a solid.
    pub fn and(mut self, other: Self) -> Self {
        self.balls.extend(other.balls);
        self.edges.extend(other.edges);
        self
    }

    /// Hull of a solid shape.
    pub fn solid(shape: &Shape) -> Self {
        let solid = |shape: SharedShape, turn| Some(Solid { surface: shape.clone(), shape, turn });
        match *shape {
            Shape::Mesh(ref mesh) => Self::of_mesh(mesh),
            Shape::Sphere { radius } => Self {
                balls: vec![Ball { centre: Vector3::zeros(), radius }],
                edges: Vec::new(),
                solid: solid(SharedShape::ball(radius), Matrix3::identity()),
                sphere: true,
                trees: None,
            },
            Shape::Box { size } => {
                let half = size / 2.0;
                let rounding = ROUNDING.min(size.min() / 4.0);
                let core = half.add_scalar(-rounding);
                let corner =
                    |i: usize| Vector3::from_fn(|axis, _| if i >> axis & 1 == 1 { core[axis] } else { -core[axis] });
                let edges = (0..8usize).flat_map(|i| {
                    (0..3).filter(move |axis| i >> axis & 1 == 0).map(move |axis| Edge {
                        ends: [corner(i), corner(i | 1 << axis)],
                        radius: rounding,
                        fade: FADE.min(size.min() / 4.0),
                        side: false,
                    })
                });
                Self {
                    balls: (0..8).map(|i| Ball { centre: corner(i), radius: rounding }).collect(),
                    edges: edges.collect(),
                    solid: solid(SharedShape::cuboid(half.x, half.y, half.z), Matrix3::identity()),
                    ..Self::default()
                }
            }
            Shape::Cylinder { radius, height } => {
                let rounding = ROUNDING.min(radius.min(height) / 4.0);
                let rim = |z: f64| {
                    let points: Vec<_> = (0..RIM)
                        .map(|i| {
                            let (s, c) = (i as f64 * std::f64::consts::TAU / RIM as f64).sin_cos();
                            Vector3::new((radius - rounding) * c, (radius - rounding) * s, z)
                        })
                        .collect();
                    Self::chain(&points, rounding, true)
                };
                let mut hull = rim(height / 2.0 - rounding).and(rim(rounding - height / 2.0));
                hull.edges.push(Edge {
                    ends: [Vector3::z() * (-height / 2.0), Vector3::z() * (height / 2.0)],
                    radius,
                    fade: FADE.min(radius.min(height) / 4.0),
                    side: true,
                });
                let turn = Matrix3::new(1., 0., 0., 0., 0., 1., 0., -1., 0.);
                hull.solid = solid(SharedShape::cylinder(height / 2.0, radius), turn);
                hull
            }
        }
    }

    /// Hull of a mesh: its convex corners and edges, without rounding, and its surface.
    fn of_mesh(mesh: &Mesh) -> Self {
        let edges: Vec<_> = mesh
            .sharp_edges()
            .into_iter()
            .map(|ends| Edge { ends, radius: 0.0, fade: FADE.min((ends[1] - ends[0]).norm() / 4.0), side: false })
            .collect();
        let balls: Vec<_> = mesh.sharp_corners().into_iter().map(|centre| Ball { centre, radius: 0.0 }).collect();
        let of_edges: Vec<_> = edges.iter().map(|e| around(&e.ends, e.radius)).collect();
        let of_balls: Vec<_> = balls.iter().map(|b| around(&[b.centre], b.radius)).collect();
        Self {
            trees: Some([of_edges, of_balls].map(|boxes| Bvh::from_leaves(BvhBuildStrategy::default(), &boxes))),
            balls,
            edges,
            solid: Some(Solid { shape: mesh::solid(mesh), surface: mesh::surface(mesh), turn: Matrix3::identity() }),
            sphere: false,
        }
    }

    /// The shape for Rapier, and its pose in the body; a chain is a compound of capsules, one per edge.
    pub fn shape(&self) -> (SharedShape, Isometry3<f64>) {
        if let Some(solid) = &self.solid {
            let turn = Rotation3::from_matrix_unchecked(solid.turn.transpose());
            return (solid.shape.clone(), Isometry3::from_parts(Vector3::zeros().into(), turn.into()));
        }
        let capsules = self.edges.iter().map(|e| SharedShape::capsule(parry(&e.ends[0]), parry(&e.ends[1]), e.radius));
        let balls = self.balls.iter().filter(|_| self.edges.is_empty());
        let mut shapes: Vec<_> = capsules
            .map(|c| (Pose::IDENTITY, c))
            .chain(balls.map(|b| (Pose::from_translation(parry(&b.centre)), SharedShape::ball(b.radius))))
            .collect();
        match shapes.as_slice() {
            [(pose, _)] => {
                let pose: Isometry3<f64> = (*pose).into();
                (shapes.swap_remove(0).1, pose)
            }
            _ => (SharedShape::compound(shapes), Isometry3::identity()),
        }
    }

    /// Largest distance of a point of the hull from its origin, m.
    pub fn extent(&self) -> f64 {
        let balls = self.balls.iter().map(|b| b.centre.norm() + b.radius);
        let edges = self.edges.iter().flat_map(|e| e.ends.map(|end| end.norm() + e.radius));
        balls.chain(edges).fold(0.0, f64::max)
    }

    /// Bounding box of the hull at `at`.
    pub fn bounds(&self, at: &Placement) -> Bounds {
        let mut bounds = Bounds::nothing();
        let mut include = |point: &Vector3<f64>, radius: f64| bounds.include(&at.to_world(point), radius);
        for ball in &self.balls {
            include(&ball.centre, ball.radius);
        }
        // Other edges end in spheres of their radius.
        for edge in self.edges.iter().filter(|e| e.side) {
            edge.ends.iter().for_each(|end| include(end, edge.radius));
        }
        bounds
    }

    /// Distance between the two hulls, m, if it is below `reach` (m); negative: depth of their overlap.
    pub fn gap(&self, at: &Placement, other: &Self, there: &Placement, reach: f64) -> Option<f64> {
        let ((own, offset), (shape, place)) = (self.shape(), other.shape());
        let pose = |at: &Placement, offset: Isometry3<f64>| -> Pose { (at.isometry() * offset).into() };
        let found = query::contact(&pose(at, offset), &*own.0, &pose(there, place), &*shape.0, reach.max(0.0));
        found.ok().flatten().map(|contact| contact.dist)
    }

    /// Whether the distance between the two hulls is below `margin` (m).
    pub fn within(&self, at: &Placement, other: &Self, there: &Placement, margin: f64) -> bool {
        match (&self.solid, &other.solid) {
            (Some(a), Some(b)) => query::distance(&a.pose(at), &*a.shape.0, &b.pose(there), &*b.shape.0)
                .is_ok_and(|d| d.distance < margin),
            (Some(_), None) => other.within(there, self, at, margin),
            (None, Some(solid)) => {
                let pose = solid.pose(there);
                self.edges.iter().any(|e| {
                    query::distance(&Pose::IDENTITY, &e.segment(at), &pose, &*solid.shape.0)
                        .is_ok_and(|d| d.distance < margin + e.radius)
                }) || self.balls.iter().any(|b| solid.distance(there, &at.to_world(&b.centre)).0 < margin + b.radius)
            }
            (None, None) => self.edges.iter().any(|e| {
                let own = e.segment(at);
                other.edges.iter().any(|o| {
                    let (_, _, p, q) = closest(&own, &o.segment(there));
                    (p - q).norm() < margin + e.radius + o.radius
                })
            }),
        }
    }

    /// Appends the contact points of this hull at `at` with `other` at `there`.
    pub fn contacts(&self, at: &Placement, other: &Self, there: &Placement, out: &mut Vec<Point>) {
        if self.solid.is_some() && other.solid.is_none() {
            let first = out.len();
            other.contacts(there, self, at, out);
            out[first..].iter_mut().for_each(|p| p.normal = -p.normal);
            return;
        }
        // For two solids of which one is a sphere, the sphere's ball determines the contact.
        if !(other.sphere && !self.sphere && self.solid.is_some()) {
            self.corners_on(at, (other, there), (false, 1.0), out);
        }
        if !self.sphere {
            other.corners_on(there, (self, at), (true, -1.0), out);
        }
        for a in &self.edges {
            let own = a.segment(at);
            let ends = a.ends.map(|end| there.to_local(&at.to_world(&end)));
            let region = around(&ends, a.radius);
            other.near(0, &region, |i| {
                let b = &other.edges[i];
                if region.intersects(&around(&b.ends, b.radius)) {
                    a.crossing(&own, b, &b.segment(there), out);
                }
            });
        }
    }

    /// Calls `visit` for the edges (`what` 0) or spheres (1) that may intersect `region` in the hull's frame, in order.
    fn near(&self, what: usize, region: &Aabb, mut visit: impl FnMut(usize)) {
        let Some(trees) = &self.trees else {
            return (0..[self.edges.len(), self.balls.len()][what]).for_each(visit);
        };
        let mut found: Vec<u32> = trees[what].intersect_aabb(region).collect();
        found.sort_unstable();
        found.into_iter().for_each(|i| visit(i as usize));
    }

    /// Appends the contacts of this hull's spheres with the other hull; `sign` is the orientation of the normal.
    ///
    /// On a chain of edges each sphere has one contact; with `fade` none at an edge's end, where the other hull has a
    /// sphere.
    fn corners_on(
        &self,
        at: &Placement,
        (other, there): (&Self, &Placement),
        (fade, sign): (bool, f64),
        out: &mut Vec<Point>,
    ) {
        // Only a mesh has enough spheres for the search to pay off.
        let region = if self.trees.is_some() { other.region(there, at) } else { Aabb::new_invalid() };
        self.near(1, &region, |i| {
            let ball = &self.balls[i];
            let centre = at.to_world(&ball.centre);
            let deepest = match &other.solid {
                Some(solid) => {
                    let (distance, normal) = solid.distance(there, &centre);
                    (ball.radius > distance).then(|| Point {
                        position: centre - normal * (0.5 * (ball.radius + distance)),
                        normal: normal * sign,
                        depth: ball.radius - distance,
                        weight: 1.0,
                    })
                }
                None => other
                    .edges
                    .iter()
                    .filter_map(|edge| {
                        let (s, foot) = edge.foot(there, &centre);
                        let gap = centre - foot;
                        let distance = gap.norm();
                        let depth = ball.radius + edge.radius - distance;
                        if depth <= 0.0 || distance < COINCIDENT {
                            return None;
                        }
                        let normal = gap / distance;
                        Some(Point {
                            position: foot + normal * (edge.radius - 0.5 * depth),
                            normal: normal * sign,
                            depth,
                            weight: if fade { edge.faded(s) } else { 1.0 },
                        })
                    })
                    .max_by(|p, q| (p.depth * p.weight).total_cmp(&(q.depth * q.weight))),
            };
            out.extend(deepest);
        });
    }

    /// Bounding box of the hull at `there`, in the frame `at`.
    fn region(&self, there: &Placement, at: &Placement) -> Aabb {
        let mut region = Aabb::new_invalid();
        for ball in &self.balls {
            region.merge(&around(&[at.to_local(&there.to_world(&ball.centre))], ball.radius));
        }
        for edge in &self.edges {
            region.merge(&around(&edge.ends.map(|end| at.to_local(&there.to_world(&end))), edge.radius));
        }
        region
    }
}

/// Bounding box of points swept by a sphere.
fn around(points: &[Vector3<f64>], radius: f64) -> Aabb {
    Aabb::from_points(points.iter().map(parry)).loosened(radius)
}

impl Solid {
    fn pose(&self, at: &Placement) -> Pose {
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(at.rotation * self.turn.transpose());
        nalgebra::Isometry3::from_parts(at.position.into(), rotation.into()).into()
    }

    /// Signed distance (m) of a point from the surface, negative inside, and the outward normal there; inertial frame.
    fn distance(&self, at: &Placement, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let local = self.turn * at.rotation.tr_mul(&(point - at.position));
        let projection = self.surface.project_local_point(parry(&local), false);
        let gap = local - own(&projection.point);
        let distance = gap.norm();
        // On the surface itself the direction from the centre replaces the normal.
        let normal = if distance > 1e-12 { gap / distance } else { local.try_normalize(0.0).unwrap_or(Vector3::z()) };
        let outward = if projection.is_inside && distance > 1e-12 { -normal } else { normal };
        let signed = if projection.is_inside { -distance } else { distance };
        (signed, at.rotation * self.turn.tr_mul(&outward))
    }
}

impl Edge {
    fn segment(&self, at: &Placement) -> Segment {
        Segment::new(parry(&at.to_world(&self.ends[0])), parry(&at.to_world(&self.ends[1])))
    }

    fn length(&self) -> f64 {
        (self.ends[1] - self.ends[0]).norm()
    }

    /// Weight of a contact at the fraction `s` of the edge.
    fn faded(&self, s: f64) -> f64 {
        (s.min(1.0 - s) * self.length() / self.fade).clamp(0.0, 1.0)
    }

    /// Fraction along the edge and position in the inertial frame of its point nearest to `point`.
    fn foot(&self, at: &Placement, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let start = at.to_world(&self.ends[0]);
        let along = at.to_world(&self.ends[1]) - start;
        let s = ((point - start).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (s, start + along * s)
    }

    /// Appends the contact of two edges between their ends; both segments are in the inertial frame.
    fn crossing(&self, own_segment: &Segment, other: &Self, other_segment: &Segment, out: &mut Vec<Point>) {
        let [a, b] = [own(&own_segment.a), own(&own_segment.b)];
        let [c, d] = [own(&other_segment.a), own(&other_segment.b)];
        let (u, v) = (b - a, d - c);
        let (lu, lv) = (u.norm(), v.norm());
        let radii = self.radius + other.radius;
        if (a + b - c - d).norm() > lu + lv + 2.0 * radii || lu * lv == 0.0 {
            return;
        }
        let mut touch = |p: Vector3<f64>, q: Vector3<f64>, weight: f64| {
            let gap = p - q;
            let distance = gap.norm();
            if distance >= radii || distance < COINCIDENT || weight <= 0.0 {
                return;
            }
            let normal = gap / distance;
            let depth = radii - distance;
            out.push(Point { position: q + normal * (other.radius - 0.5 * depth), normal, depth, weight });
        };
        let skew = (u.cross(&v).norm() / (lu * lv * PARALLEL)).min(1.0);
        if skew > 0.0 {
            let (s, t, p, q) = closest(own_segment, other_segment);
            touch(p, q, skew * self.faded(s).min(other.faded(t)));
        }
        if skew < 1.0 && (self.side || other.side) {
            let axis = u / lu;
            let [from, to] = [(c - a).dot(&axis), (d - a).dot(&axis)];
            let [low, high] = [from.min(to).max(0.0), from.max(to).min(lu)];
            let weight = (1.0 - skew) * ((high - low) / self.fade.max(other.fade)).min(1.0);
            for x in [low, high] {
                let p = a + axis * x;
                let t = ((p - c).dot(&v) / (lv * lv)).clamp(0.0, 1.0);
                touch(p, c + v * t, weight);
            }
        }
    }
}

/// Fractions and positions of the closest points of two segments.
fn closest(a: &Segment, b: &Segment) -> (f64, f64, Vector3<f64>, Vector3<f64>) {
    let (s, t) = details::closest_points_segment_segment_with_locations_nD((&a.a, &a.b), (&b.a, &b.b));
    let (s, t) = (s.barycentric_coordinates()[1], t.barycentric_coordinates()[1]);
    let at = |g: &Segment, x: f64| own(&g.a) * (1.0 - x) + own(&g.b) * x;
    (s, t, at(a, s), at(b, t))
}

fn parry(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn own(v: &Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}
