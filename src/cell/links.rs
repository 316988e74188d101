//! Dimensions of the link shapes, for collision and display.

/// Radius of an arm's tube, m; estimated from pictures.
pub const ARM_RADIUS: f64 = 0.03;
/// Distance between the end of the arm's tube and the ball line, where the struts are, m; estimated.
pub const ARM_TRIM: f64 = 0.06;
/// Radius of the balls, m; CAD.
pub const BALL_RADIUS: f64 = 0.0095;
/// Radius of a strut's tube, m; CAD, outside diameter 16 mm.
pub const STRUT_RADIUS: f64 = 0.008;
/// Half the thickness of the platform, m; estimated.
pub const PLATFORM_THICKNESS: f64 = 0.012;
/// Distance of the plate's middle line from the ball pairs, inward, m; estimated.
pub const PLATFORM_INSET: f64 = 0.015;
/// Radius of the flange face, m; estimated.
pub const FLANGE_RADIUS: f64 = 0.025;
/// Radius of the telescope's upper rod, m; CAD, diameter 14.5 mm.
pub const ROD_RADIUS: f64 = 0.00725;
/// Distance between the end of the rod and the lower Hooke joint at the shortest telescope, m; CAD, 812 − 760 mm.
pub const ROD_CLEARANCE: f64 = 0.052;
/// Radius of the telescope's lower tube, m; CAD, outside diameter 27.5 mm.
pub const TUBE_RADIUS: f64 = 0.01375;
/// Distance between the end of the tube and the upper Hooke joint at the shortest telescope, m; CAD, 812 − 776.5 mm.
pub const TUBE_CLEARANCE: f64 = 0.0355;
