"""Scales on a serial port: MT-SICS, KERN KCP and A&D."""
