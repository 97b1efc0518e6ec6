"""An instrument with a fault reads what was read: its equations, forwards or backwards.

==========  ==========================================================================
Equation    tracker: as `bench.instruments.tracker`, noise left out; force sensor:
            wrench = [F; T + offset x F], F and T the halves of
            exp(mounting) (1 + gain)^-1 (reading - bias)
Source      the instruments' own equations
Valid       faults that the instruments know
Ignores     noise
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.instruments import ForceSensor, Tracker
from bench.instruments.standpoint import inverse, moved
from bench.instruments.tracker import HOUR, STILL
from bench.recording import Recording


def true_wrench(
    sensor: ForceSensor, reading: Float[np.ndarray, "rows 6"]
) -> Float[np.ndarray, "rows 6"]:
    """Return the wrench that a sensor with these faults reads so, along true axes."""
    crosstalk = np.eye(6) + np.array(sensor.gain)
    felt = np.linalg.solve(crosstalk, (reading - np.array(sensor.bias)).T).T
    seated = Rotation.from_rotvec(sensor.mounting)
    force, torque = (seated.apply(part) for part in np.hsplit(felt, 2))
    return np.hstack([force, torque + np.cross(sensor.offset, force)])


def direction(recording: Recording) -> Float[np.ndarray, " rows"]:
    """Return +1 where the load last grew, -1 where it last fell, visit by visit."""
    mass = recording.load_mass
    if mass is None:
        assert recording.wrench is not None
        mass = np.linalg.norm(recording.wrench[:, :3], axis=1)
    sign, last = np.ones(len(mass)), 1.0
    for row in range(1, len(mass)):
        same = recording.visit[row] == recording.visit[row - 1]
        change = np.sign(mass[row] - mass[row - 1]) if same else 1.0
        last = change or last
        sign[row] = last
    return sign


def reading_of(
    tracker: Tracker,
    frame: tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]],
    point: Float[np.ndarray, "rows markers 3"],
    time: Float[np.ndarray, " rows"],
) -> Float[np.ndarray, "rows markers 3"]:
    """Return what a tracker would read, in its own frame, in m.

    Args:
        tracker: With its faults.
        frame: R and t of p_base = R p_tracker + t, as stated or fitted.
        point: In the base's frame, in m.
        time: Of each row, in s.
    """
    hours = time / HOUR
    if (tracker.base_drift, tracker.drift, tracker.frame_error) == (STILL, STILL, None):
        seen = (point - frame[1]) @ frame[0]
        return (1.0 + tracker.scale) * seen
    stated = np.eye(4)
    stated[:3, :3], stated[:3, 3] = frame
    error = np.eye(4)
    shift, vector = np.split(np.array(tracker.frame_error or STILL), 2)
    error[:3, :3] = Rotation.from_rotvec(vector).as_matrix()
    error[:3, 3] = shift
    true = np.linalg.inv(error) @ stated
    seen = inverse(true, moved(point, tracker.base_drift, hours))
    return moved((1.0 + tracker.scale) * seen, tracker.drift, hours)


def turned(
    wrench: Float[np.ndarray, "rows 6"], turn: Float[np.ndarray, "rows 3 3"]
) -> Float[np.ndarray, "rows 6"]:
    """Turn force and torque alike, row by row."""
    halves = [np.einsum("nij,nj->ni", turn, part) for part in np.hsplit(wrench, 2)]
    return np.hstack(halves)
