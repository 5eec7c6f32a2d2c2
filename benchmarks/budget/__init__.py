"""What a person waits for, against a budget for each: `python -m benchmarks.budget`."""
