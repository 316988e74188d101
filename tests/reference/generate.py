#!/usr/bin/env python3
"""Computes the reference numbers in this folder anew, sharing no code with the library.

    python3 tests/reference/generate.py            compares with the files, exit status 1 beyond 1e-12 of a column
    python3 tests/reference/generate.py DIR        writes the same files into DIR, the states taken over from here

Needs mpmath (made with Python 3.11, mpmath 1.3). All kinematics follow from positions: a joint motion q + q̇ t + q̈ t²/2 and
steps in each joint angle are run through the closed-form poses with 50 digits, and velocities, accelerations and Jacobians
are central differences of them. Drive torques are virtual work of inertia, weight and friction; strut forces are
Newton–Euler on the platform, the telescope's bar and each strut. Conventions: README.md.
"""

import csv
import os
import sys

from mpmath import cos, matrix, lu_solve, mp, mpf, nstr, pi, sin, sqrt, tanh

mp.dps = 50
STEP = mpf(10) ** -14
HERE = os.path.dirname(os.path.abspath(__file__))

G = mpf("9.81")
BASE, ARM, STRUT, PLATFORM = mpf("0.2"), mpf("0.5"), mpf("1.106"), mpf("0.048")
PAIR, UPPER_HOOKE, LOWER_HOOKE, FLANGE = mpf("0.1"), mpf("0.075"), mpf("0.038"), mpf("-0.0625")
# Mass, first moment and inertia of the bodies (README.md).
ARM_X, ARM_Z, ARM_YY = mpf("0.176"), mpf("0.006"), mpf("0.258")
STRUT_M, STRUT_X, STRUT_YY = mpf("0.179"), mpf("0.076"), mpf("0.075")
PLATFORM_M, PLATFORM_Z = mpf("1.2"), mpf("-0.024")
BAR_UP = (mpf("0.922"), mpf("-0.219"), mpf("0.084"), mpf("1.9e-5"))
BAR_LOW = (mpf("0.557"), mpf("0.146"), mpf("0.077"), mpf("3e-5"))
ROTOR = mpf("0.003")
PAYLOAD = (mpf("2.5"), (mpf("0.03"), mpf("-0.02"), mpf("-0.08")), mpf("0.012"))


def add(*vectors):
    return tuple(sum(parts) for parts in zip(*vectors))


def scale(k, a):
    return tuple(k * x for x in a)


def minus(a, b):
    return tuple(x - y for x, y in zip(a, b))


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    return scale(1 / sqrt(dot(a, a)), a)


Z = (mpf(0), mpf(0), mpf(1))
AZIMUTH = [mpf(0), 2 * pi / 3, 4 * pi / 3]
RADIAL = [(cos(a), sin(a), mpf(0)) for a in AZIMUTH]
TANGENT = [(-sin(a), cos(a), mpf(0)) for a in AZIMUTH]


