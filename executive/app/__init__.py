"""From a configuration to a finished run: the parts are chosen, put together and handed to the loop."""
