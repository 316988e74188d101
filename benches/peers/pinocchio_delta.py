"""Inverse dynamics of the three-axis delta robot by deltatwin and by Pinocchio, on the same states.

Pinocchio has the open tree (arms, struts on spherical joints, platform on a translation); the loops are closed by hand: the
motion of the passive joints follows from that of the arms, and the virtual work of all joint forces is collected at the
arms. Rigid bodies only, no friction.

    pip install ./python pin
    python benches/peers/pinocchio_delta.py
"""

import time
import tomllib

import deltatwin as dt
import numpy as np
import pinocchio as pin

NAME = "clavel-delta"


def inertia(body: dict) -> pin.Inertia:
    """A body from mass, first moment and inertia (xx, yy, zz) about its frame's origin."""
    mass = body["mass"]
    com = np.array(body["first_moment"]) / mass
    about_com = np.diag(body["inertia"]) - mass * (com @ com * np.eye(3) - np.outer(com, com))
    return pin.Inertia(mass, com, about_com)


class Delta:
    """The open tree with its closure."""

    def __init__(self, file: dict) -> None:
        g, bodies = file["geometry"], file["bodies"]
        self.base, self.arm, self.strut = g["base_radius"], g["arm_length"], g["strut_length"]
        self.platform, self.half = g["platform_radius"], g["pair_distance"] / 2
        self.turned = [pin.utils.rotate("z", 2 * np.pi * i / 3) for i in range(3)]
        self.model = pin.Model()
        self.model.gravity.linear = np.array([0.0, 0.0, -file["gravity"]])
        self.arms, self.struts = [], []
        for turn in self.turned:
            place = pin.SE3(turn, turn @ [self.base, 0, 0])
            arm = self.model.addJoint(0, pin.JointModelRY(), place, f"arm{len(self.arms)}")
            self.model.appendBodyToJoint(arm, inertia(bodies["arm"]), pin.SE3.Identity())
            self.arms.append(arm)
            for side in (1, -1):
                ball = pin.SE3(np.eye(3), np.array([self.arm, side * self.half, 0]))
                strut = self.model.addJoint(arm, pin.JointModelSpherical(), ball, f"strut{len(self.struts)}")
                self.model.appendBodyToJoint(strut, inertia(bodies["strut"]), pin.SE3.Identity())
                self.struts.append(strut)
        self.plate = self.model.addJoint(0, pin.JointModelTranslation(), pin.SE3.Identity(), "platform")
        self.model.appendBodyToJoint(self.plate, inertia(bodies["platform"]), pin.SE3.Identity())
        self.data = self.model.createData()

    def closed(self, q, qd, qdd):
        """Coordinates, rates and accelerations of the tree, and its rates per unit rate of each arm."""
        cos, sin = np.cos(q), np.sin(q)
        x = [turn @ [cos[i], 0, -sin[i]] for i, turn in enumerate(self.turned)]
        down = [turn @ [-sin[i], 0, -cos[i]] for i, turn in enumerate(self.turned)]
        centre = np.array([turn @ [self.base - self.platform, 0, 0] + self.arm * x[i] for i, turn in enumerate(self.turned)])
        # The platform is at the distance of a strut from three points: a line, and the lower of its two points.
        rows = 2 * (centre[1:] - centre[0])
        right = (centre[1:] ** 2).sum(axis=1) - (centre[0] ** 2).sum()
        along = np.cross(rows[0], rows[1])
        foot = np.linalg.lstsq(rows, right, rcond=None)[0]
        away = foot - centre[0]
        a, b, c = along @ along, 2 * along @ away, away @ away - self.strut**2
        p = min((foot + (-b + s * np.sqrt(b * b - 4 * a * c)) / (2 * a) * along for s in (1, -1)), key=lambda at: at[2])
        legs = p - centre
        rate = np.array([self.arm * d for d in down])
        jacobian = np.linalg.solve(legs, np.diag(np.einsum("ij,ij->i", legs, rate)))
        velocity = jacobian @ qd
        elbow = rate * qd[:, None]
        elbow_acc = rate * qdd[:, None] - np.array([self.arm * v for v in x]) * (qd**2)[:, None]
        relative = velocity - elbow
        push = np.einsum("ij,ij->i", legs, elbow_acc) - (relative**2).sum(axis=1)
        acceleration = np.linalg.solve(legs, push)
        full = pin.neutral(self.model)
        v, acc, map_ = np.zeros(self.model.nv), np.zeros(self.model.nv), np.zeros((self.model.nv, 3))
        for i, arm in enumerate(self.arms):
            joint = self.model.joints[arm]
            full[joint.idx_q], v[joint.idx_v], acc[joint.idx_v], map_[joint.idx_v, i] = q[i], qd[i], qdd[i], 1.0
            axis = legs[i] / self.strut
            tangent = self.turned[i][:, 1]
            turn = self.turned[i] @ pin.utils.rotate("y", q[i])
            side = np.cross(axis, [0, 0, 1.0])
            side /= np.linalg.norm(side)
            own = np.column_stack([axis, side, np.cross(axis, side)])
            spin = np.cross(axis, relative[i]) / self.strut
            spun = np.cross(axis, acceleration - elbow_acc[i]) / self.strut
            for strut in self.struts[2 * i : 2 * i + 2]:
                joint = self.model.joints[strut]
                full[joint.idx_q : joint.idx_q + 4] = pin.Quaternion(turn.T @ own).coeffs()
                place = slice(joint.idx_v, joint.idx_v + 3)
                v[place] = own.T @ (spin - qd[i] * tangent)
                acc[place] = own.T @ (spun - qdd[i] * tangent + np.cross(spin, qd[i] * tangent))
                for k in range(3):
                    move = jacobian[:, k] - (rate[i] if k == i else 0.0)
                    turned = np.cross(axis, move) / self.strut - (tangent if k == i else 0.0)
                    map_[place, k] = own.T @ turned
        joint = self.model.joints[self.plate]
        place = slice(joint.idx_v, joint.idx_v + 3)
        full[joint.idx_q : joint.idx_q + 3], v[place], acc[place], map_[place] = p, velocity, acceleration, jacobian
        return full, v, acc, map_

    def torque(self, state):
        full, v, acc, map_ = state
        return map_.T @ pin.rnea(self.model, self.data, full, v, acc)


