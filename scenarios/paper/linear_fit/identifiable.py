"""Postures that show every spring are needed, by the whole experiment and every split.

What every method stands on are six springs. Few postures cannot show them all: what
gives way beside the axes is then taken for one of them, or lost in it.
"""

from collections.abc import Sequence

import numpy as np

from bench.errors import NotIdentifiable, Unusable
from bench.recording import Recording
from scenarios.paper.material import Material
from stiffness.deflections import Selection, every_plateau, one_per_pose
from stiffness.methods.vjm import Vjm

ADVICE = (
    " The study needs all six springs: ask for 55 postures or more; what fewer are "
    "worth with axes held: python -m scenarios.how_many_poses."
)


def refuse_if_blind(material: Material, seeds: Sequence[int]) -> None:
    """Refuse an experiment that does not show every axis, before hours are spent on it.

    Args:
        material: The experiment as methods may see it.
        seeds: Of the splits.

    Raises:
        Unusable: With every axis that is not shown, and to whom.
    """
    whole, count = material.recording, len(np.unique(material.recording.pose))
    asked: list[tuple[str, Recording, Selection]] = [
        ("one reading of each", whole, one_per_pose),
        ("all readings", whole, every_plateau),
    ]
    for seed in seeds:
        part = material.training(seed)
        learnt = len(np.unique(part.pose))
        who = f"the {learnt} that methods learn from with seed {seed}"
        asked.append((who, part, every_plateau))
    faults = []
    for who, recording, select in asked:
        try:
            Vjm(material.arm, select=select).fit(recording)
        except NotIdentifiable as error:
            faults += [f"{who}: {line}" for line in str(error).splitlines()]
    if faults:
        faults[-1] += ADVICE
        raise Unusable(f"An experiment of {count} postures", faults)
