"""A cost is held against its bars, and against the poses that it was paid for."""

from collections.abc import Mapping, Sequence

BAR_S, BAR_GB = 60.0, 4.0
"""Core seconds and GB that a diagnosis of many poses may take."""


def answered(found: Sequence[Mapping[str, object]]) -> str:
    """Say whether the bars are kept and whether the cost grows with the poses.

    Args:
        found: A row for each kind and count, as in the table.
    """
    cost, gb = ([float(str(r[k])) for r in found] for k in ("core_s", "peak_gb"))
    kept = max(cost) <= BAR_S and max(gb) <= BAR_GB
    said = [
        f"At most {max(cost):.0f} core seconds and {max(gb):.1f} GB: "
        f"{'within' if kept else 'NOT within'} the bars of "
        f"{BAR_S:.0f} core seconds and {BAR_GB:.0f} GB."
    ]
    for kind in dict.fromkeys(str(r["kind"]) for r in found):
        own = [
            (int(str(r["poses"])), float(str(r["core_s"])))
            for r in found
            if r["kind"] == kind
        ]
        (few, before), (many, after) = min(own), max(own)
        if many == few:
            continue
        times, more = after / before, many / few
        verdict = (
            "does not grow with the poses"
            if times <= 1.0
            else "grows by less than the poses"
            if times < more
            else "grows as the poses or faster"
        )
        said.append(
            f"Of {kind} the cost {verdict}: {more:.3g} times the poses cost "
            f"{times:.2f} times the core seconds."
        )
    return " ".join(said)
