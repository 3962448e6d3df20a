"""The mathematics of the paper, one idea a file; torch, numpy, scipy and numba only."""
