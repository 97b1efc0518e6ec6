"""What a group of columns does to the mean of a visit, it does at one site."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.columns import Columns


@dataclass(frozen=True, eq=False)
class Site:
    """Slots of one group, averaged over the rows of each visit.

    Attributes:
        slots: Where they stand among all slots.
        mean: Twists or shifts of each visit.
        place: The place that moves; -1 where a marker shifts.
        marker: The marker that shifts; -1 where bodies move.
    """

    slots: slice
    mean: Float[np.ndarray, "visits k columns"]
    place: int = -1
    marker: int = -1


def sites_of(
    columns: Columns,
    share: Float[np.ndarray, "visits rows"],
    screw: Float[np.ndarray, "visits rows axes 6"],
) -> list[Site]:
    """Return the means of all groups of columns.

    Args:
        columns: In some visits.
        share: Weight of each row in each visit's mean.
        screw: Twist of what an axis carries per radian along it.
    """
    of_row = share[:, None]
    sites = []
    for group in columns.turns:
        along = share[..., None] * screw[:, :, group.place]
        mean = along.swapaxes(1, 2) @ group.values
        sites.append(Site(group.slots, mean, place=group.place + 1))
    for group in (*columns.motions, *columns.shifts):
        visits, rows, k, count = group.values.shape
        flat = of_row @ group.values.reshape(visits, rows, k * count)
        mean = flat.reshape(visits, k, count)
        at = {"place" if k == 6 else "marker": group.place}
        sites.append(Site(group.slots, mean, **at))
    return sites
