"""Mistakes in an analysis of a body that slides to rest."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_TRIALS = "        trials = tuple(response(sweep, trial) for sweep, trial in group.trials)\n"
_FINITE = '    if not np.all(np.isfinite(signals["speed"])):\n'

MUTANTS = (
    Fresh(
        "the mass is that of the first trial",
        "in a sweep of masses every friction but the first is scaled wrongly",
        (
            (
                '-sweep.constant(trial, "mass") * slope',
                '-sweep.constant(sweep.trials[0], "mass") * slope',
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "samples are taken to be 1 ms apart",
        "a recording at 500 Hz gives half or twice the friction",
        (
            (
                "    times = t_s[: count * size].reshape(count, size)\n",
                "    times = 1e-3 * np.arange(count * size).reshape(count, size)\n",
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "trials are kept by their number",
        "of two recordings evaluated together the trials of the first are lost",
        (
            (
                _TRIALS,
                _TRIALS
                + "        trials = tuple({trial.label: trial for trial in trials}.values())\n",
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "the seed is fixed",
        "the option for the seed is accepted and ignored: another seed shows nothing",
        (
            (
                "import numpy as np\n",
                "from dataclasses import replace\n\nimport numpy as np\n",
            ),
            (
                "identify_response(model, WORDING, options, account(group))",
                "identify_response(model, WORDING, replace(options, seed=1), account(group))",
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "samples that are not finite count as rest",
        "a sensor that fails in a trial gives friction that nobody measured",
        (
            (
                _FINITE,
                '    signals["speed"] = np.nan_to_num(signals["speed"])\n' + _FINITE,
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "a trial that cannot be evaluated is left out",
        "a result of two trials passes for one of three, without a word",
        (
            (
                _TRIALS,
                "        usable = []\n"
                "        for sweep, trial in group.trials:\n"
                "            try:\n"
                "                usable.append(response(sweep, trial))\n"
                "            except DataError:\n"
                "                continue\n"
                "        trials = tuple(usable)\n",
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "the speed of a block is that of its first sample",
        "friction is assigned to a speed that is too high: constant friction is too low",
        (("values.mean(axis=1), slope", "values[:, 0], slope"),),
        "evaluation",
    ),
    Fresh(
        "a derivative of the model has a wrong unit",
        "the derivative by c is per 10 m/s: intervals of c are ten times too wide",
        (
            (
                "np.stack([np.ones_like(speed), speed], axis=1)",
                "np.stack([np.ones_like(speed), 0.1 * speed], axis=1)",
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "the warm-up trial is left out",
        "the first trial of each group does not count, and no line of the report says so",
        (
            (
                "for sweep, trial in group.trials)\n        scale",
                "for sweep, trial in group.trials[1:])\n        scale",
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "the interval takes each sample of a block as a measurement",
        "50 samples give one slope, and count 50 times: intervals are seven times too narrow",
        (
            (
                "    return middle, values.mean(axis=1), slope\n",
                "    return (\n"
                "        t_s[: count * size],\n"
                "        np.repeat(values.mean(axis=1), size),\n"
                "        np.repeat(slope, size),\n"
                "    )\n",
            ),
        ),
        "evaluation",
    ),
)