def pose(q):
    """Vectors that describe the machine at joint angles q."""
    arm = [add(scale(cos(q[i]), RADIAL[i]), scale(-sin(q[i]), Z)) for i in range(3)]
    # The arm's own z axis, upward at rest.
    arm_z = [add(scale(sin(q[i]), RADIAL[i]), scale(cos(q[i]), Z)) for i in range(3)]
    elbow = [add(scale(BASE, RADIAL[i]), scale(ARM, arm[i])) for i in range(3)]
    # The platform is where three spheres about the elbows, moved inward by its radius, meet below.
    c = [minus(elbow[i], scale(PLATFORM, RADIAL[i])) for i in range(3)]
    a, b = minus(c[1], c[0]), minus(c[2], c[0])
    ex = unit(a)
    i = dot(ex, b)
    ey = unit(minus(b, scale(i, ex)))
    d, j = dot(ex, a), dot(ey, b)
    x = d / 2
    y = (i * i + j * j) / (2 * j) - i * x / j
    ez = cross(ex, ey)
    height = sqrt(STRUT * STRUT - x * x - y * y)
    below = -1 if ez[2] > 0 else 1
    p = add(c[0], scale(x, ex), scale(y, ey), scale(below * height, ez))
    strut = [scale(1 / STRUT, minus(add(p, scale(PLATFORM, RADIAL[i])), elbow[i])) for i in range(3)]
    hooke = add(p, scale(LOWER_HOOKE, Z))
    bar = minus(scale(UPPER_HOOKE, Z), hooke)
    length = sqrt(dot(bar, bar))
    w = unit(bar)
    fork = (cos(q[3]), sin(q[3]), mpf(0))
    yoke = unit(cross(w, fork))
    com = PAYLOAD[1]
    load = add(p, scale(FLANGE + com[2], Z), scale(com[0], fork), scale(com[1], (-sin(q[3]), cos(q[3]), mpf(0))))
    out = {"p": p, "hooke": hooke, "w": w, "fork": fork, "yoke": yoke, "load": load, "s": (length,)}
    for i in range(3):
        out.update({f"x{i}": arm[i], f"z{i}": arm_z[i], f"e{i}": elbow[i], f"u{i}": strut[i]})
    return out


class State:
    """Positions, rates, accelerations and Jacobians of the vectors of a pose."""

    def __init__(self, q, qd, qdd):
        at = lambda t: pose([a + b * t + c * t * t / 2 for a, b, c in zip(q, qd, qdd)])
        before, self.r, after = at(-STEP), at(mpf(0)), at(STEP)
        self.v = {k: scale(1 / (2 * STEP), minus(after[k], before[k])) for k in self.r}
        self.a = {
            k: scale(1 / STEP**2, minus(add(after[k], before[k]), scale(2, self.r[k]))) for k in self.r
        }
        self.d = []
        for i in range(4):
            up, down = ([x + (s * STEP if k == i else 0) for k, x in enumerate(q)] for s in (1, -1))
            up, down = pose(up), pose(down)
            self.d.append({k: scale(1 / (2 * STEP), minus(up[k], down[k])) for k in up})
        self.q, self.qd, self.qdd = q, qd, qdd
        # Rate of the bar about itself, from its yoke, and its angular acceleration.
        w, b, v, a = self.r["w"], self.r["yoke"], self.v, self.a
        side = cross(w, b)
        self.spin = dot(v["yoke"], side)
        self.spin_rate = dot(a["yoke"], side) + dot(v["yoke"], cross(v["w"], b))
        self.spin_by = [dot(d["yoke"], side) for d in self.d]


def friction(state):
    """Torques of the drives and the pull of the telescope's friction against lengthening."""
    coulomb, viscous = ["4.667", "4.376", "6.466"], ["1.727", "2.064", "1.557"]
    qd = state.qd
    own = [mpf(coulomb[i]) * tanh(100 * qd[i]) + mpf(viscous[i]) * qd[i] for i in range(3)]
    own.append(mpf("0.5272") * tanh(100 * qd[3]) + mpf("0.6672") * tanh(qd[3] / mpf("8.5919")))
    rate = state.v["s"][0]
    return own, mpf("1.641") * tanh(100 * rate) + mpf("1.247") * rate


