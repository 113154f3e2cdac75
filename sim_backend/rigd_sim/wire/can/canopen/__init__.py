"""Simulates what a CANopen node has (CiA 301): dictionary, SDO, PDO, heartbeat, emergencies."""
