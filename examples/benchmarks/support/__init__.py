"""What the benchmarks share: goals, tasks, and costs of a call."""
