"""Alternative readings of a set-up: angles, markers, wrench columns, wrench units.

Angles can be read in other ways: other signs, orders, zeros, units.

A reading is a way to take them as somebody may have meant them who wrote the file
otherwise than the format asks.

What the tracker saw can be read in other ways: mirrored, in other units and frames.

The same holds of where it is said to stand, and of where markers are said to sit.

A marker's column can be another's, of another sign or unit: its body then is not rigid.

==========  ==========================================================================
Equation    s² = mean over pairs of a body's markers of (1.4826 median |d - median d|)²,
            d = |p_i - p_j|, under each reading of its columns
Source      a rigid body keeps its distances; enumeration
Valid       absolute readings; bodies with three markers or more; one mistake a body
Ignores     markers that are wrong in less than half of the visits
==========  ==========================================================================

A wrench's columns can be in another order, of another sign, or of another row.

A wrench can be read in other ways: other signs, units and axes.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np
from scipy.optimize import fminbound

from bench.shared.errors import Warned
from bench.shared.format.checks import COUPLED, TRAVEL, ZEROS
from bench.shared.recording import Recording
from stiffness.experiment.outliers import markers_of_bodies
from stiffness.robot.arm import Arm
from stiffness.robot.tracker_frame import TrackerObservations

# --- Angles ---------------------------------------------------------------------------

OFFSET = 0.1
"""Largest offset of an encoder, in rad, beyond which a zero is another one; as in the
limits of `EncoderOffset`."""
STEP = np.radians(30.0)
SHIFTS = np.radians([-10.0, 10.0, *range(-150, 0, 30), *range(30, 181, 30)])
"""Shifts of a zero that are tried first, in rad, and how far from the best of them it
is looked for; chosen: markers follow the sine and cosine of an angle, so the misfit has
one valley, which is wider than this."""
AXES = 3
"""Axes whose best shift is fitted; chosen for time."""
SHIFT_TOLERANCE = 1e-4
"""To which a shift is fitted, in rad; chosen: far below what makes it a mistake."""


@dataclass(frozen=True)
class Angles:
    """Another way to read the axes' angles.

    Attributes:
        warned: What to say if it is the right one.
        meant: Turns postures as written, (rows, axes), into those meant.
    """

    warned: Warned
    meant: Callable[[np.ndarray], np.ndarray]


def of_angles(posture: np.ndarray, slides: np.ndarray) -> Iterator[Angles]:
    """List how else the angles may be meant.

    Args:
        posture: As written.
        slides: Whether each axis slides.
    """
    axes = range(posture.shape[1])
    travel = np.ptp(posture, axis=0)
    for k in axes:
        if travel[k] > TRAVEL:
            text = f"a{k + 1} looks reversed: it fits the readings with the other sign."
            yield Angles(
                Warned("axis_reversed", f"a{k + 1}", text), _scaled(axes, [k], -1.0)
            )
    for i, j in combinations(axes, 2):
        apart = posture[:, i] - posture[:, j]
        if slides[i] == slides[j] and np.ptp(apart) > TRAVEL:
            text = f"a{i + 1} and a{j + 1} look swapped: they fit the other way round."
            order = list(axes)
            order[i], order[j] = j, i
            yield Angles(Warned("axis_order", f"a{i + 1}", text), _reordered(order))
    count = len(axes)
    if count > 2 and len(set(slides.tolist())) == 1:
        for order in (
            list(reversed(axes)),
            [*axes[1:], 0],
            [count - 1, *axes[: count - 1]],
        ):
            said = ", ".join(f"a{k + 1}" for k in order)
            text = f"the axes look out of order: they fit when read as {said}."
            yield Angles(Warned("axis_order", "a1", text), _reordered(order))
    yield from _coupled(travel, slides)
    turning = np.flatnonzero(~slides).tolist()
    yield from _in_units(travel, turning, np.flatnonzero(slides).tolist())
    for k in turning:
        for offset in ZEROS:
            yield _from_another_zero(k, np.radians(offset))


def _from_another_zero(axis: int, offset: float) -> Angles:
    text = (
        f"a{axis + 1} looks counted from another zero: it fits with "
        f"{np.degrees(offset):+.4g}° added."
    )
    return Angles(
        Warned("axis_zero", f"a{axis + 1}", text),
        lambda posture: posture + offset * (np.arange(posture.shape[1]) == axis),
    )


def best_shift(
    posture: np.ndarray, slides: np.ndarray, misfit: Callable[[np.ndarray], float]
) -> Angles | None:
    """Fit the zero of each axis that turns, one at a time.

    Args:
        posture: As written.
        slides: Whether each axis slides.
        misfit: Of a posture that may be meant.

    Returns:
        The reading that fits best; None where no axis turns, or its zero is no farther
        off than an encoder's offset can be.
    """

    def of(axis: int, offset: float) -> float:
        return misfit(_from_another_zero(axis, offset).meant(posture))

    tried = [
        min((of(int(k), offset), offset, int(k)) for offset in SHIFTS)
        for k in np.flatnonzero(~slides)
    ]
    best: tuple[float, float, int] = (np.inf, 0.0, 0)
    for _, near, axis in sorted(tried)[:AXES]:
        found = fminbound(
            lambda offset, k=axis: of(k, offset),
            near - STEP,
            near + STEP,
            xtol=SHIFT_TOLERANCE,
        )
        offset = np.asarray(found, dtype=float).item()
        best = min(best, (of(axis, offset), offset, axis))
    _, offset, axis = best
    offset = (offset + np.pi) % (2.0 * np.pi) - np.pi
    return _from_another_zero(axis, offset) if abs(offset) > OFFSET else None


def _coupled(travel: np.ndarray, slides: np.ndarray) -> Iterator[Angles]:
    """List which angles may be counted against another axis' link, not their own."""
    axes = range(len(travel))
    for k, j in permutations(axes, 2):
        if abs(k - j) > COUPLED or slides[k] != slides[j] or travel[j] < TRAVEL:
            continue
        for own in (1.0, -1.0) if abs(k - j) == 1 else (1.0,):
            for other in (1.0, -1.0):
                yield _summed(len(travel), {k: own, j: other}, k)
    wrist = list(axes)[-3:]
    if len(wrist) == 3 and not slides[wrist].any() and travel[wrist].min() > TRAVEL:
        for k in wrist[1:]:
            first, second = (j for j in wrist if j != k)
            for a, b in product((1.0, -1.0), repeat=2):
                yield _summed(len(travel), {k: 1.0, first: a, second: b}, k)


