"""Compare, diagnose, add: the main loop, and what a notebook shows of it."""

from __future__ import annotations

import threading
import time

import deltatwin as dt
import numpy as np
import pytest
from conftest import MOTION, ROOT, scenario


@pytest.fixture(scope="module")
def fitted(model, runs) -> dt.Identification:
    return dt.identify(model, runs[0], held_out=runs[1])


def test_identify_tells_what_it_knows(fitted):
    assert fitted.channels[:4] == ["tau1", "tau2", "tau3", "tau4"]
    assert fitted.rank > 10 and np.isfinite(fitted.condition)
    assert all(r < 10 * n for r, n in zip(fitted.rms, fitted.noise_floor, strict=True))
    assert {"name", "value", "std", "unit"} == set(fitted.parameters.names)
    assert "<table>" in fitted._repr_html_()


def test_the_loop_finds_what_is_hidden(fitted, runs):
    comparison = dt.compare(fitted.model, runs[0], held_out=runs[1])
    assert comparison.worst is not None and comparison.worst[1] > 1.05
    assert comparison.findings and comparison.findings[0].sentence
    assert "<svg" in comparison._repr_html_()
    diagnosis = dt.diagnose(fitted.model, runs[0], held_out=runs[1])
    assert [e.name for e in diagnosis.effects] == ["ball_socket_coulomb"]
    assert diagnosis.effects[0].parameters[0].value == pytest.approx(0.15, rel=0.05)
    assert diagnosis.ranking["name"][0] == "ball_socket_coulomb"
    assert "<svg" in diagnosis._repr_html_()
    added = dt.add(fitted.model, diagnosis.effects[0].name, runs[0], held_out=runs[1])
    assert added.rms_after[0] < added.rms_before[0]
    assert all(after < 1.1 * noise for after, noise in zip(added.rms_after, added.noise_floor, strict=True))
    assert added.model.effects == diagnosis.model.effects and added.model.history == ["ball_socket_coulomb"]


def test_a_wrong_recording_is_refused_with_a_remedy(model, runs):
    recording = runs[0]
    wrong = dt.Recording.from_arrays(recording.t, recording.q, -recording.tau)
    with pytest.raises(dt.DataError, match="remedy"):
        dt.identify(model, wrong)
    axis = dt.Recording.from_arrays(recording.t, recording.q[:, 0], recording.tau[:, 0])
    with pytest.raises(dt.DataError, match="another kind of machine"):
        dt.compare(model, axis)
    with pytest.raises(dt.DataError):
        dt.identify(model, [])
    with pytest.raises(dt.ModelError, match="hold"):
        dt.identify(model, recording, hold=["air_drag"])


def test_the_payload_is_identified_with_a_known_robot(model):
    box = "[payload]\nmass = 2.5\ncom = [0.03, -0.02, -0.08]\ninertia_zz = 0.012\n"
    loaded = dt.simulate(scenario(3, 6.0, MOTION + box), model=model, folder=ROOT).recording
    # The recording does not tell what it was made with.
    run = dt.Recording.from_arrays(loaded.t, loaded.q, loaded.tau)
    found = dt.identify_payload(model, run)
    assert found.payload.mass == pytest.approx(2.5, abs=0.02)
    np.testing.assert_allclose(found.payload.com[:2], [0.03, -0.02], atol=2e-3)
    assert found.setup.payload == found.payload
    assert all(r < 1.1 * n for r, n in zip(found.rms, found.noise_floor, strict=True))
    mass = next(e for e in found.estimates if e.name.endswith("mass"))
    assert 0.0 < mass.std < 0.01 and abs(mass.value - 2.5) < 5 * mass.std
    assert "<table>" in found._repr_html_()
    with pytest.raises(ValueError, match="flange"):
        dt.identify_payload(dt.Model.builtin("irb360-6-1600-disassembled"), run, gate=False)


def test_how_to_fit_is_a_choice(model, runs):
    usual = dt.identify(model, runs[0])
    other = dt.identify(model, runs[0], method="log_cholesky")
    assert other.rms == pytest.approx(usual.rms, rel=1e-4)
    each = dt.identify(model, runs[0], limbs="each", derivatives="smoother")
    assert len(each.estimates) > len(usual.estimates)
    # A prior that weighs like the data keeps what it says.
    heavy = model.with_parameters({"drive_friction.viscous_1": 2.0})
    tied = dt.identify(model, runs[0], prior=heavy, gamma={"drive_friction": 1e9})
    value = {e.name: e.value for e in tied.estimates}
    assert value["drive_friction.viscous_1"] == pytest.approx(2.0, rel=1e-2)
    for wrong in ({"method": "magic"}, {"regularisation": 0.0}, {"gamma": {"torque": -1.0}}, {"gamma": {"hat": 1.0}}):
        with pytest.raises(ValueError, match="expected"):
            dt.identify(model, runs[0], **wrong)


def test_progress_is_told(model, runs):
    told: list[tuple[str, float]] = []
    dt.diagnose(model, runs[0], progress=lambda what, share: told.append((what, share)))
    assert "refit" in {what for what, _ in told}


def test_a_run_ends_with_a_status(model):
    run = dt.simulate(scenario(1, 0.2), folder=ROOT, noise=False)
    assert (run.status, run.message) == ("completed", "")
    assert run.energy_error < 1e-3 and run.max_loop_gap < 1e-10
    again = dt.simulate(scenario(1, 0.2), folder=ROOT, noise=False)
    np.testing.assert_array_equal(run.recording.tau, again.recording.tau)
    crash = dt.simulate(ROOT / "scenarios" / "crash.toml")
    assert "dislocation" in crash.event_table["kind"]
    with pytest.raises(dt.ModelError, match="duration"):
        dt.simulate(scenario(1).replace("duration = 4.0", "duration = -1.0"), folder=ROOT)


def test_the_interpreter_is_free_meanwhile(model, runs):
    """Another thread counts while a diagnosis runs."""
    ticks = 0
    running = True

    def count() -> None:
        nonlocal ticks
        while running:
            ticks += 1
            time.sleep(0.01)

    thread = threading.Thread(target=count)
    thread.start()
    begun = time.monotonic()
    dt.diagnose(model, runs[0])
    seconds, running = time.monotonic() - begun, False
    thread.join()
    assert ticks > 20 * seconds


def test_a_motion_that_tells_much(model):
    excitation = dt.excite(model, starts=1, iterations=3, time_limit=20)
    t, q, qd, qdd = excitation.states()
    assert len(t) == round(excitation.period / model.sample_time) and q.shape == qd.shape == qdd.shape == (len(t), 4)
    assert np.abs(q[0] - q[-1]).max() < 0.05
    run = dt.simulate(excitation.scenario(ROOT / "models" / "irb360-6-1600.toml"), duration=0.1, folder="/")
    assert run.status == "completed"


def test_a_plan_is_a_recording_or_a_status(model):
    plan = dt.plan(model, ROOT / "scenarios" / "u-turn.toml")
    assert plan.status == "completed" and plan.time is not None and plan.bound is not None
    assert plan.bound <= plan.time and plan.trajectory is not None
    assert plan.trajectory.t[-1] == pytest.approx(plan.time, abs=model.sample_time)
    with pytest.raises(dt.ModelError):
        dt.plan(model, "[path]\nkind = 'nothing'\n")
