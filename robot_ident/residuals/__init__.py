"""What a model leaves over: where, along which variable, at which frequency, and since when; without a verdict."""
