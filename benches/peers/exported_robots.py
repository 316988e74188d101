"""The robots that `deltatwin export` writes, in MuJoCo (MJCF) and Pinocchio (URDF), against deltatwin itself.

Both read a tree; its loops are closed here by Newton's method on the coincidence of the ball sockets and hinges and on the
couplings of joints, from the home pose and the angles of the axes alone. Compared are the mass, the pose of every link, and the torque of the axes for random motions: the
generalised forces of the tree, collected at the axes by the motion that the closed loops allow. For MuJoCo also what it makes
of the closure by itself: the acceleration that its soft constraints give for these torques, and a run of 0.3 s.

    pip install ./python mujoco pin
    cargo build -p deltatwin-cli --no-default-features
    python benches/peers/exported_robots.py [target/debug/deltatwin]
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import deltatwin as dt
import mujoco
import numpy as np
import pinocchio as pin

PROGRAM = sys.argv[1] if len(sys.argv) > 1 else "target/debug/deltatwin"
POSES = 50
SETUP = """configuration = "assembled"
[payload]
mass = 2.5
com = [0.06, -0.03, -0.12]
inertia = [0.02, 0.025, 0.015, 0.001, -0.002, 0.003]
"""


class MuJoCo:
    """The tree of an MJCF file."""

    def __init__(self, file: Path, axes: int) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(file))
        self.model.dof_damping[:] = 0
        self.model.dof_frictionloss[:] = 0
        self.data = mujoco.MjData(self.model)
        self.axes = [self.model.joint(f"axis{k + 1}").dofadr[0] for k in range(axes)]
        self.places = [self.model.joint(f"axis{k + 1}").qposadr[0] for k in range(axes)]
        kinds = self.model.eq_type
        ends = np.column_stack([self.model.eq_obj1id, self.model.eq_obj2id])
        self.sites = ends[kinds == mujoco.mjtEq.mjEQ_CONNECT]
        coupled = kinds == mujoco.mjtEq.mjEQ_JOINT
        self.couplings = [(*pair, data[1]) for pair, data in zip(ends[coupled], self.model.eq_data[coupled], strict=True)]
        self.links = [self.model.body(k).name for k in range(self.model.nbody)]
        self.struts = [k for k, name in enumerate(self.links) if name.startswith("strut")]
        self.nv = self.model.nv

    def mass(self) -> float:
        return self.model.body_mass.sum()

    def home(self, q):
        full = self.model.qpos0.copy()
        full[self.places] = q
        return full

    def move(self, full, step):
        out = full.copy()
        mujoco.mj_integratePos(self.model, out, step, 1.0)
        return out

    def place(self, full, v=None):
        self.data.qpos[:] = full
        self.data.qvel[:] = 0 if v is None else v
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)

    def gap(self):
        at, q, places = self.data.site_xpos, self.data.qpos, self.model.jnt_qposadr
        coupled = [q[places[a]] - factor * q[places[b]] for a, b, factor in self.couplings]
        return np.concatenate([*(at[a] - at[b] for a, b in self.sites), coupled])

    def _of_site(self, site, rate):
        jac = np.zeros((3, self.nv))
        body, point = self.model.site_bodyid[site], self.data.site_xpos[site]
        if rate:
            mujoco.mj_jacDot(self.model, self.data, jac, None, point, body)
        else:
            mujoco.mj_jac(self.model, self.data, jac, None, point, body)
        return jac

    def rows(self, rate=False):
        coupled = np.zeros((len(self.couplings), self.nv))
        if not rate:
            for row, (a, b, factor) in zip(coupled, self.couplings, strict=True):
                row[self.model.jnt_dofadr[[a, b]]] = 1, -factor
        return np.vstack([*(self._of_site(a, rate) - self._of_site(b, rate) for a, b in self.sites), coupled])

    def spin_rows(self, rate=False):
        out = []
        for body in self.struts:
            turn, turn_rate = np.zeros((3, self.nv)), np.zeros((3, self.nv))
            point = self.data.xpos[body]
            mujoco.mj_jac(self.model, self.data, None, turn, point, body)
            mujoco.mj_jacDot(self.model, self.data, None, turn_rate, point, body)
            along = self.data.xmat[body].reshape(3, 3)[:, 0]
            spun = np.cross(turn @ self.data.qvel, along)
            out.append(along @ turn_rate + spun @ turn if rate else along @ turn)
        return np.array(out)

    def force(self, a):
        """Generalised forces of the tree for the accelerations `a`."""
        full = np.zeros((self.nv, self.nv))
        mujoco.mj_fullM(self.model, self.data, full)
        return full @ a + self.data.qfrc_bias

    def pose(self, name):
        body = self.model.body(name).id
        return self.data.xpos[body].copy(), self.data.xmat[body].reshape(3, 3).copy()


class Pinocchio:
    """The tree of a URDF file."""

    def __init__(self, file: Path, axes: int) -> None:
        self.model = pin.buildModelFromUrdf(str(file))
        self.data = self.model.createData()
        self.joints = [self.model.joints[self.model.getJointId(f"axis{k + 1}")] for k in range(axes)]
        self.axes = [joint.idx_v for joint in self.joints]
        self.links = names = [frame.name for frame in self.model.frames]
        ends = [name.removesuffix("_cup") for name in names if name.endswith("_cup")]
        self.frames = [[self.model.getFrameId(f"{name}_{end}") for end in ("cup", "ball")] for name in ends]
        joints = ElementTree.parse(file).iter("joint")
        mimics = [(joint.get("name"), joint.find("mimic")) for joint in joints]
        place = lambda name: self.model.joints[self.model.getJointId(name)]  # noqa: E731
        self.couplings = [
            (place(name), place(mimic.get("joint")), float(mimic.get("multiplier"))) for name, mimic in mimics if mimic is not None
        ]
        self.struts = [self.model.getFrameId(name) for name in dict.fromkeys(names) if re.fullmatch(r"strut\d+", name)]
        self.nv = self.model.nv

    def mass(self) -> float:
        return sum(inertia.mass for inertia in self.model.inertias)

    def home(self, q):
        step = np.zeros(self.nv)
        step[self.axes] = q
        return pin.integrate(self.model, pin.neutral(self.model), step)

    def move(self, full, step):
        return pin.integrate(self.model, full, step)

    def place(self, full, v=None):
        self.full, self.v = full, np.zeros(self.nv) if v is None else v
        pin.computeJointJacobiansTimeVariation(self.model, self.data, full, self.v)
        pin.updateFramePlacements(self.model, self.data)

    def gap(self):
        at = [[self.data.oMf[f].translation for f in pair] for pair in self.frames]
        coupled = [self._apart(*coupling) for coupling in self.couplings]
        return np.concatenate([*(a - b for a, b in at), coupled])

    def _apart(self, joint, other, factor):
        own, leading = self.full[joint.idx_q], self.full[other.idx_q : other.idx_q + other.nq]
        if other.nq == 1:
            return own - factor * leading[0]
        # A joint without limits has cosine and sine of its angle, without full turns.
        apart = own - factor * np.arctan2(leading[1], leading[0])
        return apart - 2 * np.pi * factor * np.round(apart / (2 * np.pi * factor))

    def _jacobian(self, frame, rate):
        of = pin.getFrameJacobianTimeVariation if rate else pin.getFrameJacobian
        return of(self.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED)

    def rows(self, rate=False):
        coupled = np.zeros((len(self.couplings), self.nv))
        if not rate:
            for row, (a, b, factor) in zip(coupled, self.couplings, strict=True):
                row[[a.idx_v, b.idx_v]] = 1, -factor
        return np.vstack([*((self._jacobian(a, rate) - self._jacobian(b, rate))[:3] for a, b in self.frames), coupled])

    def spin_rows(self, rate=False):
        out = []
        for frame in self.struts:
            turn, along = self._jacobian(frame, False)[3:], self.data.oMf[frame].rotation[:, 0]
            spun = np.cross(turn @ self.v, along)
            out.append(along @ self._jacobian(frame, True)[3:] + spun @ turn if rate else along @ turn)
        return np.array(out)

    def force(self, a):
        return pin.rnea(self.model, self.data, self.full, self.v, a)

    def pose(self, name):
        at = self.data.oMf[self.model.getFrameId(name)]
        return at.translation.copy(), at.rotation.copy()


def closed(tree, q):
    """Coordinates of the tree with closed loops at the angles `q`, reached from the home pose without a jump."""
    full = tree.home(np.zeros(len(q)))
    passive = np.setdiff1d(np.arange(tree.nv), tree.axes)
    count = int(np.ceil(np.abs(q).max() / 0.2)) + 1
    for _ in range(count):
        step = np.zeros(tree.nv)
        step[tree.axes] = np.asarray(q) / count
        full = tree.move(full, step)
        for _ in range(20):
            tree.place(full)
            gap = tree.gap()
            if np.abs(gap).max() < 1e-14:
                break
            step = np.zeros(tree.nv)
            step[passive] = np.linalg.lstsq(tree.rows()[:, passive], -gap, rcond=1e-10)[0]
            full = tree.move(full, step)
    assert np.abs(gap).max() < 1e-11, np.abs(gap).max()
    return full


def completed(tree, known, bias):
    """Rates or accelerations of the tree for those of the axes: rows·v + bias = 0, struts without spin."""
    rows = np.vstack([tree.rows(), tree.spin_rows()])
    passive = np.setdiff1d(np.arange(tree.nv), tree.axes)
    out = np.zeros((tree.nv, *np.shape(known)[1:]))
    out[tree.axes] = known
    right = -(rows[:, tree.axes] @ known) - bias
    out[passive], *_ = np.linalg.lstsq(rows[:, passive], right, rcond=1e-10)
    left = rows @ out + bias
    assert np.abs(left).max() < 1e-8 * max(1.0, np.abs(out).max()), np.abs(left).max()
    return out


def compare(name, tree, model, setup, mass, states):
    """Largest differences of poses (m, 1) and torques, over all states."""
    assert abs(tree.mass() - mass) < 1e-8, (tree.mass(), mass)
    worst = {"gap": 0.0, "turn": 0.0, "torque": 0.0}
    largest, kept = 0.0, []
    for q, qd, qdd in states:
        motion = model.motion(q, qd, qdd, setup=setup)
        full = closed(tree, q)
        tree.place(full)
        v = completed(tree, qd, 0.0)
        tree.place(full, v)
        bias = np.concatenate([tree.rows(rate=True) @ v, tree.spin_rows(rate=True) @ v])
        a = completed(tree, qdd, bias)
        for body, position, rotation in zip(motion.bodies, np.squeeze(motion.position), np.squeeze(motion.rotation), strict=True):
            if body not in tree.links:
                continue
            at, turn = tree.pose(body)
            worst["gap"] = max(worst["gap"], np.abs(at - position).max())
            # A strut may stand at any angle about its axis, on which nothing depends.
            seen = slice(0, 1) if body.startswith("strut") else slice(None)
            worst["turn"] = max(worst["turn"], np.abs((turn - rotation)[:, seen]).max())
        ways = completed(tree, np.eye(len(tree.axes)), 0.0)
        torque = ways.T @ tree.force(a)
        expected = np.ravel(model.inverse_dynamics(q, qd, qdd, setup=setup))
        worst["torque"] = max(worst["torque"], np.abs(torque - expected).max())
        largest = max(largest, np.abs(expected).max())
        kept.append((full, v, expected, a))
    print(
        f"{name}: mass {tree.mass():.6f} kg; {len(states)} states: links {worst['gap']:.1e} m, {worst['turn']:.1e} rad; "
        f"torque {worst['torque']:.1e} of {largest:.0f} N·m"
    )
    assert worst["gap"] < 1e-10 and worst["turn"] < 1e-9, worst
    assert worst["torque"] < 1e-9 * largest, worst
    return kept


def softness(tree, kept, states):
    """Relative error of MuJoCo's own acceleration of the axes, median and largest."""
    errors = []
    for (full, v, torque, _), (_, _, qdd) in zip(kept, states, strict=True):
        tree.data.qpos[:], tree.data.qvel[:] = full, v
        tree.data.qfrc_applied[:] = 0
        tree.data.qfrc_applied[tree.axes] = torque
        mujoco.mj_forward(tree.model, tree.data)
        errors.append(np.abs(tree.data.qacc[tree.axes] - qdd).max() / np.abs(qdd).max())
    return np.median(errors), max(errors)


