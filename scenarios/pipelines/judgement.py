"""Judges a patch on a recording that it was not fitted to.

Nominal and patched arm do again in MuJoCo what the recording did. For each of the two
the tracker's frame and the targets' places are fitted to the recording, and nothing
else: sizes, springs and geometry stay as the patch has them.

- What refers to the clock or the stated frame of the recording that the patch was
  fitted to (`OWN_RECORDING`) is left out and listed.
- Without a load, hysteresis that a calibration found is simulated as what it does
  there: an axis that stops short, on the side it came from.
- A reading is covered where the angle and torque of each axis at which the patch has a
  law of them lie in the range of the poses that were fitted (`coverage_of`).
- A part of the patch is worth what the error grows by when it alone is taken out.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from jaxtyping import Bool, Float, Int

from bench.kinematic_chain import moving
from bench.model_file import load
from bench.patch import AxisRange, Patch, effects_of, rig_of
from bench.proof.comparison import (
    ComparisonMode,
    comparison_mode_of,
    means_count,
    residual_of,
    turns_of,
)
from bench.proof.explained_share import Channel, channel_of, floor_of
from bench.proof.nominal_fit import framed
from bench.proof.proof_checks import squares
from bench.proof.setup import mounted_on, replay_simulation_of
from bench.proof.simulation import NominalState, ReplaySimulation, SimulatedReadings
from bench.rig import Rig
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.errors import Unusable, refuse
from bench.shared.recording import Recording, targets_of
from bench.shared.settings import MM, MRAD, SETTINGS
from scenarios.pipelines.patching import FROM_SIDES, NEAR, digests_of
from scenarios.pipelines.recording_check import SMALL_TORQUE, static_torque
from scenarios.pipelines.schema import At, Proved, proved_in
from stiffness.experiment.outliers import outliers_of, without_outliers
from stiffness.robot.arm import Arm
from stiffness.robot.tracker_frame import initial_tracker_frame

# --- The form of proof.json -----------------------------------------------------------

FILE = "proof.json"


HowItHolds = Literal["holds", "better", "not shown", "worse"]


class FarReading(msgspec.Struct, frozen=True):
    """A reading that is far off: from the arm with the patch, or from the others."""

    pose: int
    marker: str
    size_mm: float


class ProofFile(msgspec.Struct, frozen=True):
    """The content of proof.json.

    Attributes:
        proof: Over all of its poses, none of which the patch was fitted to.
        covered_share: Share of readings where every angle and torque that the patch
            depends on lies in the fitted range; null where the patch does not say.
        covered: The proof over these readings alone; null where there are none.
        outliers: Readings that no smooth error makes; they are in the proof.
        disregarded: Readings that other readings of the recording contradict; they are
            not in the proof.
        left_out: Effects of the patch that belong to the recording it was fitted to.
        verdict: Whether the patch holds; see `verdict_of`.
        taught: Whether the patch was fitted to readings of this very recording.
        harmful: Parts without which the patch is better; see `Contribution`.
        springs: The same with the springs that were fitted and nothing else of the
            patch as what is before; null where it has no springs or nothing else.
    """

    recording: str
    proof: Proved
    covered_share: float | None
    covered: Proved | None
    outliers: tuple[FarReading, ...]
    left_out: tuple[At, ...]
    verdict: HowItHolds = "holds"
    taught: bool = False
    harmful: tuple[str, ...] = ()
    springs: Proved | None = None
    disregarded: tuple[FarReading, ...] = ()
    schema: int = 1


# --- What can be judged ---------------------------------------------------------------

OWN_RECORDING = ("drift", "marker_slip", "tracker_misalignment")
"""Effects of the clock or of the stated frame of the recording they were found in."""
GROUPS = 500
"""Poses over which an interval is taken; of more, so many runs of consecutive ones."""
FRAMINGS, STILL = 12, 1e-8
"""Steps of the fit of frame and targets at most, and the step in m that ends it."""
FIT_ROWS = 3000
"""Rows that frame and targets are fitted to at most, whole visits evenly taken."""
SLIGHT = 0.01
"""Share of the error below which it does not matter that a part does harm; chosen."""
FAR = 10.0
"""Distance over the median one from which a reading is listed; chosen: beyond what
smooth errors make, 15 standard deviations of noise."""


@dataclass(frozen=True)
class AxisCoverage:
    """How far a patch was fitted to what an axis does in another recording.

    Attributes:
        name: a1, a2 … as the recording counts.
        outside: Share of readings beyond the fitted angles, or torques, of its laws.
        angle: Least and largest angle in the recording, in rad (m on a slide).
        torque: The same of the torque from weight and load, in N m (N).
        fitted: Range while the patch was fitted; None where it does not say.
        laws: Effects of angle or torque that the patch has there.
        share: Share of readings inside, for those laws.
    """

    name: str
    angle: tuple[float, float]
    torque: tuple[float, float]
    fitted: AxisRange | None
    laws: tuple[str, ...]
    share: float
    outside: dict[str, float]


@dataclass(frozen=True)
class Contribution:
    """A part of a patch, and the rms error on the recording without it, in m.

    `whole` is that of all of the patch on the same rows. A part is `harmful` where the
    error is surely smaller without it, by over `SLIGHT`.
    """

    name: str
    rms: float
    whole: float
    harmful: bool


@dataclass(frozen=True)
class Judgement:
    """A patch judged on another recording.

    Attributes:
        absolute: Whether positions counted, or differences within visits alone.
        before: Error of every reading of a target as drawn, in m; NaN = not seen.
        after: The same with the patch.
        noise: What the stated noise alone would leave of each reading, in m.
        covered: Whether each row is covered; None where the patch does not say.
        parts: The patch taken apart.
        whole: Proof over all rows.
        springs: Over all rows, from the fitted springs alone to the whole patch.
        inside: Proof over the covered rows; None without.
        outside: Proof over the others; None without.
    """

    recording: Recording
    absolute: bool
    before: Float[np.ndarray, "rows targets"]
    after: Float[np.ndarray, "rows targets"]
    noise: Float[np.ndarray, " rows"]
    covered: Bool[np.ndarray, " rows"] | None
    axes: tuple[AxisCoverage, ...]
    parts: tuple[Contribution, ...]
    whole: Channel
    springs: Channel | None
    inside: Channel | None
    outside: Channel | None
    answer: ProofFile

    @property
    def slides(self) -> frozenset[str]:
        """Names of the axes that slide."""
        pairs = zip(self.axes, self.recording.slides, strict=False)
        return frozenset(axis.name for axis, slides in pairs if slides)


def judge(recording: Recording, arm: Arm, robot: Path, patch: Patch) -> Judgement:
    """Judge a patch, and take it apart, on plateaus with at least one tracked target.

    Raises:
        BenchError: Where it cannot be judged there, or an arm finds no rest.
    """
    outliers = outliers_of(recording)
    recording = without_outliers(recording, outliers)
    model = load(robot)
    _check(recording, patch, [model.joint(j).name for j in range(model.njnt)])
    kept = tuple(e for e in patch.effects if e.effect not in OWN_RECORDING)
    own = (e for e in patch.effects if e.effect in OWN_RECORDING)
    gone = tuple(At(e.effect, e.where) for e in own)
    axes, hand = patch.axes, patch.hand
    if not axes:
        axes, hand = moving(recording, model)
    patch = replace(patch, effects=kept, axes=axes, hand=hand)
    mounted = mounted_on(recording, rig_of(patch, robot))
    patch = replace(patch, mounted=mounted)
    bare = rig_of(Patch(axes=axes, hand=hand, mounted=mounted), robot)
    fit = initial_tracker_frame(arm, recording, np.zeros(len(arm.axes)))
    start = NominalState(bare, fit.turn, fit.shift, fit.marker_positions)

    simulation = replay_simulation_of(recording, bare, effects_of(patch))
    simulation = simulation.remembering(patch)
    moved, rig = patched_arm(simulation, patch, robot)
    absolute = means_count(simulation, start, replace(start, rig=rig))
    some = _some_visits(recording)
    mode = comparison_mode_of(simulation, absolute, some)
    nominal = _framed(simulation, start, mode)
    patched = _framed(moved, replace(nominal, rig=rig), mode)
    mode = replace(mode, keep=np.ones(len(some), dtype=bool))
    first, last = _errors(simulation, nominal, mode), _errors(moved, patched, mode)
    floor = floor_of(moved, patched, last.seen, mode)[0]
    covered, coverage = coverage_of(recording, arm, bare, patch)

    def proof(
        rows: np.ndarray, first: _Errors = first
    ) -> tuple[Channel | None, Channel | None]:
        if not rows.any():
            return None, None
        pose = _runs(recording.posture_id[rows])
        channels = (
            channel_of(a[rows], b[rows], np.broadcast_to(n, a.shape)[rows], pose)
            for a, b, n in (
                (first.position, last.position, floor[:, None]),
                (first.turn, last.turn, last.turn_noise),
            )
        )
        return next(channels), next(channels)

    count = lambda rows: len(np.unique(recording.posture_id[rows]))  # noqa: E731
    whole = proof(mode.keep)
    if whole[0] is None:
        fault = "no target is seen in any row that could be judged."
        raise Unusable(f"Recording {recording.name!r}", [fault])
    alone = _with_springs_alone(simulation, patch, robot, nominal, mode)
    springs = (None, None) if alone is None else proof(mode.keep, alone)
    inside = outside = (None, None)
    if covered is not None:
        inside, outside = proof(covered), proof(~covered)
    shown = np.isfinite(last.position).any(axis=1)
    mode = replace(mode, keep=some)
    parts = _parts(simulation, patch, robot, patched, mode, floor[some])
    answer = ProofFile(
        recording=recording.name,
        proof=_entry(whole, count(mode.keep)),
        covered_share=None if covered is None else float(np.mean(covered[shown])),
        covered=None
        if covered is None or inside[0] is None
        else _entry(inside, count(covered)),
        outliers=_far(recording, first.position, last.position),
        left_out=gone,
        verdict=verdict_of(whole[0]),
        taught=bool({*patch.readings} & {*digests_of(recording, None)}),
        harmful=tuple(p.name for p in parts if p.harmful),
        springs=springs[0] and _entry(springs, count(mode.keep)),
        disregarded=tuple(FarReading(o.pose, o.marker, MM * o.size) for o in outliers),
    )
    return Judgement(
        recording=recording,
        absolute=absolute,
        before=np.sqrt(first.position),
        after=np.sqrt(last.position),
        noise=np.sqrt(floor),
        covered=covered,
        axes=coverage,
        parts=parts,
        whole=whole[0],
        springs=springs[0],
        inside=inside[0],
        outside=outside[0],
        answer=answer,
    )


def verdict_of(channel: Channel) -> HowItHolds:
    """Return whether a patch holds: surely better than without, and near the noise."""
    if channel.high < 0.0:
        return "worse"
    if not channel.low > 0.0:
        return "not shown"
    near = channel.after <= SETTINGS.simulator_ratio * channel.noise
    return "holds" if near else "better"


def _check(recording: Recording, patch: Patch, joints: list[str]) -> None:
    faults = []
    moved = ", ".join(a for a in recording.axes or joints if a not in patch.axes)
    if patch.axes and moved:
        faults.append(f"it moves {moved}, which the patch holds at zero.")
    if recording.rows != "plateaus":
        faults.append('rows are a "stream"; a patch is judged on "plateaus", at rest.')
    if not recording.markers or recording.points is None:
        faults.append("nothing was tracked; a patch is judged on targets' positions.")
    refuse(f"Recording {recording.name!r}", faults)


def _some_visits(recording: Recording) -> Bool[np.ndarray, " rows"]:
    """Return the rows of whole visits, evenly taken, that a fit looks at."""
    visit = np.unique(recording.visit, return_inverse=True)[1]
    return visit % -(-len(visit) // FIT_ROWS) == 0


def _runs(pose: Int[np.ndarray, " rows"]) -> Int[np.ndarray, " rows"]:
    """Return each row's pose, or which run of consecutive poses it is in."""
    _, first, index = np.unique(pose, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    count = len(first)
    return pose if count <= GROUPS else (rank * GROUPS // count)[index]


# --- Both arms in the simulator -------------------------------------------------------


def patched_arm(
    simulation: ReplaySimulation, patch: Patch, robot: Path
) -> tuple[ReplaySimulation, Rig]:
    """Return the arm with a patch, and the recording as it does it.

    Hysteresis without settings is a calibration's; without a load its axis stops short
    by half the width, on the side that it came from.
    """
    from_side = [
        e
        for e in patch.effects
        if e.effect in FROM_SIDES
        and not e.settings
        and simulation.recording.wrench is None
    ]
    rest = tuple(e for e in patch.effects if e not in from_side)
    rig = rig_of(replace(patch, effects=rest), robot)
    side, short = (
        simulation.replay.moves.side,
        np.zeros(simulation.replay.posture.shape),
    )
    for effect in from_side:
        k = rig.anatomy.axes.index(rig.anatomy.axis(effect.where))
        own = simulation.order.tolist().index(k)
        width = effect.parameters.get("width_rad")
        short[:, own] -= float(width or 0.0) / 2 * side[:, own]
    replay = replace(simulation.replay, posture=simulation.replay.posture + short)
    held = replay_simulation_of(simulation.recording, rig, rig.effects)
    moved = replace(simulation, sensor_axes=held.sensor_axes, weight=held.weight)
    return replace(moved, replay=replay, _known={}), rig


def _framed(
    simulation: ReplaySimulation, assumed: NominalState, mode: ComparisonMode
) -> NominalState:
    """Fit frame and targets until they stand still."""
    for _ in range(FRAMINGS):
        before, assumed = assumed, framed(simulation, assumed, mode)
        steps = (
            assumed.shift - before.shift,
            assumed.turn - before.turn,
            assumed.marker_positions - before.marker_positions,
        )
        if max(float(np.abs(s).max(initial=0.0)) for s in steps) < STILL:
            break
    return assumed


@dataclass(frozen=True)
class _Errors:
    """Squares of errors in m² and, of bodies' turns and their stated noise, in rad²."""

    seen: SimulatedReadings
    position: Float[np.ndarray, "rows targets"]
    turn: Float[np.ndarray, "rows bodies"]
    turn_noise: Float[np.ndarray, "rows bodies"]


def _errors(
    simulation: ReplaySimulation, assumed: NominalState, mode: ComparisonMode
) -> _Errors:
    """Compare readings with an arm; of a 6D target its first point is its position."""
    seen = simulation.see(assumed)
    residual = residual_of(simulation, seen, mode)
    firsts = [own[0] for own in targets_of(simulation.recording).values()]
    turn = turns_of(simulation, seen, residual, mode)
    return _Errors(seen, squares(simulation, residual)[0][:, firsts], *turn)


def _with_springs_alone(
    simulation: ReplaySimulation,
    patch: Patch,
    robot: Path,
    nominal: NominalState,
    mode: ComparisonMode,
) -> _Errors | None:
    """Return the errors with a patch's springs; None: it has none or nothing else."""
    if not patch.stiffness_nm_per_rad or not (patch.effects or patch.laws):
        return None
    moved, rig = patched_arm(simulation, replace(patch, effects=(), laws=()), robot)
    return _errors(moved, _framed(moved, replace(nominal, rig=rig), mode), mode)


def _parts(
    simulation: ReplaySimulation,
    patch: Patch,
    robot: Path,
    patched: NominalState,
    mode: ComparisonMode,
    noise: Float[np.ndarray, " rows"],
) -> tuple[Contribution, ...]:
    """Return the error without each part of a patch alone."""
    rows = mode.keep
    pose = _runs(simulation.recording.posture_id[rows])
    some = simulation.part(rows)
    mode = replace(mode, keep=np.ones(int(rows.sum()), dtype=bool))

    def errors(less: Patch) -> np.ndarray:
        moved, rig = patched_arm(some, less, robot)
        state = _framed(moved, replace(patched, rig=rig), mode)
        return _errors(moved, state, mode).position

    def part(name: str, less: Patch) -> Contribution:
        without = errors(less)
        quiet = np.broadcast_to(noise[:, None], whole.shape)
        found, rms = channel_of(without, whole, quiet, pose), _rms(without)
        harmful = found is not None and found.high < 0.0 and rms < (1 - SLIGHT) * error
        return Contribution(name, rms, error, harmful)

    whole = errors(patch)
    error = _rms(whole)

    names = list(dict.fromkeys((e.effect, e.where) for e in patch.effects))
    ways = [(f"{e} at {w}", _lacking(patch, e, w)) for e, w in names]
    if patch.laws:
        ways.append(("tables without a name", replace(patch, laws=())))
    if patch.stiffness_nm_per_rad:
        ways.append(("springs as fitted", replace(patch, stiffness_nm_per_rad={})))
    return tuple(part(name, less) for name, less in ways)


def _rms(squares: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(squares)))


def _lacking(patch: Patch, effect: str, where: str) -> Patch:
    kept = (e for e in patch.effects if (e.effect, e.where) != (effect, where))
    return replace(patch, effects=tuple(kept))


# --- Coverage -------------------------------------------------------------------------

SLACK = 0.1
"""Share of the fitted range of torque by which a load may pass either end, or a torque
that hardly shows; chosen."""


def coverage_of(
    recording: Recording, arm: Arm, nominal: Rig, patch: Patch
) -> tuple[Bool[np.ndarray, " rows"] | None, tuple[AxisCoverage, ...]]:
    """Return which rows a patch covers, and what the recording does with each axis.

    Returns:
        A mask, None where the patch does not say what it was fitted to; and the axes.
    """
    torque = static_torque(recording, arm.at(recording.posture))
    inside = np.ones(len(recording.time), dtype=bool)
    axes = []
    for k, joint in enumerate(recording.axes or nominal.anatomy.axes):
        where = f"a{nominal.anatomy.axes.index(joint) + 1}"
        angle, load = recording.posture[:, k], torque[:, k]
        known, laws = patch.fitted.get(where), _laws_at(patch, where)
        own = np.full(len(angle), known is not None or not laws)
        within = {}
        if known is not None and "angle" in laws.values():
            ends = np.array(known.angle_rad)[:, :, None]
            near = (ends[:, 0] - NEAR <= angle) & (angle <= ends[:, 1] + NEAR)
            within["angle"] = near.any(axis=0)
        if known is not None and "torque" in laws.values():
            low, high = known.torque_nm
            more = max(SLACK * (high - low), SMALL_TORQUE)
            within["torque"] = (low - more <= load) & (load <= high + more)
        own &= np.all([np.ones_like(own), *within.values()], axis=0)
        inside &= own
        axes.append(
            AxisCoverage(
                name=f"a{k + 1}",
                angle=(float(angle.min()), float(angle.max())),
                torque=(float(load.min()), float(load.max())),
                fitted=known,
                laws=tuple(dict.fromkeys(name for name, _ in laws)),
                share=float(own.mean()),
                outside={name: float(1.0 - w.mean()) for name, w in within.items()},
            )
        )
    return (inside if patch.fitted else None), tuple(axes)


def _laws_at(patch: Patch, where: str) -> dict[tuple[str, str], str]:
    """Return the regressors of all effects at an axis, by effect and regressor."""
    found = {
        (e.effect, regressor): regressor
        for e in patch.effects
        if e.where == where
        for regressor in CATALOGUE[e.effect].depends_on
        if regressor in ("angle", "torque")
    }
    if any(law.where == where for law in patch.laws):
        found["table without a name", "torque"] = "torque"
    return found


# --- The entries of proof.json --------------------------------------------------------


def _entry(channels: tuple[Channel | None, Channel | None], poses: int) -> Proved:
    position, turn = channels
    return Proved(
        simulator="mujoco",
        held_out_poses=poses,
        **proved_in(position, MM, "mm"),
        **proved_in(turn, MRAD, "mrad"),
    )


def _far(
    recording: Recording,
    before: Float[np.ndarray, "rows targets"],
    after: Float[np.ndarray, "rows targets"],
) -> tuple[FarReading, ...]:
    """Return readings that are far from the arm that errs less, the farthest first."""
    better = min(before, after, key=np.nanmedian)
    far = np.nan_to_num(better) > FAR**2 * np.nanmedian(better)
    names = list(targets_of(recording))
    rows = sorted(zip(*np.nonzero(far), strict=True), key=lambda at: -after[at])
    return tuple(
        FarReading(
            int(recording.posture_id[row]), names[m], MM * float(np.sqrt(after[row, m]))
        )
        for row, m in rows
    )
