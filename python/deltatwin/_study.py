"""Studies and exams in one process, or on Ray.

A study is cut into chunks. A chunk is a pure function of the study (its digest), its number and the number of chunks:
whoever computes it, and however often, its file has the same bytes. Engines only decide where chunks are computed.
"""

from __future__ import annotations

import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from . import _progress
from ._deltatwin import Model, StudyPlan, Table, read_study_table

if TYPE_CHECKING:
    from os import PathLike

#: Makes the plan of a study with its rows in a folder, on whatever node.
_Plan: TypeAlias = Callable[[str], StudyPlan]

#: Chunks by default: enough that a lost one costs little, few enough that starting them costs little.
CHUNKS = 64
#: Tasks that wait or run at once, for every processor of the cluster.
AHEAD = 2
#: Variable by which Ray, on any system, takes 127.0.0.1 literally instead of an address that others can reach.
LOOPBACK = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
#: How often the loss of a node is made up for, by chunk.
RETRIES = 100
#: Names of the recordings in the folder of a campaign; they stay on the node that made them.
RECORDINGS = ("measurement.", "validation.")


def study(
    study: str | PathLike[str],
    folder: str | PathLike[str],
    *,
    ray: str | None = None,
    chunks: int | None = None,
    force: bool = False,
    progress: bool | Callable[[str, float], None] = True,
) -> Table:
    """Run a study of the twin and return its table.

    Parameters
    ----------
    study : path
        Study file (see ``docs/studies.md``).
    folder : path
        Folder for the rows, which is made if need be. What is there is kept: the same call goes on after an
        interruption, and a finished study is only read.
    ray : str, optional
        ``None`` computes in this process, on all its cores. ``"auto"`` uses the Ray cluster that this process is
        connected to, else the one in ``RAY_ADDRESS``, else a new one on this machine (reachable from this machine only).
        Any other text is the address of a cluster.
    chunks : int, optional
        Number of chunks on Ray; 64, or one per run of a smaller study, by default.
    force : bool
        Remove the rows of another study, or of this one, first.
    progress : bool or function
        A bar of tqdm if that is installed, or a function of what is done and the share that is done.

    Returns
    -------
    Table
        One row per run. ``folder/runs.parquet`` holds the same, byte by byte the same for any engine, number of
        chunks, and interruptions.

    Raises
    ------
    ModelError
        If the study or what it names is not valid.
    ValueError
        If the study is a search, in which every run depends on those before it, and ``ray`` is given.
    """
    plan = StudyPlan(study, folder)
    return _conducted(plan, partial(StudyPlan, str(Path(study).resolve())), ray, chunks, force, progress)


