//! The Python package `deltatwin`: its compiled part, `deltatwin._deltatwin`.
//!
//! Every class and function here translates arguments and results; the physics is that of the library. Its Python side
//! (`deltatwin/__init__.py`) names what is public, its types are in `deltatwin/_deltatwin.pyi`.

mod answer;
mod arrays;
mod catalogue;
mod data;
mod diagnose;
mod dynamics;
mod errors;
mod excite;
mod how;
mod identify;
mod interrupt;
mod kinematics;
mod law;
mod model;
mod payload;
mod plan;
mod recording;
mod regressor;
mod setup;
mod simulate;
mod study;
mod table;

use pyo3::prelude::*;

#[pymodule]
mod _deltatwin {
    #[pymodule_export]
    use super::answer::{Candidate, Change, Estimate, Finding, Named, Repeats};
    #[pymodule_export]
    use super::catalogue::{Effect, Parameter, effects};
    #[pymodule_export]
    use super::diagnose::{Addition, Diagnosis, add, diagnose};
    #[pymodule_export]
    use super::excite::{Excitation, excite};
    #[pymodule_export]
    use super::identify::{Comparison, Identification, compare, identify};
    #[pymodule_export]
    use super::kinematics::Motion;
    #[pymodule_export]
    use super::law::Law;
    #[pymodule_export]
    use super::model::Model;
    #[pymodule_export]
    use super::payload::{PayloadIdentification, identify_payload};
    #[pymodule_export]
    use super::plan::{Plan, plan};
    #[pymodule_export]
    use super::recording::Recording;
    #[pymodule_export]
    use super::regressor::{BaseRegressor, Regressor};
    #[pymodule_export]
    use super::setup::{Payload, Setup};
    #[pymodule_export]
    use super::simulate::{Event, Simulation, simulate};
    #[pymodule_export]
    use super::study::{StudyPlan, read_study_table};
    #[pymodule_export]
    use super::table::Table;

    use super::{Bound, PyModule, PyModuleMethods, PyResult};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
