"""Forces of another size than their cause were given in another unit.

==========  ==========================================================================
Equation    |F| = m g of what hangs on the hook; y = frame + places + offsets +
            s sum_k J_k c_k t_k, t = torque of the arm's own weight, c = compliance
            under the measured load: s = 1 where both are in N m
Source      statics; units: 1 kgf = 9.80665 N, 1 lbf = 4.4482216 N (ISO 80000-4);
            s' error: each posture left out in turn, Bell & McCaffrey 2002 (CR3)
Valid       masses in the model; for s, absolute places of many unloaded postures
Ignores     rope friction; how much sag a controller takes out: said beside the unit
==========  ==========================================================================
"""

import numpy as np

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.diagnosis import Warned
from stiffness.diagnosis.followed_load import EXPLAINS, Fit, jacobians
from stiffness.diagnosis.readings import Frames
from stiffness.diagnosis.signature import levers

UNLIKE = 100.0
"""Factor between fitted and nominal compliance that no arm has; chosen."""
FLOPPY, STARK = 0.1, 1e-6
"""Most and least that an arm's axes sag under its own weight, in rad; chosen: those of
industrial arms sag by 1e-4 to 3e-3."""
FELT = 1.0
"""Torque of its own weight from which an axis' sag is judged, in N m; chosen."""
HEAVY = 3.0
"""Factor between the force and the weight on the hook that no rope makes; chosen: a
tackle doubles it, pounds and kilograms for newtons are beyond."""
KGF, LBF = 9.80665, 4.4482216
"""N in a kilogram-force, which a kilogram weighs, and in a pound-force."""
NEAR = 0.25
"""How far a ratio may be from a unit's own that it is taken for; chosen: friction of a
rope is a tenth, and what plays and slips makes compliance a fifth larger or smaller."""
SURE, ERRORS = 0.08, 3.0
"""Standard error over s from which it is believed, chosen: a third of `NEAR`; and how
many of them a unit may be off, chosen: what a controller leaves is any number."""
RANK = 1e-9
"""Singular value over the largest below which columns are the same; chosen."""
POSTURES = 60
"""Visits whose sag is looked at; chosen for time."""


def of_size(some: Recording, arm: Arm, fit: Fit) -> Warned | None:
    """Doubt units where springs come out as no arm has them."""
    assert some.wrench is not None
    if some.load_mass is not None:
        force = np.linalg.norm(np.diff(some.wrench[:, :3], axis=0)[::2], axis=1)
        hung = KGF * np.abs(np.diff(some.load_mass)[::2])
        if hung.any():
            ratio = float(np.sum(force) / np.sum(hung))
            if not 1.0 / HEAVY < ratio < HEAVY:
                unit = _unit(ratio)
                text = (
                    f"the force is {ratio:.3g} times the weight on the hook"
                    f"{f', as if in {unit}' if unit else ''}: check the units of "
                    "fx_n, fy_n, fz_n and of load_kg."
                )
                return Warned("units", "wrench_sensor", text)
    if not fit.clear.any() or fit.explained < EXPLAINS:
        return None
    known = fit.clear & (arm.stiffness > 0)
    weight = np.abs(arm.at(some.posture).gravity_torque(some.tool)).max(axis=0)
    heavy = fit.clear & ~arm.slides & (weight > max(0.1 * weight.max(), FELT))
    sag = (weight * fit.compliance)[heavy]
    words = None
    if known.any():
        ratio = float(np.median(fit.compliance[known] * arm.stiffness[known]))
        if not 1.0 / UNLIKE < ratio < UNLIKE:
            words = f"{ratio:.3g} times what the model's springs give"
    if words is None and len(sag) and not STARK < sag.max() < FLOPPY:
        words = f"such that the arm's own weight would turn axes by {sag.max():.2g} rad"
    if words is None:
        return None
    text = f"deflections are {words}: check the units of wrench and markers."
    return Warned("units", "wrench_sensor", text)


def of_sag(recording: Recording, arm: Arm, frames: Frames, fit: Fit) -> Warned | None:
    """Doubt units where its own weight turns the arm otherwise than the load does."""
    if recording.displacement != "absolute" or fit.explained < EXPLAINS:
        return None
    first = np.unique(recording.visit, return_index=True)[1]
    some = recording.take(first[:: -(-len(first) // POSTURES)])
    found = _sag(some, arm, frames, fit)
    if found is None or found[1] > SURE * abs(found[0]):
        return None
    unit = _unit(found[0], ERRORS * found[1])
    if not unit:
        return None
    text = (
        f"the wrench looks given in {unit}: under its own weight the arm gives way "
        f"{found[0]:.3g} times as much as the wrench would have it. N and Nm are "
        f"expected. Or the controller takes out {1.0 - found[0]:.0%} of the sag."
    )
    return Warned("units", "wrench_sensor", text)


def _unit(ratio: float, off: float = np.inf) -> str:
    """Return the unit in which a force would be read this many times its size."""
    for name, size in (("kgf", KGF), ("lbf", LBF)):
        if abs(ratio * size - 1.0) < min(NEAR, off * size):
            return name
    return ""


def _sag(
    some: Recording, arm: Arm, frames: Frames, fit: Fit
) -> tuple[float, float] | None:
    """Return s and its standard error, by leaving out each posture in turn."""
    standing, markers = arm.at(some.posture), some.markers
    jacobian = jacobians(some, standing, frames)  # (rows, markers, 3, axes)
    torque = standing.gravity_torque(some.tool)
    placed = zip(markers, frames.place, strict=True)
    points = np.stack([standing.point(m.body, place) for m, place in placed], axis=1)
    assert some.points is not None
    left = some.points @ frames.turn.T + frames.shift - points
    places = np.zeros((*left.shape, 3 * len(markers)))
    for m, marker in enumerate(markers):
        places[:, m, :, 3 * m : 3 * m + 3] = standing.turn(marker.body)
    sag = (jacobian * (fit.compliance * torque)[:, None, None]).sum(axis=3)
    seen = np.isfinite(left)
    others = np.concatenate([levers(points), jacobian, places], axis=3)[seen]
    size = np.linalg.norm(others, axis=0)
    u, scale, _ = np.linalg.svd(others / np.where(size > 0, size, 1.0), False)
    u = u[:, scale > RANK * scale[0]]
    own, aim = (v[seen] - u @ (u.T @ v[seen]) for v in (sag, left))
    whole = own @ own
    if whole <= 0.0:
        return None
    answer = (own @ aim) / whole
    of_posture = np.broadcast_to(np.arange(len(left))[:, None, None], left.shape)[seen]
    rest, basis = aim - answer * own, np.column_stack([u, own / np.sqrt(whole)])
    square = 0.0
    for posture in np.unique(of_posture):
        its = of_posture == posture
        free = np.eye(its.sum()) - basis[its] @ basis[its].T
        foretold = np.linalg.lstsq(free, rest[its], rcond=RANK)[0]
        square += (own[its] @ foretold) ** 2
    return float(answer), float(np.sqrt(square) / whole)
