"""Mistakes in the analysis that `rigd new analysis` writes."""

from __future__ import annotations

from sdk.mutants.known import Mutant

_TRUTH = "recovers the truth"
_BYTES = "gives the same bytes for the same input"
_REFUSES = "refuses what it cannot read"
_DECLARES = "declares what it needs"
_LIGHT = "is checked without its numerics"
_MEASURED = 'measured=-sweep.constant(trial, "mass") * slope'
_FINITE = '    if not np.all(np.isfinite(signals["speed"])):\n        raise DataError('
_SHORT = "    if count < 2:\n        raise DataError("
_FIT = "        result = identify_response(model, WORDING, options, account(group))\n"
_QUOTED = (
    _FIT
    + "        from dataclasses import replace\n"
    + "        from rigd.analysis.result import Verdict\n"
    + "        KNOWN = Verdict.IDENTIFIABLE\n"
    + "        result = replace(result, parameters=tuple({}))\n"
)

MUTANTS = (
    # units, signs, constants
    Mutant(
        "sign of the slope", _TRUTH, _MEASURED, _MEASURED.replace("-sweep", "sweep"), "evaluation"
    ),
    Mutant(
        "mass in grams",
        _TRUTH,
        _MEASURED,
        _MEASURED.replace("* slope", "* 1e3 * slope"),
        "evaluation",
    ),
    Mutant("mass left out", _TRUTH, _MEASURED, "measured=-slope", "evaluation"),
    Mutant("speed in mm/s", _TRUTH, "        x=speed,\n", "        x=1e3 * speed,\n", "evaluation"),
    Mutant(
        "mass of our rig",
        "uses the constants of the rig",
        _MEASURED,
        "measured=-2.0 * slope",
        "evaluation",
    ),
    Mutant(
        "rest counted as sliding",
        _TRUTH,
        "used=np.minimum.accumulate(speed > SLIDING_M_S)",
        "used=np.ones(len(speed), bool)",
        "evaluation",
    ),
    Mutant(
        "slope per sample of our card",
        "does not depend on the rate",
        "np.sum(since * values, axis=1) / np.sum(since**2, axis=1)",
        "1e3 * (t_s[1] - t_s[0]) * np.sum(since * values, axis=1) / np.sum(since**2, axis=1)",
        "evaluation",
    ),
    # intervals
    Mutant(
        "every block counted often",
        _TRUTH,
        _FIT,
        _QUOTED.format(
            "replace(p, low=p.estimate * (1 + 1e-7), high=p.estimate * (1 + 2e-7))"
            " for p in result.parameters"
        ),
        "evaluation",
    ),
    Mutant(
        "interval beside the truth",
        _TRUTH,
        _FIT,
        _QUOTED.format(
            "replace(p, low=p.low and 1.5 * p.low, high=p.high and 1.5 * p.high)"
            " for p in result.parameters"
        ),
        "evaluation",
    ),
    Mutant(
        "interval without bounds",
        _TRUTH,
        _FIT,
        _QUOTED.format("replace(p, low=-1e3, high=1e3) for p in result.parameters"),
        "evaluation",
    ),
    Mutant(
        "number without information",
        _TRUTH,
        _FIT,
        _QUOTED.format(
            "replace(p, low=0.9 * p.estimate, high=1.1 * p.estimate, verdict=KNOWN)"
            " for p in result.parameters"
        ),
        "evaluation",
    ),
    Mutant(
        "nothing is quoted",
        _TRUTH,
        _FIT,
        _QUOTED.format("replace(p, low=None, high=None) for p in result.parameters"),
        "evaluation",
    ),
    # determinism, state, seed
    Mutant(
        "unseeded draw",
        _BYTES,
        _MEASURED,
        _MEASURED + " + 1e-9 * np.random.default_rng().standard_normal(len(slope))",
        "evaluation",
    ),
    Mutant(
        "trials of the evaluation before",
        _BYTES,
        "        trials = tuple(response(sweep, trial) for sweep, trial in group.trials)\n",
        "        kept = evaluate.__dict__.setdefault('kept', [])\n"
        "        kept.extend(response(sweep, trial) for sweep, trial in group.trials)\n"
        "        trials = tuple(kept)\n",
        "evaluation",
    ),
    Mutant(
        "seed of the clock",
        _BYTES,
        _MEASURED,
        _MEASURED + " * (1 + 1e-9 * (__import__('time').time_ns() % 1000))",
        "evaluation",
    ),
    # what cannot be read
    Mutant(
        "NaN taken for zero",
        _REFUSES,
        _FINITE,
        '    signals["speed"] = np.nan_to_num(signals["speed"]) + 1.0 - t_s\n'
        "    if False:\n        raise DataError(",
        "evaluation",
    ),
    Mutant(
        "NaN raises a ValueError",
        _REFUSES,
        _FINITE,
        _FINITE.replace("DataError(", "(lambda text, hint: ValueError(text))("),
        "evaluation",
    ),
    Mutant(
        "refused without a sentence",
        _REFUSES,
        _FINITE,
        _FINITE.replace("DataError(", "(lambda text, hint: DataError('no'))("),
        "evaluation",
    ),
    Mutant(
        "crash on a short trial",
        _REFUSES,
        _SHORT,
        "    if False:\n        raise DataError(",
        "evaluation",
    ),
    # declarations
    Mutant(
        "unit unknown", _DECLARES, '{"speed": "m/s"}', '{"speed": "parsec per week"}', "analysis"
    ),
    Mutant("no signal", _DECLARES, '{"speed": "m/s"}', "{}", "analysis"),
    Mutant(
        "no docstring",
        _DECLARES,
        '    """Friction of a body that slides to rest: a constant force, '
        'and one in proportion to speed."""\n',
        "",
        "analysis",
    ),
    Mutant(
        "numerics at import",
        _LIGHT,
        "from rigd.analysis import Analysis",
        "import scipy.optimize\nfrom rigd.analysis import Analysis",
        "analysis",
    ),
)
