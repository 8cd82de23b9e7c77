"""Measurements of the running robot against its budgets: how fast it stops, what a control tick costs."""
