"""Networks that keep the circular symmetry of θ."""
