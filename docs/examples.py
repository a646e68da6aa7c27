"""Show doctests in docstrings as code; Markdown would read `>>>` as a quotation."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

_BLOCK = re.compile(r"^( *)>>> .*(?:\n *\S.*)*", re.MULTILINE)


class Examples(Extension):
    """Put fences around every block from `>>>` to the next empty line."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Change the docstring of one object, see `griffe.Extension.on_object`."""
        if obj.docstring is not None:
            obj.docstring.value = _BLOCK.sub(r"\1```pycon\n\g<0>\n\1```", obj.docstring.value)
