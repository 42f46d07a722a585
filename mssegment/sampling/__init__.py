"""From tracks to hypotheses: elemental subsets, frame pairs, validation, and the strategy."""