def _summed(count: int, terms: Mapping[int, float], axis: int) -> Angles:
    words = " ".join(f"{'+' if s > 0 else '-'} a{j + 1}" for j, s in terms.items())
    others = " and ".join(f"a{j + 1}" for j in terms if j != axis)
    text = (
        f"a{axis + 1} looks coupled to {others}: it fits as "
        f"{words.removeprefix('+ ')}. Give the angle of the joint itself."
    )
    matrix = np.eye(count)
    matrix[axis] = 0.0
    for j, factor in terms.items():
        matrix[axis, j] = factor
    return Angles(
        Warned("axis_coupled", f"a{axis + 1}", text), lambda posture: posture @ matrix.T
    )


def _in_units(
    travel: np.ndarray, turning: list[int], sliding: list[int]
) -> Iterator[Angles]:
    """List in which units all axes may be meant, or one unlike the others."""
    axes = range(len(travel))
    for factor, words in (
        (180 / np.pi, "radians where degrees are expected"),
        (np.pi / 180, "degrees that were taken for radians"),
    ):
        text = f"axis angles look like {words}: they fit times {factor:.4g}."
        yield Angles(Warned("units", "axes", text), _scaled(axes, turning, factor))
    for k in turning:
        for factor, words in (
            (180 / np.pi, "its radians were taken for degrees"),
            (np.pi / 180, "its degrees were taken for radians"),
        ):
            if travel[k] * abs(factor - 1.0) > TRAVEL:
                text = (
                    f"a{k + 1} looks as if {words}, unlike the others: it fits times "
                    f"{factor:.4g}. Check the unit in the mapping or the file."
                )
                one = _scaled(axes, [k], factor)
                yield Angles(Warned("units", f"a{k + 1}", text), one)
    for factor, words in ((1e3, "m where mm are expected"), (1e-3, "µm, not mm")):
        if sliding:
            text = f"axes that slide look given in {words}: they fit times {factor:g}."
            yield Angles(Warned("units", "axes", text), _scaled(axes, sliding, factor))


def of_signs(posture: np.ndarray) -> Iterator[tuple[tuple[Warned, ...], np.ndarray]]:
    """List postures with two axes or more reversed, and what to say of each."""
    axes = [k for k in range(posture.shape[1]) if np.ptp(posture[:, k]) > TRAVEL]
    for count in range(2, len(axes) + 1):
        for some in combinations(axes, count):
            said = " and ".join(f"a{k + 1}" for k in some)
            text = f"{said} look reversed: they fit with the other signs."
            sign = np.ones(posture.shape[1])
            sign[list(some)] = -1.0
            warned = tuple(Warned("axis_reversed", f"a{k + 1}", text) for k in some)
            yield warned, posture * sign


