//! Terms of a formula as they are typed: `drive1: -tanh(50*qd1)`.

use std::ops::Range;
use std::sync::Arc;

use deltatwin::diagnosis::DiagnosisError;
use deltatwin::effects::Effect;
use deltatwin::effects::formula::{Expression, Formula, Place, Term};
use deltatwin::identification::FitError;
use deltatwin::kinematics::KinematicsError;
use deltatwin::machine::{Mechanism, Unit};
use deltatwin::text::nearest;

/// What is wrong with a typed term, and where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{problem}")]
pub struct LawError {
    /// Range of the text, bytes.
    pub at: Range<usize>,
    /// What was found and what was expected.
    pub problem: String,
}

/// A typed term whose law has no finite value at a sample of a recording.
#[derive(Clone, Debug, PartialEq, thiserror::Error, miette::Diagnostic)]
#[error("term {}, `{law}`: {reason}", .term + 1)]
pub struct TermError {
    /// Index of the term.
    pub term: usize,
    /// The term as typed.
    pub law: String,
    /// The value, and where it was found.
    pub reason: String,
}

impl TermError {
    /// The typed term among `terms` that `error` is about; `None` if it has another cause.
    pub fn of(error: &DiagnosisError, terms: &[String]) -> Option<Self> {
        let DiagnosisError::Fit(FitError::Kinematics { recording, reason: KinematicsError::Law(fault) }) = error else {
            return None;
        };
        let term = (0..terms.len()).find(|k| fault.term == coefficient(*k))?;
        let listed = |values: &[f64]| values.iter().map(|x| format!("{x:.4}")).collect::<Vec<_>>().join(", ");
        let reason = format!(
            "the law gives {} at t = {:.4} s of {recording}, where q = ({}) and qd = ({}); expected a finite number at every sample",
            fault.value,
            fault.t,
            listed(&fault.q),
            listed(&fault.qd)
        );
        Some(Self { term, law: terms[term].clone(), reason })
    }
}

/// Name of the coefficient of typed term `k`.
fn coefficient(k: usize) -> String {
    format!("c{}", k + 1)
}

/// A law that acts at a place of a machine, with the unit of its coefficient.
///
/// # Errors
/// If the machine does not have the place or a variable of the law, or the law cannot be read; the range is that of `law`,
/// and empty if the place is wrong.
pub fn checked(machine: Mechanism, at: &str, law: &str) -> Result<(Place, Expression, Unit), LawError> {
    let places: Vec<&str> = Place::on(machine).map(Place::name).collect();
    let Some(at) = Place::named(at).filter(|place| places.contains(&place.name())) else {
        let hint =
            nearest(at, places.iter().copied()).map_or(String::new(), |name| format!("; did you mean `{name}`?"));
        let problem = format!("this machine has no place `{at}`; expected one of {}{hint}", places.join(", "));
        return Err(LawError { at: 0..0, problem });
    };
    let law = match Expression::parse(law) {
        Ok(law) => law,
        Err(e) => return Err(LawError { at: e.at, problem: e.problem }),
    };
    if let Some(variable) = law.variables().find(|v| !v.exists_on(machine)) {
        let from = law.text().find(variable.name()).unwrap_or_default();
        let problem = format!("this machine has no `{}`", variable.name());
        return Err(LawError { at: from..from + variable.name().len(), problem });
    }
    let term = Term { name: String::new(), at, law };
    let unit = term.unit(machine);
    Ok((at, term.law, unit))
}

/// A formula of typed terms, each `PLACE: LAW`; their coefficients are called `c1`, `c2`, ….
///
/// # Errors
/// As for [`checked`], or if a term has no colon; the range is that of the term.
pub fn formula(machine: Mechanism, terms: &[String]) -> Result<Arc<dyn Effect>, LawError> {
    let term = |(k, text): (usize, &String)| {
        let Some((at, law)) = text.split_once(':') else {
            let problem = format!("`{text}`: expected a place, a colon and a law, such as `drive1: -tanh(50*qd1)`");
            return Err(LawError { at: 0..text.len(), problem });
        };
        let begin = at.len() + 1;
        let (at, law, _) = checked(machine, at.trim(), law).map_err(|e| LawError {
            at: if e.at.is_empty() { 0..at.len() } else { begin + e.at.start..begin + e.at.end },
            problem: format!("`{text}`: {}", e.problem),
        })?;
        // A typical size: the coefficient is found by the fit.
        Ok((Term { name: coefficient(k), at, law }, 1.0))
    };
    let terms = terms.iter().enumerate().map(term).collect::<Result<Vec<_>, _>>()?;
    Ok(Arc::new(Formula::new(terms, false, machine)))
}

#[cfg(test)]
mod tests {
    use deltatwin::machine::Joint;

    use super::*;

    #[test]
    fn a_fault_is_named_with_its_place_and_a_good_law_with_its_unit() {
        let delta = Mechanism::default();
        let (_, _, unit) = checked(delta, "drive1", "-qd1*abs(qd1)").unwrap();
        assert_eq!(unit.to_string(), "N·m·s²/rad²");
        assert_eq!(checked(delta, "platform_x", "-vx").unwrap().2.to_string(), "N·s/m");
        let slide = Mechanism::axis(Joint::Prismatic);
        assert_eq!(checked(slide, "drive1", "-qd1").unwrap().2.to_string(), "N·s/m");
        let typo = checked(delta, "drive1", "-tanh(50*qd7)").unwrap_err();
        assert_eq!(typo.at, 9..12, "{typo}");
        assert!(checked(delta, "drive1", "1 +").unwrap_err().at.start >= 2);
        assert!(checked(slide, "platform_x", "1").unwrap_err().problem.contains("drive1"));
        assert!(checked(slide, "drive1", "q2").unwrap_err().problem.contains("`q2`"));
        let terms = ["drive1: -qd1".to_string(), "drive2: sin(q9)".to_string()];
        let error = formula(delta, &terms).err().unwrap();
        assert_eq!(error.at, 12..14, "{error}");
        assert!(formula(delta, &["qd1".into()]).err().unwrap().problem.contains("colon"));
        let effect = formula(delta, &terms[..1]).unwrap();
        assert_eq!((effect.name(), effect.parameters().len()), ("formula", 1));
    }
}