def exam(
    model: Model | str | PathLike[str],
    folder: str | PathLike[str],
    *,
    effects: Sequence[str] | None = None,
    sizes: Sequence[Literal["small", "medium", "large"]] = ("medium",),
    seeds: int = 1,
    pairs: int = 0,
    outside: int = 0,
    null: int = 1,
    fast_null: int = 0,
    noise: Sequence[Literal["white", "autocorrelated", "speed", "drift"]] = ("white",),
    motion: Literal["fourier", "wideband", "cycle"] = "wideband",
    strut_sensors: bool = True,
    payloads: bool = True,
    duration: float = 20.0,
    seed: int = 1,
    ray: str | None = None,
    chunks: int | None = None,
    force: bool = False,
    progress: bool | Callable[[str, float], None] = True,
) -> Table:
    """Examine the diagnosis: hide effects in robots, judge what is said about them, and return the table of the answers.

    Parameters
    ----------
    model : Model or path
        The model of an assembled delta robot.
    folder : path
        Folder for the campaigns and the rows, which is made if need be. What is there is kept, as for ``study``. On Ray,
        the recordings of the campaigns are not kept, only their truths and answers.
    effects : sequence of str, optional
        Effects to hide, one at a time and in pairs; all that the model lacks by default.
    sizes : sequence of str
        Sizes of single effects.
    seeds, pairs, outside, null : int
        Campaigns per effect and size, with two effects, with a law outside the library, and with nothing hidden.
    fast_null : int
        Further campaigns with nothing hidden: other noise on the recordings of four robots.
    noise : sequence of str
        Kinds of noise, in turn.
    motion : str
        What the robots do.
    strut_sensors, payloads : bool
        Whether two thirds of the robots have a force sensor in a strut, and half of them a payload.
    duration : float
        Length of each recording, s.
    seed : int
        Draws everything.
    ray, chunks, progress
        As for ``study``.
    force : bool
        Remove the rows of another exam, or of this one, first, and judge again.

    Returns
    -------
    Table
        One row per campaign: what was hidden, what was said, and its grade. ``folder/runs.parquet`` holds the same, byte
        by byte the same for any engine, number of chunks, and interruptions. ``deltatwin exam MODEL --judge folder``
        makes a page of it.

    Raises
    ------
    ModelError
        If the model is none of an assembled delta robot, or ``effects`` names what cannot be hidden.
    ValueError
        For a word that is none of those above, or if the folder holds the rows of another exam.
    """
    options = _Exam(
        model if isinstance(model, Model) else Model.load(model),
        None if effects is None else list(effects),
        list(sizes),
        (seeds, pairs, outside, null, fast_null),
        list(noise),
        motion,
        (strut_sensors, payloads),
        duration,
        seed,
    )
    return _conducted(options.plan(str(folder), force), options.plan, ray, chunks, force, progress)


@dataclass(frozen=True)
class _Exam:
    """What an exam is made of, which nodes of a cluster are sent."""

    model: Model
    effects: list[str] | None
    sizes: list[str]
    counts: tuple[int, int, int, int, int]
    noise: list[str]
    motion: str
    robots: tuple[bool, bool]
    duration: float
    seed: int

    def plan(self, folder: str, force: bool = False) -> StudyPlan:
        """The exam with its rows in a folder."""
        seeds, pairs, outside, null, fast_null = self.counts
        strut_sensors, payloads = self.robots
        return StudyPlan.of_exam(
            self.model,
            folder,
            effects=self.effects,
            sizes=self.sizes,
            seeds=seeds,
            pairs=pairs,
            outside=outside,
            null=null,
            fast_null=fast_null,
            noise=self.noise,
            motion=self.motion,
            strut_sensors=strut_sensors,
            payloads=payloads,
            duration=self.duration,
            seed=self.seed,
            force=force,
        )


def _conducted(
    plan: StudyPlan,
    make: _Plan,
    ray: str | None,
    chunks: int | None,
    force: bool,
    progress: bool | Callable[[str, float], None],
) -> Table:
    """The table of a plan, whose rows are computed here or on Ray; nodes make the plan for themselves."""
    if force:
        plan.clear()
    if not plan.is_complete:
        if ray is None:
            plan.chunk(progress=progress)
        else:
            _on_ray(plan, make, ray, chunks, progress)
        plan.merge()
    return read_study_table(plan.folder / "runs.parquet")


def compute_chunk(
    study: str, digest: str, number: int, of: int, threads: int = 1, *, build: str | None = None
) -> dict[str, bytes]:
    """Compute one chunk of a study in a folder of its own, and return its files by their relative names.

    The function is pure: its result depends on its arguments only, not on ``threads``.

    Raises
    ------
    ValueError
        If the study file here is not the one with ``digest``, or deltatwin here is not that ``build``.
    """
    return _computed(partial(StudyPlan, study), digest, number, of, threads, build)


