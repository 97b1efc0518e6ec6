"""Catalogue of effects: what each is called, where it sits, and what it depends on.

One record an effect. Both sides read it: `bench.effects` builds the mechanisms and
`stiffness` detects them. Names, sites, parameters and dependences follow from each
effect's equation, which stands with its source in the effect's own file. Parameters
are in SI; their unit is the end of their name (`width_rad`, `bending_nm2`).

A new effect has one entry in `CATALOGUE`. Fields without a default have to be given:
what an effect depends on, and in which readings it can be seen.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Site = Literal[
    "arm",
    "base",
    "axis",
    "link",
    "flange",
    "tool",
    "wrench_sensor",
    "tracker",
    "rig",
    "marker",
]
Family = Literal["gear", "structure", "weight", "geometry", "rope", "instrument"]
Regressor = Literal[
    "torque", "angle", "load", "direction", "history", "time", "temperature"
]
Readings = Literal["within_visit", "between_visits"]
"""Readings in which an effect can be visible: differences between the rows of a visit,
while the load is applied and removed, or visit means, which depend on the
configuration."""
WITHIN: frozenset[Readings] = frozenset({"within_visit"})
MEANS: frozenset[Readings] = frozenset({"between_visits"})
BOTH: frozenset[Readings] = WITHIN | MEANS
Role = Literal["magnitude", "shape"]

INSTRUMENTS: tuple[Site, ...] = ("wrench_sensor", "rig", "tracker")
"""Sites whose faults can be visible in the readings of all bodies."""

ARCMIN = 2.909e-4
"""In rad."""
CHA = "Harmonic Drive, CHA engineering data 1018854"
CHOSEN = "no source; what is plausible"
SLAMANI = "Slamani et al. 2012, uncalibrated arms"
SENSORS = "makers' data sheets of force sensors"
TUBES = "aluminium tubes of a 10 kg arm"


@dataclass(frozen=True)
class Range:
    """A usual range in SI, with its source."""

    low: float
    high: float
    source: str


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes:
        name: As in answers, patches and flags; its end is its unit.
        role: `magnitude`: a linear amplitude; `shape`: a nonlinear parameter.
        usual: Range in catalogues and calibrations; None: none is known.
        stiffness: Whether it is one: the larger, the less its effect does.
    """

    name: str
    role: Role
    usual: Range | None = None
    stiffness: bool = False


