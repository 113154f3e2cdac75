"""Evaluates one run by the corrected method, which corrects what the paper's method leaves out.

It measures friction only while the wheel slips, and subtracts every known drag.
"""
