"""An axis counted the wrong way round is no effect of physics but a mistake of set-up.

==========  ==========================================================================
Equation    rms of a rigid fit of frame and places, under each reading of the files:
            as they are, an axis reversed, two axes swapped, mirrored, other units …
Source      enumeration; a mistake moves markers by a tenth of the reach, physics by a
            hundredth at most
Valid       absolute readings; of relative ones the loads speak, in `set_up_loads`
Ignores     three mistakes at once, unless all are reversed axes
==========  ==========================================================================
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.diagnosis import Warned
from stiffness.diagnosis.first_frames import quickly_seated, seated
from stiffness.diagnosis.mixed_markers import mixed_markers
from stiffness.diagnosis.odd_units import odd_units
from stiffness.diagnosis.other_readings import of_angles, of_signs
from stiffness.diagnosis.other_sights import less_is_stated, of_sight
from stiffness.diagnosis.set_up_loads import mistakes_of_loads
from stiffness.diagnosis.sight import Sight, extent_of
from stiffness.diagnosis.unknowns import PLACE

DOUBT = 5e-4
"""Rigid misfit over the readings' extent from which other readings are tried; chosen:
half a millimetre on a metre, what a well calibrated arm has (Slamani 2012: 0.3 mm)."""
GROSS = 0.03
"""Rigid misfit over the extent that no arm's own errors make; chosen: ten times an
uncalibrated arm's (1.2 mm rms, 3 mm at most, Slamani 2012)."""
BETTER = 5.0
"""Factor by which another reading of the files must fit better; chosen."""
CLEAR = 10.0
"""Sigmas of the tracker from which a misfit is looked at; chosen."""
ALIKE = 1.1
"""Factor within which readings fit alike; then the first is told. Chosen."""
VISITS, OF_A_BODY = 30, 2
"""Visits, and markers of a body, that this looks at; chosen for time."""
PARTNERS = 8
"""Readings that are tried together with each other one; chosen for time."""

Told = tuple[Warned, ...]


def mistakes_of_set_up(recording: Recording, arm: Arm) -> Told:
    """Return the gross mistakes that the readings show.

    Args:
        recording: What was done and seen.
        arm: The nominal arm, with the recording's names.
    """
    if recording.points is None or recording.tracker is None:
        return ()
    told: Told = ()
    if recording.displacement == "absolute":
        told = odd_units(recording, arm)
        mixed = () if told else mixed_markers(recording, arm)
        told = told or tuple(m.warned for m in mixed if m.sure)
        told = told or _mistakes_of_places(
            recording, arm, tuple(m.warned for m in mixed)
        )
    return told or mistakes_of_loads(recording, arm)


def _mistakes_of_places(recording: Recording, arm: Arm, mixed: Told) -> Told:
    """Doubt angles and the tracker, then the markers' names, then what is stated."""
    some = _some(recording, arm)
    posture = some.posture
    sight = Sight.of(arm, some, posture)
    _, before = seated(sight)
    extent = extent_of(sight)
    assert some.tracker is not None
    noise = CLEAR * float(np.max(some.tracker.repeatability))
    places = np.sqrt(3.0) * PLACE if sight.given.any() else 0.0
    if before <= max(DOUBT * extent, noise, places):
        return ()
    angles = list(of_angles(posture, arm.slides))
    tried: list[tuple[float, Told, np.ndarray]] = []
    for other in angles:
        meant = other.meant(posture)
        tried.append((_misfit(Sight.of(arm, some, meant)), (other.warned,), meant))
    told = [(left, said) for left, said, _ in tried]
    told += [(_misfit(o.meant(sight)), (o.warned,)) for o in of_sight(sight)]
    answer = _best(told, before)
    if answer or (before < GROSS * extent and not mixed):
        return answer
    if mixed:
        return mixed
    told = [(_misfit(o.meant(sight)), (o.warned,)) for o in less_is_stated(sight)]
    if answer := _best(told, before):
        return answer
    if answer := _best(_pairs(some, arm, tried, before), before):
        return answer
    text = (
        f"the markers lie {1e3 * before:.0f} mm rms off where this model puts them, "
        "and no single slip explains it. Is it this arm's model, and do the angles of "
        "a row belong to its markers?"
    )
    return (Warned("wrong_model", "rig", text),)


def _pairs(
    some: Recording,
    arm: Arm,
    tried: Sequence[tuple[float, Told, np.ndarray]],
    before: float,
) -> Iterable[tuple[float, Told]]:
    """Try several reversed axes, then each likely reading with each other one."""
    for said, meant in of_signs(some.posture):
        yield _misfit(Sight.of(arm, some, meant)), said
    for left, said, meant in sorted(tried, key=lambda t: t[0])[:PARTNERS]:
        if left > before:
            continue
        for other in of_angles(meant, arm.slides):
            sight = Sight.of(arm, some, other.meant(meant))
            yield _misfit(sight), (*said, other.warned)
        sight = Sight.of(arm, some, meant)
        for seeing in of_sight(sight):
            yield _misfit(seeing.meant(sight)), (*said, seeing.warned)


def _best(told: Iterable[tuple[float, Told]], before: float) -> Told:
    told = list(told)
    least = min((left for left, _ in told), default=np.inf)
    said = next((said for left, said in told if left <= ALIKE * least), ())
    return said if least < before / BETTER else ()


def _misfit(sight: Sight) -> float:
    """Return the rms of a rigid fit, in m."""
    return quickly_seated(sight)[1]


def _some(recording: Recording, arm: Arm) -> Recording:
    """Take the first row of some visits and a few markers of each body."""
    first = np.unique(recording.visit, return_index=True)[1]
    some = recording.take(first[:: -(-len(first) // VISITS)])
    chosen: list[int] = []
    of_body: dict[int, int] = {}
    for m, marker in enumerate(recording.markers):
        axis = arm.place(marker.body).axis
        of_body[axis] = of_body.get(axis, 0) + 1
        if of_body[axis] <= OF_A_BODY:
            chosen.append(m)
    assert some.points is not None
    markers = tuple(some.markers[m] for m in chosen)
    return replace(some, markers=markers, points=some.points[:, chosen])
