"""Everything that can be claimed: methods that predict, and the diagnosis.

The names of this file are what a notebook needs of it; each is imported when it is
used first, and Pinocchio or torch with it.
"""

from typing import TYPE_CHECKING

from bench.shared import lazy_names

if TYPE_CHECKING:
    from stiffness.calibration.result import Calibrated, calibrate
    from stiffness.diagnosis.diagnose import diagnose
    from stiffness.diagnosis.result import Decision, Diagnosis
    from stiffness.methods.gp_residual import GpResidual
    from stiffness.methods.method import Fitted, Method, Rigid
    from stiffness.methods.transferred_networks import DtCnn, FtMlp
    from stiffness.methods.vjm import Vjm
    from stiffness.robot.arm import Arm

__all__ = [
    "Arm",
    "Calibrated",
    "Decision",
    "Diagnosis",
    "DtCnn",
    "Fitted",
    "FtMlp",
    "GpResidual",
    "Method",
    "Rigid",
    "Vjm",
    "calibrate",
    "diagnose",
]

__getattr__ = lazy_names(
    __name__,
    {
        "Arm": "stiffness.robot.arm",
        "Calibrated": "stiffness.calibration.result",
        "Decision": "stiffness.diagnosis.result",
        "Diagnosis": "stiffness.diagnosis.result",
        "DtCnn": "stiffness.methods.transferred_networks",
        "Fitted": "stiffness.methods.method",
        "FtMlp": "stiffness.methods.transferred_networks",
        "GpResidual": "stiffness.methods.gp_residual",
        "Method": "stiffness.methods.method",
        "Rigid": "stiffness.methods.method",
        "Vjm": "stiffness.methods.vjm",
        "calibrate": "stiffness.calibration.result",
        "diagnose": "stiffness.diagnosis.diagnose",
    },
)


def __dir__() -> list[str]:
    return __all__
