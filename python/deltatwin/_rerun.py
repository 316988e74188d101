"""Recordings in Rerun, by its own package ``rerun-sdk``."""

from __future__ import annotations

from os import PathLike, fspath

import numpy as np
from numpy.typing import NDArray

from ._deltatwin import Model, Motion, Recording


def to_rerun(
    recording: Recording,
    model: Model,
    path: str | PathLike[str] | None = None,
    *,
    every: float = 0.01,
) -> None:
    """Show a recording in Rerun: the moving robot, measured and predicted torques, and what the model leaves.

    Parameters
    ----------
    recording : Recording
        The recording.
    model : Model
        Model of its machine.
    path : path, optional
        ``.rrd`` file to write; without it, the data go to the recording stream that ``rerun`` is initialised with
        (``rerun.init("…", spawn=True)`` opens a viewer).
    every : float
        Time between two poses of the robot, s; signals are shown with all their samples.

    Raises
    ------
    ImportError
        If ``rerun-sdk`` is not installed.
    """
    import rerun as rr
    import rerun.blueprint as rrb

    stream = rr.RecordingStream("deltatwin") if path is not None else None
    if stream is not None:
        stream.save(fspath(path))  # type: ignore[arg-type]
    axes = [name.removeprefix("q") for name in model.joint_names]
    torques = [rrb.TimeSeriesView(origin=f"torque/axis{axis}", name=f"torque of axis {axis}") for axis in axes]
    left = rrb.TimeSeriesView(origin="residual", name="measured - model")
    views = [rrb.Spatial3DView(origin="robot")] if model.has_platform else []
    columns = rrb.Horizontal(*views, rrb.Vertical(*torques), left)
    rr.send_blueprint(rrb.Blueprint(columns, collapse_panels=True), recording=stream)
    t, q, qd, qdd = recording.states()
    predicted = model.inverse_dynamics(q, qd, qdd, setup=recording.setup)
    measured = np.stack([np.interp(t, recording.t, column) for column in recording.tau.T], axis=1)
    times = rr.TimeColumn("time", duration=t)
    for i, axis in enumerate(axes):
        for kind, values in (
            ("measured", measured[:, i]),
            ("model", predicted[:, i]),
            ("residual", measured[:, i] - predicted[:, i]),
        ):
            place = f"torque/axis{axis}/{kind}" if kind != "residual" else f"residual/axis{axis}"
            rr.send_columns(place, indexes=[times], columns=rr.Scalars.columns(scalars=values), recording=stream)
    if model.has_platform:
        step = max(1, round(every / max(recording.sample_time, 1e-9)))
        motion = model.motion(q[::step], setup=recording.setup)
        platform = motion.position[:, motion.bodies.index("platform")]
        for at, strips, place in zip(t[::step], _links(model, motion), platform, strict=True):
            rr.set_time("time", duration=float(at), recording=stream)
            rr.log("robot/links", rr.LineStrips3D(strips, radii=0.008), recording=stream)
            rr.log("robot/platform", rr.Points3D([place], radii=0.03), recording=stream)
    if stream is not None:
        stream.flush()


def _links(model: Model, motion: Motion) -> list[list[NDArray[np.float64]]]:
    """For each instant the line strips of arms and struts, m."""
    names = motion.bodies
    position, rotation = motion.position, motion.rotation
    length = model.lengths["strut_length"]
    instants = []
    for k in range(len(motion)):
        strips = []
        for limb in range(3):
            arm = position[k, names.index(f"arm{limb + 1}")]
            struts = [names.index(f"strut{2 * limb + j}") for j in (1, 2)]
            # A strut's frame is at the upper ball, x to the lower one.
            balls = [position[k, s] for s in struts]
            strips.append(np.array([arm, (balls[0] + balls[1]) / 2]))
            strips.append(np.array(balls))
            strips.extend(np.array([position[k, s], position[k, s] + length[limb] * rotation[k, s, :, 0]]) for s in struts)
        instants.append(strips)
    return instants
