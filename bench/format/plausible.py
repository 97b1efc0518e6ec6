"""A reading that no bench can have made is a fault of the file, not a finding."""

import re
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float

from bench.format.columns import WRENCH
from bench.format.faults import Place, quoted
from bench.format.layout import Layout
from bench.model_facts import ModelFacts
from bench.recording import STAGES

MAX_FORCE, MAX_TORQUE = 20e3, 5e3
"""N and N m, by the format."""
LARGEST = {
    "time": (1e10, "s"),
    "angle": (200 * np.pi, "rad"),
    "length": (1e3, "m"),
    "mass": (1e5, "kg"),
    "torque": (1e6, "Nm"),
    "temperature": (1e3, "°C"),
    "count": (1e9, ""),
}
"""Sizes beyond which a unit is wrong, whatever the arm; chosen: stamps since 1970 in s,
a hundred turns, a kilometre, and a torque that no motor has."""
SAME_POSTURE = np.radians(0.05)
"""How far a pose's angles may differ from row to row; chosen: a hundred times what an
axis returns to, and far below the difference of two poses."""
BEYOND_LIMIT = np.radians(0.5)
"""How far an angle may exceed its limit, by the format."""
SLIDE_BEYOND_LIMIT = 1e-3
"""The same for a slide, in m (chosen: the format speaks of angles alone)."""


def faults_in(
    values: Mapping[str, np.ndarray],
    layout: Layout,
    place: Place,
    relative: bool,
    plateaus: bool,
    model: tuple[ModelFacts, tuple[int, ...]] | None,
) -> list[str]:
    """Name every reading that cannot be.

    Args:
        values: Columns in SI, by the format's names; NaN where already at fault.
        layout: Where they stand in the file.
        place: The file.
        relative: Whether only differences within a visit mean anything.
        plateaus: Whether a pose is a posture, not a motion.
        model: The model, and which of its joints each axis is; None where unknown.
    """

    def at(name: str, wrong: np.ndarray, say: Callable[[int], str]) -> list[str]:
        source = layout.held[name].source if name in layout.held else name
        return place.at(source, np.flatnonzero(wrong), say)

    faults = []
    if "time_s" in values:
        time = values["time_s"]
        back = np.concatenate([[False], np.diff(time) < 0.0])
        faults += at(
            "time_s",
            back,
            lambda r: f"time runs backwards, {time[r]:g} s after {time[r - 1]:g} s.",
        )
        if "load_time_s" in values:
            late = values["load_time_s"] > time
            faults += at(
                "load_time_s", late, lambda r: "later than time_s of the same row."
            )
    if "stage" in values:
        stage = values["stage"]
        known = ", ".join(STAGES)
        unknown = ~np.isin(stage, STAGES)
        faults += at(
            "stage",
            unknown,
            lambda r: f"{quoted(str(stage[r]))} is not one of {known}.",
        )
    for name, least in (("frames", 1.0), ("load_kg", 0.0)):
        if name in values:
            column, say = values[name], f"{{:g}} is less than {least:g}."
            faults += at(
                name, column < least, lambda r, c=column, s=say: s.format(c[r])
            )
    faults += _too_strong(values, at)
    for name, held in layout.held.items():
        if name in values and held.column.kind in LARGEST and name not in WRENCH:
            most, unit = LARGEST[held.column.kind]
            say = f"{{:.4g}} {unit} is beyond {most:.4g}; is its unit right?"
            column = values[name]
            beyond = np.abs(column) > most
            faults += at(name, beyond, lambda r, c=column, s=say: s.format(c[r]))
    if "pose" in values:
        faults += _odd_visits(values, relative, at)
    if "pose" in values and plateaus:
        faults += _other_postures(values, at)
    if model is not None:
        faults += _beyond_limits(values, *model, at)
    return faults


At = Callable[[str, np.ndarray, Callable[[int], str]], list[str]]


