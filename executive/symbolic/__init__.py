"""The symbolic world: a planning task that plays itself, without a simulator. Actions have the effects that the domain
gives them, or none; other agents change what they can; answers are right as often as they claim to be."""

from executive.symbolic.world import SymbolicSkill, SymbolicWorld

__all__ = ["SymbolicSkill", "SymbolicWorld"]
