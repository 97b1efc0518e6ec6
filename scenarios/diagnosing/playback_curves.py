"""Wind-up curves stand beside the arm: what was measured, and the law drawn through."""

import numpy as np
import rerun as rr

from scenarios.diagnosing.finding import MICRO, Curves, Finding, courses_of

WIDTH, HEIGHT = 100.0, 60.0
"""Of a curve's plot, in its own units; chosen."""
ACROSS, DOWN = (-58.0, 54.0), (-38.0, 46.0)
"""What of it is shown; chosen: a margin for words."""
GREY, ORANGE = (120, 120, 120), (240, 100, 0)


def curves(stream: rr.RecordingStream, finding: Finding, curves: Curves) -> None:
    """Log the curves of the axes that matter."""
    for k in shown(finding, curves):
        name = curves.axes[k]
        courses = courses_of(curves, name)
        torque = np.concatenate([c.torque for c in courses])
        turn = np.concatenate([v for c in courses for v in (c.measured, c.law)])
        middle, wide = np.mean([torque.min(), torque.max()]), np.ptp(torque) / 2
        centre, high = np.mean([turn.min(), turn.max()]), np.ptp(turn) / 2

        def placed(x: np.ndarray, y: np.ndarray, at=(middle, wide, centre, high)):
            across = WIDTH / 2 * (x - at[0]) / max(at[1], 1e-9)
            up = -HEIGHT / 2 * (y - at[2]) / max(at[3], 1e-9)
            return np.column_stack([across, up]).astype(np.float32)

        measured = np.concatenate([placed(c.torque, c.measured) for c in courses])
        points = rr.Points2D(measured, colors=[GREY], radii=0.9)
        stream.log(f"/curves/{name}/measured", points, static=True)
        if finding.proof is not None:
            strips = [placed(c.torque, c.law) for c in courses]
            lines = rr.LineStrips2D(strips, colors=[ORANGE], radii=0.35)
            stream.log(f"/curves/{name}/patch", lines, static=True)
        left, foot = -WIDTH / 2 - 4, HEIGHT / 2 + 4
        frame = [[[left, -HEIGHT / 2], [left, foot], [WIDTH / 2, foot]]]
        lines = rr.LineStrips2D(frame, colors=[(150, 150, 150)], radii=0.15)
        stream.log(f"/curves/{name}/axes", lines, static=True)
        texts = [
            f"torque {torque.min():.0f} to {torque.max():.0f} N m",
            f"turn over {MICRO * 2 * high:.0f} µrad",
        ]
        labels = rr.Points2D(
            [[0.0, foot + 5], [left + 14, -HEIGHT / 2]],
            labels=texts,
            colors=[(20, 20, 20)],
            radii=0.01,
        )
        stream.log(f"/curves/{name}/labels", labels, static=True)


def shown(finding: Finding, curves: Curves) -> list[int]:
    """Return which axes' curves are shown: those that were named or located, or two."""
    places = [n.where for n in finding.answer.named]
    places += [x.where for x in finding.answer.located]
    found = [k for k, name in enumerate(curves.axes) if name in places]
    return (found or list(range(min(2, len(curves.axes)))))[:3]
