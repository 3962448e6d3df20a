"""Training schemes, a folder or a file each, and the Lightning module and data that run them."""
