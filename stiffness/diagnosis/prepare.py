"""A recording is made ready once: the nominal is fitted, the noise is checked.

Fitted silently are the tracker's frame where it is not stated, the markers' places, and
the stiffness of every axis that has a spring in the model. Everything else competes.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bench.errors import Unusable
from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.blocks import Residuals, blocks, spring_step
from stiffness.diagnosis.data import Data
from stiffness.diagnosis.first_fit import BLIND, first_fit, residuals_of
from stiffness.diagnosis.outliers import checked
from stiffness.diagnosis.readings import Frames, bodies_of, rigid_groups
from stiffness.diagnosis.shapes_kept import with_shapes
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.standing_under_load import situation_of
from stiffness.diagnosis.visits import visits_of


@dataclass(frozen=True)
class Prepared:
    """A recording against its nominal model, ready for hypotheses.

    Attributes:
        situation: Where the arm stood under the fitted springs.
        data: What differences within visits and means of visits say.
        frames: Tracker and markers as fitted.
        readings: Residuals and their weights.
        springs: The axes whose compliance is fitted, from 0.
        blind: Axes with a spring that the data cannot see, left at the model's.
        sigma: Standard deviation of each fitted compliance, in rad/(N m).
        noise: Measured noise of a reading over the stated one; 1 where not measurable.
        freedom: How many contrasts that ratio rests on.
        doubtful: Readings (row, marker) that count less, and their size in sigma.
        arrival: One sigma of the axes' arrival, in rad.
    """

    situation: Situation
    data: Data
    frames: Frames
    readings: Residuals
    springs: tuple[int, ...]
    blind: tuple[int, ...]
    sigma: Float[np.ndarray, " springs"]
    noise: float
    freedom: int
    doubtful: tuple[tuple[int, int, float], ...]
    arrival: Float[np.ndarray, " axes"]


def prepare(recording: Recording, arm: Arm) -> Prepared:
    """Fit what is nominal and say what the noise is.

    Args:
        recording: With markers.
        arm: The nominal arm, with the recording's names.

    Raises:
        Unusable: Where there is nothing to compare, with all reasons.
    """
    faults = []
    if recording.points is None or not recording.markers:
        faults.append("it has no markers; the diagnosis needs displacements.")
    if recording.tracker is None:
        faults.append("the tracker's noise is unknown: give [sensors.tracker].")
    if faults:
        raise Unusable(f"Recording {recording.name!r}", faults)
    start = first_fit(recording, arm)
    names, body = bodies_of(arm, recording)
    situation = situation_of(arm, recording, start.compliance, names)
    frames = start.frames
    situation = replace(situation, tracker=frames.transform, spots=frames.place)
    visits = visits_of(situation.visit, situation.pose)
    readings = residuals_of(situation, frames)
    groups = rigid_groups(recording, body)
    check = checked(
        visits,
        readings.value,
        readings.point,
        readings.weight,
        readings.inverse,
        groups,
    )
    check = with_shapes(check, situation, readings, frames.place, groups)
    readings = replace(
        readings, weight=check.weight, inverse=readings.inverse / check.noise**2
    )
    data, arrival = blocks(situation, visits, readings, None)
    springs = np.flatnonzero(arm.stiffness > 0)
    _, sigma = spring_step(situation, data, springs)
    blind = sigma > BLIND / arm.stiffness[springs]
    return Prepared(
        situation=situation,
        data=data,
        frames=frames,
        readings=readings,
        springs=tuple(int(k) for k in springs[~blind]),
        blind=tuple(int(k) for k in springs[blind]),
        sigma=sigma[~blind],
        noise=check.noise,
        freedom=check.freedom,
        doubtful=check.doubtful,
        arrival=arrival,
    )
