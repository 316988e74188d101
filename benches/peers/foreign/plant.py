"""Equations of motion of the delta robot with Lagrange multipliers in seven coordinates c = (q1, q2, q3, x, y, z, psi).

Struts and telescope are equivalent points on lines, so no body but the arms has an angular velocity; the three constraints
are the lengths of the strut pairs. SI units, radians; frames and signs of docs/recordings.md. All functions run in numba.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

ARMS = 3
STATES = 17  # q, q' of the links (4 + 4), bristles (3), motors' angles and speeds (3 + 3)


class Plant(NamedTuple):
    """One machine, with its effects. Arrays have one entry per arm, or per axis where four are stated."""

    azimuth: np.ndarray
    base: float
    arm: float
    strut: float
    platform: float
    hooke_up: float
    hooke_low: float
    gravity: np.ndarray  # vector, m/s²
    arm_x: np.ndarray  # first moment of the arm along x, kg·m
    arm_z: np.ndarray
    arm_i: np.ndarray  # inertia about the shaft, kg·m²
    pair_m: np.ndarray  # mass of both struts of a pair, kg
    pair_mc: np.ndarray  # first moment from the upper ball, kg·m
    pair_i: np.ndarray  # transverse inertia about the upper ball, kg·m²
    plate_m: float
    upper_mc: float  # telescope
    upper_i: float
    lower_m: float
    lower_mc: float
    lower_i: float
    bar_spin: float  # inertia of both bars about their axis, kg·m²
    rotor: float
    load_m: float
    load_x: float  # centre of mass in the frame of the end effector, m
    load_y: float
    load_zz: float  # about the vertical axis through the centre of mass
    coulomb: np.ndarray
    viscous: np.ndarray
    steep: float
    a_c: float  # friction of axis 4
    a_v: float
    eps_v: float
    bar_coulomb: float
    bar_viscous: float
    # Effects
    power: np.ndarray  # torque at 3 rad/s of a power law of the speed, N·m
    exponent: float
    stribeck: np.ndarray  # N·m
    stribeck_speed: float
    stribeck_shape: float
    asymmetry: np.ndarray  # half the difference of Coulomb friction forwards and backwards, N·m
    cogging: np.ndarray  # N·m
    cogging_order: float  # per turn of the joint
    cogging_phase: np.ndarray
    socket: float  # N·m
    socket_speed: float
    hose: float  # N/m
    hose_preload: float  # N
    hose_at: np.ndarray
    bristle: np.ndarray  # stiffness of presliding, N·m/rad
    bristle_torque: np.ndarray
    gear: np.ndarray  # stiffness, N·m/rad; 0: rigid
    gear_damping: np.ndarray
    motor: np.ndarray  # inertia on the motor's side of an elastic gear, kg·m²
    drag: float  # N·s²/m²
    bumps: np.ndarray  # (n, 3): centre, width, torque; a smooth torque over the angle of one arm
    bumps_on: int
    cross: np.ndarray  # c·|q1'·q2'|-like torque on each arm from its neighbours, N·m·s²/rad²


@njit(cache=True)
def elbow(p, i, q):
    """Middle of the elbow's balls less the platform's radius, and its derivatives by the angle."""
    cu, su = math.cos(p.azimuth[i]), math.sin(p.azimuth[i])
    c, s = math.cos(q), math.sin(q)
    reach = p.base - p.platform + p.arm * c
    at = np.array([reach * cu, reach * su, -p.arm * s])
    first = np.array([-p.arm * s * cu, -p.arm * s * su, -p.arm * c])
    second = np.array([-p.arm * c * cu, -p.arm * c * su, p.arm * s])
    return at, first, second


@njit(cache=True)
def forward(p, q):
    """The platform: the lower common point of three spheres."""
    a, _, _ = elbow(p, 0, q[0])
    b, _, _ = elbow(p, 1, q[1])
    c, _, _ = elbow(p, 2, q[2])
    ex = b - a
    d = math.sqrt(ex @ ex)
    ex = ex / d
    i = ex @ (c - a)
    ey = c - a - i * ex
    j = math.sqrt(ey @ ey)
    ey = ey / j
    ez = np.cross(ex, ey)
    x = d / 2
    y = (i * i + j * j) / (2 * j) - i / j * x
    h = math.sqrt(max(p.strut * p.strut - x * x - y * y, 0.0))
    if ez[2] > 0.0:
        h = -h
    return a + x * ex + y * ey + h * ez


@njit(cache=True)
def platform_rate(p, q, qd):
    """Platform, its velocity and the Jacobian d(x, y, z)/d(q1, q2, q3)."""
    at = forward(p, q)
    rows = np.empty((3, 3))
    diag = np.zeros((3, 3))
    for i in range(ARMS):
        a, first, _ = elbow(p, i, q[i])
        d = at - a
        rows[i] = d
        diag[i, i] = d @ first
    jacobian = np.linalg.solve(rows, diag)
    return at, jacobian @ qd[:3], jacobian


@njit(cache=True)
def drive_friction(p, i, w):
    """Friction of an arm's drive and its effects, torque on the drive, N·m."""
    sign = math.tanh(p.steep * w)
    torque = -p.coulomb[i] * sign - p.viscous[i] * w - p.asymmetry[i] * sign * sign
    if p.power[i] != 0.0:
        torque -= p.power[i] * sign * (abs(w) / 3.0) ** p.exponent
    if p.stribeck[i] != 0.0:
        torque -= p.stribeck[i] * sign * math.exp(-((abs(w) / p.stribeck_speed) ** p.stribeck_shape))
    return torque


