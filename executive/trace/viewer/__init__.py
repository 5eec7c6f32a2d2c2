"""The run in the Rerun viewer: scene, pictures, beliefs, plans and decisions on one timeline."""
