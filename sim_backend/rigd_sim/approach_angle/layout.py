"""Lists the inputs and outputs of the approach-angle plant; imports no physics."""

from __future__ import annotations

from typing import Final

#: Steps of the integrator per second: two for each sample at 9600 Hz.
STEPS_PER_S: Final = 19_200

#: Voltages on the way to the card, before noise and conversion: four inputs, and the load cell.
SIGNALS: Final = ("gauge_a", "gauge_b", "wheel_angle", "platform_position", "normal_force")

#: (name, unit, what it is): the hidden state that verification compares with.
TRUTH: Final = (
    ("platform_position", "m", "travel of the platform since its start"),
    ("platform_speed", "m/s", "speed of the platform, V"),
    ("wheel_angle", "rad", "angle of the wheel since its start"),
    ("wheel_speed", "rad/s", "angular speed of the wheel, w"),
    ("rolling_force", "N", "force of the wheel on the platform in rolling direction, F_r"),
    ("normal_force", "N", "normal force of the contact, N"),
    ("torque", "N m", "torque of the shaft at the gauges, T"),
    ("sliding_speed", "m/s", "R_eff w - V cos(alpha), v_r"),
    ("friction_limit", "1", "largest F_r/N at this sliding speed"),
)
#: A row of the history, one per step.
HISTORY: Final = (*(f"{name}_v" for name in SIGNALS), *(name for name, _, _ in TRUTH))
FIRST_TRUTH: Final = len(SIGNALS)
#: Rows that the history holds: 6.8 s.
HISTORY_ROWS: Final = 1 << 17

#: What a healthy card keeps of a block is bounded: the exponential part of a block's latency ends
#: at so many times its mean. One block in 22,000 reaches it; without an end, a campaign of 100,000
#: blocks would hold one that no card gives, and every other campaign would end by it.
LATEST_JITTER: Final = 10.0

#: The five sets: name -> (approach angle in deg, wheel).
SETS: Final = {
    "clean_0": (0, "clean"),
    "clean_15": (15, "clean"),
    "clean_30": (30, "clean"),
    "clean_45": (45, "clean"),
    "coated_0": (0, "coated"),
}
WHEELS: Final = ("clean", "coated")
#: Approach angles at which the bearings can be mounted, in deg.
MOUNTED_DEG: Final = (0.0, 15.0, 30.0, 45.0)

#: What can be wrong with a run: name -> what it does.
FAULTS: Final = {
    "none": "nothing",
    "gauges_swapped": "the leads of the two gauges are exchanged",
    "platform_pot_dead": "the thread has come off: the potentiometer stays where it was",
    "wheel_pot_dead": "its coupling is loose: the potentiometer stays where it was",
    "wheel_pot_at_end": "turned back a turn beyond its end: it shows 0 V until it has come back",
    "scale_unsteady": "something shakes the scale: its reading never comes to rest",
    "no_sliding": "rubber under the wheel: it never slides",
}

#: The scale's status word.
STABLE: Final = 1
OVERLOAD: Final = 2
UNDERLOAD: Final = 4  # a real scale has it; this one cannot be lifted
