"""Where the tracker stands is first guessed from whatever the arm's markers allow.

==========  ==========================================================================
Equation    min over R, t, places of sum |R_b^T (R y + t - o_b) - place|^2: linear in a
            free 3 x 3 matrix for R, then Gauss-Newton on turns; unknown places are
            means over visits
Source      Shah 2013, "Solving the robot-world/hand-eye calibration problem using the
            Kronecker product", here with points; Kabsch 1976 where places are given
Valid       an arm that stands roughly where its posture says
Ignores     sag; the fit that follows takes it in
==========  ==========================================================================
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.errors import Unusable
from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.readings import Frames
from stiffness.diagnosis.sight import Sight, extent_of
from stiffness.diagnosis.signature import levers
from stiffness.equilibrium import equilibrium

SOME = 60
"""Visits that a first guess is made from; chosen."""
ODD, RARE = 8.0, 0.02
"""Misfit over the median, and over what three in four readings of the same marker stay
under, from which a reading has no say, as long as such are rarer than this; chosen."""
POOR = 0.03
"""Misfit over the extent of the readings from which every way that a cube can lie is
tried as a start; chosen."""
STEPS, CLOSE = 6, 1e-7
"""Most steps of Gauss and Newton, and one in m or rad that is the last; chosen."""


def first_frames(
    arm: Arm, recording: Recording, compliance: Float[np.ndarray, " axes"]
) -> Frames:
    """Guess the tracker's frame and the markers' places.

    Raises:
        Unusable: Where nothing tells how the tracker stands or where markers sit.
    """
    first = np.unique(recording.visit, return_index=True)[1]
    some = recording.take(first[:: max(1, len(first) // SOME)])
    posture = equilibrium(arm, some.posture, compliance, payload=recording.tool)
    sight = Sight.of(arm, some, posture)
    if recording.displacement == "relative":
        faults = []
        if sight.transform is None:
            fault = "relative readings need [frames.tracker]: they do not show it."
            faults.append(fault)
        hidden = [m.name for m in recording.markers if m.position is None]
        if hidden:
            fault = "relative readings do not show where markers sit: give position_mm "
            faults.append(f"{fault}of {', '.join(hidden)}.")
        if sight.transform is None or hidden:
            raise Unusable(f"Recording {recording.name!r}", faults)
        turn, shift = sight.transform[:3, :3], sight.transform[:3, 3]
        return Frames(turn, shift, sight.place)
    frames, _ = seated(sight)
    return frames


def seated(sight: Sight) -> tuple[Frames, float]:
    """Fit frame and places as well as can be.

    Returns:
        Both, and the rms misfit in m.
    """
    frames, rms = quickly_seated(sight)
    if sight.transform is not None or rms < POOR * extent_of(sight):
        return frames, rms
    for start in Rotation.create_group("O").as_matrix():
        other, left = _refined(sight, start, sight.weight)
        if left < rms:
            frames, rms = other, left
    return frames, rms


def quickly_seated(sight: Sight) -> tuple[Frames, float]:
    """Do the same from one start only: enough where the arm stands as it says."""
    weight = sight.weight
    if sight.transform is None:
        start = _linear(sight, weight)
        return _refined(sight, start, weight)
    turn, shift = sight.transform[:3, :3], sight.transform[:3, 3]
    return _judged(sight, turn, shift, weight)[:2]


def _linear(sight: Sight, weight: np.ndarray) -> Float[np.ndarray, "3 3"]:
    """Return the turn nearest to the matrix that fits best."""
    y = np.nan_to_num(sight.y)
    back = sight.turned.swapaxes(2, 3)  # (visits, markers, 3 of body, 3 of base)
    matrix = back[..., :, :, None] * y[:, :, None, None, :]
    design = np.concatenate([matrix.reshape(*y.shape, 9), back], axis=3)
    aim = (
        np.einsum("vmij,vmj->vmi", back, sight.origin)
        + sight.place * (sight.given[:, None])
    )
    design, aim = _less_places(sight, weight, design, aim[..., None])
    flat = design.reshape(-1, 12)
    size = np.maximum(np.linalg.norm(flat, axis=0), 1e-12)
    flat = flat / size
    solved = np.linalg.lstsq(flat.T @ flat, flat.T @ aim.reshape(-1), rcond=1e-12)[0]
    solved = solved / size
    u, _, v = np.linalg.svd(solved[:9].reshape(3, 3))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def _refined(
    sight: Sight, turn: np.ndarray, weight: np.ndarray
) -> tuple[Frames, float]:
    y, shift = np.nan_to_num(sight.y), np.zeros(3)
    back = sight.turned.swapaxes(2, 3)
    kept = weight
    for _ in range(STEPS):
        point = y @ turn.T + shift
        left = np.einsum("vmij,vmj->vmi", back, sight.origin - point)
        left = left + sight.place * sight.given[:, None]
        design, aim = _less_places(sight, kept, back @ levers(point), left[..., None])
        flat = design.reshape(-1, 6)
        inner = flat.T @ flat
        inner += 1e-10 * max(np.trace(inner), 1e-12) * np.eye(6)
        step = np.linalg.solve(inner, flat.T @ aim.reshape(-1))
        spin = Rotation.from_rotvec(step[3:6]).as_matrix()
        turn, shift = spin @ turn, spin @ shift + step[:3]
        if np.abs(step).max() < CLOSE:
            break
        kept = _judged(sight, turn, shift, weight)[2]
    return _judged(sight, turn, shift, weight)[:2]


def _judged(
    sight: Sight, turn: np.ndarray, shift: np.ndarray, weight: np.ndarray
) -> tuple[Frames, float, np.ndarray]:
    """Return the frames with the places they imply, their rms, and who had a say."""
    kept = weight
    frames = Frames(turn, shift, sight.place)
    inside = np.einsum(
        "vmji,vmj->vmi",
        sight.turned,
        np.nan_to_num(sight.y) @ turn.T + shift - sight.origin,
    )
    size = np.zeros(weight.shape)
    for _ in range(2):
        total = np.maximum(kept.sum(axis=0), 1e-12)
        mean = np.einsum("vm,vmi->mi", kept, inside) / total[:, None]
        frames = replace(
            frames, place=np.where(sight.given[:, None], sight.place, mean)
        )
        size = np.linalg.norm(sight.misfit(frames), axis=2)
        kept = weight
        if weight.any():
            own = np.quantile(size, 0.75, axis=0)
            usual = np.maximum(own, np.median(size[weight > 0]))
            odd = (size > ODD * usual) & (weight > 0)
            if odd.sum() <= RARE * weight.sum():
                kept = weight * ~odd
    rms = np.sqrt(np.sum(kept * size**2) / max(kept.sum(), 1.0))
    return frames, float(rms), kept


def _less_places(
    sight: Sight, weight: np.ndarray, *values: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Take out of each marker's rows what its unknown place can take on."""
    total = np.maximum(weight.sum(axis=0), 1e-12)[:, None, None]
    free = ~sight.given[:, None, None]
    out = []
    for value in values:
        mean = np.einsum("vm,vmij->mij", weight, value) / total
        out.append((value - mean * free) * np.sqrt(weight)[..., None, None])
    return tuple(out)
