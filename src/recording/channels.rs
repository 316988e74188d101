//! Names of the channels that only a simulation provides: the multipliers of the constraint rows.

use crate::machine::{ARMS, STRUTS};

/// Number of constraint rows of the assembled robot.
pub const ROWS: usize = 74;

/// Column names `lambda_<joint>_<row>` of the constraint multipliers, in the order of the rows.
///
/// Joints are `arm1 … arm3` and `rotor` (bearings), `strut1_upper`, `strut1_lower` … (sockets), `end_effector` (its
/// bearing on the platform), and `upper_hooke`, `slide` and `lower_hooke` of the telescope. Rows `x`, `y`, `z` make two
/// points coincide; their multipliers are forces (N) along the inertial axes. Numbered rows are scalar: moments (N·m)
/// about the cross product of two axes that the row keeps perpendicular, and for `slide_4` and `slide_5` forces (N).
pub fn multiplier_names() -> [String; ROWS] {
    let point = ["x", "y", "z"];
    let mut names = Vec::with_capacity(ROWS);
    let mut add = |joint: &str, rows: &[&str]| names.extend(rows.iter().map(|row| format!("lambda_{joint}_{row}")));
    let bearing = ["x", "y", "z", "4", "5"];
    for i in 1..=ARMS {
        add(&format!("arm{i}"), &bearing);
    }
    add("rotor", &bearing);
    for s in 1..=STRUTS {
        add(&format!("strut{s}_upper"), &point);
        add(&format!("strut{s}_lower"), &point);
    }
    add("end_effector", &bearing);
    add("upper_hooke", &["x", "y", "z", "4"]);
    add("slide", &["1", "2", "3", "4", "5"]);
    add("lower_hooke", &["x", "y", "z", "4"]);
    std::array::from_fn(|row| names[row].clone())
}

/// Whether the multiplier of `row` is a force (N); otherwise it is a moment (N·m).
pub fn is_force(row: usize) -> bool {
    let names = multiplier_names();
    ["_x", "_y", "_z"].iter().any(|end| names[row].ends_with(end))
        || names[row].starts_with("lambda_slide_4")
        || names[row].starts_with("lambda_slide_5")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_has_a_name_of_its_own() {
        let names = multiplier_names();
        assert_eq!((names[0].as_str(), names[19].as_str()), ("lambda_arm1_x", "lambda_rotor_5"));
        assert_eq!((names[23].as_str(), names[55].as_str()), ("lambda_strut1_lower_x", "lambda_strut6_lower_z"));
        assert_eq!((names[68].as_str(), names[73].as_str()), ("lambda_slide_4", "lambda_lower_hooke_4"));
        assert!(is_force(68) && !is_force(67) && !is_force(19));
        let unique: std::collections::BTreeSet<&String> = names.iter().collect();
        assert_eq!(unique.len(), ROWS);
    }
}