@dataclass(frozen=True)
class EffectInfo:
    """Prior knowledge of an effect: name, sites, parameters and dependences.

    Attributes:
        parameters: Its parameters, in the order in which they are reported.
        depends_on: Quantities that it depends on, by its equation; empty: a constant.
        visible_in: Readings in which it can be seen.
        leaves_out: What the nominal model leaves out, in a sentence for people.
        largest: Largest size that is still physical, in SI; None: no bound is known.
    """

    name: str
    family: Family
    sites: tuple[Site, ...]
    parameters: tuple[Parameter, ...]
    depends_on: tuple[Regressor, ...]
    visible_in: frozenset[Readings]
    leaves_out: str
    largest: float | None = None

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of its shape parameters."""
        return tuple(p.name for p in self.parameters if p.role == "shape")

    @property
    def magnitudes(self) -> tuple[str, ...]:
        """Names of its magnitudes."""
        return tuple(p.name for p in self.parameters if p.role == "magnitude")

    def usual(self, parameter: str) -> Range | None:
        """Return the usual range of a parameter; None where there is none."""
        known = {p.name: p.usual for p in self.parameters}
        return known.get(parameter)


def _magnitudes(
    names: str, low: float | None = None, high: float = 0.0, source: str = ""
) -> tuple[Parameter, ...]:
    usual = None if low is None else Range(low, high, source)
    return tuple(Parameter(name, "magnitude", usual) for name in names.split())


def _shapes(
    names: str, low: float | None = None, high: float = 0.0, source: str = ""
) -> tuple[Parameter, ...]:
    usual = None if low is None else Range(low, high, source)
    return tuple(Parameter(name, "shape", usual) for name in names.split())


SHIFT, TURN = "x_m y_m z_m", "rx_rad ry_rad rz_rad"

_ALL = (
    # in a gear
    EffectInfo(
        "joint_compliance",
        "gear",
        ("axis",),
        _magnitudes(
            "compliance_rad_per_nm", 1e-6, 1e-4, "springs of 10 to 1000 kN m/rad"
        ),
        ("torque",),
        BOTH,
        "the axis winds up in proportion to torque where the model is rigid",
    ),
    EffectInfo(
        "hardening",
        "gear",
        ("axis",),
        (
            *_magnitudes("stiffness_ratio", 1.5, 1.84, f"{CHA}, sizes 14 to 40"),
            *_shapes("torque_nm", 2.0, 108.0, f"{CHA}, T1 of sizes 14 to 58"),
        ),
        ("torque",),
        BOTH,
        "the gear's stiffness rises with torque",
        largest=3.0,
    ),
    EffectInfo(
        "asymmetric_stiffness",
        "gear",
        ("axis",),
        _magnitudes("ratio", 0.7, 1.4, CHOSEN),
        ("torque", "direction"),
        BOTH,
        "the axis is stiffer one way than the other",
        largest=3.0,
    ),
    EffectInfo(
        "lost_motion",
        "gear",
        ("axis",),
        _magnitudes("width_rad", 0.0, ARCMIN, f"{CHA}: below 1 arcmin"),
        ("torque",),
        BOTH,
        "a dead zone or play about zero torque",
        largest=2e-3,
    ),
    EffectInfo(
        "hysteresis",
        "gear",
        ("axis",),
        _magnitudes("width_rad", 0.0, ARCMIN, f"{CHA}: below 1 arcmin"),
        ("torque", "history"),
        BOTH,
        "friction inside the gear: the wind-up depends on the load's path",
        largest=2e-3,
    ),
    EffectInfo(
        "creep",
        "gear",
        ("axis",),
        (
            *_magnitudes("ratio", 0.01, 0.05, CHOSEN),
            *_shapes("time_s", 1.0, 600.0, CHOSEN),
        ),
        ("torque", "time"),
        BOTH,
        "the wind-up goes on growing while the load stands",
        largest=0.5,
    ),
    EffectInfo(
        "angle_dependent_stiffness",
        "gear",
        ("axis",),
        (*_magnitudes("ratio", 0.03, 0.1, CHOSEN), *_shapes("order phase_rad")),
        ("torque", "angle"),
        BOTH,
        "the stiffness varies over the axis' turn",
        largest=0.6,
    ),
    EffectInfo(
        "wrist_coupling",
        "gear",
        ("axis",),
        (*_magnitudes("compliance_rad_per_nm", -1e-5, 1e-5, CHOSEN), *_shapes("with")),
        ("torque",),
        BOTH,
        "torque on one wrist axis turns another",
    ),
    # in bearings, links and the foot
    EffectInfo(
        "bearing_tilt",
        "structure",
        ("axis",),
        (
            *_magnitudes(
                "u_rad_per_nm v_rad_per_nm",
                1.0 / 1800e3,
                1.0 / 44e3,
                "Klimchik 2011 scaled; cross-roller bearings of 44 to 910 kN m/rad",
            ),
            *_shapes("centre_m uv_rad_per_nm compliance_ratio moment_nm"),
        ),
        ("load",),
        BOTH,
        "the bearing gives way about the two directions across the axis",
    ),
    EffectInfo(
        "link_bending",
        "structure",
        ("link",),
        (
            *(
                Parameter(name, "magnitude", Range(1.8e5, 7e5, TUBES), stiffness=True)
                for name in ("bending_nm2", "torsion_nm2")
            ),
            *_shapes("bending_ratio"),
        ),
        ("load",),
        BOTH,
        "the link bends or twists",
    ),
    EffectInfo(
        "base_compliance",
        "structure",
        ("base",),
        (
            *_magnitudes(
                "rx_rad_per_nm ry_rad_per_nm rz_rad_per_nm",
                1e-7,
                1e-6,
                "anchor bolts and pedestals of 1 to 10 MN m/rad",
            ),
            *_magnitudes("x_m_per_n y_m_per_n z_m_per_n"),
            *_shapes("rxy_rad_per_nm"),
        ),
        ("load",),
        BOTH,
        "the foot or the pedestal gives way",
    ),
    # in weight
    EffectInfo(
        "gravity_load",
        "weight",
        ("link", "tool"),
        (*_magnitudes("mass_kg"), *_shapes("com_x_m com_y_m com_z_m")),
        ("load", "angle"),
        MEANS,
        "a mass or its centre differs from the model's",
        largest=15.0,
    ),
    EffectInfo(
        "mass_scale",
        "weight",
        ("arm",),
        _magnitudes("ratio", 0.7, 1.3, CHOSEN),
        ("load", "angle"),
        MEANS,
        "all masses differ from the model's by one factor",
        largest=3.0,
    ),
    EffectInfo(
        "gravity_compensator",
        "weight",
        ("axis",),
        (
            *_magnitudes("torque_nm"),
            *_shapes("phase_rad free_length_ratio arm_ratio"),
        ),
        ("angle",),
        MEANS,
        "a spring or a gas cylinder helps the axis",
        largest=300.0,
    ),
    EffectInfo(
        "deflection_compensation",
        "weight",
        ("axis",),
        _magnitudes("ratio", 0.0, 1.0, "1: what the controller's model says"),
        ("angle",),
        MEANS,
        "the controller takes out a share of the axis' own sag",
        largest=3.0,
    ),
    # in geometry
    EffectInfo(
        "transmission_error",
        "geometry",
        ("axis",),
        (
            *_magnitudes(
                "amplitude_rad", 0.0, 0.6 * ARCMIN, f"{CHA}: half of 1.2 arcmin"
            ),
            *_shapes("order phase_rad"),
        ),
        ("angle",),
        MEANS,
        "the output angle errs with the axis' angle, loaded or not",
        largest=3e-3,
    ),
    EffectInfo(
        "encoder_offset",
        "geometry",
        ("axis",),
        _magnitudes("offset_rad", -1e-3, 1e-3, SLAMANI),
        (),
        MEANS,
        "the reported angle is off by a constant",
        largest=5e-3,
    ),
    EffectInfo(
        "reading_lag",
        "geometry",
        ("axis",),
        _magnitudes("lag_rad share_lag_rad", -1e-3, 1e-3, CHOSEN),
        ("direction",),
        MEANS,
        "the reported angle lags along the last move: the axis rests elsewhere",
        largest=5e-3,
    ),
    EffectInfo(
        "geometry_error",
        "geometry",
        ("link",),
        (
            *_magnitudes(SHIFT, -5e-4, 5e-4, SLAMANI),
            *_magnitudes(TURN, -1e-3, 1e-3, SLAMANI),
        ),
        ("angle",),
        MEANS,
        "a length or an angle of the kinematic model is off",
        largest=5e-3,
    ),
    # in the rope
    EffectInfo(
        "pulley_friction",
        "rope",
        ("rig",),
        _magnitudes("ratio", 0.01, 0.04, "ropemakers: 2 % a sheave"),
        ("load", "direction"),
        BOTH,
        "the rope's tension is not the weight on the hook",
        largest=0.3,
    ),
    # in an instrument
    EffectInfo(
        "wrench_bias",
        "instrument",
        ("wrench_sensor",),
        _magnitudes("fx_n fy_n fz_n tx_nm ty_nm tz_nm"),
        ("load",),
        MEANS,
        "the force sensor reads an offset",
        largest=20.0,
    ),
    EffectInfo(
        "wrench_gain",
        "instrument",
        ("wrench_sensor",),
        _magnitudes("fx fy fz tx ty tz", -0.02, 0.02, SENSORS),
        ("load",),
        BOTH,
        "the force sensor's scale or crosstalk is off",
        largest=0.3,
    ),
    EffectInfo(
        "wrench_misalignment",
        "instrument",
        ("wrench_sensor",),
        (
            *_magnitudes(TURN, -0.0087, 0.0087, CHOSEN),
            *_magnitudes(SHIFT, -1e-3, 1e-3, CHOSEN),
        ),
        ("load", "direction"),
        BOTH,
        "the force sensor is turned or sits beside its place",
        largest=0.1,
    ),
    EffectInfo(
        "tracker_scale",
        "instrument",
        ("tracker",),
        _magnitudes("ratio", -5e-5, 5e-5, CHOSEN),
        ("angle",),
        MEANS,
        "the tracker's scale is off",
        largest=5e-4,
    ),
    EffectInfo(
        "tracker_misalignment",
        "instrument",
        ("tracker",),
        (*_magnitudes(SHIFT), *_magnitudes(TURN)),
        ("angle",),
        MEANS,
        "the tracker's stated frame is off",
        largest=2e-2,
    ),
    EffectInfo(
        "drift",
        "instrument",
        ("tracker", "base"),
        (
            *_magnitudes("x_m_per_h y_m_per_h z_m_per_h", -5e-5, 5e-5, CHOSEN),
            *_magnitudes("rx_rad_per_h ry_rad_per_h rz_rad_per_h"),
            *_shapes("time_s"),
        ),
        ("time",),
        MEANS,
        "readings wander with time",
        largest=1e-2,
    ),
    EffectInfo(
        "marker_slip",
        "instrument",
        ("marker",),
        (*_magnitudes(SHIFT, -2e-5, 2e-5, CHOSEN), *_shapes("time_s")),
        ("time",),
        MEANS,
        "one marker moved on its body during the measurement",
        largest=1e-3,
    ),
    EffectInfo(
        "channel_delay",
        "instrument",
        ("tracker", "wrench_sensor", "axis"),
        _magnitudes("delay_s"),
        ("time", "direction"),
        WITHIN,
        "one channel of a stream lags the others",
    ),
)

CATALOGUE: Mapping[str, EffectInfo] = {info.name: info for info in _ALL}
"""All effects by name, in the order in which they are listed everywhere."""


SI_UNITS = {
    "rad_per_nm": "rad/(N m)",
    "rad_per_h": "rad/h",
    "m_per_n": "m/N",
    "m_per_h": "m/h",
    "nm2": "N m²",
    "nm": "N m",
    "rad": "rad",
    "kg": "kg",
    "m": "m",
    "n": "N",
    "s": "s",
}
"""SI unit of a parameter by the ending of its name; any other has none."""


def si_unit(parameter: str) -> str:
    """Return the SI unit of a parameter; empty where it has none."""
    for ending in sorted(SI_UNITS, key=len, reverse=True):
        if parameter.endswith(f"_{ending}"):
            return SI_UNITS[ending]
    return ""


ALONG = (
    *("joint_compliance", "hardening", "hysteresis", "lost_motion", "encoder_offset"),
    "reading_lag",
)
"""Effects whose parameters are of motion and force along a slide, where the axis is
one: metres and newtons in place of radians and newton metres."""
_ON_SLIDES = {"_rad_per_nm": "_m_per_n", "_rad": "_m", "_nm": "_n"}


def on_slide(effect: str, parameter: str) -> str:
    """Return a parameter's name where the effect's axis slides, as `width_m`."""
    for ending, along in _ON_SLIDES.items():
        if effect in ALONG and parameter.endswith(ending):
            return parameter.removesuffix(ending) + along
    return parameter


def usual(effect: str, parameter: str) -> Range | None:
    """Return the usual range of an effect's parameter; None where there is none."""
    return CATALOGUE[effect].usual(parameter) if effect in CATALOGUE else None


FAR, FARTHEST, BEYOND_ALL = 100.0, 1e4, 1e9
"""Times the largest physical size, times the usual one, and the size in SI of what has
neither, beyond which a number is a mistake; chosen: no estimate comes near them."""


def is_stiffness(effect: str, parameter: str) -> bool:
    """Return whether an effect's parameter is a stiffness."""
    known = CATALOGUE[effect].parameters if effect in CATALOGUE else ()
    return any(p.stiffness for p in known if p.name == parameter)


def limit(effect: str, parameter: str) -> float:
    """Return the size, in SI, beyond which a parameter is no arm's.

    A stiffness has none: the larger it is, the less its effect does.
    """
    if is_stiffness(effect, parameter):
        return float("inf")
    info = CATALOGUE.get(effect)
    if info is None:
        return BEYOND_ALL
    along = {on_slide(effect, p.name): p.name for p in info.parameters}
    parameter = along.get(parameter, parameter)
    if info.largest is not None and parameter in info.magnitudes:
        return FAR * info.largest
    known = info.usual(parameter)
    return BEYOND_ALL if known is None else FARTHEST * known.high
