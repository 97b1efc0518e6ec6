"""What no name explains is measured: how much, where, what it goes with, how long."""

from collections.abc import Sequence

from scenarios.diagnosing.schema import Left
from scenarios.two_encoders.axis import Axis, whole_rms
from stiffness.two_encoders.remaining import SHOWS, followed, lasting

URAD = 1e6


def unexplained(axes: Sequence[Axis]) -> Left:
    """Say what is left of the axis that is left most."""
    worst = max(axes, key=lambda a: whole_rms(a.after))
    left = [worst.found.left(m) for m in worst.fitted]
    shares = followed(left, worst.fitted, worst.after, worst.judged)
    goes = [f"{100 * s:.0f} % with {x}" for x, s in shares.items() if s >= SHOWS]
    how = f"as in the other motions it goes {' and '.join(goes)}"
    if not goes:
        how = f"it goes with {', '.join(shares)} otherwise than in the other motions"
    whose = "stated" if worst.stated else "of noise from row to row"
    text = (
        f"{URAD * whole_rms(worst.after):.1f} µrad rms of the judged motion beside "
        f"{URAD * worst.noise:.1f} µrad {whose}; {how}; it keeps its sign for "
        f"{lasting(worst.after, worst.judged):.2f} s"
    )
    return Left(worst.name, f"{text}.{_help(worst)}", {}, None)


def _help(a: Axis) -> str:
    if a.judged.measured:
        return ""
    return f" A column {a.name}_tau_nm would help, or masses as they are."
