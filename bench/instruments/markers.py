"""Markers: round marks on base, links and flange, four on each in asymmetric places.

Four points at different heights, radii and angles around a body determine its pose:
they do not lie in a plane, and no rotation of the body maps them onto each other.
"""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from jaxtyping import Float

from bench.cell import reach
from bench.instruments.random_streams import Streams
from bench.kinematic_chain import Anatomy
from bench.shared.errors import UnknownName, not_sizes, not_vectors, refuse
from bench.shared.recording import Marker

LETTERS = "abcd"
ALONG = (0.20, -0.40, 0.45, -0.10)
"""Positions along a body, in its length from its middle. Chosen of all orders: far from
one plane and from looking the same when turned, on the KR10 and on the UR10."""
AROUND = tuple(np.deg2rad([20.0, 115.0, 215.0, 300.0]))
"""Angles around the body, in rad; chosen: no two gaps alike, none above 105°."""
ONE_SIDE = 0.5
"""Factor on the angles about the flange's x; chosen: marks on the side of the tool that
carries the hook, so that their centroid shows the last axis' rotation."""
NEARLY_ALONG = 0.9
"""Cosine beyond which two directions count as one; chosen."""
OUT = (0.90, 1.07, 1.00, 0.93)
"""Radii in units of the body's; chosen: no two alike."""
RADIUS = (0.14, 0.068)
"""Radius at base and at the flange for a reach of 1.19 m, in m. Chosen: just outside
the castings of a 10 kg arm, so 61 to 150 mm from a body's axis."""
SHORTEST = 0.10
"""Length over which marks are spread on a short body, same reach, in m; chosen."""


@dataclass(frozen=True)
class Slip:
    """A mark that moves on its body and stays there.

    Attributes:
        time: Time of the slip, in s since the start.
        shift: Displacement along its body's axes, in m.
    """

    marker: str
    time: float
    shift: tuple[float, ...]

    def __post_init__(self):
        """Check time and shift."""
        faults = not_sizes({"time": self.time}) + not_vectors({"shift": self.shift}, 3)
        refuse(f"Slip of {self.marker!r}", faults)


@dataclass(frozen=True)
class Stuck:
    """A mark at its true position.

    Attributes:
        position: True position in the body's frame, in m.
        normal: Its normal, in the body's frame.
    """

    marker: Marker
    position: Float[np.ndarray, "3"]
    normal: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Markers:
    """Selection, placement and slips of the marks.

    Attributes:
        targets: `all` bodies from base to flange, the last link left out, or the
            `flange` alone; of several arms the other hands too.
        placement: Standard deviation of their true positions about those in the
            manifest, per coordinate, in m; 0.5 mm is what a ruler allows.
        stated: Whether the manifest gives their places at all.
    """

    targets: Literal["all", "flange"] = "all"
    placement: float = 0.0
    stated: bool = True
    slips: tuple[Slip, ...] = ()

    def __post_init__(self):
        """Check all settings at once."""
        faults = not_sizes({"placement": self.placement})
        if self.targets not in ("all", "flange"):
            faults.append(f"targets is {self.targets!r}, expected 'all' or 'flange'.")
        refuse("Markers", faults)

    def stick(
        self, model: mujoco.MjModel, arm: Anatomy, chance: Streams
    ) -> tuple[Stuck, ...]:
        """Return the marks at their true positions.

        Raises:
            UnknownName: Where a mark that slips does not exist.
        """
        bodies = ["base", *(_marked(arm, k) for k in range(len(arm.axes)))]
        drawn = chance["placement"].standard_normal((len(bodies), len(LETTERS), 3))
        stuck = []
        for b, body in enumerate(bodies):
            if self.targets == "flange" and b - 1 not in arm.hands:
                continue
            places, normals = _around(model, arm, b - 1)
            for m, letter in enumerate(LETTERS):
                marker = Marker(
                    name=f"{body.replace('_', '')}_{letter}",
                    body=body,
                    position=places[m] if self.stated else None,
                )
                place = places[m] + self.placement * drawn[b, m]
                stuck.append(Stuck(marker, place, normals[m]))
        known = [s.marker.name for s in stuck]
        for slip in self.slips:
            if slip.marker not in known:
                raise UnknownName("marker", slip.marker, known)
        return tuple(stuck)

    def slipped(
        self, name: str, time: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, "rows 3"]:
        """Return the displacement of a mark on its body at given times, in m."""
        moved = np.zeros((len(time), 3))
        for slip in self.slips:
            if slip.marker == name:
                moved += np.outer(time >= slip.time, slip.shift)
        return moved


def _marked(arm: Anatomy, axis: int) -> str:
    """Return the name of the body on an axis that bears marks: its link, or a hand."""
    if axis == arm.mount:
        return "flange"
    return arm.hands.get(axis, f"link_{axis + 1}")


def _around(
    model: mujoco.MjModel, arm: Anatomy, axis: int
) -> tuple[Float[np.ndarray, "4 3"], Float[np.ndarray, "4 3"]]:
    """Return positions and normals on an axis' body, in its frame; -1: on the base."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    scale = reach(model, arm) / 1.19
    at_end = axis in arm.hands
    name = arm.hands[axis] if at_end else (*arm.links, arm.base)[axis]
    body = data.body(name)
    turn = body.xmat.reshape(3, 3)

    def in_body(place: np.ndarray) -> np.ndarray:
        return (place - body.xpos) @ turn

    anchors = [in_body(data.joint(name).xanchor) for name in arm.axes]
    start = anchors[axis] if axis >= 0 and not at_end else np.zeros(3)
    if at_end:
        along = -anchors[axis]
    else:  # to the next axis; of several, to their middle
        along = np.mean([anchors[k] for k in arm.carried(axis)], axis=0) - start
    if np.linalg.norm(along) < 0.02 * scale:
        along = 0.02 * scale * data.joint(arm.axes[max(axis, 0)]).xaxis @ turn
    length = max(float(np.linalg.norm(along)), SHORTEST * scale)
    along = along / np.linalg.norm(along)
    middle = start + length / 2 * along
    if not at_end and model.body(body.id).mass[0] > 0:  # around where its mass is
        mass = model.body(body.id).ipos
        middle = mass + (middle - mass) @ along * along
    angles = np.array(AROUND)
    across = np.eye(3)[np.argmin(np.abs(along).round(9))]  # not by rounding
    if at_end:
        if abs(along[0]) < NEARLY_ALONG:  # else the flange's x points out
            across = np.eye(3)[0]
        angles = ONE_SIDE * (angles - angles.mean())
    across = across - across @ along * along
    across /= np.linalg.norm(across)
    outward = np.outer(np.cos(angles), across) + np.outer(
        np.sin(angles), np.cross(along, across)
    )
    deepest = max(
        len(arm.carriers(k)) for k in arm.hands if axis in (-1, *arm.carriers(k))
    )
    depth = len(arm.carriers(axis)) if axis >= 0 else 0
    radius = scale * np.interp(depth, [0, deepest], RADIUS) * np.array(OUT)
    places = middle + np.outer(np.array(ALONG) * length, along)
    return places + radius[:, None] * outward, outward
