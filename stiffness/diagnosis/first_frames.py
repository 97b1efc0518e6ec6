"""Where the tracker stands is first guessed from whatever the arm's markers allow.

==========  ==========================================================================
Equation    min over R, t, places of sum |R y + t - (R_b place + o_b)|^2: for known
            places a rigid fit; for unknown ones Gauss-Newton from 24 turns of a cube
Source      Kabsch 1976; Dornaika & Horaud 1998, "Simultaneous robot-world and hand-eye
            calibration"
Valid       an arm that stands roughly where its posture says
Ignores     sag; the fit that follows takes it in
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.errors import Unusable
from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.columns import levers
from stiffness.diagnosis.readings import Frames
from stiffness.equilibrium import equilibrium
from stiffness.frames import kabsch

SOME = 60
"""Visits that a first guess is made from; chosen."""


def first_frames(
    arm: Arm, recording: Recording, compliance: Float[np.ndarray, " axes"]
) -> Frames:
    """Guess the tracker's frame and the markers' places.

    Raises:
        Unusable: Where nothing tells how the tracker stands.
    """
    assert recording.points is not None
    first = np.unique(recording.visit, return_index=True)[1]
    rows = first[:: max(1, len(first) // SOME)]
    posture = equilibrium(
        arm, recording.posture[rows], compliance, payload=recording.tool
    )
    standing = arm.at(posture)
    turned = np.stack([standing.turn(m.body) for m in recording.markers], axis=1)
    origin = np.stack(
        [standing.point(m.body, np.zeros(3)) for m in recording.markers], axis=1
    )
    y = recording.points[rows]
    given = np.array([m.position is not None for m in recording.markers])
    place = np.array(
        [np.zeros(3) if m.position is None else m.position for m in recording.markers]
    )
    transform = recording.base_from_tracker
    if transform is None and recording.displacement == "relative":
        raise Unusable(
            f"Recording {recording.name!r}",
            ["relative readings need [frames.tracker]: they do not show it."],
        )
    if transform is None:
        transform = _known(turned, origin, y, place, given)
    if transform is None:
        transform, place = _unknown(turned, origin, y, place)
    turn, shift = transform[:3, :3], transform[:3, 3]
    if not given.all() and recording.displacement == "absolute":
        inside = np.einsum("vmji,vmj->vmi", turned, y @ turn.T + shift - origin)
        found = np.nanmean(inside, axis=0)
        place = np.where(given[:, None], place, np.nan_to_num(found))
    return Frames(turn, shift, place)


def _known(turned, origin, y, place, given) -> np.ndarray | None:
    target = np.einsum("vmij,mj->vmi", turned, place) + origin
    use = np.isfinite(y).all(axis=2) & given
    try:
        return kabsch(y[use], target[use])
    except Unusable:
        return None


def _unknown(turned, origin, y, place) -> tuple[np.ndarray, np.ndarray]:
    """Fit frame and places together, from every way that a cube can lie."""
    moves = np.ptp(origin, axis=0).max(axis=1)
    few = np.argsort(-moves)[:4]
    best, answer = np.inf, None
    for start in Rotation.create_group("O").as_matrix():
        cost, fit = _gauss_newton(turned[:, few], origin[:, few], y[:, few], start, 12)
        if cost < best:
            best, answer = cost, fit
    assert answer is not None
    _, (transform, _) = _gauss_newton(turned, origin, y, answer[0][:3, :3], 8)
    return transform, place


def _gauss_newton(turned, origin, y, turn, steps):
    visits, markers = y.shape[:2]
    seen = np.isfinite(y).all(axis=2)
    shift, place = np.zeros(3), np.zeros((markers, 3))
    cost = np.inf
    for _ in range(steps):
        point = np.nan_to_num(y @ turn.T + shift)
        left = point - np.einsum("vmij,mj->vmi", turned, place) - origin
        design = np.zeros((visits, markers, 3, 6 + 3 * markers))
        design[..., :6] = -levers(point)
        for m in range(markers):
            design[:, m, :, 6 + 3 * m : 9 + 3 * m] = turned[:, m]
        a = (design * seen[..., None, None]).reshape(-1, design.shape[3])
        b = (left * seen[..., None]).ravel()
        ridge = a.T @ a + 1e-8 * np.eye(a.shape[1])
        step = np.linalg.solve(ridge, a.T @ b)
        spin = Rotation.from_rotvec(step[3:6]).as_matrix()
        turn, shift = spin @ turn, spin @ shift + step[:3]
        place = place + step[6:].reshape(markers, 3)
        cost = float(b @ b)
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = turn, shift
    return cost, (transform, place)
