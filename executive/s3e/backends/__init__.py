"""What answers questions about pictures: a checkpoint in this process, an OpenAI-compatible server, a shared
process."""
