"""A plant that is a co-simulation unit (FMU) of FMI 2 or 3, made by any tool."""
