"""Mistakes that users make in rig files.

What stands behind ``§`` is the right place; without one it is where the change begins.
"""

from __future__ import annotations

from pathlib import Path

from rigd.sdk.shipped_files import shipped_folder

#: Change of a shipped rig file, by its name: text that stands there, and what a user writes.
MISTAKES = [
    # typing errors
    ("wire_lugre", "    driver: cia402-current", "    driver: cia402-curent"),
    ("wire_lugre", "rate: 50 Hz", "rates: 50 Hz"),
    ("wire_lugre", "cycle: 1 kHz", "cycle: 1 kHzz"),
    ("wire_lugre", "link: encoder_bus\n", "link: encoder_buss\n"),
    ("wire_lugre", "    high: 1.65 m\n", "    hihg: 1.65 m\n"),
    ("wire_lugre", "    source: wheel_encoder.angle", "    source: wheel_encoder.angel"),
    ("wire_lugre", "dialect: mt-sics", "dialect: mtsics"),
    ("wire_lugre", "kind: linear", "kind: lineal"),
    ("labjack_lugre", "product: T7", "product: T9"),
    ("wire_lugre", "map: laumas-tlb4", "map: laumas-tlb5"),
    # units
    ("wire_lugre", "current_range: 2 A", "current_range: 2 V"),
    ("wire_lugre", "watchdog: 100 ms # five", "watchdog: 100 # five"),
    ("wire_lugre", "scale: 9.8039215686 m/s^2/V", "scale: 9.8039215686 m/s/V"),
    ("wire_lugre", "scale: 0.01 N/count", "scale: 0.01 kg/count"),
    ("wire_lugre", "    low: -20 mm\n", "    low: -20 s\n"),
    ("wire_lines", "unit: degC, doc", "unit: deg C, doc"),
    ("wire_oven", "within: 0.01 K", "within: 0.01 N"),
    # ranges
    ("wire_lugre", "low: -1.6 A, high: 1.6 A", "low: 1.6 A, high: -1.6 A"),
    ("wire_lugre", "      low: -200 N\n      high: 200 N", "      §low: 200 N\n      high: -200 N"),
    ("wire_lugre", "    low: -1.8 A\n    high: 1.8 A", "    §low: 1.8 A\n    high: -1.8 A"),
    ("wire_lugre", "low: -1.6 A, high: 1.6 A", "low: -1.6 A, high: 3 A"),
    ("ni_lugre", "speed_range: 2.5 m/s", "speed_range: 25 m/s"),
    ("wire_oven", "high: 100 degC, rate", "high: 300 degC, rate"),
    # addresses: nodes, terminals, lines, ports
    ("wire_lugre", "node: 2 #", "node: 1 #"),
    ("wire_lugre", "node: 12 #", "node: 200 #"),
    ("wire_approach_angle", "name: platform_position\n          channel: ai3",
     "name: platform_position\n          §channel: ai0"),
    ("wire_approach_angle", "channel: ai3", "§channel: ai2"),
    ("wire_approach_angle", "name: gauge_b, channel", "name: gauge_a, channel"),
    ("wire_approach_angle", "line: port0/line1", "line: port0/line0"),
    ("wire_approach_angle", "feedback: port0/line2", "feedback: port0/line1"),
    ("ni_lugre", "watchdog: {output: 7, input: 7", "watchdog: {output: 12, input: 7"),
    ("ni_lugre", "enable_output: 3", "enable_output: 1"),
    ("ni_lugre", "      encoder: 3", "      encoder: 9"),
    ("ni_lugre", "input: 1\n          unit", "input: 0\n          unit"),
    ("labjack_lugre", "outputs: [8, 9, 10, 15]", "outputs: [8, 9, 10, 15, 15]"),
    ("labjack_lugre", "watchdog: {output: 15, input: 19", "watchdog: {output: 15, input: 18"),
    ("labjack_lugre", "analog_outputs: [TDAC4, TDAC5]", "analog_outputs: [TDAC4, TDAC4]"),
    ("wire_lines", "port: /tmp/rigd-wire-lines/climate", "port: tcp://192.168.1.5"),
    # times
    ("wire_lugre", "watchdog: 100 ms # five", "watchdog: 10 ms # five"),
    ("wire_lugre", "cycle: 1 kHz", "cycle: 1.5 Hz"),
    ("wire_approach_angle", "median: 5", "median: 999"),
    ("wire_oven", "period: 200 ms", "period: 200 hours"),
    # what belongs together
    ("wire_lugre", "      kind: linear\n", "      kind: linear\n      §gear_ratio: 20.25\n"),
    ("wire_lugre", "      host: 127.0.0.1 #", "      baud: 9600\n      host: 127.0.0.1 #"),
    ("ni_lugre", "quantity: angle\n", "quantity: angle\n      §distance_per_count: 10 um/count\n"),
    ("wire_oven", "safe: '0', ready: '1'", "safe: '1', ready: '1'"),
    ("wire_lines", "separator: ';'", "pattern: '(?P<temperature>x)'\n      separator: ';'"),
    # interlocks, text
    ("wire_lugre", "    follows: wheel_servo.current", "    follows: wheel_servo.torque"),
    ("wire_lugre", "      node: 12 #", "\t  node: 12 #"),
    ("wire_lugre", "      node: 12 #", "       node: 12 #"),
]  # fmt: skip
#: Of which the next line is named: which of the two is indented wrongly is not known.
NEXT_LINE = [MISTAKES[-1]]


def spoilt(name: str, old: str, new: str) -> tuple[str, Path, int]:
    """Return the wrong text, its path, and the line of the mistake."""
    path = shipped_folder("configs") / f"{name}.yaml"
    text = path.read_text()
    assert old in text, f"{old!r} is not in {path.name}"
    at = text.index(old)
    mark = new.find("§")
    if mark < 0:
        mark = len(new) - len(new.lstrip())
    line = text.count("\n", 0, at) + new.count("\n", 0, mark) + 1
    return text.replace(old, new.replace("§", ""), 1), path, line
