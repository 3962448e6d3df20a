"""Simulated drives, written in the native NCLT and MulRan layouts."""
