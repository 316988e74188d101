"""The machine under a controller, and what its logger writes: a recording as CSV."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from plant import STATES, Plant, inverse, step


LONGEST = 0.1e-3  # s, step of the integrator; friction of axis 4 at rest has a time constant of 0.05 ms


class Drives(NamedTuple):
    """A cascade: P on position, PI on the filtered speed, feed-forward of a constant inertia."""

    rate: float  # Hz
    kp: np.ndarray  # 1/s
    kv: np.ndarray  # N·m·s/rad
    ki: np.ndarray  # 1/s
    cut: float  # Hz, low-pass of the speed
    inertia: np.ndarray  # kg·m², deliberately rough
    weight: np.ndarray  # N·m, cosine of the arm's angle
    rub: np.ndarray  # N·m, feed-forward of Coulomb friction
    step: np.ndarray  # rad, of the encoders in the loop
    limit: np.ndarray  # N·m
    late: int  # cycles of computing


@njit(cache=True)
def control_loop(p, d, y, ref, refd, refdd, offset, sub):
    """States (n, 8, encoders' side) and held torques (n, 4) at every cycle."""
    n = ref.shape[0]
    states = np.empty((n, 8))
    torques = np.empty((n, 4))
    h = 1.0 / d.rate
    speed = np.zeros(4)
    last = np.empty(4)
    total = np.zeros(4)
    out = np.zeros(4)
    mix = 1.0 - math.exp(-2.0 * math.pi * d.cut * h)
    queue = np.zeros((d.late + 1, 4))
    for k in range(n):
        for i in range(4):
            true = y[11 + i] if i < 3 else y[3]
            rate = y[14 + i] if i < 3 else y[7]
            states[k, i], states[k, 4 + i] = true, rate
            seen = np.round((true + offset[i]) / d.step[i]) * d.step[i]
            if k == 0:
                last[i] = seen
            speed[i] += mix * ((seen - last[i]) / h - speed[i])
            last[i] = seen
            want = refd[k, i] + d.kp[i] * (ref[k, i] - seen)
            error = want - speed[i]
            if k > 0:
                total[i] += d.ki[i] * error * h
            out[i] = d.kv[i] * (error + total[i]) + d.inertia[i] * refdd[k, i]
            out[i] += d.rub[i] * math.tanh(refd[k, i] / 0.2) - d.weight[i] * math.cos(ref[k, i])
            out[i] = min(max(out[i], -d.limit[i]), d.limit[i])
        if k == 0:
            for j in range(d.late + 1):
                queue[j] = out
        for j in range(d.late):
            queue[j] = queue[j + 1]
        queue[d.late] = out
        torques[k] = queue[0]
        for _ in range(sub):
            y = step(p, y, torques[k], h / sub)
    return states, torques


def start(plant: Plant, q):
    """State at rest at joint angles q, gears wound up by the weight."""
    y = np.zeros(STATES)
    y[:4], y[11:14] = q, q[:3]
    still = inverse(plant._replace(gear=np.zeros(3)), q, np.zeros(4), np.zeros(4))
    if plant.gear[0]:
        y[11:14] += still[:3] / plant.gear
    return y, still


def run(plant: Plant, drives: Drives, ref, offset):
    """Follows ref − offset by the true joints; settling at the start is not part of the result."""
    settle = int(0.7 * drives.rate)
    full = np.concatenate([np.repeat(ref[:1], settle, axis=0), ref])
    refd = np.gradient(full, 1 / drives.rate, axis=0)
    refdd = np.gradient(refd, 1 / drives.rate, axis=0)
    y, _ = start(plant, full[0] - offset)
    sub = max(int(math.ceil(1 / drives.rate / LONGEST - 1e-9)), 1)
    try:
        states, torques = control_loop(plant, drives, y, full, refd, refdd, offset, sub)
    except np.linalg.LinAlgError as error:
        raise RuntimeError("the motion left the workspace") from error
    error = np.abs(states[:, :4] + offset - full)[settle:].max(axis=0)
    if not np.isfinite(states).all() or (error > [0.15, 0.15, 0.15, 0.8]).any():
        raise RuntimeError(f"the controller lost the motion: {error}")
    return states[settle:], torques[settle:]


def coloured(rng, n, rate, tau, correlation):
    """Unit noise (n, 4) with correlation time tau, s, and the same correlation between all axes."""
    a = math.exp(-1 / (rate * tau))
    common = rng.standard_normal((n + 2000, 1))
    white = math.sqrt(1 - correlation) * rng.standard_normal((n + 2000, 4)) + math.sqrt(correlation) * common
    out = np.empty_like(white)
    out[0] = white[0]
    for k in range(1, len(white)):
        out[k] = a * out[k - 1] + math.sqrt(1 - a * a) * white[k]
    return out[2000:]


class Logger(NamedTuple):
    """What is written of a run."""

    every: int  # cycles of control per sample
    encoder: np.ndarray  # rad, step of the written angles
    jitter: float  # s, standard deviation of the instants of sampling, around the written times
    noise: str  # none, white, coloured, quantised
    sigma: np.ndarray  # N·m
    tau: float  # s, correlation time
    correlation: float
    quantum: np.ndarray  # N·m, step of written torques, 0: none


def record(path, rng, drives, states, torques, log: Logger, offset, gain, low_pass, delay):
    """Writes a CSV. gain: factors of torques; low_pass in Hz, 0: none; delay of torques in s."""
    rate = drives.rate
    n = len(states)
    t = np.arange(n) / rate
    tau = torques.copy()
    if low_pass:
        mix = 1 - math.exp(-2 * math.pi * low_pass / rate)
        for k in range(1, n):
            tau[k] = tau[k - 1] + mix * (tau[k] - tau[k - 1])
    if delay:
        tau = np.stack([np.interp(t - delay, t, c) for c in tau.T], axis=1)
    pick = np.arange(int(0.05 * rate), n, log.every)
    t, q, qd, tau = t[pick] - t[pick[0]], states[pick, :4], states[pick, 4:], tau[pick] * gain
    q = q + offset + qd * (log.jitter * rng.standard_normal((len(pick), 1)))
    dither = rng.uniform(0, 1, 4)
    q = (np.round(q / log.encoder + dither) - dither) * log.encoder
    fs = rate / log.every
    if log.noise == "coloured":
        tau = tau + log.sigma * coloured(rng, len(pick), fs, log.tau, log.correlation)
    elif log.noise != "none":
        tau = tau + log.sigma * rng.standard_normal(tau.shape)
    step_ = np.where(log.quantum > 0, log.quantum, 1e-9)
    tau = np.where(log.quantum > 0, np.round(tau / step_) * step_, tau)
    names = "t,q1,q2,q3,q4,tau1,tau2,tau3,tau4"
    digits = ["%.6f"] + (["%.13f"] * 4 if log.noise == "none" else ["%.8f"] * 4) + ["%.9f" if log.noise == "none" else "%.5f"] * 4
    np.savetxt(path, np.column_stack([t, q, tau]), delimiter=",", header=names, comments="", fmt=digits)
