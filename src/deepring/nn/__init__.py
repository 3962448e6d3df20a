"""Layers and networks, most of them equivariant to shifts of θ."""
