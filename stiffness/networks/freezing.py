"""What is frozen cannot learn, and what is held back cannot teach."""

import numpy as np
from jaxtyping import Int
from torch import nn

from bench.errors import Unusable


def unfreeze(
    layers: tuple[nn.Module, ...], network: nn.Module, unfrozen: tuple[int, ...]
) -> list[nn.Parameter]:
    """Freeze everything but some layers.

    Args:
        layers: All that can be frozen, from the inputs on.
        network: They are its layers.
        unfrozen: Those that may change, counted from 1.

    Returns:
        The weights that may change.

    Raises:
        Unusable: Where there is no such layer.
    """
    strange = [k for k in unfrozen if not 1 <= k <= len(layers)]
    if strange:
        fault = f"it has layers 1 to {len(layers)}, not {strange}."
        raise Unusable("The network", [fault])
    network.requires_grad_(False)
    chosen = [layers[k - 1] for k in sorted(set(unfrozen))]
    free = [weight for layer in chosen for weight in layer.parameters()]
    for weight in free:
        weight.requires_grad_()
    return free


def hold_back(
    pose: Int[np.ndarray, " rows"], share: float, seed: int
) -> Int[np.ndarray, " poses"]:
    """Draw a share of the poses, at least one if any, never all."""
    poses = np.unique(pose)
    count = 0
    if share > 0.0 and len(poses) > 1:
        count = min(max(round(share * len(poses)), 1), len(poses) - 1)
    return np.sort(np.random.default_rng(seed).permutation(poses)[:count])
