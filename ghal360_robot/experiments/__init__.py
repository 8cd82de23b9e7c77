"""The paper's experiments and ours: training curves, target searches, their tables and figures."""
