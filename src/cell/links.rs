//! Sizes of the links' shapes: what collides and what is drawn.

/// Radius of an arm's tube, m; estimate from pictures.
pub const ARM_RADIUS: f64 = 0.03;
/// Arm's tube ends this far before the ball line, where the struts are, m; estimate.
pub const ARM_TRIM: f64 = 0.06;
/// Radius of the balls, m; CAD.
pub const BALL_RADIUS: f64 = 0.0095;
/// Radius of a strut's tube, m; CAD, outside diameter 16 mm.
pub const STRUT_RADIUS: f64 = 0.008;
/// Half the thickness of the platform, m; estimate.
pub const PLATFORM_THICKNESS: f64 = 0.012;
/// The plate's middle line lies this far inside the ball pairs, m; estimate.
pub const PLATFORM_INSET: f64 = 0.015;
/// Radius of the flange face, m; estimate.
pub const FLANGE_RADIUS: f64 = 0.025;
/// Radius of the telescope's upper rod, m; CAD, diameter 14.5 mm.
pub const ROD_RADIUS: f64 = 0.00725;
/// The rod ends this far before the lower Hooke joint when the telescope is shortest, m; CAD, 812 − 760 mm.
pub const ROD_CLEARANCE: f64 = 0.052;
/// Radius of the telescope's lower tube, m; CAD, outside diameter 27.5 mm.
pub const TUBE_RADIUS: f64 = 0.01375;
/// The tube ends this far before the upper Hooke joint when the telescope is shortest, m; CAD, 812 − 776.5 mm.
pub const TUBE_CLEARANCE: f64 = 0.0355;
