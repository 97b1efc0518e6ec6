"""What goes apart between encoders is played back over time, before and after."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from scenarios.two_encoders.axis import Axis

PLAYBACK = "diagnosis.rrd"
TIME = "time"
URAD = 1e6


def save(axes: Sequence[Axis], file: Path) -> None:
    """Save curves of the judged motion, in µrad, and of its angle and torque."""
    stream = rr.RecordingStream("two_encoders")
    stream.save(str(file))
    for a in axes:
        times = [rr.TimeColumn(TIME, duration=a.judged.time)]
        curves = {"nominal": URAD * a.before, "named": URAD * a.after}
        curves["angle_deg"] = np.degrees(a.judged.angle)
        if a.judged.torque is not None:
            curves["torque_nm"] = a.judged.torque
        for name, values in curves.items():
            columns = rr.Scalars.columns(scalars=values)
            stream.send_columns(f"/{a.name}/{name}", indexes=times, columns=columns)
    stream.flush()
    stream.disconnect()
