"""Adds to each unit its factor to SI, for the page."""

from __future__ import annotations

from rigd.model.units import parse_unit
from rigd.panel.rig import Object


def with_factor(told: Object) -> Object:
    """Return ``told`` with the ``factor`` that turns a value in its ``unit`` into SI.

    A prompt has its bounds in SI and a person who reads them in the unit; the other way round for
    the answer.
    """
    return told | {"factor": parse_unit(told["unit"]).factor}


def complete_status(status: Object) -> Object:
    """Return a status whose prompt, if there is one, says its factor."""
    prompt = status["prompt"]
    return status if prompt is None else status | {"prompt": with_factor(prompt)}


def complete_event(event: Object) -> Object:
    """Return an event whose parameters, if it has some with units, say their factors."""
    if event["kind"] != "trial_start" or not event["data"].get("units"):
        return event
    return event | {"data": _with_factors(event["data"])}


def complete_procedure(view: Object) -> Object:
    """Return what ``procedure`` answers, with the factor of every parameter."""
    return view | {"parameters": [with_factor(item) for item in view["parameters"]]}


def complete_run(view: Object) -> Object:
    """Return what ``run`` answers, with the factors of the parameters of each trial."""
    trials = [_with_factors(item) for item in view["details"].get("trials", [])]
    return view | {"details": view["details"] | {"trials": trials}}


def _with_factors(trial: Object) -> Object:
    units = trial.get("units", {})
    return trial | {"factors": {name: parse_unit(unit).factor for name, unit in units.items()}}
