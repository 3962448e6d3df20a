"""Lightning: the module, its loss and its callbacks."""
