"""Simulated drives in the native layouts of NCLT and MulRan."""
