"""Formulas that several models need, each once, batched over leading axes."""
