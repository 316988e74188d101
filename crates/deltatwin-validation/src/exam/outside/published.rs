//! Laws measured and published by others that no effect of the library has.
//!
//! Only the shape is used: the exam sets the size of hidden effects (see [`crate::exam::size`]), so of a published
//! magnitude only ratios remain. Speeds of a motor or gear input are the joint's multiplied by the gear ratio 33.
//! Every reversal is smoothed as tanh(50·rate), as in the laws of the search, so that no law differs from them by
//! that slope alone. Entries state where a figure could not be compared with the source, and what was chosen where a
//! source gives no suitable figure. Laws with internal states (presliding hysteresis, GMS, thermal networks) are
//! excluded, because a formula has none.

use super::{Outside, law};

/// A law with its source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Published {
    /// The law as it is hidden, about 1 N·m or 1 N per unit of coefficient.
    pub law: Outside,
    /// Authors, title, place and date of the publication.
    pub work: &'static str,
    /// Equation, table or figure in the work, as far as known.
    pub place: &'static str,
    /// The published law with its symbols and units.
    pub equation: &'static str,
    /// Parameter values as published, and their reliability.
    pub values: &'static str,
    /// Adaptation to this robot.
    pub scaled: &'static str,
}

/// The laws, written down before any search was run on them.
pub const PUBLISHED: [Published; 26] = [
    Published {
        law: law(
            "franka_sigmoid",
            "drive2",
            "-2*(1/(1 + exp(-9.0657*(qd2 + 0.025882))) - 1/(1 + exp(-9.0657*0.025882)))",
        ),
        work: "C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca: Dynamic identification of the Franka Emika \
               Panda robot with retrieval of feasible parameters using penalty-based optimization, IEEE Robotics and \
               Automation Letters 4(4), 2019, 4147–4154",
        place: "friction model and its table of φ1, φ2, φ3; compared with the code that the authors published beside it",
        equation: "τ_f = φ1/(1 + exp(−φ2·(q̇ + φ3))) − φ1/(1 + exp(−φ2·φ3)), N·m, q̇ in rad/s",
        values: "joint 2: φ1 = 0.87224 N·m, φ2 = 9.0657 s/rad, φ3 = 0.025882 rad/s",
        scaled: "φ2 and φ3 as published at the joint; factor 2 for φ1",
    },
    Published {
        law: law(
            "skf_sliding",
            "drive4",
            "-10*tanh(50*qd4)*(0.05 + (0.15 - 0.05)*exp(-2.6e-8*(315.1*abs(qd4)*100)^1.4*46))",
        ),
        work: "SKF: Rolling bearings, catalogue PUB BU/P1 17000 EN, 2016 and later, The SKF model for calculating the \
               frictional moment",
        place: "sliding frictional moment M_sl = G_sl·μ_sl and its weighting factor; read in the catalogue's text",
        equation: "μ_sl = φ_bl·μ_bl + (1 − φ_bl)·μ_EHL, φ_bl = exp(−2.6e-8·(n·ν)^1.4·d_m), n in r/min, ν in mm²/s, d_m in mm",
        values: "μ_bl = 0.15, μ_EHL = 0.05 for mineral oil",
        scaled: "a bearing 6206 (d_m = 46 mm) at the gear's input (n = 33·60/2π·q̇ = 315.1·q̇) in oil of ν = 100 mm²/s: chosen; \
                 factor 10 for G_sl",
    },
    Published {
        law: law(
            "skf_rolling",
            "drive1",
            "-tanh(50*qd1)*abs(qd1)^0.6/(1 + 1.84e-9*(315.1*abs(qd1)*46)^1.28*100^0.64)\
             *exp(-6e-8*100*315.1*abs(qd1)*92*sqrt(3.1/64))",
        ),
        work: "SKF: Rolling bearings, catalogue PUB BU/P1 17000 EN, 2016 and later, The SKF model for calculating the \
               frictional moment",
        place: "rolling frictional moment with inlet shear heating and kinematic replenishment; constants compared with an \
                open program that implements the model",
        equation: "M_rr = φ_ish·φ_rs·G_rr·(ν·n)^0.6, φ_ish = 1/(1 + 1.84e-9·(n·d_m)^1.28·ν^0.64), \
                   φ_rs = exp(−K_rs·ν·n·(d + D)·√(K_z/(2(D − d)))), N·mm, n in r/min, ν in mm²/s, d, D, d_m in mm",
        values: "exponents and 1.84e-9 as above; K_rs = 6e-8 (grease), K_z = 3.1 (deep groove ball bearings)",
        scaled: "a bearing 6206 (d = 30, D = 62, d_m = 46 mm) at the gear's input, ν = 100 mm²/s: chosen; (ν·n)^0.6·G_rr as \
                 |q̇|^0.6",
    },
    Published {
        law: law("palmgren_lubricant", "drive3", "-tanh(50*qd3)*max(160, (100*315.1*abs(qd3))^(2/3))/1000"),
        work: "A. Palmgren: Ball and roller bearing engineering, 3rd ed., Burbank, Philadelphia 1959; T. A. Harris: Rolling \
               bearing analysis, 4th ed., Wiley 2001",
        place: "viscous friction torque (Harris, chapter on bearing friction); equation number not looked up, constants from \
                memory",
        equation: "M_0 = 1e-7·f_0·(ν·n)^(2/3)·d_m³ for ν·n ≥ 2000, else 160e-7·f_0·d_m³, N·mm, ν in mm²/s, n in r/min, d_m in mm",
        values: "160e-7, 1e-7, exponent 2/3, change at ν·n = 2000",
        scaled: "ν = 100 mm²/s and n at the gear's input chosen, so that the change is at 0.064 rad/s; f_0·d_m³ is in the size",
    },
    Published {
        law: law("gear_churning", "drive2", "-tanh(50*qd2)*abs(qd2)^0.59"),
        work: "C. Changenet, P. Velex: A model for the prediction of churning losses in geared transmissions – preliminary \
               results, ASME Journal of Mechanical Design 129(1), 2007, 128–133",
        place: "dimensionless churning torque at low churning Reynolds numbers; equation number not looked up, exponents from \
                memory",
        equation: "C = ½·ρ·ω²·S_m·R_p³·C_m, C_m ∝ Fr^−0.6·Re_c^−0.21, Fr = ω²·R_p/g, Re_c ∝ ω; N·m",
        values: "exponents −0.6 and −0.21: C ∝ ω^(2 − 1.2 − 0.21) = ω^0.59",
        scaled: "the power of the speed alone; all else is in the size",
    },
    Published {
        law: law("cube_root_friction", "drive3", "-tanh(50*qd3)*abs(qd3)^(1/3)"),
        work: "M. Grotjahn, M. Daemi, B. Heimann: Friction and rigid body identification of robot dynamics, International \
               Journal of Solids and Structures 38, 2001, 1889–1902",
        place: "friction model of the axes; equation number not looked up",
        equation: "Q_f = r_1·sgn(q̇) + r_2·q̇ + r_3·q̇^(1/3), N·m, q̇ in rad/s",
        values: "form only; r_3 of that robot not at hand",
        scaled: "the third term, whose other two the model has; size chosen by the exam",
    },
    Published {
        law: law("lip_seal", "telescope", "-tanh(50*sd)*abs(sd)^(1/3)"),
        work: "F. Hirano, H. Ishiwata: The lubricating condition of a lip seal, Proceedings of the Institution of Mechanical \
               Engineers 180(3B), 1965, 187–196",
        place: "coefficient of friction over the duty parameter G",
        equation: "f = Φ·G^(1/3), G = η·u·b/P_r, dimensionless; η in Pa·s, u in m/s, b in m, P_r in N",
        values: "exponent 1/3 (from memory); Φ depends on the seal",
        scaled: "a wiper on the telescope's bar: the power of the speed alone, size chosen by the exam",
    },
    Published {
        law: law("gear_asperities", "drive1", "-tanh(50*qd1)*(exp(-(abs(qd1)/0.3)^0.6) + 0.6*abs(qd1)^0.7)"),
        work: "R. Waiboer, R. Aarts, B. Jonker: Velocity dependence of joint friction in robotic manipulators with gear \
               transmissions, ECCOMAS Thematic Conference Multibody Dynamics, Madrid 2005",
        place: "combined friction model of gears and prestressed bearings, Stäubli RX90",
        equation: "T_f = T_a·exp(−(|q̇|/q̇_s)^δ_a) + T_v·|q̇|^(1−δ_v), N·m, q̇ in rad/s; no Coulomb term",
        values: "form only: the identified values were not at hand",
        scaled: "q̇_s = 0.3 rad/s, δ_a = 0.6, δ_v = 0.3, T_v/T_a = 0.6 chosen",
    },
    Published {
        law: law("lorentzian_stribeck", "telescope", "-tanh(50*sd)/(1 + (sd/0.1)^2)"),
        work: "D. P. Hess, A. Soom: Friction at a lubricated line contact operating at oscillating sliding velocities, ASME \
               Journal of Tribology 112(1), 1990, 147–152",
        place: "fitted steady friction–velocity curve; equation number not looked up",
        equation: "F = F_C + (F_s − F_C)/(1 + (v/v_s)²) + F_v·v, N, v in m/s",
        values: "form only: v_s of their contact belongs to its viscosity and load",
        scaled: "v_s = 0.1 m/s chosen for the telescope's bush; the other two terms the model has",
    },
    Published {
        law: law("root_stribeck", "telescope", "-tanh(50*sd)*exp(-(abs(sd)/0.1)^0.5)"),
        work: "L. C. Bo, D. Pavelescu: The friction–speed relation and its influence on the critical velocity of stick–slip \
               motion, Wear 82(3), 1982, 277–289",
        place: "friction over speed with exponent δ; equation number not looked up",
        equation: "F = F_C + (F_s − F_C)·exp(−(|v|/v_s)^δ), N, v in m/s",
        values: "δ from 0.5 to 1 for various materials (as quoted by B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, \
                 Automatica 30(7), 1994)",
        scaled: "δ = 0.5; v_s = 0.1 m/s chosen for the telescope's bush",
    },
    Published {
        law: law("brown_mcphee", "drive4", "-(0.6*tanh(4*qd4/2) + 0.8*(qd4/2)/((qd4/2)^2/4 + 0.75)^2)"),
        work: "P. Brown, J. McPhee: A continuous velocity-based friction model for dynamics and control with physically \
               meaningful parameters, Journal of Computational and Nonlinear Dynamics 11(5), 2016, 054502",
        place: "the model itself; equation compared with an open program that implements it",
        equation: "F = F_n·(μ_d·tanh(4·v/v_t) + (μ_s − μ_d)·(v/v_t)/(¼·(v/v_t)² + ¾)²), N, v in m/s or rad/s",
        values: "form and its constants 4, ¼, ¾",
        scaled: "μ_d : μ_s − μ_d = 0.6 : 0.8 and v_t = 2 rad/s chosen for the bearings of axis 4",
    },
    Published {
        law: law("ptfe_bush", "telescope", "-10*tanh(50*sd)*(0.1193 - 0.0927*exp(-23.62*abs(sd)))"),
        work: "M. Constantinou, A. Mokha, A. Reinhorn: Teflon bearings in base isolation II: modeling, ASCE Journal of \
               Structural Engineering 116(2), 1990, 455–474",
        place: "table of sliding friction of sheet PTFE on polished steel; values from memory",
        equation: "μ = f_max − D_f·exp(−a·|u̇|), u̇ in m/s",
        values: "at 6.9 MPa: f_max = 0.1193, D_f = 0.0927, a = 23.62 s/m",
        scaled: "as published, for a PTFE bush of the telescope; factor 10 for the normal force",
    },
    Published {
        law: law("shear_thinning", "drive4", "-qd4*(1 + (qd4/5)^2)^((0.463 - 1)/2)"),
        work: "S. Bair, C. McCabe, P. T. Cummings: Comparison of nonequilibrium molecular dynamics with experimental \
               measurements in the nonlinear shear-thinning regime, Physical Review Letters 88, 2002, 058302; P. J. Carreau, \
               Transactions of the Society of Rheology 16, 1972, 99–127",
        place: "Carreau's law fitted to squalane; exponent from memory",
        equation: "η = η_0·(1 + (η_0·γ̇/G)²)^((n−1)/2), Pa·s, γ̇ in 1/s",
        values: "n = 0.463 for squalane",
        scaled: "torque ∝ η·γ̇ with γ̇ ∝ q̇; thinning from 5 rad/s on chosen",
    },
    Published {
        law: law("eddy_brake", "drive3", "-2*(qd3/2)/(1 + (qd3/2)^2)"),
        work: "J. H. Wouterse: Critical torque and speed of eddy current brake with widely separated soft iron poles, IEE \
               Proceedings B 138(4), 1991, 153–158",
        place: "braking force over speed; equation number not looked up",
        equation: "F = F_c·2/(v/v_c + v_c/v), N, v in m/s",
        values: "form only: F_c and v_c belong to disk and air gap",
        scaled: "v_c as 2 rad/s of the arm chosen, for a conductor in the field of a magnet",
    },
    Published {
        law: law("current_gain_ripple", "drive1", "0.1*cos(132*q1 + pi/3)*qdd1"),
        work: "D.-W. Chung, S.-K. Sul: Analysis and compensation of current measurement error in vector-controlled AC motor \
               drives, IEEE Transactions on Industry Applications 34(2), 1998, 340–345",
        place: "torque error of unequal current sensor gains, at twice the electrical frequency; phase from memory",
        equation: "ΔT ∝ (ΔK)·T·cos(2θ_e + π/3), N·m, θ_e electrical angle in rad",
        values: "twice the electrical frequency, amplitude in proportion to the torque",
        scaled: "two pole pairs at a gear of 33 chosen: 2·2·33 = 132 per rad; the torque as that which accelerates the arm",
    },
    Published {
        law: law("coupled_friction", "drive2", "-tanh(50*(qd2 + qd3))"),
        work: "A. Janot, P.-O. Vandanjon, M. Gautier: A generic instrumental variable approach for industrial robot \
               identification, IEEE Transactions on Control Systems Technology 22(1), 2014, 132–145",
        place: "coupling of joints 5 and 6 of the Stäubli TX40; equation number not looked up",
        equation: "τ_c5 = I_a6·q̈_6 + f_vm6·q̇_6 + f_cm6·sgn(q̇_5 + q̇_6), N·m",
        values: "form only: value of f_cm6 not at hand",
        scaled: "its Coulomb term between two arms, as of a seal or cable between them; size chosen by the exam",
    },
    Published {
        law: law(
            "friction_spectrum",
            "drive1",
            "-tanh(50*qd1)*exp(-abs(qd1)/3)*(sin(16.5*q1 + 2) + sin(33*q1) + 0.7*sin(66*q1 + 1) + 0.5*sin(99*q1 + 3))",
        ),
        work: "M. R. Popović, A. A. Goldenberg: Modeling of friction using spectral analysis, IEEE Transactions on Robotics \
               and Automation 14(1), 1998, 114–122",
        place: "friction as a sum of spatial harmonics whose amplitudes depend on the speed; figures of the spectra",
        equation: "F(x, v) = Σ_k a_k(v)·sin(2π·k·x/L + φ_k), N·m",
        values: "form only: the amplitudes are given as figures",
        scaled: "lines at ½, 1, 2 and 3 per turn of the motor with falling amplitudes, decay over 3 rad/s: chosen",
    },
    Published {
        law: law("gear_position_friction", "drive2", "-tanh(50*qd2)*cos(33*q2 + 0.6)"),
        work: "B. Armstrong: Friction: experimental determination, modeling and compensation, IEEE International Conference \
               on Robotics and Automation, Philadelphia 1988, 1422–1427",
        place: "figures of friction over the motor's angle of a PUMA 560",
        equation: "friction torque at constant speed that repeats with the gear's position, N·m",
        values: "form only: repeatable with every turn of the gears; the figure's amplitudes were not read off",
        scaled: "one period per turn of the motor, 33 per rad; phase chosen",
    },
    Published {
        law: law("bearing_load", "drive4", "-tanh(50*qd4)*((ax^2 + ay^2)/100)^(1.55/2)"),
        work: "T. A. Harris: Rolling bearing analysis, 4th ed., Wiley 2001, after A. Palmgren 1959",
        place: "torque due to applied load with its table of z and y; table number not looked up, exponent from memory",
        equation: "M_1 = f_1·F_β·d_m, f_1 = z·(F_s/C_s)^y, N·mm, forces in N, d_m in mm",
        values: "radial deep groove ball bearings: y = 0.55",
        scaled: "the load is what the platform's horizontal acceleration puts on the bearing of axis 4, in units of 10 m/s²: \
                 M_1 ∝ |a|^1.55",
    },
    Published {
        law: law("tool_magnet", "platform_z", "-5*(1/(z + 1.5)^2 + 1/(z + 1.6)^2 - 2/(z + 1.55)^2)"),
        work: "D. Vokoun, M. Beleggia, L. Heller, P. Šittner: Magnetostatic interactions and forces between cylindrical \
               permanent magnets, Journal of Magnetism and Magnetic Materials 321(22), 2009, 3758–3763",
        place: "force between two coaxial cylinders far apart; equation number not looked up",
        equation: "F ∝ 1/x² + 1/(x + 2h)² − 2/(x + h)², N, x in m",
        values: "form only: magnetisation and radius are in the size",
        scaled: "magnets h = 50 mm high, the fixed one's face at z = −1.5 m: chosen",
    },
    Published {
        law: law("soft_tray", "platform_z", "30*max(0, -z - 1.05)^1.5*(1 - 1.5*0.2*vz)"),
        work: "K. H. Hunt, F. R. E. Crossley: Coefficient of restitution interpreted as damping in vibroimpact, ASME Journal \
               of Applied Mechanics 42(2), 1975, 440–445",
        place: "contact force with damping in proportion to the penetration's force",
        equation: "F = k·δ^n + λ·δ^n·δ̇, λ = (3/2)·α·k, n = 3/2 (Hertz), N, δ in m",
        values: "n = 3/2; α from 0.08 to 0.32 s/m for steel, bronze and ivory (from memory)",
        scaled: "the ball plane sinks into something soft below z = −1.05 m: chosen; α = 0.2 s/m",
    },
    Published {
        law: law("warming_magnets", "drive2", "0.1*qdd2*(1 - exp(-t/10))"),
        work: "T. Sebastian: Temperature effects on torque production and efficiency of PM motors using NdFeB magnets, IEEE \
               Transactions on Industry Applications 31(2), 1995, 353–357",
        place: "torque constant over the magnets' temperature",
        equation: "T = K_t·(1 + α·ΔT)·i, α = −0.0011 to −0.0012 1/K of the remanence, N·m",
        values: "α as above (from memory)",
        scaled: "ΔT rises as 1 − exp(−t/10 s): chosen, short for a motor, so that a run of 20 s shows it; the torque as that \
                 which accelerates the arm",
    },
    Published {
        law: law(
            "load_stribeck",
            "drive1",
            "-tanh(50*qd1)*abs(strut1_upper + strut2_upper)/50*exp(-abs(33*qd1/9.22)^1.3)",
        ),
        work: "A. Carvalho Bittencourt, S. Gunnarsson: Static friction in a robot joint – modeling and identification of load \
               and temperature effects, ASME Journal of Dynamic Systems, Measurement, and Control 134(5), 2012, 051013",
        place: "extended model of an ABB IRB 6620's joint and its table of parameters; values from memory",
        equation: "part of τ_f: F_s,τ·|τ_m|·exp(−|φ̇_m/φ̇_s,τ|^α), α = 1.3, φ̇_m in rad/s on the motor's side",
        values: "φ̇_s,τ = 9.22 rad/s, α = 1.3; F_s,τ = 0.126 in units of the largest torque",
        scaled: "speeds as published by the gear of 33; the load as the pull of the limb's struts over 50 N",
    },
    Published {
        law: law("friction_polynomial", "drive2", "-qd2*abs(qd2) + 0.05*qd2^3"),
        work: "L. Simoni, M. Beschi, G. Legnani, A. Visioli: Friction modeling with temperature effects for industrial robot \
               manipulators, IEEE/RSJ IROS 2015, 3524–3529; Modelling the temperature in joint friction of industrial \
               manipulators, Robotica 37(5), 2019, 906–927",
        place: "polynomial friction model; equation number not looked up",
        equation: "τ_f = f_C·sgn(q̇) + Σ_k f_k·q̇^k up to the third power with the sign of q̇, N·m, q̇ in rad/s",
        values: "form only: their values belong to their drives",
        scaled: "the second and third power, the rest the model has; ratio −0.05 s/rad chosen",
    },
    Published {
        law: law("excess_iron_loss", "drive1", "-tanh(50*qd1)*sqrt(abs(qd1))"),
        work: "G. Bertotti: General properties of power losses in soft ferromagnetic materials, IEEE Transactions on \
               Magnetics 24(1), 1988, 621–630",
        place: "excess loss per cycle in proportion to the root of the frequency",
        equation: "P_exc ∝ (B·f)^(3/2), W/kg: a torque in proportion to √f",
        values: "exponent 3/2",
        scaled: "the power of the speed alone, size chosen by the exam",
    },
    Published {
        law: law("dead_time_ripple", "drive3", "sin(396*q3 + 0.5)"),
        work: "S.-G. Jeong, M.-H. Park: The analysis and compensation of dead-time effects in PWM inverters, IEEE Transactions \
               on Industrial Electronics 38(2), 1991, 108–114",
        place: "fifth and seventh harmonic of the voltage error that dead time makes",
        equation: "voltage error ∝ sgn(i) of each phase: current harmonics 6k ± 1, torque at 6k times the electrical frequency",
        values: "sixth of the electrical frequency",
        scaled: "two pole pairs at a gear of 33 chosen: 6·2·33 = 396 per rad; phase chosen",
    },
];
