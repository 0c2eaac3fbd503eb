"""Which set of effects is missing: one search over sets, judged by what they predict of motion that was not fitted."""
