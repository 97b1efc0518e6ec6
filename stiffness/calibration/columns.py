"""Design matrix of a calibration: columns of all effects, normal equations by fold.

`candidates_of` builds the columns of each candidate effect, `Blocks` lays them out
beside the nuisance parameters (tracker frame, target positions) and the geometry, and
`normals_of` returns the normal equations of each fold.

Candidate effects beyond the geometry, linear in their coefficients:

==========  ==========================================================================
Equation    joint_compliance    turn about the axis = c tau
            bearing_tilt        turn about x or y of the axis' seat = c moment about it;
                                of a slide about its guide, wherever the carriage is
            transmission_error  turn about the axis = sum over orders n of
                                a_n cos n q + b_n sin n q
            lost_motion         a slide's guide: turn about x and about y of its seat
                                = width / 2 to the side of the moment about each
            reading_lag         turn about the axis = lag along its last move, or lag
                                times its share of that move; a constant one below zero
                                is hysteresis, a wind-up of width = −2 lag that friction
                                holds (`stiffness.calibration.result`)
            drift               the arm's base moves and turns with time
            tracker_scale       places = (1 + ratio) places
            tau, moment: of the arm's own weight and its tool's, in N m
Source      Spong 1987 (compliance); Klimchik et al. 2011 (tilt); Tuttle 1992
            (transmission error); Iwan 1966 (friction); ISO 9283 (drift, approach)
Valid       small deflections: all enter linearly
Ignores     whatever happens between the recorded poses
==========  ==========================================================================
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.calibration.model import (
    CalibrationState,
    Entry,
    entries_of,
)
from stiffness.calibration.rigid_fit import RigidFit, corrections_of, prior_sizes
from stiffness.regression.normal_equations import Normal
from stiffness.robot.tracker_frame import LARGEST_SCALE

# --- Columns --------------------------------------------------------------------------

ORDERS = (1, 3, 5, 9, 17, 33, 65, 129, 257)
"""Bounds of the bands of orders; the last entry ends the last band. Chosen: octaves, up
to what a strain-wave gear of ratio 100 does twice in each turn of its input (200)."""
POSES_PER_ORDER = 5
"""Minimum number of poses for each order of a table; chosen."""
VISIBLE = 1e-6
"""Rms of a column, in m per unit of its usual size, below which it is not visible."""
SOFTEST = 1e-4
"""Compliance in rad/(N m) at which that of an axis has to be visible; the soft end of
the catalogue's usual range, where wrists are: one that is missing bends the others."""
FARTHEST = 0.01
"""Lag in rad beyond which an axis is not read while it settles; chosen, far beyond what
the catalogue calls usual."""
USUAL_TORQUE_COMPLIANCE, USUAL_TURN = 1e-5, 1e-4
"""In rad/(N m) and rad; the usual sizes at which the visibility of columns is
judged."""


@dataclass(frozen=True)
class Candidate:
    """One candidate effect at one site, with its columns of the design matrix.

    Attributes:
        parameters: Names of its coefficients; a table has two for each order.
        columns: Function that returns its columns for a `CalibrationState`.
        least: Lower bound of a coefficient.
        most: Upper bound.
        orders: Order of each column of a table; empty where it is no table.
    """

    effect: str
    where: str
    parameters: tuple[str, ...]
    columns: Callable[[CalibrationState], Float[np.ndarray, "rows coordinates columns"]]
    least: float = -np.inf
    most: float = np.inf
    orders: tuple[int, ...] = ()

    @property
    def key(self) -> tuple[str, str]:
        """Effect and site."""
        return self.effect, self.where


