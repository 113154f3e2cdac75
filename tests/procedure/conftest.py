"""The simulated rig, and a small procedure on it to be spoilt."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigd.config.loader import load_rig
from rigd.config.rig import RigConfig
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.procedure.program import CompiledProcedure

SMALL = """\
procedure: small
title: A small procedure
doc: For tests.

parameters:
  floor: {doc: Floor, choices: [stone, pvc], default: stone}
  current: {doc: Motor current, unit: A, min: 0 A, max: 1.5 A}
  speed: {doc: Belt speed, unit: mm/s, default: 100 mm/s, max: 1 m/s}

tables:
  rolling:
    by: floor
    values: {stone: 0.009, pvc: 0.022}

sweep:
  grid:
    current: {from: 0.5 A, to: 1.5 A, step: 0.5 A}

prepare:
  - prompt: floor_prompt
    text: Lay ${floor} and go at ${speed}.
    choices: ["${floor}"]
    answer: ${floor}
    changes: floor

trial:
  limits:
    carriage.position: {low: -30 mm, high: 1.5 m}
  steps:
    - step: drive
      set:
        wheel_servo.current: ${current}
        longitudinal_belt.engaged: 0
      until: carriage.position > 1 m
      timeout: 4 s
      on_timeout: next
  after:
    - step: back
      set: {longitudinal_belt.speed: "-${speed}"}
      until:
        - carriage.position < 2 mm and |longitudinal_belt.speed| < 3 mm/s for 0.2 s
      timeout: 9 s

finish:
  - step: hold
    set: {wheel_servo.current: 0 A}
    for: 0.1 s

record: {wheel_servo: 1, truth: 10}

identify:
  model: lugre
  signals: {wheel_angle: wheel_encoder.angle}
  constants: {mass: "${rig.moving_mass}", rolling_resistance: "${rolling}"}
  group_by: floor
"""

Compile = Callable[..., CompiledProcedure]


@pytest.fixture(scope="session")
def rig() -> RigConfig:
    return load_rig("lugre-1")


@pytest.fixture
def small() -> str:
    return SMALL


@pytest.fixture
def compile_text(rig: RigConfig) -> Compile:
    def compile_it(text: str, **overrides: str) -> CompiledProcedure:
        return compile_procedure(parse_procedure(text, Path("p.yaml")), rig, overrides)

    return compile_it
