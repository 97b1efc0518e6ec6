"""Bench and claims together: diagnose, calibrate, compare encoders, import, check.

`diagnose` is what a notebook calls: it finds, proves and states what the command
`python -m scenarios.diagnose` does. What else to use when: `diagnosis`, `calibration`
and `compare_encoders` ask one engine and prove what it found, `patching` turns names
into mechanisms, `schema` is the form of diagnosis.json with its verdict,
`next_experiments` says what to measure next. None of these files knows of pages or
folders: `scenarios.report` writes what comes out.
"""

from typing import TYPE_CHECKING

from bench.shared import lazy_names

if TYPE_CHECKING:
    from scenarios.pipelines.patching import patch_of_diagnosis
    from scenarios.report.route import PipelineResult, diagnose

__all__ = ["PipelineResult", "diagnose", "patch_of_diagnosis"]

__getattr__ = lazy_names(
    __name__,
    {
        "PipelineResult": "scenarios.report.route",
        "diagnose": "scenarios.report.route",
        "patch_of_diagnosis": "scenarios.pipelines.patching",
    },
)


def __dir__() -> list[str]:
    return __all__
