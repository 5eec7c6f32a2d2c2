"""Works around incompatible native libraries in one process."""

from __future__ import annotations

import ctypes
import os
import sys
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path


@cache
def keep_triton_apart() -> None:
    """Load triton's library, where it is installed (CUDA builds of torch bring it), in such a way that it gets along
    with Mesa's OpenGL driver: before an OpenGL context is made, and before torch or transformers is imported.

    Both contain LLVM, of different versions. Mesa's driver makes its own visible to all that is loaded later, triton's
    library takes what is visible for its own, and `import triton` (which transformers does at some time) ends the
    process. So it is loaded first, when nothing is visible yet. Where somebody else has drawn before, it is told to
    prefer its own. The library alone is loaded, in about 50 ms; nothing of triton is imported.
    """
    if sys.platform != "linux" or "triton" in sys.modules:
        return
    spec = find_spec("triton")
    visible = hasattr(ctypes.CDLL(None), "LLVMContextCreate")
    # Not always: beside another malloc (LD_PRELOAD), what prefers its own frees by one what another has allocated.
    mode = os.RTLD_NOW | os.RTLD_DEEPBIND if visible else os.RTLD_NOW
    for folder in () if spec is None else spec.submodule_search_locations or ():
        with suppress(OSError):  # then `import triton` fails, too, and does not crash
            ctypes.CDLL(str(Path(folder) / "_C" / "libtriton.so"), mode)
