"""Training for domains whose objects change from problem to problem, and are described by attributes (small red metal
cube): labels are over the values of attributes, and not over named items."""
