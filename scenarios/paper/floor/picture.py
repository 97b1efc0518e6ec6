"""How far every method comes on the way to the floor, and where it fails."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure as Picture

from scenarios.reporting import style


def draw(
    errors: Mapping[str, Float[np.ndarray, "poses 3"]],
    rows: Sequence[dict],
    place: Float[np.ndarray, "poses 3"],
    file: Path,
) -> None:
    """Draw shares of the way, and a map of errors for every method but the oracle.

    Args:
        errors: In mm; the oracle last.
        rows: With the shares and their intervals.
        place: Of the flange, in m.
        file: Where to.
    """
    picture = Picture(figsize=(12, 4.2), layout="constrained")
    shown = list(errors)[:-1]
    axes = picture.subplots(1, 1 + len(shown), width_ratios=[1.4, *[1] * len(shown)])
    learnt = [r for r in rows if r["method"] not in ("VJM", "oracle")]
    names = [r["method"] for r in learnt]
    share = np.array([[r[f"share_{k}"] for r in learnt] for k in ("low", "high")])
    value = np.array([r["share_of_the_way"] for r in learnt])
    axes[0].barh(names, 100 * value, 0.6, color=style.ORANGE)
    axes[0].errorbar(
        100 * value, names, xerr=100 * np.abs(share - value), fmt="none", ecolor="black"
    )
    for end, called, side in ((0.0, "springs", "right"), (100.0, "oracle", "left")):
        axes[0].axvline(end, color="black", lw=1.0)
        axes[0].annotate(
            called,
            (end, 1.0),
            (0, 4),
            ("data", "axes fraction"),
            textcoords="offset points",
            ha=side,
        )
    axes[0].set_xlim(min(0.0, *(100 * share[0])) - 15, 115)
    axes[0].invert_yaxis()
    axes[0].set_xlabel("share of the way [%]")
    radius = np.hypot(place[:, 0], place[:, 1])
    size = {name: np.abs(errors[name]).mean(axis=1) for name in shown}
    most = np.quantile(size["VJM"], 0.98)
    for k, (ax, name) in enumerate(zip(axes[1:], shown, strict=True)):
        order = np.argsort(size[name])
        ax.scatter(
            radius[order], place[order, 2], c=size[name][order], s=9, vmax=most, vmin=0
        )
        ax.set_title(name)
        ax.set_xlabel("from A1's axis [m]")
        ax.set_ylabel("height [m]" if k == 0 else "")
        ax.set_aspect("equal", adjustable="box")
    picture.colorbar(
        axes[-1].collections[0], ax=axes[-1], label="error [mm]", shrink=0.7
    )
    style.save(picture, file)
