"""Kinematics and dynamics: laws that must hold, and the arrays of Python."""

from __future__ import annotations

import pickle

import deltatwin as dt
import numpy as np
import pytest


def test_positions_come_back(model, states):
    q, _, _ = states
    position = model.forward_kinematics(q)
    assert position.shape == (200, 3)
    np.testing.assert_allclose(model.inverse_kinematics(position, q[:, 3]), q, atol=1e-12)


def test_home_by_hand():
    # All arms horizontal: the elbows are at radius R + L, the struts reach down to the platform's radius r:
    # z = -sqrt(l² - (R + L - r)²).
    model = dt.Model.builtin("clavel-delta")
    g = model.lengths
    radius = g["base_radius"][0] + g["arm_length"][0] - g["platform_radius"][0]
    height = -np.sqrt(g["strut_length"][0] ** 2 - radius**2)
    np.testing.assert_allclose(model.forward_kinematics(np.zeros(3)), [0, 0, height], atol=1e-12)


def test_jacobian_is_the_derivative(model, states):
    q = states[0][:20]
    jacobian = model.jacobian(q)
    assert jacobian.shape == (20, 3, 4)
    step = 1e-6
    for i in range(4):
        moved = np.zeros(4)
        moved[i] = step
        difference = (model.forward_kinematics(q + moved) - model.forward_kinematics(q - moved)) / (2 * step)
        np.testing.assert_allclose(jacobian[:, :, i], difference, atol=1e-8)


def test_motion_of_the_bodies(model, states):
    q, qd, qdd = states
    motion = model.motion(q, qd, qdd)
    platform = motion.bodies.index("platform")
    np.testing.assert_allclose(motion.position[:, platform], model.forward_kinematics(q), atol=1e-12)
    velocity = np.einsum("nij,nj->ni", model.jacobian(q), qd)
    np.testing.assert_allclose(motion.velocity[:, platform], velocity, atol=1e-10)
    turned = motion.rotation[0] @ motion.rotation[0].transpose(0, 2, 1)
    np.testing.assert_allclose(turned, np.broadcast_to(np.eye(3), turned.shape), atol=1e-12)


def test_torques_are_the_sum_of_their_parts(model, states):
    q, qd, qdd = states
    model = model.without_effect("drive_friction")
    torque = model.inverse_dynamics(q, qd, qdd)
    mass, bias = model.mass_matrix(q), model.bias(q, qd)
    np.testing.assert_allclose(mass, mass.transpose(0, 2, 1), atol=1e-12)
    assert np.linalg.eigvalsh(mass).min() > 0
    np.testing.assert_allclose(torque, np.einsum("nij,nj->ni", mass, qdd) + bias, rtol=1e-10, atol=1e-9)


def test_gravity_is_the_derivative_of_the_potential(model, states):
    # dV/dq of the weights of all bodies, from positions alone: here of the payload, whose height is known.
    q = states[0][:10]
    load = dt.Setup(dt.Payload(3.0))
    weight = model.gravity(q, setup=load) - model.gravity(q)
    np.testing.assert_allclose(weight, 3.0 * 9.81 * model.jacobian(q)[:, 2], atol=1e-9)


@pytest.mark.parametrize("effect", [None, "ball_socket_load_dependent", "gear_load_friction"])
def test_forward_dynamics_inverts_inverse_dynamics(model, states, effect):
    q, qd, qdd = states
    own = model if effect is None else model.with_effect(effect)
    torque = own.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(own.forward_dynamics(q, qd, torque), qdd, rtol=1e-8, atol=1e-7)


def test_regressor_times_parameters(model, hidden, states):
    q, qd, qdd = states
    for own in (model, hidden):
        regressor = own.regressor(q, qd, qdd)
        torque = own.inverse_dynamics(q, qd, qdd)
        assert regressor.names == own.parameters["name"]
        scale = np.abs(torque).max()
        np.testing.assert_allclose(regressor.matrix @ regressor.values, torque, atol=1e-12 * scale)
        np.testing.assert_allclose(regressor.constant, 0, atol=1e-11 * scale)
        base = regressor.base()
        rank = np.linalg.matrix_rank(regressor.matrix.reshape(-1, len(regressor.names)))
        assert base.matrix.shape == (200, 4, rank)
        np.testing.assert_allclose(base.matrix @ base.values, torque, atol=1e-7 * scale)


def test_payload_is_no_parameter(model, states):
    q, qd, qdd = states
    setup = dt.Setup(dt.Payload.cuboid([0.3, 0.2, 0.1], 2.0, grip=[0, 0, 0.05]))
    regressor = model.regressor(q, qd, qdd, setup=setup)
    torque = model.inverse_dynamics(q, qd, qdd, setup=setup)
    np.testing.assert_allclose(regressor.matrix @ regressor.values + regressor.constant, torque, atol=1e-9)
    assert np.abs(regressor.constant).max() > 1


