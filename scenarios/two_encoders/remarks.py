"""What a reader should know of a comparison of encoders, or mend,."""

from collections.abc import Iterator, Sequence

from scenarios.diagnosing.schema import Called, Interval, Remark
from scenarios.two_encoders.axis import Axis
from scenarios.two_encoders.naming import contradicts
from stiffness.two_encoders.found import Trial
from stiffness.two_encoders.terms import WOUND

MOST = 0.5
"""Share that a wind-up must explain before its sign is doubted; chosen."""


def remarks(axes: Sequence[Axis], named: Sequence[Called]) -> Iterator[Remark]:
    """Yield what is known of torques and springs, of orders, and what was refused."""
    for a in axes:
        if _torque(a):
            yield Remark("torque", a.name, _torque(a))
    yield from _doubts(axes, named)
    yield from _refused(axes)


def _doubts(axes: Sequence[Axis], named: Sequence[Called]) -> Iterator[Remark]:
    for a in axes:
        if contradicts(a) and a.give is not None:
            text = (
                f"the model's spring at {a.name} has {1.0 / a.model_give:.3g} N m/rad, "
                f"the recording winds up by {1e6 * max(a.give[0], 0.0):.3g} ± "
                f"{1e6 * a.give[1]:.2g} µrad/(N m) where that makes "
                f"{1e6 * a.model_give:.3g}."
            )
            yield Remark("spring", a.name, text)
        if any(t.term.effect == WOUND and _backwards(t) for t in a.found.refused):
            text = (
                f"{a.name} would wind up against its torque: turn the sign of the "
                f"column {a.name}_tau_nm, which is positive where the motor drives the "
                "axis the way its angle grows."
            )
            yield Remark("torque_sign", a.name, text)
    if any(a.found.at_least for a in axes):
        text = (
            "the delay is the least that no axis contradicts: friction that grows with "
            "speed in the torque of every motor that winds up its gear may hide more."
        )
        yield Remark("delay", axes[0].name, text)
    for n in named:
        order = n.parameters.get("order")
        if order is not None and _wide(order):
            text = (
                f"orders {order.low:g} to {order.high:g} do as well as "
                f"{order.estimate:g}: {n.where} passes too little of a wave to tell."
            )
            yield Remark("order", n.where, text)


def _backwards(trial: Trial) -> bool:
    """Return whether a spring that pushes would explain most of what is there."""
    return trial.coefficients[0] < 0.0 and trial.gain > MOST


def _wide(order: Interval) -> bool:
    assert isinstance(order.low, float) and isinstance(order.high, float)
    return order.high - order.low > 1.0


def _refused(axes: Sequence[Axis]) -> Iterator[Remark]:
    for a in axes:
        for t in a.found.refused:
            if not t.term.order:
                text = f"{t.term.effect} is not named: {t.reason}."
                yield Remark("refused", a.name, text)


def _torque(a: Axis) -> str:
    if not _known(a):
        return (
            f"no torque of {a.name} is known: a column {a.name}_tau_nm, or masses in "
            "the model, would tell its wind-up from other causes."
        )
    if not a.judged.measured:
        return (
            f"the torque of {a.name} was not read: it is worked out from the model's "
            "masses, so a load that they do not hold is not in it."
        )
    return ""


def _known(a: Axis) -> bool:
    torque = a.judged.torque
    return torque is not None and bool((torque != torque[0]).any())
