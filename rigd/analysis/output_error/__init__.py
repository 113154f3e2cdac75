"""Output error: residuals whitened by the noise of input and sensors, diagnosis, gate."""
