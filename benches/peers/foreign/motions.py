"""Desired motions: point to point with trapezoids or S-curves, multisines, pick and place. All within limits of the arms."""

import numpy as np

from plant import forward

ARM_RANGE = (-0.55, 1.45)  # rad
BAR_RANGE = (0.84, 1.34)  # m, distance of the Hooke joints
RADIUS, LOW, HIGH = 0.55, -1.16, -0.86  # m, cylinder of the platform's targets


def arms(plant, at):
    """Arm angles of platform positions (n, 3), the elbow outwards."""
    q = np.empty((len(at), 3))
    for i, azimuth in enumerate(plant.azimuth):
        x = at @ [np.cos(azimuth), np.sin(azimuth), 0.0] - (plant.base - plant.platform)
        y = at @ [-np.sin(azimuth), np.cos(azimuth), 0.0]
        z = at[:, 2]
        # arm·(x cos q − z sin q) = (x² + y² + z² + arm² − strut²) / 2
        side = (x * x + y * y + z * z + plant.arm**2 - plant.strut**2) / (2 * plant.arm)
        q[:, i] = np.arctan2(-z, x) - np.arccos(np.clip(side / np.hypot(x, z), -1, 1))
    return q


def profile(kind, steps):
    """A path coordinate 0…1 over `steps` samples with zero rate at both ends."""
    u = np.linspace(0, 1, steps)
    if kind == "trapezoid":
        third = 1 / 3
        s = np.where(u < third, u * u / 2, np.where(u < 1 - third, third * (u - third / 2), 0))
        s = np.where(u >= 1 - third, third * (1 - third) - (1 - u) ** 2 / 2, s)
        return s / s[-1]
    return u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3)


def smooth(reference, rate, seconds):
    """Mean over a window, twice: what a controller's interpolator does with corners of the acceleration."""
    width = max(int(rate * seconds), 1)
    window = np.ones(width) / width
    for _ in range(2):
        padded = np.pad(reference, ((width, width), (0, 0)), mode="edge")
        reference = np.stack([np.convolve(c, window, mode="same") for c in padded.T], axis=1)[width:-width]
    return reference


def targets(rng, n):
    """Random platform positions (n, 3)."""
    r, angle = RADIUS * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * np.pi, n)
    return np.stack([r * np.cos(angle), r * np.sin(angle), rng.uniform(LOW, HIGH, n)], axis=1)


def point_to_point(plant, rng, rate, seconds, quick):
    """Moves between random points, in the joints, each as fast as the limits on speed and acceleration allow."""
    kind = rng.choice(["trapezoid", "s_curve"])
    speed, acceleration = 5.0 * quick, 45.0 * quick
    now = np.append(arms(plant, targets(rng, 1))[0], rng.uniform(-2, 2))
    parts, count = [], 0
    while count < rate * seconds:
        to = np.append(arms(plant, targets(rng, 1))[0], rng.uniform(-3, 3))
        far = np.abs(to - now) / [1, 1, 1, 4]
        time = max(1.9 * far.max() / speed, np.sqrt(7.5 * far.max() / acceleration), 0.05)
        pause = rng.choice([0.0, 0.03, 0.2])
        s = np.append(profile(kind, int(time * rate)), np.ones(int(pause * rate)))
        parts.append(now + s[:, None] * (to - now))
        count += len(s)
        now = to
    return smooth(np.concatenate(parts), rate, 0.02 if kind == "trapezoid" else 0.002)


def multisine(plant, rng, rate, seconds, quick):
    """Sums of sines with random frequencies and phases in all joints, from rest."""
    t = np.arange(int(rate * seconds)) / rate
    ramp = np.clip(t / 0.5, 0, 1)
    ramp = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    q = np.empty((len(t), 4))
    for axis in range(4):
        f = rng.uniform(0.1, 1.8 * quick, 6)
        a = rng.uniform(0.3, 1, 6) / np.sqrt(1 + f**2)
        wave = np.sum(a[:, None] * np.sin(2 * np.pi * f[:, None] * t + rng.uniform(0, 2 * np.pi, 6)[:, None]), axis=0)
        q[:, axis] = wave / np.abs(wave).max()
    scale = np.array([1, 1, 1, 3.0]) * rng.uniform(0.35, 0.6)
    centre = np.append(np.full(3, rng.uniform(0.3, 0.5)), 0)
    return centre + scale * q * ramp[:, None]


def pick_and_place(plant, rng, rate, seconds, quick):
    """Up, over, down between random pairs of places on a table, rounded, with a turn of axis 4."""
    table = rng.uniform(-1.15, -1.05)
    up = rng.uniform(0.05, 0.15)
    now, turn = targets(rng, 1)[0], 0.0
    now[2] = table
    parts, count = [], 0
    while count < rate * seconds:
        to = targets(rng, 1)[0]
        to[2] = table
        far = np.linalg.norm(to - now)
        time = max(far / (2.2 * quick), 0.25 / quick) + 0.1
        n = int(time * rate)
        u = np.linspace(0, 1, n)
        over = profile("s_curve", n)
        lift = np.clip(np.minimum(u, 1 - u) / 0.35, 0, 1)
        lift = lift**3 * (10 - 15 * lift + 6 * lift**2)
        path = now + over[:, None] * (to - now)
        path[:, 2] += up * lift
        turned = turn + over * rng.choice([-1, 1]) * np.pi / 2
        hold = int(rate * rng.choice([0.02, 0.05, 0.15]))
        joints = np.column_stack([arms(plant, path), turned])
        parts.append(np.concatenate([joints, np.repeat(joints[-1:], hold, axis=0)]))
        count += n + hold
        now, turn = to, turned[-1]
    return smooth(np.concatenate(parts), rate, 0.003)


KINDS = {"point_to_point": point_to_point, "multisine": multisine, "pick_and_place": pick_and_place}


def feasible(plant, q, rate):
    """Whether arms, telescope, speeds, accelerations and jerks stay within their limits."""
    few = q[:: max(int(rate // 200), 1)]
    at = np.array([forward(plant, row) for row in few])
    bar = np.linalg.norm(at + [0, 0, plant.hooke_low - plant.hooke_up], axis=1)
    rates = np.gradient(q, 1 / rate, axis=0)
    bends = np.gradient(rates, 1 / rate, axis=0)
    inside = ARM_RANGE[0] < q[:, :3].min() and q[:, :3].max() < ARM_RANGE[1]
    jerks = np.gradient(smooth(bends, rate, 0.003), 1 / rate, axis=0)
    slow = np.abs(rates[:, :3]).max() < 9 and np.abs(bends[:, :3]).max() < 87 and np.abs(jerks[:, :3]).max() < 2500
    return inside and slow and BAR_RANGE[0] < bar.min() and bar.max() < BAR_RANGE[1] and np.isfinite(at).all()


def motion(plant, rng, kind, rate, seconds, quick):
    """A feasible desired motion (n, 4); slower and other ones are drawn until one is."""
    for _ in range(60):
        q = KINDS[kind](plant, rng, rate, seconds, quick)[: int(rate * seconds)]
        if feasible(plant, q, rate):
            return q
        quick = max(0.93 * quick, 0.3)
    raise RuntimeError(f"no feasible motion of kind {kind}")
