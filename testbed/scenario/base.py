"""What all parts of a scenario share: the frozen base class, and fields with units."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import ConfigDict, Field

from testbed.frozen import Frozen

LARGEST_SEED = 2**32 - 1
STEP_TOLERANCE = 1e-3  # so that 0.01667 and 0.004167 written by hand still are 4 to 1


class Spec(Frozen):
    """A part of a scenario; what its fields are by default is checked like what a file says."""

    model_config = ConfigDict(validate_default=True)


def unit_field(default: Any, unit: str, **constraints: Any) -> Any:
    """A field whose unit the error messages tell."""
    return Field(default, json_schema_extra={"unit": unit} if unit else None, **constraints)


Metres = Annotated[float, Field(ge=-100, le=100, json_schema_extra={"unit": "m"})]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=80)]
