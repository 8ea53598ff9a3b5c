"""What recordings of all kinds of cases of the gap share: names and colours of the ways of moving, the finding in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

WAYS = {"measured": "Measured", "nominal": "Model as it was", "explained": "With the explanation"}
COLOURS = {"measured": [90, 100, 112], "nominal": [194, 102, 12], "explained": [31, 111, 139]}


def summary(found: Mapping[str, Any], note: str) -> str:
    """The finding as Markdown.

    Args:
        found: `findings.json`.
        note: What the viewer has to know about the pictures.
    """
    return f"**{str(found['verdict']).replace('_', ' ')}**\n\n{found['sentence']}\n\n{note}\n"
