"""Digital twin of a delta robot that compares, diagnoses the missing physical effect, and adds it.

Quantities are in SI units and radians. Joint coordinates ``q``, rates ``qd`` and accelerations ``qdd`` are float64
arrays ``(n, dof)``, one row per state, or ``(dof,)`` for one state; torques are at the gear output. ``dof`` is 4 for a
delta robot with telescope (three arms, rotation of the end effector), 3 without, 1 for a single axis. Results are arrays
of the same number of rows. Contiguous float64 arrays are read without a copy.

>>> import deltatwin as dt
>>> model = dt.Model.builtin("irb360-6-1600")
>>> model.inverse_dynamics([0.3, 0.3, 0.3, 0.0]).shape
(4,)
"""

from ._deltatwin import (
    Addition,
    BaseRegressor,
    Candidate,
    Change,
    Comparison,
    Diagnosis,
    Effect,
    Estimate,
    Event,
    Excitation,
    Finding,
    Identification,
    Law,
    Model,
    Motion,
    Named,
    Parameter,
    Payload,
    PayloadIdentification,
    Plan,
    Recording,
    Regressor,
    Repeats,
    Setup,
    Simulation,
    StudyPlan,
    Table,
    __version__,
    add,
    compare,
    diagnose,
    effects,
    excite,
    identify,
    identify_payload,
    plan,
    read_study_table,
    simulate,
)
from ._errors import DataError, ModelError
from ._rerun import to_rerun
from ._study import compute_chunk, exam, study

__all__ = [
    "Addition",
    "BaseRegressor",
    "Candidate",
    "Change",
    "Comparison",
    "DataError",
    "Diagnosis",
    "Effect",
    "Estimate",
    "Event",
    "Excitation",
    "Finding",
    "Identification",
    "Law",
    "Model",
    "ModelError",
    "Motion",
    "Named",
    "Parameter",
    "Payload",
    "PayloadIdentification",
    "Plan",
    "Recording",
    "Regressor",
    "Repeats",
    "Setup",
    "Simulation",
    "StudyPlan",
    "Table",
    "__version__",
    "add",
    "compare",
    "compute_chunk",
    "diagnose",
    "effects",
    "exam",
    "excite",
    "identify",
    "identify_payload",
    "plan",
    "read_study_table",
    "simulate",
    "study",
    "to_rerun",
]
