"""Two effects concealed on arms of any model file, with the base as shipped and turned.

A model of a file is given springs in proportion to what its axes carry, and stands once
as it is shipped and once on a wall drawn from the seed. What is concealed, and how hard
springs truly are, is the same for both, so that only the frames differ. What hangs on
the hook is within the payload of the file's arm. Effects are drawn again until each is
visible with either base, for what no reading shows cannot be named.
"""

import time
import warnings
from collections.abc import Callable, Collection, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_type_hints
from xml.etree import ElementTree

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from bench.effects import EFFECTS
from bench.effects.effect import Effect
from bench.effects.places import places_for
from bench.experiment import record
from bench.instruments import Instruments, Markers
from bench.kinematic_chain import anatomy, with_axes
from bench.model_file import load, plain_mjcf
from bench.patched_model import patched_model
from bench.payload import payload_of, usual_path
from bench.proof.setup import base_of
from bench.rig import RIGID, Rig
from bench.shared.errors import BenchError, Unusable
from bench.shared.plan import Plan
from bench.shared.recording import Recording
from bench.shared.settings import SETTINGS
from bench.standard_plans import tour
from scenarios.pipelines.diagnosis import answer_of, asked, proved
from scenarios.pipelines.inputs import arm_of
from scenarios.pipelines.patching import fitted_springs
from scenarios.report.page import Table
from scenarios.studies.blind_trials.generation import error_free_instruments
from scenarios.studies.blind_trials.visibility import Scale, scale_of
from stiffness.diagnosis.result import Nominal

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
Stated = Literal["springs", "none", "urdf"]
"""What the model that is diagnosed says of its joints' stiffness."""
LEAST_CHI2 = 100.0
"""Size from which a concealed effect counts as visible, after springs, frame and places
took what they can; chosen: ten standard errors."""
DRAWS = 40
"""Draws of two effects before a trial is given up; chosen."""


@dataclass(frozen=True)
class ArmTrial:
    """One trial on one arm.

    Attributes:
        right: Whether every true name was given or declared as an equivalent.
        springs_off: Largest relative error of a spring of the patch; NaN without.
        compliances_inside: Share of the patch's compliances whose truth lies within
            its 95 % interval; NaN without.
        after_over_noise: What the patched simulator leaves of the poses kept back, over
            what stated noise leaves; NaN without a proof.
        bends_off: How far `model.xml` in plain MuJoCo bends under a load otherwise than
            the patched rig, as a share; NaN without, infinite where MuJoCo warns.
    """

    model: str
    number: int
    base: str
    truth: str
    named: str
    right: bool
    verdict: str
    springs_off: float
    compliances_inside: float
    after_over_noise: float
    bends_off: float
    seconds: float
    failed: str = ""

    @property
    def exact(self) -> bool:
        """Whether the names given are the true ones."""
        return set(self.named.split()) == set(self.truth.split())


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
    models: list[Path],
    trials: int,
    poses: int,
    seed: int,
    folder: Path,
    known: Collection[tuple[str, int]] = (),
    stated: Stated = "springs",
) -> Iterator[ArmTrial]:
    """Carry out trials, each with the base as shipped and turned, all arms in turn.

    Trials that are known, by model and number, are left out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(trials):
        for m, file in enumerate(models):
            if (file.stem, number) not in known:
                yield from _trials_of(file, poses, (seed, m, number), folder, stated)


def with_springs(file: Path, base: str, draw: np.random.Generator) -> str:
    """Return an arm's model as plain MJCF with springs, its base as shipped or turned.

    Of several arms the chain with the most axes is taken. The draw says where the
    turned base stands.
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


def given(file: Path, stated: Stated, folder: Path) -> Path:
    """Return the model of an arm with what it is to say of its joints' stiffness."""
    if stated == "springs":
        return file
    path = folder / f"{file.stem}_rigid{'.urdf' if stated == 'urdf' else '.xml'}"
    if stated == "urdf":
        root = _as_urdf(load(file))
    else:
        root = ElementTree.fromstring(plain_mjcf(load(file)))
        for joint in root.iter("joint"):
            joint.attrib.pop("stiffness", None)
    path.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    return path