def candidates_of(
    state: CalibrationState, highest: int = ORDERS[-1]
) -> tuple[Candidate, ...]:
    """Return all candidate effects that these postures can make visible.

    Tables end below the order `highest`.
    """
    chain = state.standing.chain
    found: list[Candidate] = []
    poses = len(np.unique(state.readings.posture_id))
    for k, slides in enumerate(chain.slides):
        where = f"a{k + 1}"
        if not slides:  # what a slide carries weighs the same wherever it is
            name = "compliance_rad_per_nm"
            wound = _wind_up(k)
            found.append(Candidate("joint_compliance", where, (name,), wound, 0.0))
        for j, name in enumerate(("u_rad_per_nm", "v_rad_per_nm")):
            found.append(Candidate("bearing_tilt", where, (name,), _tilt(k, j), 0.0))
        if slides:
            play = _guide_play(k)
            found.append(Candidate("lost_motion", where, ("width_rad",), play, 0.0))
            continue
        for name, law in (("lag_rad", _side(k)), ("share_lag_rad", _share(k))):
            lag = Candidate("reading_lag", where, (name,), law, -FARTHEST, FARTHEST)
            found.append(lag)
        orders = tuple(range(1, min(highest, poses // POSES_PER_ORDER + 1)))
        names = tuple(f"{f}_{n}" for n in orders for f in ("cos", "sin"))
        twice = tuple(n for n in orders for _ in range(2))
        table = _table(k, orders)
        found.append(Candidate("transmission_error", where, names, table, orders=twice))
    shift = tuple(f"{a}_m_per_h" for a in "xyz") + tuple(
        f"r{a}_rad_per_h" for a in "xyz"
    )
    found.append(Candidate("drift", "base", shift, _drift))
    scale = Candidate(
        "tracker_scale", "tracker", ("ratio",), _scale, -LARGEST_SCALE, LARGEST_SCALE
    )
    found.append(scale)
    return tuple(c for c in found if _shows(c, state))


def _shows(candidate: Candidate, state: CalibrationState) -> bool:
    some = state
    if candidate.orders:  # its first orders are visible
        lever = state.lever[int(candidate.where[1:]) - 1]
        return bool(np.sqrt(np.mean(lever**2)) * USUAL_TURN > VISIBLE)
    size = np.sqrt(np.mean(candidate.columns(some) ** 2, axis=(0, 1)))
    usual = {
        "reading_lag": USUAL_TURN,
        "lost_motion": USUAL_TURN,
        "bearing_tilt": USUAL_TORQUE_COMPLIANCE,
    }
    one = usual.get(candidate.effect, 1.0)
    if candidate.effect == "joint_compliance":  # or the spring's own, where softer
        stiff = state.readings.arm.stiffness[int(candidate.where[1:]) - 1]
        one = max(SOFTEST, 1.0 / stiff if stiff > 0.0 else 0.0)
    return bool(size.max() * one > VISIBLE)


def stacked(
    candidates: Sequence[Candidate], state: CalibrationState
) -> Float[np.ndarray, "rows coordinates columns"]:
    """Return the columns of several candidates side by side."""
    rows = (*state.residual.shape, 0)
    return np.concatenate(
        [np.zeros(rows), *(c.columns(state) for c in candidates)], axis=2
    )


def _wind_up(k: int):
    return lambda s: (s.lever[k] * s.torque[:, k, None])[:, :, None]


def _side(k: int):
    return lambda s: (s.lever[k] * s.readings.moves.side[:, k, None])[:, :, None]


def _share(k: int):
    return lambda s: (s.lever[k] * s.readings.moves.share[:, k, None])[:, :, None]


def _tilt(k: int, j: int):
    def columns(s: CalibrationState) -> np.ndarray:
        seat, centre, moment = s.bearing(k)
        about = np.sum(seat[j] * moment, axis=1)
        return (s.tilting(k, seat[j], centre) * about[:, None])[:, :, None]

    return columns


def _guide_play(k: int):
    def columns(s: CalibrationState) -> np.ndarray:
        seat, centre, moment = s.bearing(k)
        sides = [np.sign(np.sum(along * moment, axis=1))[:, None] for along in seat]
        moved = [
            s.tilting(k, along, centre) * side
            for along, side in zip(seat, sides, strict=True)
        ]
        return 0.5 * np.sum(moved, axis=0)[:, :, None]

    return columns


def _table(k: int, orders: Sequence[int]):
    def columns(s: CalibrationState) -> np.ndarray:
        angle = s.readings.posture[:, k, None] * np.array(orders)
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=2).reshape(len(angle), -1)
        return s.lever[k][:, :, None] * waves[:, None, :]

    return columns


def _drift(s: CalibrationState) -> np.ndarray:
    return s.frame_jacobian * s.readings.hours[:, None, None]


def _scale(s: CalibrationState) -> np.ndarray:
    return s.as_read(np.hstack([s.point, np.zeros_like(s.point)]))[:, :, None]


# --- Columns by cause -----------------------------------------------------------------

Key = tuple[str, str]
SILENT: Key = ("silent", "")
"""Nuisance parameters: tracker frame, target positions, springs of the model."""

STATED = (("drawing", ""), 0)
"""The prior of all that the drawing states."""


@dataclass(frozen=True)
class Blocks:
    """Layout of the design matrix: what each column and its coefficient belong to.

    Attributes:
        owner: Effect and site of each column.
        parameter: Name of each column's coefficient.
        order: Order of each column of a table; 0 elsewhere.
        least: Lower bound of each coefficient.
        most: Upper bound.
        entry: Index of each column among the columns of the state's nuisance
            Jacobian; −1 elsewhere.
        start: Value of each coefficient in the state: the corrections of what is
            stated so far, 0 elsewhere. Coefficients are full values, not steps: what
            is not fitted is as the model has it.
        size: One sigma of each coefficient before the readings; infinite where nothing
            is stated.
        candidates: Those whose columns follow the columns of the geometry.
    """

    owner: tuple[Key, ...]
    parameter: tuple[str, ...]
    order: Int[np.ndarray, " columns"]
    least: Float[np.ndarray, " columns"]
    most: Float[np.ndarray, " columns"]
    entry: Int[np.ndarray, " columns"]
    start: Float[np.ndarray, " columns"]
    size: Float[np.ndarray, " columns"]
    candidates: tuple[Candidate, ...]

    @classmethod
    def of(
        cls,
        rigid: RigidFit,
        state: CalibrationState,
        candidates: Sequence[Candidate],
        sprung: Iterable[Key],
    ) -> "Blocks":
        """Lay out the visible parameters of the geometry, then the candidates."""
        drawing = entries_of(state.standing.chain)
        quiet = [Entry(*SILENT, "")] * (len(rigid.kept) - len(drawing))
        shown = np.flatnonzero(rigid.kept)
        entries = [(*drawing, *quiet)[j] for j in shown]
        known = set(sprung)
        owner: list[Key] = [(e.effect, e.where) for e in entries]
        parameter = [e.parameter for e in entries]
        order, least = [0] * len(entries), [-np.inf] * len(entries)
        most = [np.inf] * len(entries)
        for c in candidates:
            count = len(c.parameters)
            owner += [SILENT if c.key in known else c.key] * count
            parameter += c.parameters
            order += c.orders or [0] * count
            least += [c.least] * count
            most += [c.most] * count
        entry = np.concatenate([shown, np.full(len(owner) - len(shown), -1)])
        start, size = np.zeros(len(owner)), np.full(len(owner), np.inf)
        start[: len(shown)] = corrections_of(state.readings, state.geometry)[shown]
        size[: len(shown)] = prior_sizes(state.readings)[shown]
        return cls(
            tuple(owner), tuple(parameter), np.array(order), np.array(least),
            np.array(most), entry, start, size, tuple(candidates),
        )  # fmt: skip

    @property
    def keys(self) -> tuple[Key, ...]:
        """Return every effect and site that can be claimed, once."""
        return tuple(k for k in dict.fromkeys(self.owner) if k != SILENT)

    def columns_of(self, keys: Iterable[Key]) -> Int[np.ndarray, " some"]:
        """Return the indices of the columns of some blocks, in order."""
        wanted = set(keys)
        return np.array([i for i, o in enumerate(self.owner) if o in wanted], dtype=int)

    def parts(self, key: Key) -> list[Int[np.ndarray, " some"]]:
        """Return a block's columns; parameter by parameter where they are bounded."""
        own = self.columns_of([key])
        if np.isfinite(self.least[own]).all():
            return [own[i : i + 1] for i in range(len(own))]
        return [own]

    def holds(self, columns: Int[np.ndarray, " some"], x: np.ndarray) -> bool:
        """Return whether the coefficients of some columns lie within their bounds."""
        return bool(np.all((x >= self.least[columns]) & (x <= self.most[columns])))

    @property
    def octaves(self) -> list[tuple[Key, int]]:
        """Return effect, site and octave of each column; octave 0: it is no table."""
        octave = np.searchsorted(ORDERS, self.order, side="right").tolist()
        return list(zip(self.owner, octave, strict=True))

    @property
    def band(self) -> Int[np.ndarray, " columns"]:
        """Return the band of each column, whose variance is estimated; −1: none."""
        pairs = self.octaves
        names = {pair: i for i, pair in enumerate(sorted({p for p in pairs if p[1]}))}
        return np.array([names.get(pair, -1) for pair in pairs])

    @property
    def priors(self) -> list[tuple[Key, int]]:
        """Return by what prior each column is shrunk: an octave's, or the drawing's."""
        return [
            STATED if stated else pair
            for stated, pair in zip(np.isfinite(self.size), self.octaves, strict=True)
        ]

    def by_prior(
        self, values: Mapping[tuple[Key, int], float]
    ) -> Float[np.ndarray, " columns"]:
        """Return a value for each column from one for each prior; 1 elsewhere."""
        return np.array([values.get(prior, 1.0) for prior in self.priors])

    def matrix(
        self, state: CalibrationState, rows: Int[np.ndarray, " some"] | None = None
    ) -> Float[np.ndarray, "n columns"]:
        """Return the columns at some rows, a line for each coordinate of a row."""
        return self.problem(state, rows)[0]

    def problem(
        self, state: CalibrationState, rows: Int[np.ndarray, " some"] | None = None
    ) -> tuple[Float[np.ndarray, "n columns"], Float[np.ndarray, " n"]]:
        """Return design matrix and right-hand side of the linearised problem."""
        if rows is not None:
            state = CalibrationState.of(state.readings.take(rows), state.geometry)
        drawing = state.nuisance_jacobian()[:, :, self.entry[self.entry >= 0]]
        both = [drawing, stacked(self.candidates, state)]
        a = np.concatenate(both, axis=2).reshape(-1, len(self.owner))
        return a, state.residual.ravel() + a @ self.start


# --- Normal equations by fold ---------------------------------------------------------

CHUNK = 500
"""Rows whose columns are held in memory at a time."""


def normals_of(
    blocks: Blocks, state: CalibrationState, fold: Int[np.ndarray, " rows"], count: int
) -> list[Normal]:
    """Return the normal equations of each fold; a negative fold is in none."""
    width = len(blocks.owner)
    found = []
    for f in range(count):
        gram, aim = np.zeros((width, width)), np.zeros(width)
        rows = np.flatnonzero(fold == f)
        square = 0.0
        for start in range(0, len(rows), CHUNK):
            own = rows[start : start + CHUNK]
            a, y = blocks.problem(state, own)
            gram += a.T @ a
            aim += a.T @ y
            square += float(y @ y)
        found.append(
            Normal(gram, aim, square, int(state.readings.coordinates[rows].sum()))
        )
    return found
