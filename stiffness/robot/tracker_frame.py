"""Registration of the tracker to the base: stated, by base markers, or by the arm.

Bound on the tracker's scale error (`LARGEST_SCALE`), far below errors of drawings:

==========  ==========================================================================
Equation    |ratio| <= 5e-4
Source      a laser's wavelength in air changes by 1 ppm a degree and 0.27 ppm a hPa
            (Edlen 1966, "The refractive index of air", Metrologia 2, 71): 50 ppm with
            another day's air and another place's height; cameras are scaled by a bar or
            wand of known length, about 0.1 to 0.3 mm a metre where it is done by hand
Valid       instruments in order, in their own unit of length
Ignores     an inch taken for 25 mm and the like: those are errors of the set-up
==========  ==========================================================================

Tracker frame from known marker positions (`tracker_frame`):

==========  ==========================================================================
Equation    R, t = argmin sum |R p_tracker + t - p_base|^2, by the SVD of the moment
Source      Kabsch 1976, "A solution for the best rotation to relate two sets of
            vectors", Acta Crystallographica A32, 922
Needs       the frame in the manifest; or three markers on the base whose places are
            known; or markers with known places on moving bodies, not on one line
Assumes     the arm's posture is as reported; springs, where given, are linear
==========  ==========================================================================

Tracker frame and marker positions from postures and readings (`initial_tracker_frame`,
`fit_tracker_frame`):

==========  ==========================================================================
Equation    min over R, t, places of sum |R_b^T (R y + t - o_b) - place|^2: linear in a
            free 3 x 3 matrix for R, then Gauss-Newton on turns; unknown places are
            means over visits
Source      Shah 2013, "Solving the robot-world/hand-eye calibration problem using the
            Kronecker product", here with points; Kabsch 1976 where places are given
Valid       an arm whose posture is roughly as reported
Ignores     sag, which the fit that follows includes
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable
from bench.shared.recording import UNLOADED, Recording, transform_of
from stiffness.robot.arm import Arm
from stiffness.robot.equilibrium import equilibrium
from stiffness.robot.kinematics import point_jacobian

# --- Accuracy of trackers and of stated marker positions ------------------------------

LARGEST_SCALE = 5e-4
"""Maximum scale error, either sign; chosen: the widest above, and half as much
again."""


# --- Nuisance parameters --------------------------------------------------------------

MARKER_POSITION_SIGMA = 1e-3
"""Standard deviation of a given marker place, in m: what is nominal by the rules."""


# --- Frames ---------------------------------------------------------------------------

FLAT = 1e-3
"""Second over first extent of points below which they lie on a line; chosen."""
ENOUGH = 3
"""Number of points that determine a frame."""


@dataclass(frozen=True)
class TrackerFrame:
    """The tracker's frame, with its source.

    Attributes:
        base_from_tracker: Transform, in m.
        source: The manifest, markers on the base, or markers on the moving arm.
    """

    base_from_tracker: Float[np.ndarray, "4 4"]
    source: Literal["manifest", "base markers", "arm markers"]


def tracker_frame(
    arm: Arm,
    recording: Recording,
    compliance: Float[np.ndarray, " axes"] | None = None,
) -> TrackerFrame:
    """Return the tracker's frame from the best source that the recording has.

    Args:
        arm: The nominal arm, with the recording's names.
        recording: Its unloaded rows are used.
        compliance: Springs on which the unloaded arm sags under its weight, in
            rad/(N m); None = rigid.

    Returns:
        The transform and the source.

    Raises:
        Unusable: Where nothing determines the frame.
    """
    if recording.base_from_tracker is not None:
        return TrackerFrame(recording.base_from_tracker, "manifest")
    fixed = [arm.attachment(marker.body).axis < 0 for marker in recording.markers]
    known = [marker.position is not None for marker in recording.markers]
    on_base = np.array(fixed, dtype=bool) & np.array(known, dtype=bool)
    frame = None
    if recording.displacement == "absolute" and on_base.any():
        frame = _fit(arm, recording, on_base, None, "base markers")
    if frame is None and recording.displacement == "absolute" and any(known):
        chosen = np.array(known, dtype=bool)
        frame = _fit(arm, recording, chosen, compliance, "arm markers")
    if frame is None:
        advice = (
            "the tracker's frame is unknown: give [frames.tracker], or position_mm of "
            "three markers on the base or of the markers on the arm (absolute)."
        )
        raise Unusable(f"Recording {recording.name!r}", [advice])
    return frame


def rotations(
    shape: Float[np.ndarray, "points 3"], seen: Float[np.ndarray, "rows points 3"]
) -> Float[np.ndarray, "rows 3 3"]:
    """Return the rotations that bring vectors nearest to those seen (Kabsch 1976)."""
    u, _, vt = np.linalg.svd(np.einsum("rpi,pj->rij", seen, shape))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return u @ vt


def kabsch(
    source: Float[np.ndarray, "points 3"], target: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, "4 4"]:
    """Return the rigid transform of least squared distance between points, in m.

    Raises:
        Unusable: Where the points lie on one line, so that a rotation is undetermined.
    """
    middle, aim = source.mean(axis=0), target.mean(axis=0)
    extent = np.linalg.svd(source - middle, compute_uv=False)
    if len(source) < ENOUGH or extent[1] < FLAT * extent[0]:
        raise Unusable(
            "The markers", ["they lie on one line; a turn about it is free."]
        )
    turn = Rotation.align_vectors(target - aim, source - middle)[0].as_matrix()
    return transform_of(turn, aim - turn @ middle)


def unloaded_rows(recording: Recording) -> Int[np.ndarray, " unloaded"]:
    """Return the rows read without load; each visit's first where none is marked."""
    marked = np.flatnonzero(recording.stage == UNLOADED)
    return marked if len(marked) else np.unique(recording.visit, return_index=True)[1]


