"""What may be wrong on a rig, as a table: each kind at three sizes, the sizes that labs meet."""

from __future__ import annotations

from typing import Final

from support.lugre_wrong import BACK, Wrong

#: What the rig file states, as a factor of what is true.
STATED: Final = (
    Wrong("wheel radius stated", "stated.wheel_radius", (1.002, 1.01, 2.0), "times", ("radius",)),
    Wrong("mass stated", "stated.mass", (1.01, 1.1, 2.0), "times", ("mass",)),
    Wrong("torque constant stated", "stated.torque_constant", (1.03, 1.1, 1.5), "times"),
    Wrong("gear efficiency stated", "stated.gear_efficiency", (1.05, 1.1, 1.23), "times"),
    Wrong("gear ratio stated", "stated.gear_ratio", (1.02, 1.1, 2.0), "times"),
    Wrong("no-load torque stated", "stated.no_load_torque", (1.2, 2.0, 0.0), "times"),
    Wrong("wheel inertia stated", "stated.wheel_inertia", (1.05, 1.3, 3.0), "times"),
    Wrong("guide friction stated", "stated.guide_friction", (1.1, 1.5, 0.0), "times"),
    Wrong("rolling resistance stated", "stated.rolling_resistance", (0.8, 0.5, 0.0), "times"),
    Wrong("roller transitions stated", "stated.roller_transitions", (17 / 18, 0.5, 2.0), "times"),
)
#: Forces that the model does not have, or takes for small.
FORCES: Final = (
    Wrong("floor slopes", "physics.slope", (0.03, 0.2, 1.0), "m/s^2", ("slope",)),
    Wrong("cable drags, viscous", "physics.drag", (0.05, 0.2, 1.0), "N s/m", ("drag",)),
    Wrong("cable drags, dry", "physics.cable", (0.03, 0.1, 0.5), "N"),
    Wrong("drag by speed squared", "physics.square_drag", (0.05, 0.2, 1.0), "N s^2/m^2"),
    Wrong("rolling resistance by speed", "physics.rolling_by_speed", (1e-3, 5e-3, 0.02), "s/m"),
    Wrong("guide sticks", "physics.guide_stiction", (0.5, 2.0, 8.0), "share"),
    Wrong("drive wheel eccentric", "physics.eccentric", (2e-5, 1e-4, 5e-4), "m", ("wheel",)),
    Wrong(
        "gear loses less when driven back",
        "physics.efficiency_back",
        (0.05, 0.2, 0.42),
        "1",
        program=BACK,
    ),
    Wrong("motor fades", "physics.motor_fades", (0.01, 0.05, 0.2), "1/s"),
    Wrong("motor fades over the trials", "fades", (0.01, 0.03, 0.1), "share"),
    Wrong("wheel wears over the trials", "shrinks", (1e-4, 1e-3, 0.01), "share"),
    Wrong("motor cogs", "physics.cogging", (2e-4, 1e-3, 5e-3), "N m"),
    Wrong("vibration", "physics.ripple", (0.6, 0.9, 3.0), "1/s"),
    Wrong("vibration of another order", "physics.ripple_7", (0.05, 0.2, 1.0), "1/s"),
    Wrong("accelerometer shakes", "shake", (0.3, 0.45, 1.5), "1/s"),
    Wrong("gear has backlash", "physics.backlash", (0.001, 0.009, 0.035), "rad", program=BACK),
    Wrong("carriage springs", "physics.sprung_hz", (60.0, 30.0, 12.0), "Hz"),
    Wrong("carriage rolls at first", "physics.first_speed", (0.06, 0.12, 0.3), "m/s"),
)
#: Friction that is another one.
FRICTION: Final = (
    Wrong("Stribeck exponent", "physics.exponent", (0.7, 1.0, 2.0), "1"),
    Wrong("bristles roll out", "physics.relaxation", (0.3, 2.0, 10.0), "1/m"),
    Wrong("Dahl's exponent", "physics.dahl", (1.2, 1.6, 2.5), "1"),
    Wrong("no bristle", "physics.rigid", (0.01, 3e-3, 1e-3), "m/s"),
    Wrong(
        "friction depends on direction", "physics.backward", (0.02, 0.1, 0.3), "share", program=BACK
    ),
    Wrong("stain", "physics.stain", (0.03, 0.1, 0.4), "share"),
    Wrong("friction warms", "physics.warming", (0.02, 0.1, 0.3), "share"),
    Wrong("friction by wheel angle", "physics.by_angle", (0.02, 0.1, 0.3), "share"),
    Wrong("floor wears", "worn", (0.02, 0.1, 0.3), "share", ("trial",)),
    Wrong("contact softens", "softened", (0.03, 0.1, 0.3), "share", ("trial",)),
    Wrong("mass changes", "loaded", (0.01, 0.05, 0.2), "share"),
    Wrong("trials on another floor", "swapped", (1, 2, 4), "trials"),
    Wrong("two floors", "edge_share", (0.03, 0.15, 1.0), "share"),
)
#: Sensors that sample late, or not at their stated time.
TIMES: Final = (
    Wrong("wheel encoder late", "wheel.delay_s", (3e-4, 1e-3, 5e-3), "s", ("delay",)),
    Wrong("guide encoder late", "guide.delay_s", (3e-4, 3e-3, 8e-3), "s", ("delay",)),
    Wrong("accelerometer late", "accelerometer.delay_s", (1e-3, 5e-3, 0.02), "s"),
    Wrong("current late", "current.delay_s", (5e-4, 3e-3, 0.01), "s"),
    Wrong("guide clock drifts", "guide.drift", (1e-4, 1e-3, 0.01), "1"),
    Wrong("wheel clock drifts", "wheel.drift", (1e-4, 1e-3, 0.01), "1"),
    Wrong("guide encoder jitters", "guide.jitter_s", (3e-5, 2e-4, 1e-3), "s"),
    Wrong("wheel encoder repeats samples", "wheel.repeats", (0.005, 0.05, 0.3), "share"),
    Wrong("accelerometer behind a filter", "accelerometer.lowpass_hz", (100.0, 30.0, 8.0), "Hz"),
    Wrong("current behind a filter", "current.lowpass_hz", (300.0, 100.0, 30.0), "Hz"),
    Wrong(
        "amplifier slow, monitor shows the command",
        "physics.loop_hz",
        (300.0, 80.0, 25.0),
        "Hz",
        also=(("wanted", 1.0),),
    ),
    Wrong("brake acts before it is recorded", "held_late_s", (0.01, 0.05, 0.1), "s"),
    Wrong("samples cut out", "cut_s", (0.003, 0.03, 0.2), "s"),
)
#: Sensors that show something else.
READINGS: Final = (
    Wrong("guide encoder's scale", "guide.gain", (1.002, 1.01, 1.05), "times"),
    Wrong("wheel encoder's scale", "wheel.gain", (1.002, 1.01, 1.05), "times"),
    Wrong("measuring wheel eccentric", "guide_eccentric", (2e-5, 1e-4, 5e-4), "m"),
    Wrong("measuring wheel slips", "guide_slips", (1e-4, 1e-3, 5e-3), "s^2/m"),
    Wrong("guide encoder misses lines", "guide.lines", (2, 8, 32), "counts"),
    Wrong("guide encoder turned round", "turned", (1, 3, 6), "trials"),
    Wrong("wheel encoder loses counts", "wheel.lost", (1e-4, 1e-3, 0.01), "share"),
    Wrong("guide encoder jumps", "guide.jump", (1e-4, 1e-3, 0.01), "m"),
    Wrong("accelerometer's gain", "accelerometer.gain", (1.01, 1.03, 1.15), "times", ("gain",)),
    Wrong("accelerometer's zero drifts", "accelerometer.fading", (0.02, 0.1, 0.5), "m/s^3"),
    Wrong("accelerometer tilted", "tilt", (0.1, 0.25, 0.5), "rad", ("gain",)),
    Wrong("accelerometer's mount rings", "accelerometer.ring_hz", (300.0, 120.0, 40.0), "Hz"),
    Wrong("accelerometer clips", "accelerometer.clip", (2.5, 1.8, 1.0), "m/s^2"),
    Wrong("accelerometer noisy", "accelerometer.noise", (0.06, 0.15, 0.6), "m/s^2"),
    Wrong("current's gain", "current.gain", (1.01, 1.03, 1.15), "times"),
    Wrong("current's zero drifts", "current.fading", (0.003, 0.02, 0.1), "A/s"),
    Wrong("current coarse", "current.count", (0.01, 0.05, 0.15), "A"),
    Wrong("current's gain falls above 0.8 A", "current.bend", (0.02, 0.1, 0.4), "share"),
    Wrong("current clips", "current.clip", (1.45, 1.2, 0.8), "A"),
    Wrong("current hums", "current.hum", (0.01, 0.05, 0.2), "A"),
    Wrong("current noisy", "current.noise", (0.012, 0.03, 0.12), "A"),
)
GROUPS: Final = {
    "constants stated": STATED,
    "forces": FORCES,
    "friction": FRICTION,
    "times of sensors": TIMES,
    "readings of sensors": READINGS,
}
KINDS: Final = tuple(kind for group in GROUPS.values() for kind in group)
SIZES: Final = ("small", "medium", "large")
