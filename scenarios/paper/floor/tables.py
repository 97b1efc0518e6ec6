"""How far every method comes on the way to the floor, as a table and in words."""

from collections.abc import Mapping, Sequence

from scenarios.reporting import page


def shown(rows: Sequence[Mapping]) -> page.Table:
    """Return every method's error and its share of the way, as a table."""
    caption = (
        f"Errors over all directions on {rows[0]['n']} fresh poses, seed "
        f"{rows[0]['seeds']} [mm]; intervals over poses"
    )
    header = ["method", "MAE", "95 % interval", "share of the way [%]", "interval"]
    cells = [
        [
            str(r["method"]),
            f"{r['MAE_mm']:.4f}",
            f"{r['low_mm']:.4f} to {r['high_mm']:.4f}",
            f"{100 * r['share_of_the_way']:.0f}",
            f"{100 * r['share_low']:.0f} to {100 * r['share_high']:.0f}",
        ]
        for r in rows
    ]
    return page.Table(caption, header, cells)


def summary(rows: Sequence[Mapping]) -> str:
    """Say how far each method comes."""
    mae = {r["method"]: r["MAE_mm"] for r in rows}
    way = [
        f"{r['method']} {100 * r['share_of_the_way']:.0f} %"
        for r in rows
        if r["method"] not in ("VJM", "oracle")
    ]
    return (
        f"Springs leave {mae['VJM']:.4f} mm on fresh poses, one who knows the truth's "
        f"form {mae['oracle']:.4f} mm. Of the way between them go: {', '.join(way)}."
    )
