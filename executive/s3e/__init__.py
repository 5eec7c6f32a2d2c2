"""S3E: from a PDDL domain and camera pictures to a probability for every atom (the paper's Sections 4 and 5)."""