def _too_strong(values: Mapping[str, np.ndarray], at: At) -> list[str]:
    if not all(name in values for name in WRENCH):
        return []
    faults = []
    kinds = (
        (WRENCH[:3], MAX_FORCE, "a force", "20 kN"),
        (WRENCH[3:], MAX_TORQUE, "a torque", "5 kNm"),
    )
    for names, limit, kind, shown in kinds:
        vectors = np.stack([values[name] for name in names], axis=1)
        sizes = np.linalg.norm(np.nan_to_num(vectors), axis=1)
        largest = np.argmax(np.abs(np.nan_to_num(vectors)), axis=1)
        for axis, name in enumerate(names):
            wrong = (sizes > limit) & (largest == axis)
            say = f"{kind} of {{:.4g}} is above {shown}; is its unit right?"
            faults += at(name, wrong, lambda r, n=sizes, s=say: s.format(n[r]))
    return faults


def _odd_visits(values: Mapping[str, np.ndarray], relative: bool, at: At) -> list[str]:
    pose = values["pose"]
    visit = values.get("visit", np.cumsum(np.diff(pose, prepend=pose[:1]) != 0))
    faults = []
    if "visit" in values:
        same = np.diff(visit) == 0
        two = np.concatenate([[False], same & (np.diff(pose) != 0)])
        back = np.concatenate([[False], np.diff(visit) < 0])
        faults += at(
            "pose", two, lambda r: f"visit {visit[r]:.0f} has another pose above."
        )
        faults += at(
            "visit",
            back,
            lambda r: f"{visit[r]:.0f} after {visit[r - 1]:.0f}; visits are counted.",
        )
    if relative:
        _, where, counts = np.unique(visit, return_inverse=True, return_counts=True)
        faults += at(
            "visit" if "visit" in values else "pose",
            (counts == 1)[where],
            lambda r: "one row in its visit, and relative displacements need two.",
        )
    return faults


def _other_postures(values: Mapping[str, np.ndarray], at: At) -> list[str]:
    """Say where a pose's id stands for another posture than in its first row."""
    pose = values["pose"]
    if not np.isfinite(pose).all():
        return []
    _, first, which = np.unique(pose, return_index=True, return_inverse=True)
    faults = []
    for name in (n for n in values if re.fullmatch(r"a[0-9]+_deg", n)):
        away = np.degrees(values[name] - values[name][first[which]])
        faults += at(
            name,
            np.abs(away) > np.degrees(SAME_POSTURE),
            lambda r, a=away: (
                f"{a[r]:.3g}° from where pose {pose[r]:.0f} stood first; give another "
                "posture an id of its own."
            ),
        )
    return faults


def _beyond_limits(
    values: Mapping[str, np.ndarray],
    model: ModelFacts,
    joints: tuple[int, ...],
    at: At,
) -> list[str]:
    faults = []
    for axis, joint in enumerate(joints, start=1):
        slides = model.slides[joint]
        name = f"a{axis}_mm" if slides else f"a{axis}_deg"
        if name not in values:
            continue
        allowed = SLIDE_BEYOND_LIMIT if slides else BEYOND_LIMIT
        unit, factor = ("mm", 1e3) if slides else ("°", float(np.degrees(1.0)))
        low, high = model.lower[joint], model.upper[joint]
        column: Float[np.ndarray, " rows"] = values[name]
        span = (low - allowed, high + allowed)
        wrong = (column < span[0]) | (column > span[1])
        mirrored = np.all((-column >= span[0]) & (-column <= span[1]))
        shown = f"{low * factor:g} to {high * factor:g}{unit}"
        say = f"{{:.6g}}{unit} is beyond the limits of {model.joints[joint]!r}, {shown}"
        say += "; with the other sign all rows are inside." if mirrored else "."
        faults += at(name, wrong, lambda r, c=column * factor, s=say: s.format(c[r]))
    return faults