def _as_urdf(model: mujoco.MjModel) -> ElementTree.Element:
    """Return a chain of hinges, each through its body's origin, as URDF."""
    robot = ElementTree.Element("robot", name="rigid")
    ElementTree.SubElement(robot, "link", name="world")
    for b in range(1, model.nbody):
        link = ElementTree.SubElement(robot, "link", name=model.body(b).name)
        if model.body_mass[b] > 0.0:
            inertial = ElementTree.SubElement(link, "inertial")
            mass = repr(float(model.body_mass[b]))
            ElementTree.SubElement(inertial, "mass", value=mass)
            inertial.append(_origin(model.body_ipos[b], model.body_iquat[b]))
            own = dict(zip(("ixx", "iyy", "izz"), model.body_inertia[b], strict=True))
            own |= dict.fromkeys(("ixy", "ixz", "iyz"), 0.0)
            inertia = {name: repr(float(value)) for name, value in own.items()}
            ElementTree.SubElement(inertial, "inertia", inertia)
        robot.append(_urdf_joint(model, b))
    return robot


def _urdf_joint(model: mujoco.MjModel, b: int) -> ElementTree.Element:
    hinged, j = bool(model.body_jntnum[b]), model.body_jntadr[b]
    name = model.joint(j).name if hinged else f"to_{model.body(b).name}"
    kind = "revolute" if hinged else "fixed"
    joint = ElementTree.Element("joint", name=name, type=kind)
    parent = model.body(model.body_parentid[b]).name
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=model.body(b).name)
    joint.append(_origin(model.body_pos[b], model.body_quat[b]))
    if hinged:
        if np.any(model.jnt_pos[j]) or model.jnt_type[j] != mujoco.mjtJoint.mjJNT_HINGE:
            fault = f"joint {name!r} is no hinge through its body's origin."
            raise Unusable("Model as URDF", [fault])
        axis = " ".join(repr(float(x)) for x in model.jnt_axis[j])
        ElementTree.SubElement(joint, "axis", xyz=axis)
        low, high = map(float, model.jnt_range[j])
        if not model.jnt_limited[j]:
            low, high = -np.pi, np.pi
        limit = {"lower": repr(low), "upper": repr(high)}
        ElementTree.SubElement(joint, "limit", limit, effort="0", velocity="0")
    return joint


def _origin(position: np.ndarray, quaternion: np.ndarray) -> ElementTree.Element:
    turn = Rotation.from_quat(quaternion, scalar_first=True)
    with warnings.catch_warnings(action="ignore"):  # of two angles that are one
        angles = turn.as_euler("xyz")
    place, spin = (" ".join(repr(float(x)) for x in v) for v in (position, angles))
    return ElementTree.Element("origin", xyz=place, rpy=spin)


def _stiffness(model: mujoco.MjModel) -> dict[str, float]:
    """Return springs that the arm's own weight winds up by `WOUND_UP` at most.

    However its base is turned: gravity counts along the direction that loads an axis
    most, else the first axis of an upright arm would be as soft as a wrist.
    """
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    size, gravity = np.linalg.norm(model.opt.gravity), model.opt.gravity.copy()
    torque = np.zeros(model.nv)
    for _ in range(50):
        data.qpos[:] = random.uniform(-np.pi, np.pi, model.nq)
        square = np.zeros(model.nv)
        for along in np.eye(3):
            model.opt.gravity[:] = size * along
            mujoco.mj_forward(model, data)
            square += data.qfrc_bias**2
        torque = np.maximum(torque, np.sqrt(square))
    model.opt.gravity[:] = gravity
    known = np.maximum(torque / WOUND_UP, SOFTEST)
    names = [model.joint(j).name for j in range(model.njnt)]
    return dict(zip(names, known.tolist(), strict=True))


@dataclass(frozen=True)
class _Setup:
    """An arm on its base with its true springs, and what is done with it."""

    base: str
    rig: Rig
    plan: Plan
    watch: Instruments

    def seen(self, effects: tuple[Effect, ...], seed: int) -> Recording:
        return record(replace(self.rig, effects=effects), self.plan, self.watch, seed)

    def weighing(self, seed: int) -> Callable[[Effect], float]:
        """Return a function that says how visible an effect is, as χ²."""
        quiet = replace(self, watch=error_free_instruments(self.watch))
        spread, scale = self.watch.tracker.repeatability, list[Scale]()

        def weigh(effect: Effect) -> float:
            if not scale:
                silent = quiet.seen((), seed)
                scale.append(scale_of(self.rig, silent, spread, known_frame=False))
            return scale[0].visibility(quiet.seen((effect,), seed)).chi2

        return weigh