def run(tree, model, setup, q, torque, seconds=0.3):
    """Largest difference of the axes' angles (rad) after a run from rest with constant torques."""
    tree.data.qpos[:], tree.data.qvel[:] = closed(tree, q), 0
    tree.data.qfrc_applied[:] = 0
    tree.data.qfrc_applied[tree.axes] = torque
    step = tree.model.opt.timestep
    count = round(seconds / step)
    state, rate = np.array(q, float), np.zeros(len(q))
    worst = 0.0
    for _ in range(count):
        mujoco.mj_step(tree.model, tree.data)
        acc = lambda x, v: np.ravel(model.forward_dynamics(x, v, torque, setup=setup))  # noqa: E731
        k1 = acc(state, rate)
        k2 = acc(state + step / 2 * rate, rate + step / 2 * k1)
        k3 = acc(state + step / 2 * rate + step**2 / 4 * k1, rate + step / 2 * k2)
        k4 = acc(state + step * rate + step**2 / 2 * k2, rate + step * k3)
        state = state + step * rate + step**2 / 6 * (k1 + k2 + k3)
        rate = rate + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        worst = max(worst, np.abs(tree.data.qpos[tree.places] - state).max())
    tree.place(tree.data.qpos.copy())
    return worst, np.abs(state - q).max(), np.abs(tree.gap()).max()