def _computed(
    make: _Plan, digest: str, number: int, of: int, threads: int, build: str | None
) -> dict[str, bytes]:
    """The files of one chunk of a plan, computed in a folder of its own, by their relative names."""
    with tempfile.TemporaryDirectory(prefix="deltatwin-") as folder:
        plan = make(folder)
        if plan.digest != digest:
            raise ValueError(
                f"{plan}: has the digest {plan.digest} on this node, the study has {digest}; "
                "expected the same files and the same deltatwin on every node"
            )
        if build is not None and plan.build != build:
            raise ValueError(
                f"{plan}: deltatwin is the build {plan.build:.12} on this node, the study began with {build:.12}; "
                "expected the same deltatwin on every node"
            )
        plan.chunk(number, of, threads=threads, progress=False)
        root = Path(folder)
        files = (p for p in sorted(root.rglob("*")) if p.is_file() and not p.name.startswith(RECORDINGS))
        return {str(p.relative_to(root)): p.read_bytes() for p in files}


def keep(folder: Path, files: dict[str, bytes]) -> None:
    """Write the files of a chunk, each at once: a file is either whole or not there."""
    for name, content in files.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=".writing-")
        with os.fdopen(handle, "wb") as out:
            out.write(content)
            out.flush()
            os.fsync(out.fileno())
        os.replace(temporary, target)


def _on_ray(
    plan: StudyPlan,
    make: _Plan,
    address: str,
    chunks: int | None,
    progress: bool | Callable[[str, float], None],
) -> None:
    """Compute the chunks that are not there on Ray, a bounded number at a time."""
    if address == "auto" and "ray" not in sys.modules and not os.environ.get("RAY_ADDRESS"):
        os.environ.setdefault(LOOPBACK, "0")
    import ray

    if plan.is_search:
        raise ValueError(f"{plan}: every run depends on those before it; expected ray=None for a search")
    of = chunks if chunks is not None else max(1, min(CHUNKS, plan.runs))
    if not 1 <= of <= 99_999:
        raise ValueError(f"chunks is {of}; expected 1 to 99999")
    own = not ray.is_initialized()
    if own:
        _connect(address)
    bar = progress if callable(progress) else (_progress.bar("study") if progress else None)
    try:
        folder = plan.folder
        plan.claim()
        missing = [k for k in range(1, of + 1) if not plan.part(k, of).is_file()]
        task = ray.remote(num_cpus=1, max_retries=RETRIES)(_computed)
        most = AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
        waiting: dict[ray.ObjectRef[dict[str, bytes]], int] = {}
        done = of - len(missing)
        todo = iter(missing)
        while True:
            while len(waiting) < most and (number := next(todo, None)) is not None:
                waiting[task.remote(make, plan.digest, number, of, 1, plan.build)] = number
            if not waiting:
                break
            ready, _ = ray.wait(list(waiting), num_returns=1, timeout=0.5)
            for reference in ready:
                number = waiting.pop(reference)
                try:
                    files = ray.get(reference)
                except (ray.exceptions.ObjectLostError, ray.exceptions.WorkerCrashedError, ray.exceptions.NodeDiedError):
                    waiting[task.remote(make, plan.digest, number, of, 1, plan.build)] = number
                    continue
                except ray.exceptions.RayTaskError as error:
                    raise error.as_instanceof_cause() from None
                keep(folder, files)
                done += 1
            if bar is not None:
                bar("study", done / of)
    finally:
        if isinstance(bar, _progress.Bar):
            bar.close()
        if own:
            ray.shutdown()


def _connect(address: str) -> None:
    """Connect to a cluster; without one, start one that only this machine can reach."""
    import ray

    if address != "auto" or os.environ.get("RAY_ADDRESS"):
        ray.init(address=address, log_to_driver=False)
        return
    ray.init(_node_ip_address="127.0.0.1", include_dashboard=False, log_to_driver=False)
    own = {node["NodeManagerAddress"] for node in ray.nodes()}
    if own != {"127.0.0.1"}:
        text = f"Ray listens on {', '.join(sorted(own))}: set {LOOPBACK}=0 before Ray is imported to keep it local"
        warnings.warn(text, RuntimeWarning, stacklevel=4)
