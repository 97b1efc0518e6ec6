"""Every reading speaks once: within its visit of the load, in its mean of the rest.

Within visits and between them are orthogonal parts of the same readings. Where a
marker was not seen, its mean is completed by the motion of its body.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.arrival import arrival_of, largest_arrival, trend_of
from stiffness.diagnosis.between import Between
from stiffness.diagnosis.data import Data
from stiffness.diagnosis.evidence import evidence_of
from stiffness.diagnosis.rigid import rigid_motion
from stiffness.diagnosis.signature import Signature, levers, turn
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.unknowns import unknowns
from stiffness.diagnosis.visits import Visits, mean_of
from stiffness.diagnosis.within import Within
from stiffness.diagnosis.wrench_errors import COMMON, feigned_turns

DECADES = 10.0
"""Fitted compliances may be this many times the model's (one sigma of their prior):
stiffness is nominal over at least a decade either way."""


@dataclass(frozen=True)
class Residuals:
    """Readings less where they should be.

    Attributes:
        value: In m along the base's axes; NaN where not seen.
        point: The readings themselves, in the base's frame.
        weight: Frames behind each, less for outliers, 0 where not seen.
        inverse: Inverse covariance of one frame's reading, 1/m^2.
        body: Index of each marker's body.
    """

    value: Float[np.ndarray, "rows markers 3"]
    point: Float[np.ndarray, "rows markers 3"]
    weight: Float[np.ndarray, "rows markers"]
    inverse: Float[np.ndarray, "3 3"]
    body: Int[np.ndarray, " markers"]


def blocks(
    situation: Situation,
    visits: Visits,
    readings: Residuals,
    arrival: Float[np.ndarray, " axes"] | None,
    field: bool = True,
) -> tuple[Data, Float[np.ndarray, " axes"]]:
    """Compress readings to what they say within visits and between them.

    Args:
        situation: Where the arm stood.
        visits: How rows lie side by side.
        readings: The residuals.
        arrival: One sigma of the axes' arrival, in rad; None: to be estimated.
        field: Whether the tracker's smooth error is to be reckoned with.

    Returns:
        Both blocks, and the arrival.
    """
    weight = visits.gather(readings.weight) * visits.counts[..., None]
    values = np.nan_to_num(visits.gather(readings.value))
    expected = readings.point - readings.value  # lever arms end where the model says
    point = mean_of(visits.gather(expected), weight)
    screw = visits.gather(situation.screw)
    errors = feigned_turns(situation, visits)
    within = Within.of(
        values,
        weight,
        readings.inverse,
        point,
        readings.body,
        (situation.carried, screw, errors),
    )
    count, longest, _ = weight.shape
    axes = screw.shape[2]
    if situation.recording.displacement == "relative":
        return Data(visits, within, None), np.zeros(axes)
    fitted, _, _ = rigid_motion(values, weight, readings.inverse, point, readings.body)
    complete = np.where((weight > 0)[..., None], values, fitted)
    seen = weight.max(axis=2)
    share = seen / np.maximum(seen.sum(axis=1, keepdims=True), 1e-12)
    mean = np.einsum("vr,vrmi->vmi", share, complete)
    carried = situation.carried[:, readings.body]
    turned = levers(point).reshape(count, -1, 6) @ screw.mean(axis=1).swapaxes(1, 2)
    turned = turned * np.repeat(carried[1:].T, 3, axis=0)
    shared = errors.reshape(count, axes, longest, -1)[..., :COMMON].mean(axis=2)
    precision = weight.sum(axis=1)[..., None, None] * readings.inverse
    nuisance = unknowns(situation, visits, point, field)
    if nuisance.field.shape[2]:
        precision = _with_noise(precision, nuisance.rest)
    place = (point, share, carried, screw)
    if arrival is None:
        silent = Between.of(mean, precision, turned @ shared, nuisance, place)
        first = visits.row[:, 0]
        trend = trend_of(
            situation.rest[first],
            situation.torque[first],
            situation.recording.time[first],
        )
        lever = silent.roots.white(turned)
        largest = largest_arrival(situation)
        arrival = arrival_of(silent.residual[..., 0], lever, trend, largest)
    feigned = np.concatenate([turned * arrival, turned @ shared], axis=2)
    between = Between.of(mean, precision, feigned, nuisance, place)
    return Data(visits, within, between), arrival


def _with_noise(
    precision: Float[np.ndarray, "visits markers 3 3"],
    variance: Float[np.ndarray, "visits markers"],
) -> Float[np.ndarray, "visits markers 3 3"]:
    """Return inverse covariances with more noise of each marker; 0 = not seen stays."""
    return np.linalg.solve(np.eye(3) + variance[..., None, None] * precision, precision)


def spring_columns(situation: Situation, springs: np.ndarray) -> list[Signature]:
    """Return what more compliance of each axis does."""
    return [turn(int(k), situation.torque[:, k]) for k in springs]


def spring_step(
    situation: Situation, data: Data, springs: np.ndarray, means: bool = True
) -> tuple[Float[np.ndarray, " springs"], Float[np.ndarray, " springs"]]:
    """Return the best change of each compliance and its standard deviation.

    Args:
        situation: Where the arm stood.
        data: Both blocks.
        springs: The axes.
        means: Whether the means of visits have a say.
    """
    model = 1.0 / situation.arm.stiffness[springs]
    asked = data if means else replace(data, between=None)
    fold = np.zeros(data.visits.poses(), dtype=int)
    found = evidence_of(asked, spring_columns(situation, springs), fold)
    gram, score = found.gram[0], found.score.sum(axis=0)
    prior = (DECADES * model) ** -2.0
    inner = (gram + np.diag(prior)) * model * model[:, None]
    ask = model * (score + prior * (model - situation.compliance[springs]))
    step = model * np.linalg.solve(inner, ask)
    return step, model * np.sqrt(np.diag(np.linalg.inv(inner)))
