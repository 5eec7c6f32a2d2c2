"""The parts of `python -m benchmarks.viplan`.

recorded.py     recorded answers of models, and the tasks that they are about
decoding.py     whole states from the answers of a first look
household.py    calibration, and what visibility and memory are worth
loop.py         the closed loop in a symbolic world whose answers are drawn from recorded ones
"""
