"""Friction coefficients of an omni-wheel at an approach angle: the paper's analysis, and better.

"The paper" is "Omni-wheel friction coefficient measuring methodology for various angles". All
arrays and results are in SI. Three coefficients are told apart everywhere (:class:`Coefficient`).
"""
