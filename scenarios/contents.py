"""What a recording holds is said before what it can show."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from bench.recording import Recording
from scenarios.replicates import replicate_noise


def contents_of(r: Recording) -> Iterator[tuple[str, str]]:
    """Say what a recording holds, row by row of a table."""
    visits = np.unique(r.visit, return_index=True)[1]
    counts = Counter(r.pose[visits].tolist())
    again = sum(1 for count in counts.values() if count > 1)
    yield "robot", r.robot or "not named"
    yield "rows", f"{len(r.time)} {'plateaus' if r.rows == 'plateaus' else 'instants'}"
    yield "duration", f"{(r.time[-1] - r.time[0]) / 60.0:.1f} min"
    yield "poses", f"{len(counts)} in {len(visits)} visits, {again} visited again"
    yield "displacement", r.displacement
    for body, count in Counter(m.body for m in r.markers).items():
        columns = [i for i, m in enumerate(r.markers) if m.body == body]
        assert r.points is not None
        blank = float(np.mean(np.isnan(r.points[:, columns]).any(axis=2)))
        targets = {m.target for m in r.markers if m.body == body and m.target}
        six = f" of {len(targets)} in 6D" if targets else ""
        place = sum(r.markers[i].position is not None for i in columns)
        yield (
            f"markers on {body}",
            f"{count}{six}; places {_share(place, count)}; "
            f"{f'not seen in {blank:.1%} of readings' if blank else 'always seen'}",
        )
    if not r.markers:
        yield "markers", "none"
    known = "known" if r.base_from_tracker is not None else "unknown, to be fitted"
    yield "tracker's frame", known
    yield "tracker's noise", noise_of(r)
    yield "wrench", wrench_of(r)
    yield "load path", load_path_of(r)
    if r.link_posture is not None:
        yield "encoders after the gear", f"{_measured(r.link_posture)} axes"
    if r.axis_torque is not None:
        yield "motor torque", f"{_measured(r.axis_torque)} axes"
    if r.temperature is not None:
        low, high = r.temperature.min(), r.temperature.max()
        yield "temperature", f"{low:.1f} to {high:.1f} °C"


def noise_of(r: Recording) -> str:
    """Put the tracker's stated noise beside what replicates show."""
    if r.tracker is None:
        return "no tracker"
    frames = 1.0 if r.frames is None else float(np.mean(1.0 / r.frames)) ** 0.5
    stated = ", ".join(f"{1e3 * s * frames:.4f}" for s in r.tracker.repeatability)
    found = replicate_noise(r)
    if found is None:
        return f"stated {stated} mm in x, y, z; no pose visited again to compare"
    seen = ", ".join(f"{1e3 * s:.4f}" for s in found[0])
    return f"stated {stated} mm in x, y, z; poses visited again show {seen} mm"


def wrench_of(r: Recording) -> str:
    """Say how strong the measured load is."""
    if r.wrench is None:
        return "not measured"
    force = np.linalg.norm(r.wrench[:, :3], axis=1).max()
    torque = np.linalg.norm(r.wrench[:, 3:], axis=1).max()
    return f"up to {force:.1f} N and {torque:.2f} Nm"


def load_path_of(r: Recording) -> str:
    """Say how the load goes in the commonest visit."""
    if r.load_mass is None and r.wrench is None:
        return "weight alone"
    per_row = r.stage if r.load_mass is None else r.load_mass
    unit = "" if r.load_mass is None else " kg"
    starts = np.unique(r.visit, return_index=True)[1][1:]
    paths = Counter(tuple(visit.tolist()) for visit in np.split(per_row, starts))
    path, count = paths.most_common(1)[0]
    shown = [step if isinstance(step, str) else f"{step:g}" for step in path[:16]]
    more = " …" if len(path) > len(shown) else ""
    return f"{' '.join(shown)}{more}{unit} in {count} of {paths.total()} visits"


def _share(stated: int, count: int) -> str:
    """Say how many markers' places on their body are stated."""
    if stated in (0, count):
        return "stated" if stated else "not stated"
    return f"of {stated} stated"


def _measured(columns: np.ndarray) -> int:
    return int(np.sum(~np.isnan(columns).all(axis=0)))
