"""Fits any installed friction law to the slip and traction of method A, and compares all of them.

Both have errors (errors-in-variables), which move sigma_1 under any law; see :mod:`.preprocess`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rigd.analysis import ConfigError, Options
from rigd.analysis.friction import SlipForce
from rigd.analysis.friction.identify import SlipData, compare_laws, identify_law
from rigd.analysis.friction.registry import find_law, installed_laws
from rigd.analysis.result import IdentificationResult, ModelComparison
from rigd_analyses.lugre.curve import RESOLVED
from rigd_analyses.lugre.laws.lugre import Lugre, Lugre4
from rigd_analyses.lugre.slip_force.identify import METHOD, Settings, trial_fits
from rigd_analyses.lugre.slip_force.verdicts import BIASES
from rigd_analyses.lugre.trials.slip_and_traction import ProcessedSweep, process
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial

#: The law whose parameters are identified without `--law`, by functions made for it.
LUGRE = "lugre"


def identify_by_law(
    trials: Sequence[LugreTrial], constants: LugreConstants, settings: Settings, options: Options
) -> IdentificationResult:
    """Return the parameters of the law that ``options`` name.

    Raises:
        ConfigError: no such law is installed, or it cannot be used.
        DataError: the recordings cannot answer.
    """
    return identify_law(
        options.law, find_law(options.law), _slip_data(trials, constants, settings), options
    )


def compare_by_law(
    trials: Sequence[LugreTrial], constants: LugreConstants, settings: Settings, options: Options
) -> tuple[ModelComparison, tuple[str, ...]]:
    """Return which installed laws the data support, and a sentence on each that cannot be used.

    Raises:
        ConfigError: a robust loss is asked for.
        DataError: the recordings cannot answer.
    """
    if options.robust:
        raise ConfigError(
            "--compare: BIC needs the least squares", hint="leave out --robust, or --compare"
        )
    laws, broken = installed_laws()
    return compare_laws(laws, _slip_data(trials, constants, settings), options), broken


def _slip_data(
    trials: Sequence[LugreTrial], constants: LugreConstants, settings: Settings
) -> SlipData:
    sweep = process(trials, constants, settings.guards)
    guards = [
        replace(settings.guards, window_s=settings.guards.window_s + step)
        for step in settings.window_steps_s
    ]
    return SlipData(
        trials=_samples(sweep),
        title="Friction of the omni-wheel",
        method=METHOD,
        account=sweep.account,
        window_s=settings.guards.window_s,
        least_slip_m_s=RESOLVED * max(trial.slip_noise_m_s for trial in sweep.trials),
        shown=lambda predicted: trial_fits(sweep, predicted),
        others=tuple(_samples(process(trials, constants, other)) for other in guards),
        biases=BIASES,
        rivals={LUGRE: Lugre, "lugre-4": Lugre4},
    )


def _samples(sweep: ProcessedSweep) -> tuple[SlipForce, ...]:
    return tuple(trial.samples for trial in sweep.trials)