def main() -> None:
    model = dt.Model.builtin(NAME)
    for effect in model.effects:
        model = model.without_effect(effect)
    delta = Delta(tomllib.loads(model.to_toml()))
    rng = np.random.default_rng(1)
    count = 50_000
    q, qd, qdd = rng.uniform(-0.2, 0.9, (count, 3)), rng.uniform(-5, 5, (count, 3)), rng.uniform(-80, 80, (count, 3))
    begun = time.perf_counter()
    own = model.inverse_dynamics(q, qd, qdd)
    seconds = time.perf_counter() - begun
    print(f"deltatwin, {count} states in one call: {1e6 * seconds / count:.2f} µs per state")
    begun = time.perf_counter()
    for k in range(5000):
        model.inverse_dynamics(q[k], qd[k], qdd[k])
    print(f"deltatwin, one call per state: {1e6 * (time.perf_counter() - begun) / 5000:.2f} µs")
    some = 2000
    begun = time.perf_counter()
    states = [delta.closed(q[k], qd[k], qdd[k]) for k in range(some)]
    closing = time.perf_counter() - begun
    begun = time.perf_counter()
    other = np.array([delta.torque(state) for state in states])
    torque = time.perf_counter() - begun
    print(f"pinocchio {pin.__version__}, rnea of the tree and virtual work: {1e6 * torque / some:.2f} µs per state")
    print(f"closing the loops by hand in numpy: {1e6 * closing / some:.0f} µs per state")
    worst = np.abs(own[:some] - other).max()
    print(f"largest difference {worst:.1e} N·m of {np.abs(other).max():.0f} N·m")
    assert worst < 1e-9 * np.abs(other).max()


if __name__ == "__main__":
    main()
