"""Makes the report of lateral sweeps: parameters, and speed errors beside the paper's."""