def bodies_mass(model, payload):
    """Mass of the moving bodies of a model file, kg."""
    bodies = tomllib.loads(model.to_toml())["bodies"]
    limbs = tomllib.loads(model.to_toml()).get("limbs", [{}] * 3)
    # A model file lists arms and struts of passive limbs one by one.
    driven = sum(limb.get("drive", True) for limb in limbs)
    counts = {"arm": driven, "strut": 2 * driven}
    return sum(counts.get(name, 1) * body.get("mass", 0.0) for name, body in bodies.items()) + payload


def main() -> None:
    folder = Path(tempfile.mkdtemp())
    (folder / "load.setup.toml").write_text(SETUP)
    file = tomllib.loads(SETUP)["payload"]
    loaded = dt.Setup(dt.Payload(file["mass"], file["com"], inertia=file["inertia"]))
    rng = np.random.default_rng(7)
    robots = (
        ("irb360-6-1600", None),
        ("irb360-6-1600", loaded),
        ("irb360-1-1130", None),
        ("clavel-delta", loaded),
        ("linear-delta", None),
        ("par4", None),
        ("h4", None),
        ("i4", None),
        ("par2", None),
    )
    for name, setup in robots:
        model = dt.Model.load(Path(__file__).parents[2] / "models" / f"{name}.toml")
        for effect in model.effects:
            model = model.without_effect(effect)
        source = folder / f"{name}.toml"
        model.save(source, force=True)
        mass = bodies_mass(model, setup.payload.mass if setup else 0.0)
        trees = []
        for ending, kind in (("xml", MuJoCo), ("urdf", Pinocchio)):
            target = folder / f"{name}.{ending}"
            how = ["--setup", str(folder / "load.setup.toml")] if setup else []
            subprocess.run([PROGRAM, "export", str(source), "-o", str(target), "--force", *how], check=True, stdout=subprocess.DEVNULL)
            trees.append(kind(target, model.dof))
        carriages = name == "linear-delta"
        relative = name in ("par4", "h4", "i4", "par2")
        low, high, speed, acceleration = (0.05, 0.15, 0.5, 5) if carriages else (0.3, 0.5, 3, 30) if relative else (-0.3, 0.9, 6, 60)
        last = rng.uniform(low, high, POSES) if relative else rng.uniform(-3, 3, POSES)
        arms = np.column_stack([rng.uniform(low, high, (POSES, 3)), last])[:, : model.dof]
        states = []
        for k, q in enumerate(arms):
            moving = float(k % 2)
            qd = moving * rng.uniform(-speed, speed, model.dof)
            states.append((q, qd, rng.uniform(-acceleration, acceleration, model.dof)))
        title = f"{name}{' with payload' if setup else ''}"
        kept = compare(f"{title}, MuJoCo {mujoco.__version__}", trees[0], model, setup, mass, states)
        median, most = softness(trees[0], kept, states)
        print(f"  its own accelerations differ by {median:.1e} in the median, {most:.1e} at most")
        q = np.array([0.1, 0.12, 0.11] if carriages else [0.1, 0.2, 0.15, 0.12 if relative else 0.3])[: model.dof]
        push = np.array([0.4, -0.25, 0.15] if carriages else [1, 0.8, 1.2, 0.9] if relative else [8, -5, 3, 0.3])
        hold = np.ravel(model.gravity(q, setup=setup))
        worst, moved, gap = run(trees[0], model, setup, q, hold + push[: model.dof])
        print(f"  a run of 0.3 s: {worst:.1e} rad of {moved:.2f} rad; its loops are open by {1e6 * gap:.2f} µm at the end")
        # The impedance of a closure is at most 0.9999: a little of the acceleration yields, more of it in light robots.
        # A rack that turns a light spindle yields most.
        soft = (5e-2, 0.2) if name == "i4" else (5e-3, 3e-2)
        assert median < soft[0] and most < soft[1] and worst < 3e-3 * moved, (median, most, worst)
        compare(f"{title}, Pinocchio {pin.__version__}", trees[1], model, setup, mass, states)


if __name__ == "__main__":
    main()
