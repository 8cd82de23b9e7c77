"""The safety chain between what is wanted and what the base is told: pure steps that give their reasons."""
