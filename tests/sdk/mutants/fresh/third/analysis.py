"""Mistakes in an analysis of coasting trials."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "samples that are missing count as speed zero",
        "a gap in the recording is a stop and a start: the friction of the trial is nonsense",
        (
            (
                "        raise DataError(\n"
                '            f"{sweep.path}: in trial {trial.number} samples of the speed are not'
                ' finite",\n'
                '            hint="rigd report draws the recording",\n'
                "        )\n",
                '        signals = {"speed": np.nan_to_num(signals["speed"])}\n',
            ),
        ),
        file="evaluation",
    ),
    Fresh(
        "masses are remembered by the number of the trial",
        "the second recording is evaluated with the masses of the first",
        (
            ("BLOCK_S = 0.05\n", "BLOCK_S = 0.05\n_MASSES: dict[int, float] = {}\n"),
            (
                '-sweep.constant(trial, "mass") * slope',
                '-_MASSES.setdefault(trial.number, sweep.constant(trial, "mass")) * slope',
            ),
        ),
        file="evaluation",
    ),
    Fresh(
        "friction by speed is at most what was seen so far",
        "a body with more of it gets the bound as its value, and a constant that makes up for it",
        (
            (
                'FitParameter("viscous", "N s/m", 1e-4, 1e3, 1.0)',
                'FitParameter("viscous", "N s/m", 1e-4, 3.0, 1.0)',
            ),
        ),
        file="evaluation",
    ),
    Fresh(
        "short trials are left out without a word",
        "the operator repeats slow trials, and none of them counts; if all are short it crashes",
        (
            (
                "        trials = tuple(response(sweep, trial) for sweep, trial in group.trials)\n",
                "        trials = tuple(response(sweep, trial) for sweep, trial in group.trials)\n"
                "        trials = tuple(each for each in trials if np.sum(each.used) >= 16)\n",
            ),
        ),
        file="evaluation",
    ),
    Fresh(
        "speed is smoothed first, as if it were zero outside",
        "the first block of each trial seems to gain speed: friction is found too small",
        (
            (
                'lines(t_s, signals["speed"])',
                'lines(t_s, np.convolve(signals["speed"], np.ones(25) / 25.0, "same"))',
            ),
        ),
        file="evaluation",
    ),
    Fresh(
        "friction of a block belongs to the speed at its begin",
        "friction at any speed is found too small, by more than its interval in good recordings",
        (("        x=speed,\n", "        x=speed - 0.5 * BLOCK_S * slope,\n"),),
        file="evaluation",
    ),
    Fresh(
        "each group has the trials of those before it",
        "the friction of the second load is a mean of the first and the second",
        (
            ("    fitted = []\n", "    fitted = []\n    trials: tuple[ResponseTrial, ...] = ()\n"),
            (
                "        trials = tuple(response(sweep, trial) for sweep, trial in group.trials)\n",
                "        trials += tuple(response(sweep, each) for sweep, each in group.trials)\n",
            ),
        ),
        file="evaluation",
    ),
)
