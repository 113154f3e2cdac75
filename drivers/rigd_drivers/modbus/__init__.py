"""Operates Modbus devices over TCP and RTU: a load-cell transmitter and a speed servo.

The modules, from the lowest level to the highest:

* ``pdu`` encodes requests and checks their answers;
* ``framing`` makes TCP and RTU frames;
* ``exchange`` sends one request at a time, and refuses and counts every other reply;
* ``transport`` connects to a socket or a serial port;
* ``client`` combines exchange and transport, waiting or not.

``pdu``, ``framing`` and ``exchange`` do no I/O. ``registers`` and ``servo_map`` define how a map of
a device states which value is at which address; the maps are files of ``rigd_drivers/maps``.
"""
