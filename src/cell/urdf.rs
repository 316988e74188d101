//! The robot as URDF, for display by other programs.

use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

use super::links::{Cylinder, cylinder};
use crate::machine::bodies::{self, END_EFFECTOR, PLATFORM, TELESCOPE_LOWER, TELESCOPE_UPPER, body_name};
use crate::machine::{Actuator, six_struts, three_arms};
use crate::model::Model;

/// Name of the link at the inertial frame.
pub const BASE: &str = "base";

/// Spanning tree of the robot as URDF; `None` for a machine that is not a delta robot, or is disassembled.
///
/// Arms and end effector are on the joints `axis1…4`; struts, platform and telescope are on floating joints, whose
/// poses are the transforms of the recording. Link frames are the body frames of the twin, visual shapes are cylinders
/// of the collision dimensions. Masses are omitted, since a tree cannot represent the closed loops.
pub fn urdf(model: &Model) -> Option<String> {
    if !model.assembled || !model.mechanism.is_delta() {
        return None;
    }
    let g = &model.geometry;
    let mut out = Tree::new(&model.name);
    out.link(BASE, None);
    for i in three_arms() {
        let arm = body_name(bodies::arm(i));
        out.link(&arm, cylinder(g, bodies::arm(i)));
        let limb = &g.limbs[i];
        let limits = (limb.limits, &model.drives[i]);
        let (kind, pitch, axis) = match limb.actuator {
            Actuator::Revolute => ("revolute", 0.0, [0.0, 1.0, 0.0]),
            Actuator::Prismatic { inclination } => ("prismatic", inclination, [1.0, 0.0, 0.0]),
        };
        out.joint(&format!("axis{}", i + 1), kind, [BASE, &arm], limb.shaft().into(), [pitch, limb.azimuth()]);
        out.axis(axis, Some(limits));
    }
    for s in six_struts() {
        let (limb, strut) = (s / 2, body_name(bodies::strut(s)));
        out.link(&strut, cylinder(g, bodies::strut(s)));
        let elbow = g.elbow_ball(s).into();
        out.joint(&format!("elbow{}", s + 1), "floating", [&body_name(bodies::arm(limb)), &strut], elbow, [0.0; 2]);
        out.end();
    }
    let platform = body_name(PLATFORM);
    out.link(&platform, cylinder(g, PLATFORM));
    out.joint("translation", "floating", [BASE, &platform], [0.0; 3], [0.0; 2]);
    out.end();
    if !g.has_telescope() {
        return Some(out.finish());
    }
    let effector = body_name(END_EFFECTOR);
    out.link(&effector, cylinder(g, END_EFFECTOR));
    out.joint("axis4", "continuous", [&platform, &effector], [0.0, 0.0, g.flange_height], [0.0; 2]);
    out.axis([0.0, 0.0, 1.0], None);
    let (upper, lower) = (body_name(TELESCOPE_UPPER), body_name(TELESCOPE_LOWER));
    out.link(&upper, cylinder(g, TELESCOPE_UPPER));
    out.joint("hooke_upper", "floating", [BASE, &upper], [0.0, 0.0, g.upper_hooke_height], [0.0; 2]);
    out.end();
    out.link(&lower, cylinder(g, TELESCOPE_LOWER));
    out.joint("hooke_lower", "floating", [&platform, &lower], [0.0, 0.0, g.lower_hooke_height], [0.0; 2]);
    out.end();
    Some(out.finish())
}

/// URDF text under construction. Writing to a string cannot fail.
struct Tree(String);

impl Tree {
    fn new(name: &str) -> Self {
        let name: String =
            name.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect();
        Self(format!("<?xml version=\"1.0\"?>\n<robot name=\"{name}\">\n"))
    }

    fn line(&mut self, text: std::fmt::Arguments) {
        let _ = writeln!(self.0, "{text}");
    }

    fn link(&mut self, name: &str, shape: Option<Cylinder>) {
        let Some(shape) = shape else {
            return self.line(format_args!("  <link name=\"{name}\"/>"));
        };
        let (radius, length, [x, y, z]) = (shape.radius, shape.length(), shape.centre());
        let pitch = if shape.is_along_x() { FRAC_PI_2 } else { 0.0 };
        self.line(format_args!("  <link name=\"{name}\">"));
        self.line(format_args!("    <visual>"));
        self.line(format_args!("      <origin xyz=\"{x} {y} {z}\" rpy=\"0 {pitch} 0\"/>"));
        self.line(format_args!("      <geometry><cylinder radius=\"{radius}\" length=\"{length}\"/></geometry>"));
        self.line(format_args!("    </visual>"));
        self.line(format_args!("  </link>"));
    }

    /// Begins a joint at `x`, `y`, `z` (m) with pitch and yaw (rad) in the frame of its parent.
    fn joint(
        &mut self,
        name: &str,
        kind: &str,
        [parent, child]: [&str; 2],
        [x, y, z]: [f64; 3],
        [pitch, yaw]: [f64; 2],
    ) {
        self.line(format_args!("  <joint name=\"{name}\" type=\"{kind}\">"));
        self.line(format_args!("    <origin xyz=\"{x} {y} {z}\" rpy=\"0 {pitch} {yaw}\"/>"));
        self.line(format_args!("    <parent link=\"{parent}\"/>"));
        self.line(format_args!("    <child link=\"{child}\"/>"));
    }

    /// Writes axis and limits of the joint, and closes it.
    fn axis(&mut self, [x, y, z]: [f64; 3], limits: Option<([f64; 2], &crate::machine::Drive)>) {
        self.line(format_args!("    <axis xyz=\"{x} {y} {z}\"/>"));
        if let Some(([lower, upper], drive)) = limits {
            let (effort, velocity) = (drive.max_torque, drive.max_speed);
            self.line(format_args!(
                "    <limit lower=\"{lower}\" upper=\"{upper}\" effort=\"{effort}\" velocity=\"{velocity}\"/>"
            ));
        }
        self.end();
    }

    fn end(&mut self) {
        self.line(format_args!("  </joint>"));
    }

    fn finish(mut self) -> String {
        self.0.push_str("</robot>\n");
        self.0
    }
}
