"""Plain data as YAML text that :mod:`testbed.documents` reads back as it was."""

from __future__ import annotations

from typing import Any

import yaml

from testbed.documents import plain_scalar


def document_text(data: object, width: int = 110) -> str:
    """Mappings, lists, text, numbers, true, false and null, in the order that they have.

    Args:
        data: What to write.
        width: Longer lines are folded where YAML allows it.
    """
    return yaml.dump(  # type: ignore[no-any-return,unused-ignore]
        data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=width
    )


class _Dumper(yaml.SafeDumper):
    """Puts text in quotes that our reader would take for a number, such as the unique id 12e4."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    try:
        # PyYAML would fold rare line breaks into spaces; escapes in double quotes keep them.
        plain = plain_scalar(text) == text and text.isprintable()
    except ValueError:
        plain = False
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if plain else '"')


_Dumper.add_representer(str, _represent_text)
