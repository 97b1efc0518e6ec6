"""The physics that simulations of arms leave out, one hypothesis a file."""

from stiffness.diagnosis.hypotheses.angle_dependent_stiffness import (
    AngleDependentStiffness,
)
from stiffness.diagnosis.hypotheses.asymmetric_stiffness import AsymmetricStiffness
from stiffness.diagnosis.hypotheses.base_compliance import BaseCompliance
from stiffness.diagnosis.hypotheses.base_tilt import BaseTilt
from stiffness.diagnosis.hypotheses.bearing_tilt import BearingTilt
from stiffness.diagnosis.hypotheses.channel_delay import ChannelDelay
from stiffness.diagnosis.hypotheses.creep import Creep
from stiffness.diagnosis.hypotheses.drift import Drift
from stiffness.diagnosis.hypotheses.encoder_offset import EncoderOffset
from stiffness.diagnosis.hypotheses.geometry_error import GeometryError
from stiffness.diagnosis.hypotheses.gravity_compensator import GravityCompensator
from stiffness.diagnosis.hypotheses.gravity_load import GravityLoad
from stiffness.diagnosis.hypotheses.hardening import Hardening
from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.hypotheses.hysteresis import Hysteresis
from stiffness.diagnosis.hypotheses.joint_compliance import JointCompliance
from stiffness.diagnosis.hypotheses.link_bending import LinkBending
from stiffness.diagnosis.hypotheses.lost_motion import LostMotion
from stiffness.diagnosis.hypotheses.marker_slip import MarkerSlip
from stiffness.diagnosis.hypotheses.pulley_friction import PulleyFriction
from stiffness.diagnosis.hypotheses.tracker_misalignment import TrackerMisalignment
from stiffness.diagnosis.hypotheses.tracker_scale import TrackerScale
from stiffness.diagnosis.hypotheses.transmission_error import TransmissionError
from stiffness.diagnosis.hypotheses.wrench_bias import WrenchBias
from stiffness.diagnosis.hypotheses.wrench_gain import WrenchGain
from stiffness.diagnosis.hypotheses.wrench_misalignment import WrenchMisalignment
from stiffness.diagnosis.hypotheses.wrist_coupling import WristCoupling

HYPOTHESES: tuple[Hypothesis, ...] = (
    # in a gear
    JointCompliance(),
    Hardening(),
    AsymmetricStiffness(),
    LostMotion(),
    Hysteresis(),
    Creep(),
    AngleDependentStiffness(),
    WristCoupling(),
    # in bearings, links and the foot
    BearingTilt(),
    LinkBending(),
    BaseTilt(),
    BaseCompliance(),
    # in weight
    GravityLoad(),
    GravityCompensator(),
    # in geometry
    TransmissionError(),
    EncoderOffset(),
    GeometryError(),
    # in the rope and the force sensor
    PulleyFriction(),
    WrenchBias(),
    WrenchGain(),
    WrenchMisalignment(),
    # in what is seen, and when
    TrackerScale(),
    TrackerMisalignment(),
    Drift(),
    MarkerSlip(),
    ChannelDelay(),
)
"""Every effect that can be named; one may read and grep it.

Two laws may have one name: a base that tips is a base that gives way.
"""
