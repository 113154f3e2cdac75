"""Gives each trial of a simulated rig its own random numbers, whichever process plays it."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence

from rigd.procedure.program import TrialPlan

#: Bits of the seed of a trial. Plants add numbers from 2**40 on for series of different purposes.
SEED_BITS = 40


def trial_seeds(
    seed: int, rig: str, procedure: str, trials: Sequence[TrialPlan]
) -> Mapping[int, int]:
    """Return the seed of each trial, by its number.

    It is of the seed, rig and procedure of the run, and of parameters and repeat of the trial: a
    part of a sweep that is recorded apart draws what it draws within the whole, and two parts share
    nothing. Trials that are alike in all of this are told apart by their order as written.
    """
    seen: Counter[str] = Counter()
    seeds = {}
    for trial in sorted(trials, key=lambda item: item.number):
        parameters = sorted(trial.parameters.items())
        key = json.dumps([seed, rig, procedure, parameters, trial.repeat])
        word = hashlib.blake2b(f"{key} {seen[key]}".encode(), digest_size=8).digest()
        seeds[trial.number] = int.from_bytes(word, "big") >> (64 - SEED_BITS)
        seen[key] += 1
    return seeds
