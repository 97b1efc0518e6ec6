"""Ends of links in the MuJoCo model: bodies, poses and rotations along the chain.

A link ends at the bearing of the next axis, the last one at the flange. A link that
carries several axes, as a torso does, has as many ends: `link_2:a10` is where a10 sits.
"""

from bench.kinematic_chain import Anatomy
from bench.shared.errors import Unusable


def end_of(arm: Anatomy, where: str) -> str:
    """Return the body at the end of a link, or the hand.

    A link is `link_k`, or the link's own name; `link_k:aN` where it carries several
    axes.

    Raises:
        Unusable: Where the link carries several axes and none of them is named, or one
            that it does not carry.
    """
    k = arm.links.index(arm.body(where))
    ends = {f"a{n + 1}": arm.axes[n] for n in arm.carried(k)}
    if not ends:
        return arm.hands[k]
    _, colon, name = where.partition(":")
    known = [*ends, *ends.values()]
    axis = arm.axis(name) if colon else next(iter(ends.values()))
    if axis not in ends.values() or (len(ends) > 1 and not colon):
        fault = (
            f"{where!r} is no end of one link: it carries {', '.join(known)}; write "
            f"{' or '.join(f'link_{k + 1}:{end}' for end in ends)}."
        )
        raise Unusable("The place of an effect", [fault])
    return arm.end(axis)
