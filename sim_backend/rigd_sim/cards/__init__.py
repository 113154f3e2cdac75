"""Cards of the simulated rigs, register by register, and what is wired to them."""