def _trials_of(
    file: Path, poses: int, key: tuple[int, int, int], folder: Path, stated: Stated
) -> Iterator[ArmTrial]:
    """Carry out one trial with each base; a key is seed, arm and number."""
    number = key[2]
    place, conceal, springs, instruments = (
        np.random.default_rng((*key, part)) for part in range(4)
    )
    started, models, truth = time.perf_counter(), list[Path](), tuple[Effect, ...]()
    try:
        for b, base in enumerate(BASES):
            models.append(folder / f"{file.stem}_{number}_{b}.xml")
            text = with_springs(file, base, place)
            models[-1].write_text(text, encoding="utf-8")
        axes = Rig(models[0]).anatomy.axes
        path = usual_path(payload_of(Rig(file, axes=axes)))
        scale = SPREAD ** springs.uniform(-1.0, 1.0, len(axes))
        seed = int(instruments.integers(2**31))
        setups = []
        for base, model in zip(BASES, models, strict=True):
            rig = Rig(model)
            rig = replace(rig, stiffness=rig.nominal.jnt_stiffness * scale)
            plan, watch = (
                tour(rig, poses, path, seed=seed),
                Instruments(markers=Markers()),
            )
            setups.append(_Setup(base, rig, plan, watch))
        truth = _visible_effects(setups, seed, conceal)
    except BenchError as error:
        spent = time.perf_counter() - started
        yield from (_failed(file, number, base, truth, spent, error) for base in BASES)
        return
    for setup in setups:
        started = time.perf_counter()
        try:
            recording = setup.seen(truth, seed)
            started = time.perf_counter()
            model = given(Path(setup.rig.arm_file), stated, folder)
            yield _answered(file, number, setup, truth, recording, model)
        except BenchError as error:
            spent = time.perf_counter() - started
            yield _failed(file, number, setup.base, truth, spent, error)


def _visible_effects(
    setups: list[_Setup], seed: int, draw: np.random.Generator
) -> tuple[Effect, ...]:
    """Draw two effects at two places, each visible with every base.

    Raises:
        Unusable: Where no draw is.
    """
    kinds = {kind.name: kind for kind in EFFECTS}
    arm = setups[0].rig.anatomy
    axes = [p for p in places_for(("axis",), arm) if p[1:].isdigit()]
    weighing, known = [s.weighing(seed) for s in setups], dict[tuple[str, str], bool]()
    for _ in range(DRAWS):
        names = draw.choice(CONCEALED, 2, replace=False)
        at = draw.choice(axes[: len(arm.axes) - 1], 2, replace=False)
        drawn = tuple(kinds[n](str(a)) for n, a in zip(names, at, strict=True))
        for effect in drawn:
            if (effect.name, effect.where) not in known:
                seen = all(weigh(effect) >= LEAST_CHI2 for weigh in weighing)
                known[effect.name, effect.where] = seen
        if all(known[e.name, e.where] for e in drawn):
            return drawn
    fault = f"no two effects are visible (χ² of {LEAST_CHI2:g}) in {DRAWS} draws."
    raise Unusable("Trial", [fault])


def _failed(
    file: Path,
    number: int,
    base: str,
    truth: tuple[Effect, ...],
    seconds: float,
    error: BenchError,
) -> ArmTrial:
    first, _, faults = str(error).partition("\n")
    failed = f"{first} {faults.partition(chr(10))[0].strip()}".strip()
    return ArmTrial(
        *(file.stem, number, base, _names(truth), "", False, "failed"),
        *(np.nan, np.nan, np.nan, np.nan, seconds, failed),
    )


def _answered(
    file: Path,
    number: int,
    setup: _Setup,
    truth: tuple[Effect, ...],
    recording: Recording,
    model: Path,
) -> ArmTrial:
    """Diagnose and prove a recording, and hold the answer against the truth."""
    started = time.perf_counter()
    arm = arm_of(model).for_recording(recording)
    found = asked(recording, arm)
    simulated, why = proved(found, recording, arm, model)
    seconds = time.perf_counter() - started
    answer = answer_of(found, simulated, why, (), seconds)
    given = {f"{n.effect}@{n.where}" for n in answer.named}
    declared = given | {
        f"{e.effect}@{e.where}" for n in answer.named for e in n.equivalents[:3]
    }
    wanted = {f"{e.name}@{e.where}" for e in truth}
    off = inside = after = bends = np.nan
    if simulated is not None and not why:
        fitted = np.minimum(simulated.patched.rig.springs, RIGID)
        off = float(np.max(np.abs(fitted / setup.rig.springs - 1.0)))
        inside = compliances_inside(fitted_springs(found, simulated), setup.rig.springs)
        bends = bends_otherwise(simulated.patched.rig, model)
        if simulated.markers is not None:
            after = simulated.markers.after / simulated.markers.noise
    return ArmTrial(
        model=file.stem,
        number=number,
        base=setup.base,
        truth=_names(truth),
        named=" ".join(sorted(given)),
        right=wanted <= declared,
        verdict=answer.verdict,
        springs_off=off,
        compliances_inside=inside,
        after_over_noise=after,
        bends_off=bends,
        seconds=seconds,
        failed=why,
    )


