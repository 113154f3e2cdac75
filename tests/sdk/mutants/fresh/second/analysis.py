"""Mistakes in an analysis of a body that slides to rest."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "the mass of the first trial counts for all",
        "with weights added from trial to trial the friction is wrong by their ratio",
        (
            (
                'sweep.constant(trial, "mass")',
                'sweep.constant(sweep.trials[0], "mass")',
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "blocks count until the speed is below zero",
        "blocks at rest are fitted as sliding: the constant friction comes out too low",
        (
            (
                "np.minimum.accumulate(speed > SLIDING_M_S)",
                "np.minimum.accumulate(speed > 0.0)",
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "slopes are taken as of samples at 1 kHz",
        "a recording at 500 Hz gives twice the friction",
        (
            (
                "    since = times - middle[:, None]\n",
                "    since = (np.arange(size) - 0.5 * (size - 1)) * np.ones((count, 1)) / 1000.0\n",
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "the fit does not get the options",
        "--robust, --starts and --seed change nothing",
        (
            (
                "identify_response(model, WORDING, options, account(group))",
                "identify_response(model, WORDING, Options(), account(group))",
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "the names of the two parameters are exchanged in the report",
        "the report shows the viscous friction as F_c and the constant one as c",
        (
            (
                '        ResponseQuantity("F_c", "friction at any speed", FASTER),\n'
                '        ResponseQuantity("c", "friction in proportion to the speed", FASTER),\n',
                '        ResponseQuantity("c", "friction in proportion to the speed", FASTER),\n'
                '        ResponseQuantity("F_c", "friction at any speed", FASTER),\n',
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "the derivative by the viscous friction has a factor too much",
        "the uncertainty of c is wrong by the value of c",
        (
            (
                "np.stack([np.ones_like(speed), speed], axis=1)",
                "np.stack([np.ones_like(speed), theta[1] * speed], axis=1)",
            ),
        ),
        "evaluation",
    ),
    Fresh(
        "missing samples count as rest",
        "one NaN in the speed, and the friction of its block is off by orders; no error",
        (
            (
                '    if not np.all(np.isfinite(signals["speed"])):\n'
                "        raise DataError(\n"
                '            f"{sweep.path}: in trial {trial.number}'
                ' samples of the speed are not finite",\n'
                '            hint="rigd report draws the recording",\n'
                "        )\n",
                '    signals = {**signals, "speed": np.nan_to_num(signals["speed"])}\n',
            ),
        ),
        "evaluation",
    ),
)