def torques(state, payload, rubbing):
    """Virtual work: what the drives must do against inertia, weight and friction."""
    r, a = state.r, state.a
    own, pull = friction(state) if rubbing else ([mpf(0)] * 4, mpf(0))
    tau = []
    for i, d in enumerate(state.d):
        work = own[i] + pull * d["s"][0]
        for k in range(3):
            work += ARM_YY * dot(a[f"x{k}"], d[f"x{k}"]) + G * (ARM_X * d[f"x{k}"][2] + ARM_Z * d[f"z{k}"][2])
            e, u, de, du = a[f"e{k}"], a[f"u{k}"], d[f"e{k}"], d[f"u{k}"]
            up = add(e, scale(G, Z))
            one = STRUT_M * dot(up, de) + STRUT_X * (dot(up, du) + dot(u, de)) + STRUT_YY * dot(u, du)
            work += 2 * one
        work += PLATFORM_M * dot(add(a["p"], scale(G, Z)), d["p"])
        for (m, mc, across, along), joint in ((BAR_UP, None), (BAR_LOW, "hooke")):
            at, by = (scale(G, Z), (mpf(0),) * 3) if joint is None else (add(a[joint], scale(G, Z)), d[joint])
            work += m * dot(at, by) + mc * (dot(at, d["w"]) + dot(a["w"], by)) + across * dot(a["w"], d["w"])
            twist = add(scale(state.spin_rate, r["w"]), scale(state.spin, state.v["w"]))
            turn = add(cross(r["w"], d["w"]), scale(state.spin_by[i], r["w"]))
            work += along * dot(twist, turn)
        if i == 3:
            work += ROTOR * state.qdd[3]
        if payload:
            m, _, inertia = PAYLOAD
            work += m * dot(add(a["load"], scale(G, Z)), d["load"])
            work += inertia * state.qdd[3] if i == 3 else 0
        tau.append(work)
    return tau


def strut_forces(state, payload, rubbing):
    """Newton–Euler: axial forces of the six struts at both ends, tension positive."""
    r, v, a = state.r, state.v, state.a
    pull = friction(state)[1] if rubbing else mpf(0)
    up = lambda x: add(x, scale(G, Z))
    w, fork, yoke = r["w"], r["fork"], r["yoke"]
    # What turns with axis 4: its moment about z comes from the lower Hooke joint, the rest through the platform.
    carried, moment, about_z = (mpf(0),) * 3, (mpf(0),) * 3, mpf(0)
    if payload:
        m, _, inertia = PAYLOAD
        arm = minus(r["load"], r["p"])
        carried = scale(m, up(a["load"]))
        moment = cross(arm, carried)
        about_z = inertia * state.qdd[3]
        moment = add(moment, scale(about_z, Z))
        from_axis = add(r["p"], scale(FLANGE, Z))
        about_z += cross(minus(r["load"], from_axis), carried)[2]
    # A Hooke joint transmits a moment across its two axes.
    normal = cross(fork, yoke)
    lower_moment = about_z / normal[2]  # on what hangs below, along normal
    # The bar's lower part slides in the upper: the force along it is its own inertia, weight and the friction.
    m, mc, _, _ = BAR_LOW
    own = add(scale(m, up(a["hooke"])), scale(mc, a["w"]))
    along = dot(own, w) - pull  # force of the platform on the lower part, along w
    # Moments about the upper joint of the whole bar: inertia − weight = joint moments + force at its lower end.
    needed = (mpf(0),) * 3
    for (m, mc, across, twist), joint in ((BAR_UP, None), (BAR_LOW, "hooke")):
        at = scale(G, Z) if joint is None else up(a[joint])
        place = (mpf(0),) * 3 if joint is None else scale(-r["s"][0], w)
        needed = add(
            needed,
            cross(place, add(scale(m, at), scale(mc, a["w"]))),
            scale(mc, cross(w, at)),
            scale(across, cross(w, a["w"])),
            scale(twist, add(scale(state.spin_rate, w), scale(state.spin, v["w"]))),
        )
    # Unknown: two transverse forces at the lower end, the moment at the upper joint.
    e1 = unit(cross(w, (mpf(1), mpf(0), mpf(0))))
    e2 = cross(w, e1)
    lever = scale(-r["s"][0], w)
    columns = [cross(lever, e1), cross(lever, e2), normal]
    right = add(needed, scale(lower_moment, normal))
    solved = lu_solve(matrix([[c[i] for c in columns] for i in range(3)]), matrix(list(right)))
    on_bar = add(scale(along, w), scale(solved[0], e1), scale(solved[1], e2))
    # Struts: transverse forces at the lower end from moments about the upper one.
    transverse = []
    for k in range(3):
        u, at = r[f"u{k}"], up(a[f"e{k}"])
        whole = scale(1 / STRUT, add(scale(STRUT_X, at), scale(STRUT_YY, a[f"u{k}"])))
        transverse.append(minus(whole, scale(dot(whole, u), u)))
    # Platform: forces, and moments about the centre of the ball plane.
    force = add(scale(PLATFORM_M, up(a["p"])), carried, on_bar)
    com = scale(PLATFORM_Z, Z)
    torque = add(cross(com, up(a["p"])), moment, cross(scale(LOWER_HOOKE, Z), on_bar))
    torque = minus(torque, scale(lower_moment, normal))
    columns = []
    for k in range(3):
        for side in (1, -1):
            ball = add(scale(PLATFORM, RADIAL[k]), scale(side * PAIR / 2, TANGENT[k]))
            force = add(force, transverse[k])
            torque = add(torque, cross(ball, transverse[k]))
            pull_of = scale(-1, r[f"u{k}"])
            columns.append(pull_of + cross(ball, pull_of))
    system = matrix([[c[i] for c in columns] for i in range(6)])
    lower = list(lu_solve(system, matrix(list(force + torque))))
    upper = []
    for s in range(6):
        k = s // 2
        own = dot(r[f"u{k}"], add(scale(STRUT_M, up(a[f"e{k}"])), scale(STRUT_X, a[f"u{k}"])))
        upper.append(lower[s] - own)
    return lower, upper


