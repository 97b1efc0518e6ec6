"""Two effects concealed on arms of any model file, with the base as shipped and turned.

A model of a file is given springs in proportion to what its axes carry, and stands once
as it is shipped and once on a wall drawn from the seed. What is concealed, and how hard
springs truly are, is the same for both, so that only the frames differ.
"""

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from bench.effects import EFFECTS
from bench.effects.effect import Effect
from bench.effects.places import places_for
from bench.experiment import record
from bench.instruments import Instruments, Markers
from bench.kinematic_chain import anatomy, with_axes
from bench.model_file import load, plain_mjcf
from bench.rig import RIGID, Rig
from bench.shared.errors import BenchError, Unusable
from bench.standard_plans import tour
from scenarios.pipelines.diagnosis import answer_of, asked, proved
from scenarios.pipelines.inputs import arm_of

CONCEALED = ("hysteresis", "bearing_tilt", "lost_motion", "hardening", "encoder_offset")
"""Effects that are drawn, two at two places; each is visible at a catalogue's size."""
WOUND_UP = 1e-3
"""Largest wind-up of a gear under the arm's own weight in rad; chosen: a soft arm."""
SOFTEST = 2e3
"""Least stiffness of a wrist in N m/rad; chosen."""
SPREAD = 2.0
"""True stiffness over the model's: up to this factor either way; chosen."""
FURTHEST = 2.0
"""How far a base is moved in each direction, in m; chosen."""
BASES = ("as shipped", "turned")


@dataclass(frozen=True)
class ArmTrial:
    """One trial on one arm.

    Attributes:
        model: Name of the model's file.
        number: Of the trial.
        base: How the base stands.
        truth: Names that are true.
        named: Names that were given.
        right: Whether every true name was given or declared as an equivalent.
        exact: Whether the names given are the true ones.
        verdict: Of the answer.
        springs_off: Largest relative error of a spring of the patch; NaN without.
        after_over_noise: What the patched simulator leaves of the poses kept back, over
            what stated noise leaves; NaN without a proof.
        seconds: Of diagnosis and proof.
        failed: Why there is no answer; empty where there is one.
    """

    model: str
    number: int
    base: str
    truth: str
    named: str
    right: bool
    exact: bool
    verdict: str
    springs_off: float
    after_over_noise: float
    seconds: float
    failed: str = ""


def model_files(folder: Path) -> list[Path]:
    """Return the model files of a folder, sorted.

    Raises:
        Unusable: Where there is none.
    """
    found = [file for kind in ("*.xml", "*.urdf") for file in folder.glob(kind)]
    if not found:
        fault = "it holds no .xml (MJCF) or .urdf file."
        raise Unusable(f"Folder {str(folder)!r}", [fault])
    return sorted(found)


def trials_of(
    models: list[Path], trials: int, poses: int, seed: int, folder: Path
) -> Iterator[ArmTrial]:
    """Carry out trials, each with the base as shipped and turned.

    Args:
        models: Files of arms.
        trials: Of each arm.
        poses: Of a recording.
        seed: Of everything that is drawn.
        folder: For the models with springs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for m, file in enumerate(models):
        for number in range(trials):
            for base in BASES:
                yield _trial(file, base, poses, (seed, m, number), folder)


def with_springs(file: Path, base: str, draw: np.random.Generator) -> str:
    """Return an arm's model as plain MJCF with springs, its base as shipped or turned.

    Of several arms the chain with the most axes is taken.

    Args:
        file: MJCF or URDF.
        base: One of `BASES`.
        draw: Where the turned base's place comes from.
    """
    model = load(file)
    arm = anatomy(model)
    if len(arm.hands) > 1:
        longest = max((arm.carriers(k) for k in range(len(arm.axes))), key=len)
        model = with_axes(model, [arm.axes[k] for k in longest])
    stiffness = _stiffness(model)
    root = ElementTree.fromstring(plain_mjcf(model))
    for joint in root.iter("joint"):
        joint.set("stiffness", repr(stiffness[joint.get("name", "")]))
    turn = Rotation.random(rng=draw)
    place = draw.uniform(-FURTHEST, FURTHEST, 3)
    if base == "turned":
        world = root.find("worldbody")
        assert world is not None
        wall = ElementTree.Element(
            "body",
            name="wall",
            pos=" ".join(map(repr, place.tolist())),
            quat=" ".join(map(repr, turn.as_quat(scalar_first=True).tolist())),
        )
        wall.extend(list(world))
        for child in list(world):
            world.remove(child)
        world.append(wall)
    return ElementTree.tostring(root, encoding="unicode")


def _stiffness(model: mujoco.MjModel) -> dict[str, float]:
    """Return springs that the arm's own weight winds up by `WOUND_UP` at most."""
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    torque = np.zeros(model.nv)
    for _ in range(50):
        data.qpos[:] = random.uniform(-np.pi, np.pi, model.nq)
        mujoco.mj_forward(model, data)
        torque = np.maximum(torque, np.abs(data.qfrc_bias))
    known = np.maximum(torque / WOUND_UP, SOFTEST)
    names = [model.joint(j).name for j in range(model.njnt)]
    return dict(zip(names, known.tolist(), strict=True))


