"""Arm of the study: effects of its gears, bearings, links and base.

Every number has its source, or "chosen". The catalogue is Harmonic
Drive's CHA engineering data 1018854 (torsional stiffness, hysteresis loss below 1
arcmin); which gears a KR10 has is not published, the sizes follow from the axes' effort
limits (288, 312, 120, 46, 42, 28 N m). Within what the catalogue allows, sizes were
calibrated so that a six-spring fit to the experiment leaves errors of the size of Table
2 of Wu et al. 2024. No method may import this file.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from jaxtyping import Float

from bench.effects.angle_dependent_stiffness import AngleDependentStiffness
from bench.effects.base_compliance import BaseCompliance
from bench.effects.bearing_tilt import BearingTilt
from bench.effects.creep import Creep
from bench.effects.effect import Effect
from bench.effects.hardening import Hardening
from bench.effects.hysteresis import Hysteresis
from bench.effects.link_bending import LinkBending

ARCMIN = pi / 180 / 60

GEARS = {
    # axis: K1, K2, K3 in kN m/rad and T1, T2 in N m
    "a1": ((54.0, 78.0, 98.0), (29.0, 108.0)),  # size 32, ratio 50
    "a2": ((54.0, 78.0, 98.0), (29.0, 108.0)),  # size 32, ratio 50
    "a3": ((31.0, 50.0, 57.0), (14.0, 48.0)),  # size 25, ratio above 50
    "a4": ((10.0, 14.0, 16.0), (3.9, 12.0)),  # size 17, ratio above 50
    "a5": ((10.0, 14.0, 16.0), (3.9, 12.0)),  # size 17, ratio above 50
    "a6": ((3.4, 4.7, 5.7), (2.0, 6.9)),  # size 14, ratio 50
}
HYSTERESIS_ARCMIN = 0.3  # catalogue: below 1
TILT_NM_PER_RAD = {
    # chosen, each within a factor of two of cross-roller bearings of 44 (size 14), 78
    # (17) to 910 kN m/rad (40), from memory of the CSF-2UH list; A4 and A5 are softer
    # than theirs, A1 stiffer than any: a robot's main bearing is larger
    "a1": 1800e3,
    "a2": 900e3,
    "a3": 400e3,
    "a4": 62e3,
    "a5": 62e3,
    "a6": 44e3,
}
BASE_NM_PER_RAD = 2e6  # chosen: between an aluminium table and a steel pedestal
RIPPLE, RIPPLE_ORDER = 0.09, 2.0  # chosen: an estimate for strain waves is 3 to 10 %
CREEP, CREEP_TIME = 0.02, 20.0  # chosen: 1 to 5 %, no source for a gear
LINKS = {
    # EI and GJ in N m² of aluminium tubes of the links' size: 150 x 8 and 120 x 6 mm
    "link_2": (6.3e5, 4.7e5),
    "link_4": (2.45e5, 1.82e5),
}


@dataclass(frozen=True)
class Truth:
    """True effects and stiffness of an arm.

    Attributes:
        stiffness: Stiffness of the axes' springs at small torque, in N m/rad.
    """

    effects: tuple[Effect, ...]
    stiffness: Float[np.ndarray, " axes"]


def default_truth() -> Truth:
    """Return the truth of the study's KR10."""
    effects: list[Effect] = [
        BaseCompliance(
            "base", rx_rad_per_nm=1 / BASE_NM_PER_RAD, ry_rad_per_nm=1 / BASE_NM_PER_RAD
        )
    ]
    for link, (bending, torsion) in LINKS.items():
        effects.append(LinkBending(link, bending_nm2=bending, torsion_nm2=torsion))
    for i, (axis, ((k1, k2, k3), (t1, t2))) in enumerate(GEARS.items()):
        tilt = 1 / TILT_NM_PER_RAD[axis]
        effects += [
            Hardening(
                axis,
                stiffness_ratio=k3 / k1,
                torque_nm=t1,
                middle_share=(k2 - k1) / (k3 - k1),
                second_torque=t2 / t1,
            ),
            Hysteresis(axis, width_rad=HYSTERESIS_ARCMIN * ARCMIN),
            Creep(axis, ratio=CREEP, time_s=CREEP_TIME),
            AngleDependentStiffness(
                axis, ratio=RIPPLE, order=RIPPLE_ORDER, phase_rad=float(i)
            ),
            BearingTilt(axis, u_rad_per_nm=tilt, v_rad_per_nm=tilt),
        ]
    k1 = np.array([stiffness[0] for stiffness, _ in GEARS.values()])
    return Truth(tuple(effects), 1e3 * k1)