def compliances_inside(
    nominal: Nominal | None, springs: Float[np.ndarray, " axes"]
) -> float:
    """Return the share of fitted compliances whose truth lies within its interval."""
    if nominal is None or not np.any(nominal.sigma > 0.0):
        return np.nan
    own = nominal.sigma > 0.0
    off = np.abs(nominal.compliance - 1.0 / springs)[own] / nominal.sigma[own]
    return float(np.mean(off <= norm.ppf(0.5 + SETTINGS.confidence / 2)))


def _names(effects: tuple[Effect, ...]) -> str:
    return " ".join(sorted(f"{e.name}@{e.where}" for e in effects))


LOAD = (30.0, 40.0, -50.0)
"""On the flange, in N along the world's axes; chosen: a tool's."""
STEADY = 10.0
"""Seconds that plain MuJoCo is stepped; by the bar of ten seconds without a warning."""


def bends_otherwise(rig: Rig, file: Path) -> float:
    """Return by what share plain MuJoCo bends otherwise than a patched rig."""
    model = patched_model(rig, file)
    built, flange = model.compiled(), rig.anatomy.flange
    b, stood, data = built.body(flange).id, list[np.ndarray](), mujoco.MjData(built)
    if built.nkey:
        mujoco.mj_resetDataKeyframe(built, data, 0)
    for force in (np.zeros(3), np.array(LOAD)):  # in turn: friction remembers
        for _ in range(round(STEADY / built.opt.timestep)):
            mujoco.mj_step1(built, data)
            data.xfrc_applied[b, :3] = force
            data.xfrc_applied[b, 3:] = np.cross(data.xpos[b] - data.xipos[b], force)
            mujoco.mj_step2(built, data)
        if any(w.number for w in data.warning):
            return np.inf
        stood.append(data.xpos[b].copy())
    posture, base = np.array([list(model.held.values())]), base_of(rig)[1]
    bare = rig.respond(posture, np.zeros((1, 1, 6)), np.ones((1, 1)))
    lever = -bare.rotation[0, bare.bodies.index(flange)] @ rig.mounted.sensor_position
    pull, wrench = np.array(LOAD), np.zeros((1, 2, 6))
    wrench[0, 1] = [*(base.T @ pull), *(base.T @ np.cross(lever, pull))]
    still, loaded = rig.respond(posture, wrench, np.full((1, 2), 60.0)).point(
        flange, np.zeros(3)
    )
    moved = loaded - still
    off = stood[1] - stood[0] - moved
    return float(np.linalg.norm(off) / np.linalg.norm(moved))


def rows_of(trials: list[ArmTrial]) -> list[dict[str, object]]:
    """Return the trials as rows of a table."""
    return [asdict(trial) for trial in trials]


def trials_in(rows: list[dict[str, str]]) -> list[ArmTrial]:
    """Return the trials of a table that was written from `rows_of`."""
    read: dict[type, Callable[[str], Any]] = {
        bool: lambda cell: cell == "True",
        int: int,
        float: lambda cell: float(cell or "nan"),
        str: str,
    }
    kinds = get_type_hints(ArmTrial)
    return [ArmTrial(**{n: read[kinds[n]](row[n]) for n in kinds}) for row in rows]


COUNTED: dict[str, Callable[[ArmTrial], bool]] = {
    "both named or declared": lambda t: t.right,
    "exactly these": lambda t: t.exact,
    "springs within 5 %": lambda t: t.springs_off <= 0.05,
    "after ≤ 1.05 × noise": lambda t: t.after_over_noise <= 1.05,
    "model.xml bends as the rig within 1 %": lambda t: t.bends_off <= 0.01,
    "explained": lambda t: t.verdict == "explained",
}
"""What is counted of the trials, by its heading; what is not known does not count."""


def summary_of(trials: list[ArmTrial]) -> Table:
    """Return a row for each arm and base: names, springs, residuals, verdicts."""
    rows = []
    for model in dict.fromkeys(t.model for t in trials):
        for base in BASES:
            own = [t for t in trials if (t.model, t.base) == (model, base)]
            counts = (f"{sum(map(c, own))}/{len(own)}" for c in COUNTED.values())
            shares = [t.compliances_inside for t in own if t.compliances_inside >= 0.0]
            inside = f"{np.mean(shares):.1%}" if shares else ""
            median = f"{np.median([t.seconds for t in own]):.0f}"
            rows.append([model, base, *counts, inside, median])
    caption = (
        "Two effects concealed on each arm, its base as shipped and turned; the last "
        "share is of all axes of all trials."
    )
    header = ("arm", "base", *COUNTED, "compliances within intervals", "median [s]")
    return Table(caption, header, rows)
