"""Executive used as a library: short programs that the tests run, and that README and docs quote."""
