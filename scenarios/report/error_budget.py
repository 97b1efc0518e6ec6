"""Error budget of an answer with many names, and the arm drawn by it.

The budget is of the mismatch: the square, beyond noise, by which the fitted nominal arm
misses the poses kept back. The shares of the names add up to what the patch
explains; the rest is open.

==========  ==========================================================================
Equation    share_k = E s_k / sum_j s_j; E the share that the patch explains, s_k the
            name's `budget_share`: f_k' f / f' f of what names displace
Source      Pratt 1987, "Dividing the indivisible: using simple symmetry to partition
            variance explained"
Valid       names that were proved together; without a proof s_k itself
Ignores     the error of what the patch explains
==========  ==========================================================================

The figure has at the left the arm in a recorded posture, links and axes coloured by
their share; at the right what the simulator misses before and after the patch, beside
noise, and the budget by place.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from bench.meshes import shapes
from bench.proof.explained_share import Channel
from bench.proof.proof import Proof
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.settings import MICRO
from scenarios.pipelines.schema import Answer, At, Open
from scenarios.report.figures import BLUE, GREEN, GREY, HEAT, ORANGE, RED, save

MANY = 4
"""Number of names from which an answer is told in groups; chosen: up to three lines
need no grouping."""


# --- The budget -----------------------------------------------------------------------


@dataclass(frozen=True)
class ErrorBudget:
    """Shares of the mismatch, 0 to 1.

    Attributes:
        of: Share of each place, by family of effects; places along the arm, then the
            instruments.
        unexplained: What no name explains; None where no proof tells.
        places: Of what is unexplained, the share of each place where it is significant.
    """

    of: Mapping[str, Mapping[str, float]]
    unexplained: float | None
    places: Mapping[str, float]

    @property
    def of_places(self) -> dict[str, float]:
        """The share of each place."""
        return {where: sum(kinds.values()) for where, kinds in self.of.items()}

    @property
    def totals(self) -> dict[str, float]:
        """The share of each place, what has no name there with it."""
        named = self.of_places
        places = dict.fromkeys((*named, *self.places))
        return {w: named.get(w, 0.0) + self.places.get(w, 0.0) for w in places}

    @property
    def of_families(self) -> dict[str, float]:
        """The share of each family of effects, largest first."""
        found: dict[str, float] = {}
        for kinds in self.of.values():
            for family, share in kinds.items():
                found[family] = found.get(family, 0.0) + share
        return dict(sorted(found.items(), key=lambda x: -x[1]))


def budget_of(answer: Answer) -> ErrorBudget:
    """Return how much of the mismatch each place and family of effects makes."""
    found: dict[str, dict[str, float]] = {}
    shares = shares_of_names(answer)
    for one in sorted(answer.named, key=lambda n: along_the_arm(n.where)):
        kinds = found.setdefault(one.where, {})
        family = family_of(one.effect)
        kinds[family] = kinds.get(family, 0.0) + shares[At(one.effect, one.where)]
    explained = _explained(answer)
    return ErrorBudget(
        of=found,
        unexplained=None if explained is None else 1.0 - explained,
        places={p.where: p.share for p in open_places(answer)},
    )


def open_places(answer: Answer) -> tuple[Open, ...]:
    """Return the places without a name, together no more than names leave open.

    The search says how much a generic law of each place alone explains; such laws share
    what they explain with each other.
    """
    explained, total = (
        _explained(answer),
        sum(p.share for p in answer.unexplained_places),
    )
    room = 1.0 - (explained or 0.0)
    scale = min(1.0, room / total) if total > 0.0 else 1.0
    return tuple(
        msgspec.structs.replace(p, share=scale * p.share)
        for p in answer.unexplained_places
    )


def shares_of_names(answer: Answer) -> dict[At, float]:
    """Return the share of each name; they add up to what is explained, or are zero."""
    parts = {
        At(n.effect, n.where): n.budget_share
        if isinstance(n.budget_share, float)
        else 0.0
        for n in answer.named
    }
    explained, total = _explained(answer), sum(parts.values())
    scale = 1.0 if explained is None or total <= 0.0 else explained / total
    return {name: scale * part for name, part in parts.items()}


def _explained(answer: Answer) -> float | None:
    """Return the share that the patch explains, 0 to 1; None where no proof tells."""
    share = answer.explained_share
    estimate = None if share is None else share.estimate
    return min(max(estimate, 0.0), 1.0) if isinstance(estimate, float) else None


def family_of(effect: str) -> str:
    """Return the kind of part that an effect belongs to; `other` where unknown."""
    return CATALOGUE[effect].family if effect in CATALOGUE else "other"


def along_the_arm(where: str) -> tuple[float, str]:
    """Return a key that sorts places from the base to the tool, instruments last."""
    ends = {"base": -1.0, "flange": 900.0, "tool": 901.0}
    if where in ends:
        return ends[where], where
    for start, after in (("a", 0.0), ("link_", 0.5)):
        number = where.removeprefix(start).partition(":")[0]
        if where.startswith(start) and number.isdigit():
            return float(number) + after, where
    return 1000.0, where


def percent(share: float) -> str:
    """Return a share in percent with a digit that can be read: 27 %, 1.3 %, < 0.1 %.

    Below zero: of a name that acts against the others.
    """
    if share <= -1e-3:
        return f"−{percent(-share)}"
    if share < 1e-3:
        return "0 %" if share <= 0.0 else "< 0.1 %"
    return f"{100 * share:.0f} %" if share >= 0.0995 else f"{100 * share:.1f} %"


# --- What is drawn --------------------------------------------------------------------

TALL = 1.6
"""Height over breadth up to which a taller posture shows more; chosen: the picture's
place is as tall."""


@dataclass(frozen=True)
class ArmView:
    """An arm in one posture, in the base's frame, in m.

    Attributes:
        triangles: Corners of all visible triangles.
        body: Of each triangle, the place of its body, `base` or `link_k`.
    """

    triangles: Float[np.ndarray, "triangles 3 3"]
    body: tuple[str, ...]
    axes: Float[np.ndarray, "axes 3"]
    base: Float[np.ndarray, "3"]
    flange: Float[np.ndarray, "3"]

    def point(self, where: str) -> Float[np.ndarray, "3"] | None:
        """Return where a place is; None where it is not on the arm."""
        ends = {"base": self.base, "flange": self.flange, "tool": self.flange}
        if where in ends:
            return ends[where]
        number = where.removeprefix("link_").removeprefix("a").partition(":")[0]
        if not number.isdigit() or not 1 <= int(number) <= len(self.axes):
            return None
        k = int(number) - 1
        if where.startswith("a"):
            return self.axes[k]
        beyond = self.axes[k + 1] if k + 1 < len(self.axes) else self.flange
        return (self.axes[k] + beyond) / 2.0


def arm_view(simulated: Proof) -> ArmView:
    """Return the arm in the recorded posture that shows its axes farthest apart."""
    simulation, anatomy = simulated.simulation, simulated.nominal.rig.anatomy
    states = simulation.see(simulated.nominal).states
    base, turn = simulation.base
    position = (states.position - base) @ turn
    rotation = turn.T @ states.rotation
    links = [states.bodies.index(anatomy.links[k]) for k in simulation.order]
    model = simulated.nominal.rig.nominal
    joints = [model.joint(anatomy.axes[k]).pos for k in simulation.order]
    origins = np.stack(
        [
            position[:, b] + rotation[:, b] @ at
            for b, at in zip(links, joints, strict=True)
        ],
        axis=1,
    )
    spread = np.ptp(origins[:, :, 2], axis=1)
    across = np.linalg.norm(np.ptp(origins[:, :, :2], axis=1), axis=1)
    row = int(np.argmax(np.minimum(spread, TALL * across)))
    of_body = {anatomy.base: "base"}
    of_body |= {
        anatomy.links[k]: f"link_{i}" for i, k in enumerate(simulation.order, 1)
    }
    triangles, owner = [np.zeros((0, 3, 3))], []
    for shape in shapes(model):
        if shape.body not in states.bodies:
            continue
        b = states.bodies.index(shape.body)
        corner = shape.vertex @ rotation[row, b].T + position[row, b]
        triangles.append(corner[shape.face])
        owner += [of_body.get(shape.body, "")] * len(shape.face)
    flange = states.bodies.index(anatomy.flange)
    return ArmView(
        np.concatenate(triangles),
        tuple(owner),
        origins[row],
        position[row, states.bodies.index(anatomy.base)],
        position[row, flange],
    )


# --- The figure -----------------------------------------------------------------------

FAMILIES = {
    "gear": ("gears", ORANGE),
    "structure": ("bearings, links and foot", BLUE),
    "weight": ("weight", GREEN),
    "geometry": ("geometry and encoders", "#7e57c2"),
    "rope": ("rope", "#8d6e63"),
    "instrument": ("instruments", "#00838f"),
    "other": ("other", "#455a64"),
}
"""Words and colour of each family of effects."""


def of_arm(
    view: ArmView,
    budget: ErrorBudget,
    channel: Channel | None,
    unit: str,
    file: Path | None = None,
) -> Figure:
    """Draw the arm by place, error before and after beside noise, and the budget.

    The unit is that of the proof's channel, times a million.
    """
    figure = Figure(figsize=(11.5, 6.2), layout="constrained")
    parts = figure.add_gridspec(2, 2, width_ratios=(1.25, 1), height_ratios=(1, 3.4))
    _arm(figure.add_subplot(parts[:, 0]), view, budget)
    bars = figure.add_subplot(parts[0, 1])
    _before_after(bars, channel, unit)
    _budget(figure.add_subplot(parts[1, 1]), budget)
    return save(figure, file)


def _before_after(axes: Axes, channel: Channel | None, unit: str) -> None:
    title = "Missed on poses kept back"
    if channel is not None and (share := channel.explained) is not None:
        title += f": {percent(share.estimate)} of what is not noise is explained"
    axes.set_title(title, loc="left", size=10)
    axes.grid(visible=False)
    if channel is None:
        axes.axis("off")
        axes.text(0, 0.5, "Not proved in the simulator.", transform=axes.transAxes)
        return
    values = [MICRO * x for x in (channel.before, channel.after, channel.noise)]
    names = ("before", "after", "noise alone")
    bars = axes.barh([2, 1, 0], values, 0.72, color=(GREY, "#333333", "#c8c8c8"))
    words = [f"{value:.3g} {unit}" for value in values]
    axes.bar_label(bars, words, padding=4, fontsize=10)
    axes.set_yticks([2, 1, 0], names)
    axes.set_xlim(0, 1.2 * max(values))
    axes.set_xticks([])
    axes.spines["bottom"].set_visible(False)
    axes.tick_params(left=False)


def _budget(axes: Axes, budget: ErrorBudget) -> None:
    """Draw a bar for each place, and for what is open."""
    rows: list[tuple[str, Mapping[str, float]]] = []
    for where in sorted(budget.totals, key=along_the_arm):
        left = {"open": budget.places[where]} if where in budget.places else {}
        rows.append((where, {**budget.of.get(where, {}), **left}))
    if budget.unexplained is not None:
        elsewhere = budget.unexplained - sum(budget.places.values())
        rows += [("elsewhere", {"open": elsewhere})] * (elsewhere > 1e-3)
    words = {**FAMILIES, "open": ("without a name", RED)}
    largest = max((sum(kinds.values()) for _, kinds in rows), default=0.0)
    labelled: set[str] = set()
    for i, (_, kinds) in enumerate(rows):
        start = 0.0
        for family, share in kinds.items():
            word, colour = words[family]
            known = None if word in labelled else word
            labelled.add(word)
            axes.barh(i, share, 0.72, left=start, color=colour, label=known)
            start += share
        at = max(start, 0.0) + 0.015 * largest
        axes.text(at, i, percent(start), va="center", fontsize=9)
    axes.set_yticks(range(len(rows)), [where for where, _ in rows], fontsize=9)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    # what goes against the rest is drawn to the left
    least = min((sum(kinds.values()) for _, kinds in rows), default=0.0)
    axes.set_xlim(1.1 * min(least, 0.0), 1.25 * max(largest, 1e-9))
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set_xticks([])
    axes.grid(visible=False)
    axes.spines[["bottom", "left"]].set_visible(False)
    axes.tick_params(left=False)
    title = "Share of the mismatch, by place"
    axes.set_title(title, loc="left", size=10)
    if labelled:
        below = {"loc": "upper center", "bbox_to_anchor": (0.45, 0.0), "ncols": 3}
        axes.legend(**below, fontsize=9, columnspacing=1.2, handlelength=1.4)


# --- The arm --------------------------------------------------------------------------

LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])
RAISED, ASIDE = np.radians(14.0), np.radians(20.0)
"""How far above the arm's level and beside its side it is looked at from; chosen."""