def _scaled(axes: range, some: list[int], factor: float):
    scale = np.ones(len(axes))
    scale[some] = factor
    return lambda posture: posture * scale


def _reordered(order: list[int]):
    return lambda posture: posture[:, order]


# --- Markers and tracker frame --------------------------------------------------------


@dataclass(frozen=True)
class Seeing:
    """Another way to read what the tracker saw, or where it and the markers are.

    Attributes:
        warned: What to say if it is the right one.
        meant: Turns observations as written into those meant.
    """

    warned: Warned
    meant: Callable[[TrackerObservations], TrackerObservations]


def of_sight(observed: TrackerObservations) -> Iterator[Seeing]:
    """List how else what the tracker saw may be meant."""
    text = "the markers look mirrored: they fit with {} of the tracker's {}."
    for i, name in enumerate("xyz" if observed.transform is not None else "y"):
        sign = np.ones(3)
        sign[i] = -1.0
        said = text.format("the sign", f"{name} changed")
        if observed.transform is None:
            said = text.format("one coordinate", "with the other sign")
        yield Seeing(Warned("mirrored", "tracker", said), _seen(np.diag(sign)))
    if observed.transform is not None:
        for i, j in combinations(range(3), 2):
            swap = np.eye(3)
            swap[[i, j]] = swap[[j, i]]
            said = text.format(f"{'xyz'[i]} and {'xyz'[j]}", "swapped")
            yield Seeing(Warned("mirrored", "tracker", said), _seen(swap))
    for factor, words in ((1e3, "in m where mm are expected"), (1e-3, "in µm, not mm")):
        text = f"marker positions look as if given {words}: they fit times {factor:g}."
        yield Seeing(Warned("units", "tracker", text), _seen(factor * np.eye(3)))
    if observed.given.any():
        for factor in (1e3, 1e-3):
            text = (
                "position_mm of the markers look as if given in another unit: they fit "
                f"times {factor:g}."
            )
            yield Seeing(
                Warned("units", "markers", text),
                lambda s, f=factor: replace(s, marker_positions=s.marker_positions * f),
            )
    if observed.transform is not None:
        for factor in (1e3, 1e-3):
            text = (
                "[frames.tracker] position_mm looks as if given in another unit: it "
                f"fits times {factor:g}."
            )
            yield Seeing(
                Warned("units", "tracker", text),
                lambda s, f=factor: _with_scaled_shift(s, f),
            )
        text = (
            "[frames.tracker] looks inverted: it fits the other way round. p_base = "
            "R(quaternion) p_tracker + position is expected."
        )
        yield Seeing(Warned("tracker_frame", "tracker", text), _inverted)


KEPT = 1e-3
"""Spread of a distance within a body that is kept, in m; chosen: a loose marker moves
by tenths of a millimetre, another's column by centimetres."""
CLEARLY = 5.0
"""Factor by which another reading must keep distances better; chosen."""
INCH = 25.4
"""Millimetres to an inch."""


def detect_column_errors(some: Recording, kept: float) -> tuple[Warned, ...]:
    """Say which columns of markers stand twice, or are another's than they are called.

    Args:
        some: Some visits with absolute markers.
        kept: Spread of a distance within a body up to which it is kept, in m.
    """
    assert some.points is not None
    told = [*_columns_read_twice(some)]
    for own in markers_of_bodies(some).values() if not told else ():
        points, names = some.points[:, own], [some.markers[m].name for m in own]
        before = _spread(points) if len(own) > 2 else 0.0
        if before <= max(kept, KEPT):
            continue
        others = [(_spread(p), text) for text, p in _of_marker_columns(points, names)]
        after, text = min(others, key=lambda one: one[0])
        if after <= min(max(kept, KEPT), before / CLEARLY):
            told.append(
                Warned(
                    "marker_columns",
                    "markers",
                    f"{text}: then the markers of {some.markers[own[0]].body!r} keep "
                    f"their distances to {1e3 * after:.2g} mm, as written they change "
                    f"by {1e3 * before:.2g} mm. Correct the mapping or the file.",
                )
            )
    return tuple(told)


def _columns_read_twice(some: Recording) -> Iterator[Warned]:
    """Yield the markers' columns that hold the same numbers as one before."""
    assert some.points is not None
    seen: dict[bytes, str] = {}
    for m, marker in enumerate(some.markers):
        for c, axis in enumerate("xyz"):
            values, name = some.points[:, m, c], f"{marker.name}_{axis}_mm"
            read = values[np.isfinite(values)]
            if len(read) > 1 and np.ptp(read) > 0.0:
                first = seen.setdefault(values.tobytes(), name)
                if first != name:
                    text = (
                        f"{first} and {name} hold the same numbers: one is read from "
                        "the other's column. Correct the mapping or the file."
                    )
                    yield Warned("marker_columns", f"marker:{marker.name}", text)


