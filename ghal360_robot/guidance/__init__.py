"""Which cue to show: the wedge state, the abstract MDP with its exact plan, and the strategies."""
