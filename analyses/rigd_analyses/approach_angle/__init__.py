"""Computes the friction coefficients of an omni-wheel at an approach angle, by two methods.

One is the method of the paper "Omni-wheel friction coefficient measuring methodology for various
angles"; the other corrects it. All arrays and results are in SI. There are three coefficients;
every result names the one that it is (:class:`Coefficient`).
"""
