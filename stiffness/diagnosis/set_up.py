"""An axis counted the wrong way round is no effect of physics but a mistake of set-up.

==========  ==========================================================================
Equation    rms of a rigid fit of frame and places, under each reading of the files:
            as they are, an axis reversed, two axes swapped, mirrored, other units
Source      enumeration; a mistake moves markers by a tenth of the reach, physics by a
            hundredth at most
Valid       absolute readings; wrench mistakes also relative ones
Ignores     two mistakes at once
==========  ==========================================================================
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from bench.errors import BenchError
from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.diagnosis import Warned
from stiffness.diagnosis.first_frames import first_frames
from stiffness.diagnosis.readings import weight_of

GROSS = 0.004
"""Rigid misfit over the arm's extent from which a mistake is looked for; chosen: 4 mm
on a metre, several times an uncalibrated arm's error (1.2 mm rms, Slamani 2012)."""
BETTER = 5.0
"""Factor by which another reading of the files must fit better; chosen."""
SOME = 60


def mistakes_of_set_up(recording: Recording, arm: Arm) -> tuple[Warned, ...]:
    """Return the gross mistakes that the positions of markers show.

    Args:
        recording: With markers.
        arm: The nominal arm, with the recording's names.
    """
    if recording.displacement == "relative" or recording.points is None:
        return ()
    first = np.unique(recording.visit, return_index=True)[1]
    some = recording.take(first[:: max(1, len(first) // SOME)])
    before = _misfit(some, arm)
    extent = _extent(some)
    reach = max(_reach(some, arm), 1e-6)
    if before < GROSS * reach and 0.1 < extent / reach < 10.0:
        return ()
    best, answer = before / BETTER, None
    for warned, other in _other_readings(some, arm):
        after = _misfit(other, arm)
        scale = 1.0 if warned.code != "units" else reach / max(_extent(other), 1e-9)
        if after < best and after < 2 * GROSS * reach and 0.1 < scale < 10.0:
            best, answer = after, warned
    if answer is None:
        return ()
    return (answer,)


def _other_readings(
    recording: Recording, arm: Arm
) -> Iterator[tuple[Warned, Recording]]:
    posture, points = recording.posture, recording.points
    assert points is not None
    for k in range(posture.shape[1]):
        sign = np.ones(posture.shape[1])
        sign[k] = -1.0
        text = (
            f"a{k + 1} looks reversed: its angles fit the markers with the other sign."
        )
        yield (
            Warned("axis_reversed", f"a{k + 1}", text),
            _posed(recording, posture * sign),
        )
    for i, j in combinations(range(posture.shape[1]), 2):
        order = np.arange(posture.shape[1])
        order[[i, j]] = j, i
        text = f"a{i + 1} and a{j + 1} look swapped: they fit the other way round."
        yield (
            Warned("axis_order", f"a{i + 1}", text),
            _posed(recording, posture[:, order]),
        )
    flip = np.array([1.0, -1.0, 1.0])
    text = "the markers look mirrored: they fit with one coordinate's sign changed."
    yield Warned("mirrored", "tracker", text), _seen(recording, points * flip)
    for factor, words in ((1e3, "in m where mm are expected"), (1e-3, "in µm, not mm")):
        text = f"marker positions look as if given {words}: they fit times {factor:g}."
        yield Warned("units", "tracker", text), _seen(recording, points * factor)
    for factor, words in (
        (180 / np.pi, "radians"),
        (np.pi / 180, "degrees taken twice"),
    ):
        text = f"axis angles look like {words}: they fit times {factor:.4g}."
        yield Warned("units", "axes", text), _posed(recording, posture * factor)


def _posed(recording: Recording, posture: np.ndarray) -> Recording:
    return replace(recording, posture=posture)


def _seen(recording: Recording, points: np.ndarray) -> Recording:
    return replace(recording, points=points)


def _misfit(recording: Recording, arm: Arm) -> float:
    """Return the rms of a rigid fit in m; inf where there is none."""
    try:
        frames = first_frames(arm, recording, np.zeros(len(arm.axes)))
    except BenchError:
        return np.inf
    standing = arm.at(recording.posture)
    expected = np.stack(
        [
            standing.point(marker.body, place)
            for marker, place in zip(recording.markers, frames.place, strict=True)
        ],
        axis=1,
    )
    assert recording.points is not None
    left = recording.points @ frames.turn.T + frames.shift - expected
    seen = weight_of(recording) > 0
    return float(np.sqrt(np.mean(np.sum(left[seen] ** 2, axis=1))))


def _extent(recording: Recording) -> float:
    points = recording.points
    assert points is not None
    return float(np.nanmax(np.nanmax(points, axis=0) - np.nanmin(points, axis=0)))


def _reach(recording: Recording, arm: Arm) -> float:
    """Return over how large a box the markers should go, in m."""
    standing = arm.at(recording.posture)
    at = [
        standing.point(m.body, np.zeros(3) if m.position is None else m.position)
        for m in recording.markers
    ]
    spans = [np.ptp(p, axis=0).max() for p in at]
    return float(max(spans))


def wrench_mistake(ratio: np.ndarray, sigma: np.ndarray) -> Warned | None:
    """Say whether the springs that differences within visits ask for make no sense.

    Args:
        ratio: Fitted compliance over the model's, unbounded, of each axis.
        sigma: Its standard deviation.
    """
    clear = np.abs(ratio) > 5.0 * sigma
    if not clear.any():
        return None
    if np.all(ratio[clear] < 0.0):
        text = (
            "the wrench looks reversed: the arm moves against it. Give what the world "
            "exerts on the robot."
        )
        return Warned("wrench_sign", "wrench_sensor", text)
    middle = float(np.median(ratio[clear]))
    if middle > UNITS or 0.0 < middle < 1.0 / UNITS:
        text = (
            f"deflections are {middle:.3g} times what the model's springs give: check "
            "the units of wrench and markers."
        )
        return Warned("units", "wrench_sensor", text)
    return None


UNITS = 100.0
"""Factor between fitted and nominal compliance that no arm has; chosen: two decades."""
