"""What the package promises: no copies, no leaks, Ctrl-C, and other programs that use it as it is."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time

import deltatwin as dt
import numpy as np
import pytest
from conftest import ROOT


def resident() -> int:
    """Resident memory of this process, bytes."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs Linux")
def test_calls_leak_nothing(model):
    """A hundred thousand calls, and ten thousand errors, keep less than 3 MB."""
    q = np.full(4, 0.2)
    law = dt.Law("leaky", lambda t, q, qd: qd, {"a": 1.0})
    setup = dt.Setup(dt.Payload(1.0))

    def calls(count: int) -> None:
        for k in range(count):
            model.inverse_dynamics(q, q, q)
            if k % 10 == 0:
                model.mass_matrix(q, setup=setup)
                with pytest.raises(ValueError):
                    model.inverse_dynamics(q[:3])
            if k % 100 == 0:
                dt.Law("leaky", lambda t, q, qd: qd, {"a": 1.0})
                model.with_effect(law).parameters.__arrow_c_stream__()

    calls(5_000)
    before = resident()
    calls(100_000)
    assert resident() - before < 3_000_000


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs Linux")
def test_contiguous_arrays_are_not_copied(model):
    """Two hundred megabytes of states go in; only the result is allocated."""
    q = np.full((2_000_000, 4), 0.2)
    model.inverse_dynamics(q[:10])
    before = resident()
    torque = model.inverse_dynamics(q, q, q)
    assert resident() - before < torque.nbytes + 16_000_000


@pytest.mark.parametrize(
    "call",
    [
        "dt.simulate(SCENARIO, duration=3000.0)",
        "dt.excite(model, starts=1000, iterations=100000, time_limit=1e6)",
        "dt.diagnose(model, dt.simulate(SCENARIO, duration=20.0).recording, time_limit=1e5)",
        "dt.study(ROOT + '/scenarios/studies/bulky-box.toml', 'study')",
        "dt.plan(model, ROOT + '/scenarios/u-turn.toml', tighten=True)",
    ],
)
def test_interrupts_end_a_call_within_a_second(call, tmp_path):
    """Ctrl-C two seconds after a call has begun."""
    code = f"""
        import time, deltatwin as dt
        ROOT, SCENARIO = {str(ROOT)!r}, {str(ROOT / "scenarios/excitation.toml")!r}
        model = dt.Model.load(ROOT + "/models/irb360-6-1600.toml")
        print("ready", flush=True)
        try:
            {call}
            print("done", flush=True)
        except KeyboardInterrupt:
            print("interrupted", time.monotonic(), flush=True)
        import os
        os._exit(0)
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(2.0)
    process.send_signal(signal.SIGINT)
    sent = time.monotonic()
    word, *rest = process.stdout.readline().split()
    process.wait(timeout=60)
    if word == "done":
        pytest.skip("the call was faster than the interrupt")
    assert word == "interrupted"
    assert float(rest[0]) - sent < 1.0


def test_scipy_integrates_the_forward_dynamics(model):
    """A robot let go from rest: the energy of a frictionless machine does not change."""
    integrate = pytest.importorskip("scipy.integrate")
    calm = model
    for effect in model.effects:
        calm = calm.without_effect(effect)
    still = np.zeros(4)

    def rate(t, state):
        return np.concatenate([state[4:], calm.forward_dynamics(state[:4], state[4:], still)])

    start = np.concatenate([[0.3, 0.2, 0.25, 0.0], still])
    path = integrate.solve_ivp(rate, (0.0, 0.1), start, rtol=1e-10, atol=1e-12)
    q, qd = path.y[:4].T, path.y[4:].T
    kinetic = 0.5 * np.einsum("ni,nij,nj->n", qd, calm.mass_matrix(q), qd)
    # Work of the weight, which is minus the change of the potential.
    work = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(q, axis=0) * (calm.gravity(q)[1:] + calm.gravity(q)[:-1]))[3::4]])
    np.testing.assert_allclose(kinetic, -work, atol=0.02 * kinetic.max())
    assert kinetic.max() > 0.5


def test_scipy_fits_a_parameter(model, states):
    optimize = pytest.importorskip("scipy.optimize")
    q, qd, qdd = states
    measured = model.with_parameters({"drive_friction.viscous_2": 2.34}).inverse_dynamics(q, qd, qdd)

    def residual(x):
        return (model.with_parameters({"drive_friction.viscous_2": x[0]}).inverse_dynamics(q, qd, qdd) - measured).ravel()

    assert optimize.least_squares(residual, [1.0]).x[0] == pytest.approx(2.34, abs=1e-8)


def test_salib_ranks_factors(model):
    pytest.importorskip("SALib")
    from SALib.analyze import sobol as analyze
    from SALib.sample import sobol as sample

    problem = {"num_vars": 2, "names": ["mass", "offset"], "bounds": [[0.0, 6.0], [0.0, 0.05]]}
    q, qdd = np.full(4, 0.2), np.array([30.0, 0.0, 0.0, 0.0])

    def torque(x):
        setup = dt.Setup(dt.Payload(x[0], [x[1], 0.0, 0.0]))
        return model.inverse_dynamics(q, None, qdd, setup=setup)[0]

    points = sample.sample(problem, 128)
    indices = analyze.analyze(problem, np.array([torque(x) for x in points]), seed=1)
    assert indices["S1"][0] > 0.95 and indices["S1"][1] < 0.05


def test_copp_plans_with_the_model(model):
    """The fastest motion along a line in the joint angles, within the torques of the drives."""
    copp = pytest.importorskip("copp_py")
    from copp_py.solver.topp2_ra import Problem, solve

    calm = model
    for effect in model.effects:
        calm = calm.without_effect(effect)
    s = np.linspace(0.0, 1.0, 201)
    line = np.array([0.6, 0.4, -0.2, 0.5])
    q, dq = np.array([0.1, 0.1, 0.3, 0.0]) + np.outer(s, line), np.tile(line, (201, 1))
    limit = np.array(calm.limits["torque"])
    robot = copp.Robot(4, inverse_dynamics=calm)
    robot.append_s(s)
    robot.set_q(q, dq, np.zeros_like(q), 0)
    robot.add_torque_limits(limit, -limit, start_idx_s=0)
    squared = solve(Problem(robot.constraints, (0, 200), (0.0, 0.0)))
    # q' = line, so along the motion q̇ = line·ṡ and q̈ = line·s̈ with s̈ = ½·d(ṡ²)/ds, constant between stations.
    speed, push = np.sqrt(squared[1:-1]), 0.5 * np.diff(squared)[1:] / np.diff(s)[1:]
    use = np.abs(calm.inverse_dynamics(q[1:-1], np.outer(speed, line), np.outer(push, line))) / limit
    # Always at a limit, but for the interval in which it turns from speeding up to slowing down.
    assert use.max() < 1.02 and np.sort(use.max(axis=1))[2] > 0.98


def test_mypy_sees_the_types(tmp_path):
    pytest.importorskip("mypy")
    script = tmp_path / "use.py"
    script.write_text(
        "import deltatwin as dt\n"
        "model = dt.Model.builtin('irb360-6-1600')\n"
        "reveal_type(model.inverse_dynamics([0.0] * 4))\n"
        "reveal_type(dt.diagnose)\n"
        "model.inverse_dynamic([0.0] * 4)\n"
    )
    run = subprocess.run([sys.executable, "-m", "mypy", "--strict", script], capture_output=True, text=True, check=False)
    assert "ndarray" in run.stdout and "Any" not in run.stdout.replace("ndarray[tuple[Any", "")
    assert 'has no attribute "inverse_dynamic"' in run.stdout
