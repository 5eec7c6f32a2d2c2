"""From depth pictures to poses: what the robot finds out by itself about where things are.

models.py        shapes that are known: distance fields, surface samples, symmetries
clouds.py        points in space of what is neither furniture nor robot, and the clusters that they form
registration.py  poses of a shape from points, many starts at once
evidence.py      what a pose would have the cameras see, against what they saw
tracks.py        which of several identical things is which, and how certain that is
assignment.py    all ways to assign one set of things to another, weighed
estimated_scene.py  scenes for relations, drawn by what is estimated
hiding.py        what may hide an item that is seen nowhere
marks.py         tags in pictures for what looks the same
localizer.py     all of it together, over time: what is seen, remembered, held, missing or unknown
"""

from executive.perception.estimated_scene import EstimatedScenes
from executive.perception.localizer import Capture, Known, Localizer
from executive.perception.models import ItemModel

__all__ = ["Capture", "EstimatedScenes", "ItemModel", "Known", "Localizer"]
