"""Results as tables, figures, TensorBoard events and pages."""
