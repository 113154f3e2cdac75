"""What may be wrong on a rig, as a table: each kind at three sizes, the sizes that labs meet."""

from __future__ import annotations

from typing import Final

from support.lugre.wrong import BACK, Wrong

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
    Wrong(
        "radius rolled along a wrong measuring wheel",
        "guide.gain",
        (1.003, 1.007, 1.015),
        "times",
        same=("stated.wheel_radius",),
    ),
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
    Wrong("shaft winds up", "physics.shaft", (3000.0, 1000.0, 200.0), "N m/rad"),
    Wrong("wheel creeps on its hub", "physics.hub", (0.004, 0.04, 0.2), "rad/s for each N m"),
    Wrong("wheel grows with speed", "physics.swells", (1e-5, 1e-4, 5e-4), "m", ("grows",)),
    Wrong("cable springs", "physics.spring", (0.03, 0.2, 1.0), "N/m", ("position",)),
    Wrong("floor undulates", "physics.undulates", (0.01, 0.05, 0.2), "m/s^2"),
    Wrong("floor has a joint", "physics.joint", (1.0, 5.0, 20.0), "N"),
    Wrong("gear loses more at low load", "physics.load_loss", (0.03, 0.1, 0.3), "share"),
    Wrong("gear's torque ripples", "physics.gear_ripple", (0.003, 0.02, 0.1), "share"),
    Wrong("seal rubs more at rest", "physics.seal", (0.1, 0.5, 2.0), "share"),
    Wrong("no-load torque falls over the trials", "idles", (0.1, 0.3, 0.6), "share"),
    Wrong("guide rubs by place", "physics.guide_wave", (0.1, 0.3, 1.0), "share"),
    Wrong("guide bears weight", "physics.guide_bears", (0.01, 0.05, 0.2), "share"),
    Wrong("load on the wheel swings", "physics.rocks", (0.01, 0.05, 0.2), "share"),
    Wrong("load on the wheel falls with speed", "physics.lifts", (0.005, 0.03, 0.1), "s/m"),
    Wrong("one trial without a weight", "forgotten", (0.01, 0.05, 0.2), "share"),
    Wrong("carriage is knocked", "knocked", (1.0, 5.0, 20.0), "N"),
    Wrong("current flows at rest", "at_rest_a", (0.005, 0.02, 0.08), "A"),
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
    Wrong("dust", "physics.dust", (0.02, 0.1, 0.3), "1/m", ("position", "trial")),
    Wrong("contact aged at rest", "physics.aged", (0.05, 0.2, 0.6), "share"),
    Wrong("friction strengthens with slip", "physics.strengthens", (0.01, 0.05, 0.2), "1"),
    Wrong("bristles of two kinds", "physics.soft", (0.05, 0.2, 0.5), "share"),
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
    Wrong("samples between the steps", "logger.late_s", (2e-4, 5e-4, 8e-4), "s"),
    Wrong("logger's clock slow", "logger.slow", (2e-3, 0.007, 0.02), "1"),
    Wrong("logger averages", "logger.smooth_s", (5e-3, 0.02, 0.1), "s"),
    Wrong("logger interpolates", "logger.coarse_s", (2e-3, 0.01, 0.05), "s"),
    Wrong("rows late in bursts", "logger.burst_s", (1e-3, 5e-3, 0.02), "s"),
    Wrong("rows stand still", "logger.frozen_s", (3e-3, 0.01, 0.05), "s"),
    Wrong("guide clock steps", "guide.step_s", (1e-3, 5e-3, 0.03), "s"),
    Wrong("wheel clock steps", "wheel.step_s", (1e-3, 5e-3, 0.03), "s"),
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
    Wrong("few digits", "logger.digits", (4.0, 3.0, 2.0), "digits"),
    Wrong("guide encoder loses counts when fast", "guide.fast", (5e-4, 3e-3, 0.02), "share"),
    Wrong("measuring wheel gives", "guide_gives", (3e-6, 3e-5, 3e-4), "s^2"),
    Wrong("measuring wheel has play", "guide.play", (5e-5, 2e-4, 1e-3), "m", program=BACK),
    Wrong("wheel encoder out of centre", "wheel.turns", (2e-4, 2e-3, 0.01), "rad"),
    Wrong("accelerometer curved", "accelerometer.square", (3e-3, 0.01, 0.05), "s^2/m"),
    Wrong("accelerometer uneven", "accelerometer.uneven", (0.01, 0.05, 0.2), "share", program=BACK),
    Wrong("current has a deadband", "current.deadband", (0.005, 0.02, 0.08), "A"),
    Wrong("current uneven", "current.uneven", (0.01, 0.03, 0.1), "share", program=BACK),
    Wrong("current shows an alias", "current.alias", (0.005, 0.02, 0.1), "A"),
    Wrong("current in another unit", "current.gain", (0.1, 10.0, 1000.0), "times"),
    Wrong("acceleration in g", "accelerometer.gain", (0.5, 9.81, 1.0 / 9.81), "times"),
    Wrong("angle in degrees", "wheel.gain", (0.5, 2.0, 57.29577951308232), "times"),
    Wrong("current's sign", "current.gain", (-1.01, -0.99, -1.0), "times"),
    Wrong("accelerometer's sign", "accelerometer.gain", (-1.01, -0.99, -1.0), "times"),
    Wrong("wheel encoder's sign", "wheel.gain", (-1.001, -0.999, -1.0), "times"),
    Wrong("columns swapped, or rows sorted", "crossed", (1, 2, 3), ""),
)
#: Two things at once.
PAIRS: Final = (
    Wrong(
        "radius and delay",
        "stated.wheel_radius",
        (1.003, 1.01, 1.05),
        "times",
        also=(("guide.delay_s", 2e-3),),
    ),
    Wrong(
        "slope and drag", "physics.slope", (0.05, 0.2, 0.6), "m/s^2", also=(("physics.drag", 0.3),)
    ),
    Wrong(
        "torque constant and mass",
        "stated.torque_constant",
        (1.02, 1.05, 1.2),
        "times",
        also=(("stated.mass", 1.02),),
    ),
    Wrong(
        "accelerometer's gain and slope",
        "accelerometer.gain",
        (1.03, 1.05, 1.2),
        "times",
        also=(("physics.slope", 0.1),),
    ),
    Wrong(
        "stain and eccentric measuring wheel",
        "physics.stain",
        (0.05, 0.1, 0.3),
        "share",
        also=(("guide_eccentric", 1e-4),),
    ),
    Wrong("wear and warming", "worn", (0.03, 0.1, 0.3), "share", also=(("physics.warming", 0.05),)),
    Wrong(
        "both encoders' scales", "guide.gain", (1.002, 1.01, 1.05), "times", same=("wheel.gain",)
    ),
)
GROUPS: Final = {
    "constants stated": STATED,
    "forces": FORCES,
    "friction": FRICTION,
    "times of sensors": TIMES,
    "readings of sensors": READINGS,
    "two at once": PAIRS,
}
KINDS: Final = tuple(kind for group in GROUPS.values() for kind in group)
SIZES: Final = ("small", "medium", "large")