@njit(cache=True)
def position_torque(p, i, q):
    """Torques on an arm's drive that depend on its angle, N·m."""
    torque = 0.0
    if p.cogging[i] != 0.0:
        torque += p.cogging[i] * math.sin(p.cogging_order * q + p.cogging_phase[i])
    if i == p.bumps_on:
        for k in range(p.bumps.shape[0]):
            x = (q - p.bumps[k, 0]) / p.bumps[k, 1]
            torque += p.bumps[k, 2] * math.exp(-x * x)
    return torque


@njit(cache=True)
def sockets(p, i, d, dd, first, w, forces):
    """Coulomb friction of the four balls of a limb; the struts do not spin."""
    u = d / p.strut
    turn = np.cross(u, dd / p.strut)
    cu, su = math.cos(p.azimuth[i]), math.sin(p.azimuth[i])
    v = np.array([-su, cu, 0.0])
    for upper in range(2):
        rel = turn - upper * w * v
        size = math.sqrt(rel @ rel) + 1e-12
        moment = -2.0 * p.socket * math.tanh(size / p.socket_speed) / size * rel
        push = np.cross(moment, u) / p.strut
        forces[3:6] += push
        forces[i] -= first @ push
        if upper == 1:
            forces[i] -= moment @ v


@njit(cache=True)
def limbs(p, c, cd, mass, bias, rows, gamma):
    """Arms and struts: rows of the mass matrix, forces (bias, to the right), constraints rows·c'' = gamma."""
    for i in range(ARMS):
        a, first, second = elbow(p, i, c[i])
        w = cd[i]
        cos, sin = math.cos(c[i]), math.sin(c[i])
        cu, su = math.cos(p.azimuth[i]), math.sin(p.azimuth[i])
        x_first = np.array([-sin * cu, -sin * su, -cos])
        z_first = np.array([cos * cu, cos * su, -sin])
        l = p.strut
        m_bb = p.pair_i[i] / (l * l)
        m_ab = p.pair_mc[i] / l - m_bb
        m_aa = p.pair_m[i] - 2.0 * p.pair_mc[i] / l + m_bb
        mass[i, i] += p.arm_i[i] + m_aa * (first @ first)
        for k in range(3):
            mass[i, 3 + k] += m_ab * first[k]
            mass[3 + k, i] += m_ab * first[k]
            mass[3 + k, 3 + k] += m_bb
        acc = second * w * w
        bias[i] += (p.arm_x[i] * x_first + p.arm_z[i] * z_first) @ p.gravity
        bias[i] += (p.pair_m[i] - p.pair_mc[i] / l) * (first @ p.gravity) - m_aa * (first @ acc)
        bias[3:6] += p.pair_mc[i] / l * p.gravity - m_ab * acc
        d = c[3:6] - a
        dd = cd[3:6] - first * w
        rows[i, 3:6] = d
        rows[i, i] = -(d @ first)
        gamma[i] = d @ acc - dd @ dd
        if p.socket != 0.0:
            sockets(p, i, d, dd, first, w, bias)


