"""Simulates instruments on a serial port: scales, supplies, ovens, and what sends lines."""
