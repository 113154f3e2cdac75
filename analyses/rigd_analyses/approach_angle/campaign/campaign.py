"""Evaluates a campaign, that is, all runs that one analysis evaluates together.

The result has each run by both methods, the maximum of each set (runs that share wheel and angle),
and the trend over the angle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

from rigd_analyses.approach_angle.better.bending import Bending, Sample, fit_bending
from rigd_analyses.approach_angle.better.motion import Motion, motion
from rigd_analyses.approach_angle.better.result import BetterRun
from rigd_analyses.approach_angle.better.run import evaluate, no_numbers, sliding_blocks, usable
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.campaign.sets import evaluate_set
from rigd_analyses.approach_angle.campaign.slip_over_angle import slip_over_angle
from rigd_analyses.approach_angle.campaign.stops import stops_of
from rigd_analyses.approach_angle.campaign.trend import trend
from rigd_analyses.approach_angle.mains import without_mains
from rigd_analyses.approach_angle.paper import PaperSettings, analyse_paper
from rigd_analyses.approach_angle.raw.flags import raw_flags
from rigd_analyses.approach_angle.raw.run_data import Flag, KnownRun, SetReference
from rigd_analyses.approach_angle.result import CampaignResult, SetResult, Trend
from rigd_analyses.approach_angle.run_result import RunResult
from rigd_analyses.approach_angle.shared.balance import balance_errors, excluded_errors
from rigd_analyses.approach_angle.shared.load import load_errors
from rigd_analyses.approach_angle.shared.share import gauge_errors
from rigd_analyses.approach_angle.shared.travel import travel_errors


def analyse_campaign(
    runs: Sequence[KnownRun],
    reference: SetReference | None = None,
    paper: PaperSettings | None = None,
    better: BetterSettings | None = None,
    repeats: int | None = None,
) -> CampaignResult:
    """Return the result of the campaign; never raises for bad runs, in any number.

    ``reference`` is printed beside and never used. ``repeats`` is how often each combination of
    set, load, and voltage was to run; by default up to the highest repeat that was recorded. Sets
    come in the order of their wheels and angles, for any order of the recordings.
    """
    paper, better = paper or PaperSettings(), better or BetterSettings()
    runs = [replace(k, run=without_mains(k.run, k.calibration, better.limits)) for k in runs]
    moved = [_moved(known, better) for known in runs]
    bending = _bending(moved, better)
    results = [
        _both(known, flags, moves, paper, better, bending)
        for known, (flags, moves) in zip(runs, moved, strict=True)
    ]
    balanced, unseen = balance_errors(runs, results)
    shared = (
        *balanced,
        *excluded_errors(runs, results),
        *load_errors(runs, results),
        *gauge_errors(runs, results),
        *travel_errors(runs, results),
    )
    cells = _cells(runs)
    expected = max([k.run.repeat for k in runs], default=1) if repeats is None else repeats
    published = {} if reference is None else reference.values
    sets = tuple(
        evaluate_set(
            name,
            [known for known in runs if known.run.set_name == name],
            [r for r in results if r.run.set_name == name],
            published=published.get(name),
            missing=_missing(name, cells, expected),
            settings=better,
            shared=shared,
            unseen={} if balanced else unseen,
        )
        for name in _set_names(runs)
    )
    trends = _trends(sets)
    return CampaignResult(
        runs=tuple(results),
        sets=sets,
        trends=trends,
        reference="" if reference is None else reference.label,
        statements=(*_statements(runs, bending, better), *_shared_statement(sets)),
        warnings=(
            *(error.sentence for error in shared),
            *_warnings(sets, trends),
            *_stop_warnings(runs),
        ),
        shared=shared,
        slips=slip_over_angle(results),
    )


def _set_names(runs: Sequence[KnownRun]) -> list[str]:
    first = {k.run.set_name: k.run for k in reversed(runs)}
    return sorted(first, key=lambda name: (first[name].wheel, first[name].alpha_rad))


def _moved(known: KnownRun, settings: BetterSettings) -> tuple[tuple[Flag, ...], Motion | None]:
    flags = raw_flags(known.run, known.calibration, known.rig, settings.limits)
    if not usable(known.run, flags):
        return flags, None
    return flags, motion(known, settings)


def _bending(
    moved: Sequence[tuple[tuple[Flag, ...], Motion | None]], settings: BetterSettings
) -> Bending | None:
    return fit_bending(
        [Sample(moves, sliding_blocks(moves, settings)) for _, moves in moved if moves is not None]
    )


def _both(
    known: KnownRun,
    flags: tuple[Flag, ...],
    moves: Motion | None,
    paper: PaperSettings,
    better: BetterSettings,
    bending: Bending | None,
) -> RunResult:
    run, calibration, rig = known.run, known.calibration, known.rig
    by_paper = analyse_paper(run, calibration, rig, paper)
    if moves is None:
        ours: BetterRun = no_numbers(flags)
    else:
        ours = evaluate(moves, better, flags=flags, bending=bending)
    by_code = {flag.code: flag for flag in (*by_paper.flags, *ours.flags)}
    return RunResult(run, by_paper, ours, tuple(by_code.values()))


def _cells(runs: Sequence[KnownRun]) -> Mapping[tuple[str, float, float], int]:
    """Return how often each set, load, and voltage was recorded, 0 if never."""
    sets = dict.fromkeys(known.run.set_name for known in runs)
    loads = sorted({known.run.cell[1] for known in runs})
    voltages = sorted({known.run.voltage_v for known in runs})
    cells = {(s, load, v): 0 for s in sets for load in loads for v in voltages}
    for known in runs:
        cells[known.run.cell] += 1
    return cells


def _missing(
    name: str, cells: Mapping[tuple[str, float, float], int], repeats: int
) -> tuple[str, ...]:
    return tuple(
        f"{load:g} kg at {voltage:g} V: {count} of {repeats} repeats recorded"
        for (set_name, load, voltage), count in cells.items()
        if set_name == name and count < repeats
    )


def _trends(sets: Sequence[SetResult]) -> dict[str, Trend]:
    """Return the trends of that wheel which ran at the most angles."""
    wheels = [s.wheel for s in sets]
    if not wheels:
        return {}
    wheel = max(
        dict.fromkeys(wheels),
        key=lambda w: len({s.alpha_rad for s in sets if s.wheel == w}),
    )
    chosen = sorted((s for s in sets if s.wheel == wheel), key=lambda s: s.alpha_rad)
    sources: dict[str, Callable[[SetResult], float | None]] = {
        "paper": lambda s: s.paper.value,
        "better": lambda s: None if s.maximum is None else s.maximum.value,
        "published": lambda s: s.published,
    }
    found: dict[str, Trend] = {}
    for source, value in sources.items():
        having = [(s, v) for s in chosen if (v := value(s)) is not None]
        u = [s.maximum.u for s, _ in having if s.maximum] if source == "better" else None
        item = trend(
            source, [s.name for s, _ in having], [s.alpha_rad for s, _ in having],
            [v for _, v in having], u,
        )  # fmt: skip
        if item is not None:
            found[source] = item
    return found


def _statements(
    runs: Sequence[KnownRun], bending: Bending | None, settings: BetterSettings
) -> tuple[str, ...]:
    zero = (
        "Too few runs slide steadily to learn the gauges' crosstalk; the zero before the trigger "
        "holds it and is not taken off."
        if bending is None
        else f"The gauges see {1e3 * bending.amplitude:.2f} mN m of bending per N of load, once "
        f"per turn (±{2e3 * bending.u:.2f}, k = 2; learnt from {bending.runs} sliding runs); it "
        "and the zero before the trigger are taken off every run."
    )
    cells = sum(k.run.normal_force_v is not None for k in runs)
    load = "N is what the scale shows before the start, and then " + (
        "what the fast load cell shows more."
        if cells
        else "what it rises by along the travel, as the calibration has it."
    )
    return (
        f"Speeds and accelerations come from a Rauch-Tung-Striebel smoother "
        f"({settings.wheel_cutoff_hz:g} Hz wheel, {settings.platform_cutoff_hz:g} Hz platform) "
        "over the whole record, pre-trigger and post-stop samples included.",
        zero,
        "F_r is the torque at the gauges less wheel inertia, bearing friction, and rolling "
        "resistance, over the effective radius; all by the calibration.",
        load,
        f"Friction is quoted while the wheel slides, in means over {1e3 * settings.block_s:.0f} "
        "ms; elsewhere F_r/N is what the motion asked for.",
        "The maximum of a set is that of one robust curve through the sliding blocks of all its "
        "runs; its uncertainty is the spread between runs and the systematic terms of the budget.",
        "All tables show the rolling-direction coefficient F_r/N unless they name another.",
    )


def _shared_statement(sets: Sequence[SetResult]) -> Iterator[str]:
    shown = [f"{s.name} {s.shared_u:.1%}" for s in sets if s.maximum and s.shared_u > 0.0]
    if shown:
        yield (
            "The interval of each maximum holds what its runs may share and the comparison of all "
            f"runs cannot exclude: u (k = 1) of {', '.join(shown)}."
        )


def _warnings(sets: Sequence[SetResult], trends: Mapping[str, Trend]) -> list[str]:
    found = [f"{s.name}: {text}" for s in sets for text in s.warnings]
    if "better" not in trends:
        found.append("There is no trend over the angle: fewer than three angles have a maximum.")
    return found


def _stop_warnings(runs: Sequence[KnownRun]) -> list[str]:
    stops = stops_of([known.run.run_on for known in runs])
    if not stops.beyond:
        return []
    return [
        f"The wheel ran on to {max(stops.beyond):.1f} rad in {len(stops.beyond)} of {len(runs)} "
        f"runs, at most {stops.limit_rad:g} rad is allowed: give the procedure a larger run_on, "
        "or its potentiometer will come to its end."
    ]