@njit(cache=True)
def telescope(p, c, cd, mass, bias):
    """Both bars as lines with points on them, and their spin; friction of the slide."""
    span = np.array([-c[3], -c[4], p.hooke_up - p.hooke_low - c[5]])
    s = math.sqrt(span @ span)
    e = span / s
    rate = -(e @ cd[3:6])
    ed = (-cd[3:6] - e * rate) / s
    by = -(np.eye(3) - np.outer(e, e)) / s
    edd = (-ed * rate - e * (ed @ (-cd[3:6]))) / s - ed * rate / s
    inertia = p.upper_i + p.lower_i
    mass[3:6, 3:6] += inertia * (by @ by) + p.lower_mc * (by + by.T) + p.lower_m * np.eye(3)
    bias[3:6] -= inertia * (by @ edd) + p.lower_mc * edd
    bias[3:6] += by @ ((p.upper_mc + p.lower_mc) * p.gravity) + p.lower_m * p.gravity
    # Spin of the bars: the upper Hooke joint's first axis is a1 on the motor, its second is at right angles to a1 and e.
    a1 = np.array([math.cos(c[6]), math.sin(c[6]), 0.0])
    a1d = cd[6] * np.array([-a1[1], a1[0], 0.0])
    side = np.cross(a1, e)
    k = e @ a1
    kd = ed @ a1 + e @ a1d
    den = 1.0 - k * k
    spin = (cd[6] * e[2] + k * (ed @ side)) / den
    rest = cd[6] * ed[2] + kd * (ed @ side) + k * (edd @ side + ed @ np.cross(a1d, e))
    spin_rest = (rest + spin * 2.0 * k * kd) / den
    h = np.empty(4)
    h[:3] = k / den * (by @ side)
    h[3] = e[2] / den
    mass[3:7, 3:7] += p.bar_spin * np.outer(h, h)
    bias[3:7] -= p.bar_spin * spin_rest * h
    bias[3:6] -= p.bar_spin * spin * (by @ np.cross(ed, e))
    slide = -p.bar_coulomb * math.tanh(100.0 * rate) - p.bar_viscous * rate
    bias[3:6] -= slide * e


@njit(cache=True)
def plate(p, c, cd, mass, bias):
    """Platform, payload, motor 4, hose, drag."""
    for k in range(3):
        mass[3 + k, 3 + k] += p.plate_m + p.load_m
    bias[3:6] += (p.plate_m + p.load_m) * p.gravity
    cos, sin = math.cos(c[6]), math.sin(c[6])
    r = np.array([cos * p.load_x - sin * p.load_y, sin * p.load_x + cos * p.load_y])
    mass[3, 6] -= p.load_m * r[1]
    mass[6, 3] -= p.load_m * r[1]
    mass[4, 6] += p.load_m * r[0]
    mass[6, 4] += p.load_m * r[0]
    mass[6, 6] += p.rotor + p.load_zz + p.load_m * (r @ r)
    bias[3] += p.load_m * cd[6] * cd[6] * r[0]
    bias[4] += p.load_m * cd[6] * cd[6] * r[1]
    bias[6] += p.load_m * (r[0] * p.gravity[1] - r[1] * p.gravity[0])
    w = cd[6]
    bias[6] -= p.a_c * math.tanh(100.0 * w) + p.a_v * math.tanh(w / p.eps_v)
    if p.hose != 0.0 or p.hose_preload != 0.0:
        d = p.hose_at - c[3:6]
        length = math.sqrt(d @ d)
        bias[3:6] += (p.hose + p.hose_preload / length) * d
    if p.drag != 0.0:
        bias[3:6] -= p.drag * math.sqrt(cd[3:6] @ cd[3:6]) * cd[3:6]


