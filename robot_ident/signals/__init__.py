"""What is done to sampled signals: Fourier lines, filters, derivatives."""
