"""The mathematics of the paper, one equation per file, and what is needed to check it."""