def _fit(
    arm: Arm,
    recording: Recording,
    chosen: Bool[np.ndarray, " markers"],
    compliance: np.ndarray | None,
    source: Literal["base markers", "arm markers"],
) -> TrackerFrame | None:
    """Fit the frame to some markers' nominal places; None where they are too few."""
    assert recording.points is not None
    rows = unloaded_rows(recording)
    posture = recording.posture[rows]
    if compliance is not None:
        posture = equilibrium(arm, posture, compliance, payload=recording.tool)
    standing = arm.at(posture)
    seen, nominal = [], []
    for k in np.flatnonzero(chosen):
        marker = recording.markers[k]
        assert marker.position is not None
        point = recording.points[rows, k]
        visible = np.isfinite(point).all(axis=1)
        seen.append(point[visible])
        nominal.append(standing.point(marker.body, marker.position)[visible])
    source_points, target = np.concatenate(seen), np.concatenate(nominal)
    try:
        transform = kabsch(source_points, target)
    except Unusable:
        return None
    return TrackerFrame(transform, source)


# --- Fitted frame and marker positions ------------------------------------------------


@dataclass(frozen=True)
class TrackerFit:
    """Fitted pose of the tracker and positions of the markers.

    Attributes:
        turn: R in p_base = R p_tracker + shift.
        shift: Translation t in the same, in m.
        marker_positions: Position of each marker in its body's frame, in m.
        wander: Variance by which each marker wanders on its body along no law, in m²;
            empty: none does.
    """

    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]
    marker_positions: Float[np.ndarray, "markers 3"]
    wander: tuple[float, ...] = ()

    @property
    def transform(self) -> Float[np.ndarray, "4 4"]:
        """Transform from the tracker's frame to the base's, in m."""
        return transform_of(self.turn, self.shift)

    def displaced(
        self, twist: Float[np.ndarray, "6"], marker_step: Float[np.ndarray, "markers 3"]
    ) -> "TrackerFit":
        """Return the fit after a small twist in the base's frame and marker steps.

        A twist moves the predictions, so the readings move the opposite way.
        """
        back = Rotation.from_rotvec(-twist[3:]).as_matrix()
        return replace(
            self,
            turn=back @ self.turn,
            shift=back @ self.shift - twist[:3],
            marker_positions=self.marker_positions + marker_step,
        )


# --- Observations of the tracker ------------------------------------------------------

FAR = 10.0
"""Distance from the middle, over that of nearly all readings, beyond which a reading is
invalid; chosen."""


