"""Ways to damage and to forge files. All randomness comes from the `Random` that they are given."""
