"""Places where an effect can sit: parts of the arm, and instruments of the cell."""

from collections.abc import Collection

from bench.effects.effect import Effect
from bench.kinematic_chain import Anatomy
from bench.shared.errors import UnknownName

CELL = ("rig", "tracker", "wrench_sensor")
"""Places that every cell has."""


def places_for(kinds: Collection[str], arm: Anatomy) -> list[str]:
    """Return all places of some kinds: the vocabulary's names, then the model's own."""
    found = []
    for kind, own in (("axis", arm.axes), ("link", arm.links)):
        if kind in kinds:
            prefix = "a" if kind == "axis" else "link_"
            found += [f"{prefix}{k}" for k in range(1, len(own) + 1)]
            found += own
        if kind == "link" and kind in kinds:
            for k in range(len(own)):  # a link that forks ends at several axes
                ends = arm.carried(k)
                found += [f"link_{k + 1}:a{n + 1}" for n in ends if len(ends) > 1]
    found += [kind for kind in ("arm", "base", "flange", *CELL) if kind in kinds]
    found += ["tool"] if "tool" in kinds else []  # the flange, where there is none
    found += ["marker:<name>"] if "marker" in kinds else []
    return list(dict.fromkeys(found))


def misplaced(effect: Effect, arm: Anatomy) -> list[str]:
    """Return what is wrong with the places that an effect names; empty if nothing."""
    where = effect.where
    known = places_for(effect.places, arm)
    marker = where.startswith("marker:") and len(where) > len("marker:")
    faults = []
    if where not in known and not ("marker" in effect.places and marker):
        faults.append(str(UnknownName(f"place for {effect.name!r}", where, known)))
    partner = effect.parameters().get("with")
    if isinstance(partner, str) and partner not in known:
        faults.append(str(UnknownName("axis to couple with", partner, known)))
    return faults
