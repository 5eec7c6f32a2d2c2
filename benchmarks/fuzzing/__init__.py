"""Whatever comes from outside, read as it must not be: targets, inputs for them, and what is watched meanwhile.

readers.py   the parsers of what people write and what servers send, and how each is given an input
kept.py      likewise those of what Executive itself has written
targets.py   all of them, with files that it reads and words that mean something to it
inputs.py    such files, changed at random (hypothesis)
watch.py     no hang, no traceback, no write outside the scratch folder, nothing started and nobody called
guided.py    the same targets under atheris, which looks for inputs that reach new lines
"""
