"""The parts of benchmarks.monitor.

courses.py     looks at states in turn: made up, or those of a collection; and made-up estimators
looks.py       what a monitor makes of such looks, and how well conformal prediction keeps its promise
spoiling.py    the estimator on pictures that are made bad, until it is right about the whole state half of the time
configurations.py  estimators and monitors of the closed loop, as a campaign
figures.py     what episodes come to, and what was to be reached
"""
