"""The paper's Tables I to IV and its case study, from finished runs."""
