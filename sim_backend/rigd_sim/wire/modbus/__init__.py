"""Modbus devices at the wire: servers on TCP and on a paced serial line.

``frames`` and ``bank`` know the protocol, ``line`` serves it, ``part`` shows faults in it;
``transmitter`` and ``servo`` are the devices.
"""

from rigd_sim.wire.modbus.line import SerialLine, TcpLine
from rigd_sim.wire.modbus.servo import SimModbusServo
from rigd_sim.wire.modbus.transmitter import SimModbusTransmitter

__all__ = ["SerialLine", "SimModbusServo", "SimModbusTransmitter", "TcpLine"]