def _draw_effects(rig: Rig, draw: np.random.Generator) -> tuple[Effect, ...]:
    kinds = {kind.name: kind for kind in EFFECTS}
    names = draw.choice(CONCEALED, 2, replace=False)
    axes = [p for p in places_for(("axis",), rig.anatomy) if p[1:].isdigit()]
    at = draw.choice(axes[: len(rig.anatomy.axes) - 1], 2, replace=False)
    return tuple(kinds[n](str(a)) for n, a in zip(names, at, strict=True))


def _trial(
    file: Path, base: str, poses: int, key: tuple[int, int, int], folder: Path
) -> ArmTrial:
    """Carry out one trial; the same key (seed, arm, number) conceals the same."""
    number = key[2]
    stand, conceal, springs, instruments = (
        np.random.default_rng((*key, part)) for part in range(4)
    )
    model = folder / f"{file.stem}_{number}_{BASES.index(base)}.xml"
    truth: tuple[Effect, ...] = ()
    started = time.perf_counter()
    try:
        model.write_text(with_springs(file, base, stand), encoding="utf-8")
        rig = Rig(model)
        truth = _draw_effects(rig, conceal)
        scale = SPREAD ** springs.uniform(-1.0, 1.0, len(rig.springs))
        true = replace(rig, effects=truth, stiffness=rig.nominal.jnt_stiffness * scale)
        seed = int(instruments.integers(2**31))
        watch = Instruments(markers=Markers())
        recording = record(true, tour(rig, poses, seed=seed), watch, seed)
        arm = arm_of(model).for_recording(recording)
        started = time.perf_counter()
        found = asked(recording, arm)
        simulated, why = proved(found, recording, arm, model)
        seconds = time.perf_counter() - started
        answer = answer_of(found, simulated, why, (), seconds)
    except BenchError as error:
        names = _names(truth)
        failed = str(error).partition("\n")[0]
        spent = time.perf_counter() - started
        return ArmTrial(
            *(file.stem, number, base, names, "", False, False, "failed"),
            *(np.nan, np.nan, spent, failed),
        )
    given = {f"{n.effect}@{n.where}" for n in answer.named}
    declared = given | {
        f"{e.effect}@{e.where}" for n in answer.named for e in n.equivalents[:3]
    }
    wanted = {f"{e.name}@{e.where}" for e in truth}
    off = after = np.nan
    if simulated is not None and not why:
        fitted = np.minimum(simulated.patched.rig.springs, RIGID)
        off = float(np.max(np.abs(fitted / true.springs - 1.0)))
        if simulated.markers is not None:
            after = simulated.markers.after / simulated.markers.noise
    return ArmTrial(
        model=file.stem,
        number=number,
        base=base,
        truth=_names(truth),
        named=" ".join(sorted(given)),
        right=wanted <= declared,
        exact=wanted == given,
        verdict=answer.verdict,
        springs_off=off,
        after_over_noise=after,
        seconds=seconds,
    )


def _names(effects: tuple[Effect, ...]) -> str:
    return " ".join(sorted(f"{e.name}@{e.where}" for e in effects))


def rows_of(trials: list[ArmTrial]) -> list[dict[str, object]]:
    """Return the trials as rows of a table."""
    return [asdict(trial) for trial in trials]


def summary_of(trials: list[ArmTrial]) -> list[list[str]]:
    """Return a row for each arm and base: names, springs, what is left, verdicts."""
    found = []
    for model in dict.fromkeys(t.model for t in trials):
        for base in BASES:
            own = [t for t in trials if (t.model, t.base) == (model, base)]
            off = [t.springs_off for t in own if np.isfinite(t.springs_off)]
            after = [t.after_over_noise for t in own if np.isfinite(t.after_over_noise)]
            count = len(own)
            found.append(
                [
                    model,
                    base,
                    f"{sum(t.right for t in own)}/{count}",
                    f"{sum(t.exact for t in own)}/{count}",
                    f"{sum(x <= 0.05 for x in off)}/{count}",
                    f"{sum(x <= 1.05 for x in after)}/{count}",
                    f"{sum(t.verdict == 'explained' for t in own)}/{count}",
                    f"{np.median([t.seconds for t in own]):.0f}",
                ]
            )
    return found


HEADER = [
    "arm",
    "base",
    "both named or declared",
    "exactly these",
    "springs within 5 %",
    "after ≤ 1.05 × noise",
    "explained",
    "median [s]",
]
"""Of `summary_of`."""