@njit(cache=True)
def system(p, q, qd):
    """Mass matrix, forces without the drives' friction, constraint rows and their right-hand side."""
    c = np.empty(7)
    cd = np.empty(7)
    at, velocity, _ = platform_rate(p, q, qd)
    c[:3], c[3:6], c[6] = q[:3], at, q[3]
    cd[:3], cd[3:6], cd[6] = qd[:3], velocity, qd[3]
    mass = np.zeros((7, 7))
    bias = np.zeros(7)
    rows = np.zeros((3, 7))
    gamma = np.zeros(3)
    limbs(p, c, cd, mass, bias, rows, gamma)
    telescope(p, c, cd, mass, bias)
    plate(p, c, cd, mass, bias)
    return mass, bias, rows, gamma


@njit(cache=True)
def inverse(p, q, qd, qdd):
    """Torques at the gear output of a rigid machine for a given motion, with all friction."""
    mass, bias, rows, gamma = system(p, q, qd)
    cdd = np.empty(7)
    cdd[:3], cdd[6] = qdd[:3], qdd[3]
    cdd[3:6] = np.linalg.solve(np.ascontiguousarray(rows[:, 3:6]), gamma - rows[:, :3] @ qdd[:3])
    f = mass @ cdd - bias
    multipliers = np.linalg.solve(np.ascontiguousarray(rows[:, 3:6].T), f[3:6])
    tau = np.empty(4)
    for i in range(ARMS):
        tau[i] = f[i] - rows[i, i] * multipliers[i] - drive_friction(p, i, qd[i]) - position_torque(p, i, q[i])
    tau[3] = f[6]
    return tau


@njit(cache=True)
def bristle_rate(p, i, z, w):
    """Dahl's presliding: rate of the deflection."""
    return w * (1.0 - p.bristle[i] / p.bristle_torque[i] * z * math.copysign(1.0, w))


@njit(cache=True)
def derivative(p, y, tau):
    """Rate of the state under the torques of the motors."""
    q, qd = y[0:4], y[4:8]
    out = np.zeros(STATES)
    out[0:4] = qd
    mass, bias, rows, gamma = system(p, q, qd)
    for i in range(ARMS):
        j, k = (i + 1) % 3, (i + 2) % 3
        w = qd[i]
        on_motor = drive_friction(p, i, y[14 + i] if p.gear[i] != 0.0 else w)
        torque = position_torque(p, i, q[i]) - p.cross[i] * abs(qd[j] * qd[k])
        if p.bristle[i] != 0.0:
            out[8 + i] = bristle_rate(p, i, y[8 + i], w)
            torque -= p.bristle[i] * y[8 + i]
        if p.gear[i] != 0.0:
            twist = p.gear[i] * (y[11 + i] - q[i]) + p.gear_damping[i] * (y[14 + i] - w)
            out[11 + i] = y[14 + i]
            out[14 + i] = (tau[i] + on_motor - twist) / p.motor[i]
            torque += twist
            mass[i, i] -= p.motor[i]
        else:
            torque += tau[i] + on_motor
            out[11 + i] = w
        bias[i] += torque
    bias[6] += tau[3]
    full = np.zeros((10, 10))
    full[:7, :7] = mass
    full[:7, 7:] = rows.T
    full[7:, :7] = rows
    right = np.empty(10)
    right[:7] = bias
    right[7:] = gamma
    solved = np.linalg.solve(full, right)
    out[4:7] = solved[:3]
    out[7] = solved[6]
    if not (p.gear[0] != 0.0):
        out[14:17] = out[4:7]
    return out


@njit(cache=True)
def step(p, y, tau, h):
    """One step of the classical Runge-Kutta method."""
    k1 = derivative(p, y, tau)
    k2 = derivative(p, y + 0.5 * h * k1, tau)
    k3 = derivative(p, y + 0.5 * h * k2, tau)
    k4 = derivative(p, y + h * k3, tau)
    return y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