@dataclass(frozen=True)
class TrackerObservations:
    """Readings of markers, with the expected poses of their bodies.

    Attributes:
        turned: Rotation from each marker's body to the base.
        origin: Origin of each marker's body, in m.
        y: Readings in the tracker's frame, in m; NaN where not seen.
        marker_positions: Position of each marker in its body, in m.
        given: Whether that position is stated.
        transform: base_from_tracker; None where not stated.
    """

    turned: Float[np.ndarray, "visits markers 3 3"]
    origin: Float[np.ndarray, "visits markers 3"]
    y: Float[np.ndarray, "visits markers 3"]
    marker_positions: Float[np.ndarray, "markers 3"]
    given: Bool[np.ndarray, " markers"]
    transform: Float[np.ndarray, "4 4"] | None

    @classmethod
    def of(
        cls, arm: Arm, recording: Recording, posture: np.ndarray
    ) -> "TrackerObservations":
        """Return the observations with the arm in the recording's postures."""
        standing, markers = arm.at(posture), recording.markers
        assert recording.points is not None
        bodies = list(dict.fromkeys(m.body for m in markers))  # with several markers
        placements = np.stack([standing.placement(body) for body in bodies], axis=1)
        all_of_them = placements[:, [bodies.index(m.body) for m in markers]]
        return cls(
            turned=all_of_them[..., :3, :3],
            origin=all_of_them[..., :3, 3],
            y=recording.points,
            marker_positions=np.array(
                [np.zeros(3) if m.position is None else m.position for m in markers]
            ),
            given=np.array([m.position is not None for m in markers]),
            transform=recording.base_from_tracker,
        )

    @cached_property
    def filled(self) -> Float[np.ndarray, "visits markers 3"]:
        """Readings in m; 0 where not seen."""
        return np.nan_to_num(self.y)

    @cached_property
    def weight(self) -> Float[np.ndarray, "visits markers"]:
        """One for a valid reading, 0 for a missing or impossible one."""
        seen = np.isfinite(self.y).all(axis=2)
        if not seen.any():
            return seen.astype(float)
        off = np.abs(self.y - _quantile(self.y[seen], 0.5)).max(axis=2)
        most = _quantile(off[seen], 0.95)
        return (seen & (np.nan_to_num(off) <= FAR * most)).astype(float)


def extent_of(observed: TrackerObservations) -> float:
    """Return the size of the box that contains the readings, in m."""
    y = observed.y[observed.weight > 0]
    return float(np.ptp(y, axis=0).max()) if len(y) else 0.0


# --- Initial fit of the frame ---------------------------------------------------------

SOME = 60
"""Number of visits used for a first estimate; chosen."""
ODD, RARE = 8.0, 0.02
"""Misfit over the median, and over what three in four readings of the same marker stay
under, from which a reading is excluded, as long as such are rarer than this; chosen."""
POOR = 0.03
"""Misfit over the extent of the readings from which all 24 rotations of a cube are
tried as a start; chosen."""
STEPS, CLOSE = 6, 1e-7
"""Maximum number of Gauss-Newton steps, and the step in m or rad at convergence;
chosen."""