def _looked_at(view: ArmView) -> Float[np.ndarray, "3 3"]:
    """Return the directions right, up and towards the viewer, seen from the side."""
    reach = (view.flange - view.base)[:2]
    away = np.arctan2(reach[1], reach[0]) if np.linalg.norm(reach) > 1e-3 else 0.0
    away -= np.pi / 2.0 - ASIDE
    towards = np.array([np.cos(away), np.sin(away), np.tan(RAISED)])
    towards /= np.linalg.norm(towards)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(towards, right), towards])


def shades(budget: ErrorBudget) -> dict[str, tuple[float, float, float]]:
    """Return the colour of each place: the darker, the larger its share."""
    shares = budget.totals
    most = max(shares.values(), default=0.0) or 1.0
    return {where: HEAT(share / most)[:3] for where, share in shares.items()}


def body_shades(budget: ErrorBudget) -> dict[str, tuple[float, float, float]]:
    """Return the colour of each link: of its own share or its axis', the larger."""
    shares, colour = budget.totals, shades(budget)
    found = {}
    for where in shares:
        number = where.removeprefix("link_").removeprefix("a").partition(":")[0]
        both = (f"a{number}", f"link_{number}") if number.isdigit() else (where,)
        largest = max((w for w in both if w in shares), key=lambda w: shares[w])
        found[both[-1]] = colour[largest]
    return found


