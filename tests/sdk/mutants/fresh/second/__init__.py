"""The mistakes of a second author, who had read neither the suites nor the first mutants."""
