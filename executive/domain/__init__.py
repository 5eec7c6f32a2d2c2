"""A domain folder read and checked: PDDL, the manifest `domain.toml`, questions and scene. Loading one runs no code."""

from executive.domain.loader import Domain, Subject, list_domains, load_domain, load_subject

__all__ = ["Domain", "Subject", "list_domains", "load_domain", "load_subject"]