def test_constraint_forces_hold_the_drives(model, states):
    q, qd, qdd = states
    names = model.constraint_force_names()
    forces = model.constraint_forces(q, qd, qdd)
    own = [names.index(n) for n in ("lambda_a1", "lambda_a2", "lambda_a3", "lambda_tb")]
    np.testing.assert_allclose(forces[:, own], model.inverse_dynamics(q, qd, qdd), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", dt.Model.builtin_names())
def test_every_machine(name):
    model = dt.Model.builtin(name)
    q = np.full((5, model.dof), 0.2)
    torque = model.inverse_dynamics(q, q, q)
    assert torque.shape == (5, model.dof) and np.isfinite(torque).all()
    np.testing.assert_allclose(model.forward_dynamics(q, q, torque), q, atol=1e-7)


def test_arrays_of_any_kind(model, states):
    q, qd, qdd = states
    whole = model.inverse_dynamics(q, qd, qdd)
    np.testing.assert_array_equal(model.inverse_dynamics(q[3], qd[3], qdd[3]), whole[3])
    np.testing.assert_array_equal(model.inverse_dynamics(np.asfortranarray(q), qd, qdd), whole)
    np.testing.assert_array_equal(model.inverse_dynamics(q[::2], qd[::2], qdd[::2]), whole[::2])
    np.testing.assert_array_equal(model.inverse_dynamics(q.tolist(), qd.tolist(), qdd.tolist()), whole)
    many = np.tile(q, (20, 1))
    np.testing.assert_array_equal(model.inverse_dynamics(many)[:200], model.inverse_dynamics(q))
    assert model.inverse_dynamics(np.empty((0, 4))).shape == (0, 4)


def test_shapes_are_told(model):
    with pytest.raises(ValueError, match=r"q has the shape \(3, 2\); expected \(n, 4\) or \(4,\)"):
        model.inverse_dynamics(np.zeros((3, 2)))
    with pytest.raises(ValueError, match="qd has 2 row"):
        model.inverse_dynamics(np.zeros((3, 4)), np.zeros((2, 4)))
    with pytest.raises(ValueError, match="row 1"):
        model.inverse_kinematics([[0, 0, -1.0], [5.0, 0, 0]])
    with pytest.raises(ValueError):
        model.inverse_dynamics(np.zeros((2, 2, 4)))
    with pytest.raises(ValueError):
        model.inverse_dynamics("angles")


def test_models_do_not_change(model):
    other = model.with_effect("air_drag")
    assert "air_drag" in other.effects and "air_drag" not in model.effects
    assert other.without_effect("air_drag").to_toml() == model.to_toml()
    heavier = model.with_parameters({"drive_friction.viscous_1": 2.5})
    names = model.parameters["name"]
    place = names.index("drive_friction.viscous_1")
    assert heavier.parameters["value"][place] == 2.5 != model.parameters["value"][place]
    with pytest.raises(KeyError, match="drive_friction"):
        model.with_parameters({"drive_friction.viscos_1": 2.5})
    with pytest.raises(KeyError, match="ball_socket_viscous"):
        model.with_effect("ball_socket_viscos")
    with pytest.raises(ValueError, match="expected a number from"):
        model.with_effect("ball_socket_viscous", coefficient=-1)
    with pytest.raises(AttributeError):
        model.name = "mine"


def test_models_travel(model, hidden, tmp_path, states):
    file = tmp_path / "hidden.toml"
    hidden.save(file)
    with pytest.raises(FileExistsError):
        hidden.save(file)
    q, qd, qdd = states
    torque = hidden.inverse_dynamics(q, qd, qdd)
    for other in (dt.Model.load(file), pickle.loads(pickle.dumps(hidden))):
        np.testing.assert_array_equal(other.inverse_dynamics(q, qd, qdd), torque)


def test_errors_of_models_have_a_place(tmp_path, model):
    file = tmp_path / "broken.toml"
    text = model.to_toml()
    line = next(k for k, l in enumerate(text.splitlines(), 1) if l.startswith("sample_time"))
    lines = text.splitlines()
    lines[line - 1] = "sample_time = -1.0"
    file.write_text("\n".join(lines))
    with pytest.raises(dt.ModelError) as caught:
        dt.Model.load(file)
    assert isinstance(caught.value, ValueError)
    assert (caught.value.path, caught.value.line) == (str(file), line)
    assert caught.value.column is not None
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.line, str(again)) == (line, str(caught.value))
    with pytest.raises(FileNotFoundError):
        dt.Model.load(tmp_path / "missing.toml")


def test_the_catalogue():
    all_effects = {e.name: e for e in dt.effects()}
    assert len(all_effects) > 30
    viscous = all_effects["ball_socket_viscous"]
    assert viscous.parameters[0].unit == "N·m·s/rad" and viscous.summary and viscous.law
