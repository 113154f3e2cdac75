"""Finds errors that all runs of a campaign share, which no single run can show.

A gain that is wrong, a missed tare, a light rubbing in every run: each run looks good, and the
maximum is wrong by up to twice its interval. Many runs together show such an error:

- :mod:`.balance`: the signed residual of the force balance, over force, load and angle;
- :mod:`.load`: what the scale shows against the announced loads;
- :mod:`.share`: the part of the torque that each gauge shows, and the turns of the shaft's bending;
- :mod:`.travel`: how F_r/N changes along the travel, beside its change with the sliding speed.

What is found is named with its size, and the interval of each maximum is widened by its effect.
Nothing is corrected: that one error explains the data best does not make it the true one.
"""
