"""Makes the tables of a report as data: parameters, models, starts, uncertainty."""
