"""The thresholds of output error: from where on a fit counts as ended, wrong, explained or refused.

Each field names its kind and its unit: ``max_p_value_...`` is a chance of a false alarm,
``min_gain_...`` a gain in -2 ln L, ``..._sd`` are standard errors, ``..._mean_square`` is that of
whitened residuals (1 if model and noise are right), ``..._cost`` is in ln L, ``..._share`` a part
of something.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class OutputErrorThresholds:
    """Where fit, diagnosis, judgement and tests of agreement decide."""

    # -- The fit ends (:mod:`.estimator`) --
    #: Relative decrease of the cost below which a fit ends.
    min_decrease: float = 1e-7
    #: And below which one ends that is repeated with a better filter of the noise.
    min_decrease_rough: float = 1e-5
    #: And on a few trials, which rank the starts.
    min_decrease_ranking: float = 1e-2
    #: In scaled coordinates: two starts have ended in one optimum.
    max_distance_one_optimum: float = 0.05
    #: The same while starts are ranked.
    max_distance_one_optimum_ranking: float = 0.2
    #: An optimum that is so much worse does not come back.
    max_cost_behind_best: float = 30.0
    #: That an estimate may have left to go: where slip turns its sign the cost has kinks, and 0.4
    #: was seen at a point from which no step leads down.
    max_left_sd: float = 0.5
    #: Beyond which a fit is continued.
    max_left_settled_sd: float = 0.1
    #: A gain that is worth another fit.
    min_cost_gained: float = 0.5
    #: Beyond which no fit is continued: a lower cost shows less of why it is wrong.
    max_mean_square_continued: float = 10.0
    #: Information on a scaled parameter below which it is not seen.
    min_information: float = 1e-9
    #: Share of a parameter's or column's information below which nothing is its own.
    min_own_share: float = 1e-9

    # -- What explains a misfit (:mod:`.diagnosis`) --
    #: Of one false alarm in the tests of all candidates together; of that of a band or a jump.
    max_p_value_cause: float = 0.005
    #: Less what chance gains, below which no constant is left to the data.
    min_gain_constant: float = 20.0
    #: The same of what no file states. In 97 wrong worlds of a second author the three names below
    #: it were wrong: they are what wrong constants leave to second order. 34 of 41 above are right.
    min_gain_suspect: float = 100.0
    #: Of the best gain, from which a thing with a name is preferred to a dependence.
    min_named_share: float = 0.7
    #: Of the best gain, from which another explanation is worth a word.
    min_rival_share: float = 0.9
    #: By which the data prefer one explanation to another (95 % of chi-squared).
    min_gain_told_apart: float = 3.84
    #: Of a constant's variance that the data must take away.
    min_determined_share: float = 1e-3
    #: Of an output, beyond which nothing is fitted: its size would be chance.
    max_mean_square_explained: float = 1e4
    #: Of all outputs, up to which the optimum is taken for the right one.
    max_mean_square_right: float = 1.5
    #: Of a mean square above ``max_mean_square_right`` that a cause may leave: half of the misfit
    #: in its units.
    max_left_share: float = 0.25
    #: Below which what was fitted has no size.
    min_size_sd: float = 2.0

    # -- Whether numbers may be given (:mod:`.gate`) --
    #: Of its own uncertainties: a constant that the data move by more is another one.
    max_pull: float = 8.0
    #: Of an output.
    max_mean_square_output: float = 1.5
    #: Of an output in its worst trial.
    max_mean_square_trial: float = 2.5

    # -- Whether trials and groups agree (:mod:`.homogeneity`, :mod:`.joint`) --
    #: Of each test of agreement, if nothing differs.
    max_p_value_agreement: float = 1e-4
    #: Of what differs between trials that a trend must explain to be one.
    min_trend_share: float = 0.7
    #: Of one false alarm in the tests of all shared constants, if no group differs.
    max_p_value_shared: float = 1e-4
    #: Of the information that is stated of a constant: data that show less show nothing.
    min_shown_share: float = 1e-6
    #: Within which groups must agree on each constant.
    max_apart_sd: float = 0.1


THRESHOLDS = OutputErrorThresholds()
