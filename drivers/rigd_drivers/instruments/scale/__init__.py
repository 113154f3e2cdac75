"""Reads scales on a serial port: MT-SICS, KERN KCP, A&D, Sartorius SBI and Ohaus."""
