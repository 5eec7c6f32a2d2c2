"""What the replies of a chat server mean: those that can be used, and what each kind of refusal says to do."""

from __future__ import annotations

from typing import Any

from executive.util.files import parse_json

KEY, OPENAI_KEY = "EXECUTIVE_API_KEY", "OPENAI_API_KEY"
"""Where the API key is looked up, in this order. The second one is meant for somebody else's server, so that it is
sent over an encrypted connection or to this machine alone."""

TOLD = 200
"""Characters of a server's own error message that are passed on."""
_HEARD = 4_000
"""Characters of it that are searched for what the server does not take."""
_BUSY = frozenset({408, 425, 429})


class ReplyError(Exception):
    """A reply that cannot be used. Raised by whatever reads replies; `again` says that another try may help, `words`
    are the server's own, where it refused the request as it was."""

    def __init__(
        self,
        reason: str,
        *,
        again: bool = True,
        gone: bool = False,
        after: float = 0.0,
        status: int = 200,
        words: str | None = None,
    ) -> None:
        super().__init__(reason)
        self.reason, self.again, self.gone, self.after, self.status = reason, again, gone, after, status
        self.words = words


def decoded(data: bytes) -> Any:
    """What a reply holds.

    Raises:
        ReplyError: it is no JSON, or cut off.
    """
    try:
        return parse_json(data)
    except ValueError:
        raise ReplyError("the reply is not complete JSON") from None


def elsewhere(status: int, location: str, path: str) -> ReplyError:
    """What to do about a server that sends everybody to another address. It is not followed by itself: it would be told
    the key."""
    to = location[:TOLD].split("?")[0].removesuffix(f"/{path}")
    hint = f"; pass that address with --server: {to}" if to else ""
    return ReplyError(f"the server sends requests elsewhere (status {status}){hint}", again=False, status=status)


def refusal(status: int, after: str, data: bytes) -> ReplyError:
    """What a status other than 200 means. The server's own words are passed on as far as there are any."""
    words = _words(data)
    told = f": {words[:TOLD]}" if words else ""
    if status in (401, 403):
        # A model that may not be asked for probabilities is refused like somebody who may not ask at all.
        hint = "" if "logprob" in words else f"; give its API key as {KEY}"
        return ReplyError(f"the server refuses access ({status}{told}){hint}", again=False, status=status)
    again = status >= 500 or status in _BUSY
    try:
        pause = min(60.0, max(0.0, float(after)))
    except ValueError:  # a date; the usual pause does
        pause = 0.0
    return ReplyError(
        f"the server answers with status {status}{told}",
        again=again,
        after=pause,
        status=status,
        words=None if status in _BUSY or status == 404 else words[:_HEARD],
    )


def _words(data: bytes) -> str:
    """What a server says of what it refuses: in one of the places where such servers say it."""
    try:
        reply = parse_json(data)
    except ValueError:
        return ""
    reply = reply[0] if isinstance(reply, list) and reply else reply  # Google's
    error = reply.get("error") or reply if isinstance(reply, dict) else reply
    if not isinstance(error, dict):
        return str(error) if isinstance(error, str) else ""
    said = error.get("message") or error.get("detail") or ""
    if isinstance(said, list):  # FastAPI's, with where in the request
        said = "; ".join(f"{each.get('loc')}: {each.get('msg')}" for each in said if isinstance(each, dict))
    passed_on = error.get("metadata")  # OpenRouter's: what the server behind it said
    more = [error.get("param"), passed_on.get("raw") if isinstance(passed_on, dict) else None]
    return " ".join(str(each) for each in (said, *more) if each and (each is said or str(each) not in str(said)))


def model_names(reply: Any) -> tuple[str, ...]:
    """The names in a server's list of models.

    Raises:
        ReplyError: it is no such list.
    """
    try:
        names = [entry["id"] for entry in (() if reply["data"] is None else reply["data"])]  # null is Ollama's for none
    except (LookupError, TypeError):
        names = [None]
    if not all(isinstance(name, str) and name.isprintable() for name in names):
        raise ReplyError("what answers there is no OpenAI-compatible server: it lists no models", again=False)
    return tuple(names)
