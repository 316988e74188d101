"""Laws in Python, as candidates beside the catalogue."""

from __future__ import annotations

import deltatwin as dt
import numpy as np
import pytest
from conftest import ROOT, scenario


def spring(t, q, qd):
    """A spring on arm 1 that no effect of the catalogue is: torque per N·m/rad³ of stiffness."""
    torque = np.zeros_like(q)
    torque[:, 0] = q[:, 0] ** 3
    return torque


def law() -> dt.Law:
    return dt.Law("cubic_spring", spring, {"stiffness": 20.0}, units={"stiffness": "N·m/rad"})


@pytest.fixture(scope="module")
def measured(model) -> tuple[dt.Recording, dt.Recording]:
    """Runs of a robot with the spring, simulated by a formula of the library, not by the function."""
    term = '[[effects.formula.terms]]\nname = "spring"\nat = "drive1"\nlaw = "-q1^3"\ncoefficient = 30.0\n'
    text = f"{model.to_toml()}\n[effects.formula]\n{term}"
    machine = dt.Model.parse(text)

    def run(seed: int) -> dt.Recording:
        return dt.simulate(scenario(seed, 6.0), model=machine, controller=model, folder=ROOT).recording

    return run(3), run(4)


def test_a_law_is_named_beside_the_catalogue(model, measured):
    own = law()
    diagnosis = dt.diagnose(model, measured[0], held_out=measured[1], candidates=[own])
    assert [e.name for e in diagnosis.effects] == ["cubic_spring"]
    assert diagnosis.effects[0].parameters[0].value == pytest.approx(30.0, rel=0.05)
    assert own.samples > 10_000 and own.seconds > 0 and "calls" in repr(own)
    added = dt.add(model, law(), measured[0])
    assert added.effect == "cubic_spring" and added.rms_after[0] < 0.7 * added.rms_before[0]
    refitted = dt.identify(added.model, measured[0])
    assert refitted.rms[0] == pytest.approx(added.rms_after[0], rel=1e-3)
    with pytest.raises(dt.ModelError, match="formula"):
        added.model.to_toml()


def test_a_law_acts_like_the_effect_it_describes(model, states):
    q, qd, qdd = states
    calm = model.without_effect("drive_friction")
    own = dt.Law("damper", lambda t, q, qd: qd, {"viscous": 1.0}, nonnegative=True)
    difference = calm.with_effect(own, viscous=0.7).inverse_dynamics(q, qd, qdd) - calm.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(difference, 0.7 * qd, atol=1e-9)
    inertia = dt.Law("flywheel", lambda t, q, qd, qdd: qdd, {"inertia": 0.1}, accelerations=True)
    difference = calm.with_effect(inertia).inverse_dynamics(q, qd, qdd) - calm.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(difference, 0.1 * qdd, atol=1e-9)
    both = dt.Law("both", lambda t, q, qd: np.stack([qd, np.sign(qd)]), {"a": 1.0, "b": 2.0})
    regressor = calm.with_effect(both).regressor(q, qd, qdd)
    np.testing.assert_allclose(regressor.matrix[:, 1, -2:], np.stack([qd, np.sign(qd)], axis=-1)[:, 1], atol=1e-12)
    torque = calm.with_effect(both, a=0.3, b=0.4).inverse_dynamics(q, qd, qdd) - calm.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(torque, 0.3 * qd + 0.4 * np.sign(qd), atol=1e-9)


def test_what_a_law_raises_is_raised(model, measured):
    def broken(t, q, qd):
        raise ZeroDivisionError("by the law")

    with pytest.raises(ZeroDivisionError, match="by the law"):
        dt.diagnose(model, measured[0], candidates=[dt.Law("broken", broken, {"a": 1.0})])
    with pytest.raises(ValueError, match="returned the shape"):
        dt.diagnose(model, measured[0], candidates=[dt.Law("flat", lambda t, q, qd: t, {"a": 1.0})])
    with pytest.raises(ValueError, match="catalogue"):
        dt.Law("air_drag", spring, {"a": 1.0})
    with pytest.raises(ValueError, match="unit"):
        dt.Law("mine", spring, {"a": 1.0}, units={"a": "furlong"})
