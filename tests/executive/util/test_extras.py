"""What is not installed is asked for by the extra that brings it."""

from __future__ import annotations

import pytest

from executive.errors import MissingError
from executive.util.extras import needed


def test_a_missing_package_is_asked_for_by_its_extra() -> None:
    assert needed("json", "nothing", "this").__name__ == "json"
    with pytest.raises(MissingError, match="extra 'mcap'") as missing:
        needed("no_such_package", "mcap", "to write MCAP")
    assert missing.value.command.endswith("pip install 'executive[mcap]'")