def _spread(points: np.ndarray) -> float:
    """Return the robust rms by which distances between markers vary, in m."""
    i, j = np.triu_indices(points.shape[1], 1)
    apart = np.linalg.norm(points[:, i] - points[:, j], axis=2)
    apart = apart[:, np.isfinite(apart).sum(axis=0) > 1]
    if not apart.size:
        return 0.0
    away = np.abs(apart - np.nanmedian(apart, axis=0))
    return float(np.sqrt(np.mean((1.4826 * np.nanmedian(away, axis=0)) ** 2)))


def _of_marker_columns(
    points: np.ndarray, names: list[str]
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield how else the columns of a body's markers may be meant."""
    every = list(product(range(len(names)), range(3)))
    said = {(m, c): f"{names[m]}_{'xyz'[c]}_mm" for m, c in every}
    for one, other in combinations(every, 2):
        if one[0] == other[0] or one[1] == other[1]:
            meant = points.copy()
            meant[:, one[0], one[1]] = points[:, other[0], other[1]]
            meant[:, other[0], other[1]] = points[:, one[0], one[1]]
            yield f"{said[one]} and {said[other]} look exchanged", meant
    for m, c in every:
        for factor, how in (
            (-1.0, "looks as if it had the other sign"),
            (INCH, f"looks as if given in inches: it fits times {INCH}"),
            (1.0 / INCH, f"looks as if taken for inches: it fits over {INCH}"),
        ):
            meant = points.copy()
            meant[:, m, c] *= factor
            yield f"{said[m, c]} {how}", meant


def less_is_stated(observed: TrackerObservations) -> Iterator[Seeing]:
    """List what to doubt wholly where no other reading of it fits."""
    if observed.transform is not None:
        text = (
            "[frames.tracker] does not fit: with a frame that is fitted to the markers "
            "all agree. Correct it, or leave it out."
        )
        yield Seeing(
            Warned("tracker_frame", "tracker", text),
            lambda s: replace(s, transform=None),
        )
    if observed.given.any():
        text = (
            "position_mm of the markers do not fit: with places that are fitted all "
            "agree. Correct them, or leave out what is not known to a millimetre."
        )
        yield Seeing(
            Warned("marker_places", "markers", text),
            lambda s: replace(s, given=np.zeros_like(s.given)),
        )


def _seen(matrix: np.ndarray):
    return lambda observed: replace(observed, y=observed.y @ matrix.T)


def _with_scaled_shift(
    observed: TrackerObservations, factor: float
) -> TrackerObservations:
    assert observed.transform is not None
    moved = observed.transform.copy()
    moved[:3, 3] *= factor
    return replace(observed, transform=moved)


def _inverted(observed: TrackerObservations) -> TrackerObservations:
    assert observed.transform is not None
    return replace(observed, transform=np.linalg.inv(observed.transform))


# --- Order and rows of the wrench -----------------------------------------------------

WRENCH = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
"""What the format calls the columns."""
MOVED = {
    (0, 3): "pulled along and turned about that axis alone, the arm moves against it",
    (0,): "pulled along that axis alone, the arm moves against it",
    (3,): "turned about that axis alone, the arm moves against it",
}
"""What is seen where a force and its moment, forces or moments are reversed."""
PARTS = tuple(MOVED)
"""What is in another order or of another sign together: first column of each part."""
ROWS = ((1, "the row before"), (-1, "the row after"))
"""By how many rows a wrench can come late, and whose it then is."""


def of_columns(some: Recording) -> Iterator[tuple[Warned, Recording]]:
    """List in which other orders and signs the columns may be meant.

    Args:
        some: With a wrench.
    """
    wrench = some.wrench
    assert wrench is not None
    orders = [order for order in permutations(range(3)) if order != (0, 1, 2)]
    for starts in PARTS:
        for order in orders:
            columns = np.arange(6)
            for start in starts:
                columns[start : start + 3] = start + np.array(order)
            yield _read_as(some, columns, _order_in_words(starts, order))
    text = "the moments look given before the forces: they fit the other way round."
    yield _read_as(some, np.array([3, 4, 5, 0, 1, 2]), text)
    for starts in PARTS:
        for i in range(3):
            sign = np.ones(6)
            sign[[start + i for start in starts]] = -1.0
            names = " and ".join(WRENCH[start + i] for start in starts)
            look = "look" if len(starts) > 1 else "looks"
            text = f"{names} {look} reversed: {MOVED[starts]}."
            warned = Warned("wrench_sign", "wrench_sensor", text)
            yield warned, replace(some, wrench=wrench * sign)


def of_rows(recording: Recording) -> Iterator[tuple[Warned, Recording]]:
    """List whose row's wrench may be meant.

    Args:
        recording: Whole, of plateaus, with a wrench.
    """
    for late, whose in ROWS:
        text = (
            f"the wrench looks one row off: it fits the deflections of {whose}. Shift "
            "its columns by one row against the markers'."
        )
        warned = Warned("wrench_rows", "wrench_sensor", text)
        assert recording.wrench is not None
        yield warned, replace(recording, wrench=np.roll(recording.wrench, -late, 0))


def _order_in_words(starts: tuple[int, ...], order: tuple[int, ...]) -> str:
    moved = [i for i in range(3) if order[i] != i]
    parts = [" and ".join(WRENCH[start + i] for i in moved) for start in starts]
    if len(moved) == 2:
        return f"{', '.join(parts)} look exchanged: they fit the other way round."
    read = ", ".join(WRENCH[start + i] for start in starts for i in order)
    said = ", ".join(WRENCH[start + i] for start in starts for i in range(3))
    return f"{said} look out of order: they fit when read from {read}."


def _read_as(
    some: Recording, columns: np.ndarray, text: str
) -> tuple[Warned, Recording]:
    assert some.wrench is not None
    warned = Warned("wrench_columns", "wrench_sensor", text)
    return warned, replace(some, wrench=some.wrench[:, columns])


# --- Size of the load and of the sag --------------------------------------------------

KGF, LBF = 9.80665, 4.4482216
"""N in a kilogram-force, which a kilogram weighs, and in a pound-force."""


# --- Signs, units and axes of the wrench ----------------------------------------------

FORCES = (("kgf", KGF), ("lbf", LBF))
"""Other units of force, in N."""


def of_loads(
    some: Recording, arm: Arm, misfit: Callable[[np.ndarray], float]
) -> Iterator[tuple[Warned, Recording]]:
    """List how else the load, and relative displacements, may be meant.

    Args:
        some: With a wrench.
        arm: The nominal arm, with the recording's names.
        misfit: Residual in m with each of the wrench's six components times a factor;
            of all units of force the one with the smallest is listed.
    """
    wrench, sensor = some.wrench, some.wrench_sensor
    assert wrench is not None and sensor is not None
    text = (
        "the wrench looks reversed: the arm moves against it. Give what the world "
        "exerts on the robot."
    )
    if some.displacement == "relative":
        text += " Or the displacements are counted backwards."
    yield Warned("wrench_sign", "wrench_sensor", text), replace(some, wrench=-wrench)
    for part, columns in (("force", slice(0, 3)), ("torque", slice(3, 6))):
        sign = np.ones(6)
        sign[columns] = -1.0
        text = f"the {part} looks reversed: the arm moves against it, not the rest."
        warned = Warned("wrench_sign", "wrench_sensor", text)
        yield warned, replace(some, wrench=wrench * sign)
    units = [(unit, n, np.array([n] * 3 + [1.0] * 3)) for unit, n in FORCES]
    unit, size_in_n, size = min(units, key=lambda other: misfit(other[2]))
    text = (
        f"the forces look as if given in {unit}, the torques in Nm: they fit "
        f"together with the forces times {size_in_n:g}. N is expected."
    )
    yield Warned("units", "wrench_sensor", text), replace(some, wrench=wrench * size)
    for factor in (1e3, 1e-3):
        size = np.array([1.0] * 3 + [factor] * 3)
        text = (
            "torques and forces look as if given in units that do not belong together: "
            f"they fit with the torques times {factor:g}. N and Nm are expected."
        )
        warned = Warned("units", "wrench_sensor", text)
        yield warned, replace(some, wrench=wrench * size)
    other = "base" if sensor.frame == "sensor" else "sensor"
    text = (
        f"the wrench looks as if given along the axes of the {other}, not of the "
        f"{sensor.frame}: say frame = {other!r} in [sensors.wrench]."
    )
    turned = replace(some, wrench_sensor=replace(sensor, frame=other))
    yield Warned("wrench_frame", "wrench_sensor", text), turned
    text = f"{text[:-1]}, and change its sign."
    warned = Warned("wrench_sign", "wrench_sensor", text)
    yield warned, replace(turned, wrench=-wrench)
    if some.displacement == "relative":
        for angles in of_angles(some.posture, arm.slides):
            yield angles.warned, replace(some, posture=angles.meant(some.posture))
