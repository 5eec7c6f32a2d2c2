"""Growing an eye: a small vision-language model for one simulated domain, from nothing (`executive train`)."""
