//! Values printed in the paper.

use deltatwin::machine::PerAxis;

/// Table 1, disassembled robot. First moments in kg·m, inertia in kg·m², friction in N·m and N·m·s/rad.
pub mod table_1 {

    use deltatwin::machine::{PerAxis, ThreeArms};

    /// m c_x of the arms.
    pub const FIRST_MOMENT_X: ThreeArms<f64> = [0.150, 0.153, 0.152];
    /// m c_z of the arms.
    pub const FIRST_MOMENT_Z: ThreeArms<f64> = [0.005, 0.007, 0.016];
    /// Θ_yy of the arms.
    pub const INERTIA_YY: ThreeArms<f64> = [0.228, 0.232, 0.238];
    /// C_M·i_G² of drive 4.
    pub const ROTOR_INERTIA: f64 = 0.003;
    /// p_C of the drives.
    pub const COULOMB: PerAxis<f64> = [4.201, 4.145, 5.773, 0.387];
    /// p_v of the drives.
    pub const VISCOUS: PerAxis<f64> = [0.281, 0.419, 0.448, 0.012];
    /// Section 6.2.2: difference of the results of the two weightings.
    pub const DIFFERENCE: f64 = 1e-13;
}

/// Table 2, eq. 48 for drive 4: A_C in N·m, A_v in N·m, ε_v in rad/s.
pub const TABLE_2: [f64; 3] = [0.5272, 0.6672, 8.5919];

/// Table 3, assembled robot: parameter of `rigid_bodies` or of a body, symbol, value, unit.
pub const TABLE_3: [(&str, &str, f64, &str); 15] = [
    ("strut_mass", "strut m", 0.179, "kg"),
    ("strut_first_moment_x", "strut m c_x", 0.076, "kg·m"),
    ("strut_inertia_xx", "strut Θ_xx", 1.50e-5, "kg·m²"),
    ("strut_inertia_yy", "strut Θ_yy = Θ_zz", 0.075, "kg·m²"),
    ("arm_first_moment_x", "arm m c_x", 0.176, "kg·m"),
    ("arm_first_moment_z", "arm m c_z", 0.006, "kg·m"),
    ("arm_inertia_yy", "arm Θ_yy", 0.258, "kg·m²"),
    ("platform_mass", "platform m", 1.200, "kg"),
    ("telescope_upper_first_moment_z", "telescope, upper part, m c_z", -0.219, "kg·m"),
    ("telescope_upper_inertia_xx", "telescope, upper part, Θ_xx = Θ_yy", 0.084, "kg·m²"),
    ("telescope_upper_inertia_zz", "telescope, upper part, Θ_zz", 1.90e-5, "kg·m²"),
    ("telescope_lower_mass", "telescope, lower part, m", 0.557, "kg"),
    ("telescope_lower_first_moment_z", "telescope, lower part, m c_z", 0.146, "kg·m"),
    ("telescope_lower_inertia_xx", "telescope, lower part, Θ_xx = Θ_yy", 0.077, "kg·m²"),
    ("telescope_lower_inertia_zz", "telescope, lower part, Θ_zz", 3.00e-5, "kg·m²"),
];

/// Table 4, assembled robot.
pub mod table_4 {

    use deltatwin::machine::ThreeArms;

    /// p_C of the drives, N·m.
    pub const COULOMB: ThreeArms<f64> = [4.667, 4.376, 6.466];
    /// p_v of the drives, N·m·s/rad.
    pub const VISCOUS: ThreeArms<f64> = [1.727, 2.064, 1.557];
    /// p_C of the telescope's prismatic joint, N.
    pub const TELESCOPE_COULOMB: f64 = 1.641;
    /// p_v of the telescope's prismatic joint, N·s/m.
    pub const TELESCOPE_VISCOUS: f64 = 1.247;
}

/// Fig. 10: RMS torque error of the base parameters on the verification motion, N·m.
pub const FIG_10_BASE: PerAxis<f64> = [1.5, 1.5, 1.6, 0.17];
/// Fig. 10: RMS torque error of the consistent parameters, N·m.
pub const FIG_10_CONSISTENT: PerAxis<f64> = [1.5, 1.6, 1.7, 0.16];
/// Section 6.4: range of the computed strut forces of Fig. 11, N.
pub const FIG_11_RANGE: [f64; 2] = [-10.0, 15.0];
/// Section 6.5: mass of the measurement strut, kg.
pub const MEASUREMENT_STRUT: f64 = 0.340;
/// Section 6.5: mass of the weight plate, kg.
pub const WEIGHT_PLATE: f64 = 5.0;
/// Section 6.2.1: weights on the upper arms, kg.
pub const ARM_WEIGHTS: [f64; 2] = [1.0, 2.5];

/// Section 6.6: the optimised U-turn.
pub mod u_turn {
    /// Length along y, m.
    pub const LENGTH: f64 = 0.8;
    /// Height, m.
    pub const HEIGHT: f64 = 0.18;
    /// Duration, s.
    pub const TIME: f64 = 0.48;
    /// s of the valleys of the maximum velocity curve in the two corners (Fig. 15).
    pub const VALLEYS: [f64; 2] = [0.2, 0.8];
    /// λ̄_S less the margin of 10 %, N.
    pub const STRUT_FORCE: f64 = 108.0;
}
