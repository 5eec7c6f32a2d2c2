"""From atoms to questions: the domain's templates, a language model that words them, the paper's prompts."""
