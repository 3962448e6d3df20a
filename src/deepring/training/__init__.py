"""Training schemes, and the Lightning module and data module that run them."""