def kinematics(state):
    r, v = state.r, state.v
    out = dict(zip(("ee_x", "ee_y", "ee_z"), r["p"]))
    out["telescope_rate"] = v["s"][0]
    for k in range(3):
        strut = cross(r[f"u{k}"], v[f"u{k}"])
        arm = cross(r[f"x{k}"], v[f"x{k}"])
        out[f"limb{k + 1}_upper_socket_rate"] = sqrt(dot(minus(strut, arm), minus(strut, arm)))
        out[f"limb{k + 1}_lower_socket_rate"] = sqrt(dot(strut, strut))
    return out


def dynamics(state, payload, rubbing):
    out = {f"tau{i + 1}": x for i, x in enumerate(torques(state, payload, rubbing))}
    lower, upper = strut_forces(state, payload, rubbing)
    out.update({f"strut{s + 1}_lower": x for s, x in enumerate(lower)})
    out.update({f"strut{s + 1}_upper": x for s, x in enumerate(upper)})
    return out


FILES = {
    "kinematics": kinematics,
    "rigid_no_payload": lambda s: dynamics(s, False, False),
    "rigid_payload": lambda s: dynamics(s, True, False),
    "friction_no_payload": lambda s: dynamics(s, False, True),
}


def main(target):
    bad = False
    for name, compute in FILES.items():
        with open(os.path.join(HERE, name + ".csv")) as file:
            rows = list(csv.DictReader(file))
        columns = list(rows[0])
        worst = {c: [mpf(0), mpf(0)] for c in columns}
        made = []
        for row in rows:
            vector = lambda word: [mpf(row.get(f"{word}{i}", "0")) for i in range(1, 5)]
            state = State(vector("q"), vector("qd"), vector("qdd"))
            got = compute(state)
            for c, x in got.items():
                worst[c][0] = max(worst[c][0], abs(x - mpf(row[c])))
                worst[c][1] = max(worst[c][1], abs(mpf(row[c])))
            made.append([nstr(got[c], 15) if c in got else row[c] for c in columns])
        errors = {c: d / m for c, (d, m) in worst.items() if m}
        column = max(errors, key=errors.get)
        print(f"{name}: {len(rows)} states, worst column {column}: {nstr(errors[column], 2)} of its magnitude")
        bad |= errors[column] > mpf("1e-12")
        if target:
            with open(os.path.join(target, name + ".csv"), "w", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows([columns] + made)
    return int(bad)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1] if len(sys.argv) > 1 else None))