def _arm(axes: Axes, view: ArmView, budget: ErrorBudget) -> None:
    looked = _looked_at(view)
    flat = view.triangles @ looked.T
    cross = np.cross(
        view.triangles[:, 1] - view.triangles[:, 0],
        view.triangles[:, 2] - view.triangles[:, 0],
    )
    normal = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-15)
    bright = 0.62 + 0.38 * np.abs(normal @ LIGHT)
    of_body = body_shades(budget)
    own = np.array([of_body.get(b, HEAT(0.0)[:3]) for b in view.body]).reshape(-1, 3)
    order = np.argsort(flat[:, :, 2].mean(axis=1))
    faces = np.clip(own * bright[:, None], 0.0, 1.0)[order]
    drawn = PolyCollection(list(flat[order][:, :, :2]), facecolors=faces)
    drawn.set(edgecolor=faces, linewidth=0.3, rasterized=True)
    axes.add_collection(drawn)
    spine = np.vstack([view.base, view.axes, view.flange]) @ looked.T
    if not len(flat):  # a model without visible shapes
        axes.plot(spine[:, 0], spine[:, 1], "-", color="#b8bcc0", lw=7, zorder=1)
    _labels(axes, view, budget, looked)
    axes.set_aspect("equal", adjustable="datalim")
    axes.axis("off")
    title = "Where it comes from: the darker, the more of the mismatch"
    axes.set_title(title, loc="left", size=10)


