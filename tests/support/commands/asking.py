"""A procedure on the simulated rig that asks a question, then turns the wheel in two trials."""

from __future__ import annotations

ASKING = """\
procedure: asking
title: Asks, then turns the wheel
doc: For tests.
parameters:
  current: {doc: Amplitude, unit: A, default: 0.3 A, min: 0 A, max: 1.5 A}
  time: {doc: How long, unit: s, default: 0.5 s, max: 7200 s}
repeats: 2
prepare:
  - prompt: weigh
    text: What does the scale show?
    unit: kg
    min: 1 kg
    max: 6 kg
    answer: 3.9 kg
trial:
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: "${current}", frequency: 2 Hz}}}
      for: ${time}
finish:
  - step: hold
    set: {wheel_servo.current: 0 A}
    for: 0.2 s
"""
