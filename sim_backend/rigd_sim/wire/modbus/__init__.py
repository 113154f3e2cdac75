"""Simulates Modbus devices: servers on TCP, and on a serial line with realistic timing.

``frames`` and ``bank`` implement the protocol, ``line`` connects it to TCP or a serial line, and
``part`` simulates faults in it. ``transmitter`` and ``servo`` are the devices.
"""

from rigd_sim.wire.modbus.line import SerialLine, TcpLine
from rigd_sim.wire.modbus.servo import SimModbusServo
from rigd_sim.wire.modbus.transmitter import SimModbusTransmitter

__all__ = ["SerialLine", "SimModbusServo", "SimModbusTransmitter", "TcpLine"]