def _labels(axes: Axes, view: ArmView, budget: ErrorBudget, looked: np.ndarray) -> None:
    """Name all places beside the arm, one below the other, with a line to each."""
    colour = shades(budget)
    numbered = [f"a{k + 1}" for k in range(len(view.axes))]
    places = list(dict.fromkeys((*numbered, *budget.totals)))
    spots = {w: looked @ at for w in places if (at := view.point(w)) is not None}
    edge = np.vstack([view.triangles.reshape(-1, 3) @ looked.T, *spots.values()])
    low, high = edge.min(axis=0), edge.max(axis=0)
    middle = (low[0] + high[0]) / 2.0
    tall = max(high[1] - low[1], 1e-3)
    sides = {True: [], False: []}
    for where in sorted(spots, key=lambda w: -spots[w][1]):
        sides[bool(spots[where][0] > middle)].append(where)
    for short, long in ((True, False), (False, True)):  # neither side crowded
        while len(sides[long]) > len(sides[short]) + 2:
            nearest = min(sides[long], key=lambda w: abs(spots[w][0] - middle))
            sides[long].remove(nearest)
            sides[short].append(nearest)
    margin = 0.12 * tall
    for right, some in sides.items():
        some.sort(key=lambda w: -spots[w][1])
        heights = _apart([spots[w][1] for w in some], 0.062 * tall)
        x = high[0] + margin if right else low[0] - margin
        for where, y in zip(some, heights, strict=True):
            at = spots[where]
            told, faint = f"{where}  {_shares_at(budget, where)}", where not in colour
            axes.plot([at[0], x], [at[1], y], "-", color="#9a9a9a", lw=0.7, zorder=5)
            edged = RED if where in budget.places else "#333333"
            look = {"mfc": colour.get(where, "white"), "mec": edged, "zorder": 6}
            axes.plot(*at[:2], "o", ms=11 if where in numbered else 6, **look)
            side = "left" if right else "right"
            shade = "#8a8a8a" if faint else "#1c1c1c"
            weight = "normal" if faint else "bold"
            word = axes.text(x, y, f" {told} ", fontsize=9.5, color=shade)
            word.set(ha=side, va="center", weight=weight)
    wide = 0.36 * tall
    across = (low[0] - margin - wide, high[0] + margin + wide)
    axes.plot(across, (low[1] - 0.1 * tall, high[1] + 0.08 * tall), alpha=0.0)
    axes.margins(0.0)
    beside = [w for w in places if w not in spots]
    if beside:
        told = [f"{w} {_shares_at(budget, w)}" for w in beside]
        text = axes.text(0.02, 0.0, f"Beside the arm: {', '.join(told)}", fontsize=9.5)
        text.set(va="bottom", transform=axes.transAxes)


def _shares_at(budget: ErrorBudget, where: str) -> str:
    """Return what a place makes of the mismatch, in words."""
    named, left = budget.of_places.get(where), budget.places.get(where)
    told = [] if named is None else [percent(named)]
    told += [] if left is None else [f"{percent(left)} open"]
    return ", ".join(told) or "–"


def _apart(heights: list[float], least: float) -> list[float]:
    """Return heights, highest first, moved so that none is nearer than the least."""
    placed = list(heights)
    for _ in range(50):
        for i in range(len(placed) - 1):
            short = least - (placed[i] - placed[i + 1])
            if short > 0.0:
                placed[i] += short / 2.0
                placed[i + 1] -= short / 2.0
    return placed
