"""Time: the clock of frame budgets, and work in threads."""