def initial_tracker_frame(
    arm: Arm, recording: Recording, compliance: Float[np.ndarray, " axes"]
) -> TrackerFit:
    """Return a first estimate of the tracker's frame and the marker positions.

    Raises:
        Unusable: Where nothing determines the tracker's frame or the marker positions.
    """
    first = np.unique(recording.visit, return_index=True)[1]
    some = recording.take(first[:: max(1, len(first) // SOME)])
    posture = equilibrium(arm, some.posture, compliance, payload=recording.tool)
    observed = TrackerObservations.of(arm, some, posture)
    if recording.displacement == "relative":
        faults = []
        if observed.transform is None:
            fault = "relative readings need [frames.tracker]: they do not show it."
            faults.append(fault)
        hidden = [m.name for m in recording.markers if m.position is None]
        if hidden:
            fault = "relative readings do not show where markers sit: give position_mm "
            faults.append(f"{fault}of {', '.join(hidden)}.")
        if observed.transform is None or hidden:
            raise Unusable(f"Recording {recording.name!r}", faults)
        turn, shift = observed.transform[:3, :3], observed.transform[:3, 3]
        return TrackerFit(turn, shift, observed.marker_positions)
    frames, _ = fit_tracker_frame(observed)
    return frames


def fit_tracker_frame(observed: TrackerObservations) -> tuple[TrackerFit, float]:
    """Return the best fit of frame and marker positions over several starts.

    Returns:
        Both, and the rms misfit in m.
    """
    frames, rms = fit_tracker_frame_once(observed)
    if observed.transform is not None or rms < POOR * extent_of(observed):
        return frames, rms
    for start in Rotation.create_group("O").as_matrix():
        other, left = _refined(observed, start, observed.weight)
        if left < rms:
            frames, rms = other, left
    return frames, rms


def fit_tracker_frame_once(
    observed: TrackerObservations, steps: int = STEPS
) -> tuple[TrackerFit, float]:
    """Return the fit from one start only: enough where postures are as reported.

    Args:
        observed: Readings of markers.
        steps: Most Gauss-Newton steps.
    """
    weight = observed.weight
    if observed.transform is None:
        start = _linear(observed, weight)
        return _refined(observed, start, weight, steps)
    turn, shift = observed.transform[:3, :3], observed.transform[:3, 3]
    return _judged(observed, turn, shift, weight)[:2]


def _linear(
    observed: TrackerObservations, weight: np.ndarray
) -> Float[np.ndarray, "3 3"]:
    """Return the rotation nearest to the best-fitting matrix."""
    y = observed.filled
    back = observed.turned.swapaxes(2, 3)  # (visits, markers, 3 of body, 3 of base)
    matrix = back[..., :, :, None] * y[:, :, None, None, :]
    design = np.concatenate([matrix.reshape(*y.shape, 9), back], axis=3)
    aim = (
        np.einsum("vmij,vmj->vmi", back, observed.origin)
        + observed.marker_positions * (observed.given[:, None])
    )
    design, aim = _less_places(observed, weight, design, aim[..., None])
    flat = design.reshape(-1, 12)
    size = np.maximum(np.linalg.norm(flat, axis=0), 1e-12)
    flat = flat / size
    solved = np.linalg.lstsq(flat.T @ flat, flat.T @ aim.reshape(-1), rcond=1e-12)[0]
    solved = solved / size
    u, _, v = np.linalg.svd(solved[:9].reshape(3, 3))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def _refined(
    observed: TrackerObservations,
    turn: np.ndarray,
    weight: np.ndarray,
    steps: int = STEPS,
) -> tuple[TrackerFit, float]:
    y, shift = observed.filled, np.zeros(3)
    back = observed.turned.swapaxes(2, 3)
    frames, rms, kept = (
        TrackerFit(turn, shift, observed.marker_positions),
        np.inf,
        weight,
    )
    for _ in range(steps):
        point = y @ turn.T + shift
        left = np.einsum("vmij,vmj->vmi", back, observed.origin - point)
        left = left + observed.marker_positions * observed.given[:, None]
        design, aim = _less_places(
            observed, kept, back @ point_jacobian(point), left[..., None]
        )
        flat = design.reshape(-1, 6)
        inner = flat.T @ flat
        inner += 1e-10 * max(np.trace(inner), 1e-12) * np.eye(6)
        step = np.linalg.solve(inner, flat.T @ aim.reshape(-1))
        spin = Rotation.from_rotvec(step[3:6]).as_matrix()
        turn, shift = spin @ turn, spin @ shift + step[:3]
        frames, rms, kept = _judged(observed, turn, shift, weight)
        if np.abs(step).max() < CLOSE:
            break
    return frames, rms


def _judged(
    observed: TrackerObservations,
    turn: np.ndarray,
    shift: np.ndarray,
    weight: np.ndarray,
) -> tuple[TrackerFit, float, np.ndarray]:
    """Return the frames with their marker positions, their rms, and valid readings."""
    kept = weight
    positions = observed.marker_positions
    away = observed.filled @ turn.T + shift - observed.origin
    inside = (away[..., None, :] @ observed.turned)[..., 0, :]
    size = np.zeros(weight.shape)
    for _ in range(1 if observed.given.all() else 2):  # means depend on what is kept
        total = np.maximum(kept.sum(axis=0), 1e-12)
        mean = np.einsum("vm,vmi->mi", kept, inside) / total[:, None]
        positions = np.where(observed.given[:, None], observed.marker_positions, mean)
        off = inside - positions
        size = np.sqrt(np.einsum("vmi,vmi->vm", off, off))
        kept = weight
        if weight.any():
            usual = np.maximum(_quantile(size, 0.75), _quantile(size[weight > 0], 0.5))
            odd = (size > ODD * usual) & (weight > 0)
            if odd.sum() <= RARE * weight.sum():
                kept = weight * ~odd
    rms = np.sqrt(np.sum(kept * size**2) / max(kept.sum(), 1.0))
    return TrackerFit(turn, shift, positions), float(rms), kept


def _quantile(values: np.ndarray, share: float) -> np.ndarray | float:
    """Return a quantile along the first axis; for few numbers faster than numpy's."""
    ordered = np.sort(values, axis=0)
    at = share * (len(ordered) - 1)
    below, above = ordered[int(at)], ordered[int(np.ceil(at))]
    return below + (at - int(at)) * (above - below)


def _less_places(
    observed: TrackerObservations, weight: np.ndarray, *values: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Project each marker's unknown position out of its rows."""
    free, root = ~observed.given[:, None, None], np.sqrt(weight)[..., None, None]
    if not free.any():
        return tuple(value * root for value in values)
    total = np.maximum(weight.sum(axis=0), 1e-12)[:, None, None]
    out = []
    for value in values:
        mean = np.einsum("vm,vmij->mij", weight, value) / total
        out.append((value - mean * free) * root)
    return tuple(out)
