"""The run in the Rerun viewer: scene, pictures, beliefs, plans and decisions on one timeline."""

from executive import former_names


def __getattr__(name: str) -> object:
    if name == "RerunSink":
        from executive.trace.viewer.sink import RerunSink

        return former_names.renamed(__name__, name, "executive.RerunSink", RerunSink)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
