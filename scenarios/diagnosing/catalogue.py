"""Catalogues say how large an effect usually is; beyond that one looks twice."""

from collections.abc import Mapping
from dataclasses import dataclass

ARCMIN = 2.909e-4
"""In rad."""
CHA = "Harmonic Drive, CHA engineering data 1018854"
CHOSEN = "no source; what is plausible"
KIN = "Slamani et al. 2012, uncalibrated arms"
MAKERS = "makers' data sheets of force sensors"


@dataclass(frozen=True)
class Usual:
    """A range in SI and where it comes from."""

    low: float
    high: float
    source: str


def _all(names: str, low: float, high: float, source: str) -> dict[str, Usual]:
    return {name: Usual(low, high, source) for name in names.split()}


USUAL: Mapping[str, Mapping[str, Usual]] = {
    "joint_compliance": _all(
        "compliance_rad_per_nm", 1e-6, 1e-4, "springs of 10 to 1000 kN m/rad"
    ),
    "hardening": {
        "stiffness_ratio": Usual(1.5, 1.84, f"{CHA}, sizes 14 to 40"),
        "torque_nm": Usual(2.0, 108.0, f"{CHA}, T1 of sizes 14 to 58"),
    },
    "asymmetric_stiffness": _all("ratio", 0.7, 1.4, CHOSEN),
    "lost_motion": _all("width_rad", 0.0, ARCMIN, f"{CHA}: below 1 arcmin"),
    "hysteresis": _all("width_rad", 0.0, ARCMIN, f"{CHA}: below 1 arcmin"),
    "creep": {
        "ratio": Usual(0.01, 0.05, CHOSEN),
        "time_s": Usual(1.0, 600.0, CHOSEN),
    },
    "angle_dependent_stiffness": _all("ratio", 0.03, 0.1, CHOSEN),
    "transmission_error": _all(
        "amplitude_rad", 0.0, ARCMIN, f"{CHA}: 1 arcmin from peak to peak"
    ),
    "bearing_tilt": _all(
        "u_rad_per_nm v_rad_per_nm",
        1.0 / 1800e3,
        1.0 / 44e3,
        "Klimchik 2011 scaled; cross-roller bearings of 44 to 910 kN m/rad",
    ),
    "wrist_coupling": _all("compliance_rad_per_nm", -1e-5, 1e-5, CHOSEN),
    "encoder_offset": _all("offset_rad", -1e-3, 1e-3, KIN),
    "link_bending": _all(
        "bending_nm2 torsion_nm2", 1.8e5, 7e5, "aluminium tubes of a 10 kg arm"
    ),
    "geometry_error": _all("x_m y_m z_m", -5e-4, 5e-4, KIN)
    | _all("rx_rad ry_rad rz_rad", -1e-3, 1e-3, KIN),
    "base_compliance": _all(
        "rx_rad_per_nm ry_rad_per_nm rz_rad_per_nm",
        1e-7,
        1e-6,
        "anchor bolts and pedestals of 1 to 10 MN m/rad",
    ),
    "wrench_gain": _all("fx fy fz tx ty tz", -0.02, 0.02, MAKERS),
    "wrench_misalignment": _all("rx_rad ry_rad rz_rad", -0.0087, 0.0087, CHOSEN)
    | _all("x_m y_m z_m", -1e-3, 1e-3, CHOSEN),
    "pulley_friction": _all("ratio", 0.01, 0.04, "ropemakers: 2 % a sheave"),
    "tracker_scale": _all("ratio", -5e-5, 5e-5, CHOSEN),
    "drift": _all("x_m_per_h y_m_per_h z_m_per_h", -5e-5, 5e-5, CHOSEN),
    "marker_slip": _all("x_m y_m z_m", -2e-5, 2e-5, CHOSEN),
}


def usual(effect: str, parameter: str) -> Usual | None:
    """Return the usual range of a parameter; None where there is none."""
    return USUAL.get(effect, {}).get(parameter)
