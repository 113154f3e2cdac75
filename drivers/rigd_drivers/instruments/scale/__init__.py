"""Reads scales on a serial port, with the protocols MT-SICS, KERN KCP and A&D."""
