"""Contains the parts that the author of an analysis needs; the import loads no large library.

Recordings: :mod:`.source`. Estimators: :mod:`.model`, :mod:`.fit`,
:mod:`.uncertainty`, :mod:`.profile`, :mod:`.identifiability`, :mod:`.residuals`. Results and pages:
:mod:`.result`, :mod:`.parameters`, :mod:`.report`. Calibrations: :mod:`.calibration`.
"""

from rigd.analysis.analysis import Analysis, ChecksTrials, Evaluation, Options
from rigd.model.errors import ConfigError, DataError
from rigd.model.units import format_quantity, parse_quantity, parse_unit, quotient
from rigd.sdk.analysis import ANY_UNIT, Calibratable, Needs

__all__ = [
    "ANY_UNIT",
    "Analysis",
    "Calibratable",
    "ChecksTrials",
    "ConfigError",
    "DataError",
    "Evaluation",
    "Needs",
    "Options",
    "format_quantity",
    "parse_quantity",
    "parse_unit",
    "quotient",
]
