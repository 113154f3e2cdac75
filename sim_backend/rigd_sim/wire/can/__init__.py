"""CAN devices at the wire: a bus between processes, and CANopen nodes on it."""
